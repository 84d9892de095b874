#!/usr/bin/env python3
"""Writes what a staged Debian package is made of, as SPDX 2.3: its files, the Debian packages whose libraries its
binaries link, and those that were compiled into them (headers and archives that the build read).

    packaging/debian/sbom.py STAGED --package teletact-service --version 0.1.0 --architecture amd64 --build build/package

cmake/sbom.cmake calls it for each package before it is closed. Takes dpkg-dev, binutils and ninja.
"""
import argparse, datetime, hashlib, json, os, re, subprocess, sys, time, urllib.parse
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[2]
# What Debian names otherwise than SPDX, and what both name alike; any other licence is NOASSERTION.
LICENCES = {"expat": "MIT", "libpng": "libpng-2.0", "mpl-2": "MPL-2.0", "bsd-3-clause~google": "BSD-3-Clause"}
LICENCES |= {name.lower(): name for name in
             ("Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "BSL-1.0", "MIT", "MPL-2.0", "Zlib")}


def lines(*words, **options):
    return subprocess.run([str(word) for word in words], stdout=subprocess.PIPE, text=True, **options).stdout.splitlines()


def owners(paths):
    """The installed packages, as dpkg names them, that hold these files."""
    wanted = {spelling: path for path in paths for spelling in (path, path.removeprefix("/usr"))}  # dpkg may know either
    names, found, packages = list(wanted), set(), set()
    for first in range(0, len(names), 500):
        for line in lines("dpkg", "-S", *names[first:first + 500], stderr=subprocess.DEVNULL):
            package, _, path = line.partition(": ")
            if path in wanted:
                found.add(wanted[path])
                packages.add(package.split(", ")[0])
    if missing := sorted(set(paths) - found):
        sys.exit(f"sbom: part of the package, and of no Debian package: {' '.join(missing[:5])}")
    return packages


def linked_libraries(binaries, architecture):
    """The files that the loader takes for what these name; their own among them are left out."""
    names = {name for binary in binaries
             for name in re.findall(r"\(NEEDED\).*\[(.*)\]", "\n".join(lines("readelf", "-d", binary, check=True)))}
    triplet = lines("dpkg-architecture", "-f", "-A", architecture, "-q", "DEB_TARGET_MULTIARCH", check=True)[0]
    paths = set()
    for name in names - {binary.name for binary in binaries}:
        folder = next((folder for folder in (f"/usr/lib/{triplet}", f"/lib/{triplet}", "/lib", "/lib64")
                       if os.path.exists(f"{folder}/{name}")), "/nowhere")
        paths.add(f"{folder}/{name}")
    return paths


def read_by_the_build(build, names):
    """The headers and archives, neither the build's nor ours, of which it made the targets of these names."""
    ninja = ["ninja", "-n", "-C", build, "-t"]
    targets = [target for target in (line.split(": ")[0] for line in lines(*ninja, "targets", "all", check=True))
               if os.path.basename(target) in names and (build / target).is_file()]
    if missing := set(names) - {os.path.basename(target) for target in targets}:
        sys.exit(f"sbom: {build} builds no {' '.join(sorted(missing))}")
    inputs = set(lines(*ninja, "inputs", *targets, check=True))
    read, went_in = {name for name in inputs if name.endswith(".a")}, False
    for line in lines(*ninja, "deps", check=True):  # "object: #deps 2", then as many lines of four spaces and a header
        if line.startswith(" "):
            read |= {line.strip()} if went_in else set()
        elif line:
            went_in = line.partition(": ")[0] in inputs
    paths = {os.path.normpath(build / name) for name in read}
    return {path for path in paths if not path.startswith((f"{SOURCE}/", f"{build}/"))}


def licence(package):
    """What Debian's machine-readable copyright says of a source as a whole."""
    text = Path(f"/usr/share/doc/{package}/copyright").read_text(errors="replace")
    whole = re.search(r"^Files:\s*\*\s*$.*?^License:\s*(.+?)\s*$", text, re.MULTILINE | re.DOTALL)
    return LICENCES.get(whole[1].lower(), "NOASSERTION") if whole else "NOASSERTION"


def spdx_id(name):
    return "SPDXRef-" + re.sub(r"[^A-Za-z0-9.]", "-", name)


def installed(packages):
    """Each as SPDX describes it, sorted by name."""
    release = dict(re.findall(r'^(ID|VERSION_ID)="?([^"\n]*)"?$', Path("/etc/os-release").read_text(), re.MULTILINE))
    fields = "${Package}\t${Version}\t${Architecture}\t${source:Package}\t${source:Version}\n"
    for line in sorted(lines("dpkg-query", "-W", "-f", fields, *packages, check=True) if packages else []):
        name, version, architecture, source, source_version = line.split("\t")
        purl = (f"pkg:deb/{release['ID']}/{urllib.parse.quote(name)}@{urllib.parse.quote(version)}"
                f"?arch={architecture}&distro={release['ID']}-{release.get('VERSION_ID', 'testing')}")
        yield source, {
            "SPDXID": spdx_id(name), "name": name, "versionInfo": version,
            "sourceInfo": f"built from {source} {source_version}", "downloadLocation": "NOASSERTION",
            "filesAnalyzed": False, "licenseConcluded": "NOASSERTION", "licenseDeclared": licence(name), "copyrightText": "NOASSERTION",
            "externalRefs": [{"referenceCategory": "PACKAGE-MANAGER", "referenceType": "purl", "referenceLocator": purl}]}


def contents(root, left_out):
    for path in sorted(root.rglob("*")):
        name = f"./{path.relative_to(root)}"
        if path.is_file() and name != left_out:
            body = path.read_bytes()
            yield {"SPDXID": spdx_id(f"File-{name[2:]}"), "fileName": name,
                   "licenseConcluded": "NOASSERTION", "copyrightText": "NOASSERTION",
                   "checksums": [{"algorithm": kind.upper(), "checksumValue": hashlib.new(kind, body).hexdigest()}
                                 for kind in ("sha1", "sha256")]}


def document(options, own_name):
    files = list(contents(options.staged, own_name))
    code = hashlib.sha1("".join(sorted(file["checksums"][0]["checksumValue"] for file in files)).encode()).hexdigest()
    binaries = [path for path in options.staged.rglob("*") if path.is_file() and path.read_bytes()[:4] == b"\x7fELF"]
    linked, compiled_in = [], []
    if binaries:
        linked = list(installed(owners(linked_libraries(binaries, options.architecture))))
        of_linked = {source for source, _ in linked}
        compiled_in = [one for one in installed(owners(read_by_the_build(options.build, {path.name for path in binaries})))
                       if one[0] not in of_linked]  # a linked library's own headers
    full_name = f"{options.package}_{options.version}_{options.architecture}"
    ours = {"SPDXID": spdx_id(options.package), "name": options.package, "versionInfo": options.version,
            "downloadLocation": "NOASSERTION", "filesAnalyzed": True, "copyrightText": "NOASSERTION",
            "licenseConcluded": "Apache-2.0", "licenseDeclared": "Apache-2.0",
            "packageVerificationCode": {"packageVerificationCodeValue": code, "packageVerificationCodeExcludedFiles": [own_name]}}
    relations = [("SPDXRef-DOCUMENT", "DESCRIBES", ours)]
    relations += [(ours["SPDXID"], "CONTAINS", file) for file in files]
    relations += [(ours["SPDXID"], "DYNAMIC_LINK", package) for _, package in linked]
    relations += [(ours["SPDXID"], "STATIC_LINK", package) for _, package in compiled_in]
    created = datetime.datetime.fromtimestamp(int(os.environ.get("SOURCE_DATE_EPOCH", time.time())), datetime.timezone.utc)
    return {"spdxVersion": "SPDX-2.3", "dataLicense": "CC0-1.0", "SPDXID": "SPDXRef-DOCUMENT", "name": full_name,
            "documentNamespace": f"https://teletact.invalid/spdx/{full_name}/{code}",
            "creationInfo": {"created": created.strftime("%Y-%m-%dT%H:%M:%SZ"), "creators": ["Tool: teletact-sbom"]},
            "packages": [ours] + [package for _, package in linked + compiled_in], "files": files,
            "relationships": [{"spdxElementId": one, "relationshipType": kind, "relatedSpdxElement": other["SPDXID"]}
                              for one, kind, other in relations]}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("staged", type=Path)
    for name in ("package", "version", "build"):
        parser.add_argument(f"--{name}", required=True)
    parser.add_argument("--architecture", help="this machine's unless given")
    options = parser.parse_args()
    options.architecture = options.architecture or lines("dpkg", "--print-architecture", check=True)[0]
    options.build = Path(options.build).resolve()
    folder = next(options.staged.glob(f"**/share/doc/{options.package}"))
    own_name = f"./{(folder / 'sbom.spdx.json').relative_to(options.staged)}"
    (options.staged / own_name).write_text(json.dumps(document(options, own_name), indent=1) + "\n")


main()
