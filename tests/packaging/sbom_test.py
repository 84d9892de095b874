#!/usr/bin/env python3
"""The list of what each Debian package is made of (sbom.spdx.json), compared with the package: its files, what its
binaries link as the loader finds it, what the package depends on, and the headers that the sources include.

    tests/packaging/sbom_test.py --build build/release

Packs what is built there. Exits with 77, and says so, where dpkg-dev is missing.
"""
import argparse, hashlib, json, re, shutil, subprocess, sys, tempfile
from pathlib import Path

# By a header of each: what is compiled in, and no library of it is linked.
HEADERS = {"/usr/include/eigen3/Eigen/Core", "/usr/include/boost/asio.hpp", "/usr/include/CLI/CLI.hpp",
           "/usr/include/nlohmann/json.hpp"}
OPENCL = {"/usr/include/CL/opencl.hpp", "/usr/include/CL/cl.h"}
NEVER = {"/usr/include/gtest/gtest.h"}


def run(*words):
    done = subprocess.run([str(word) for word in words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                          timeout=900)
    assert done.returncode == 0, f"{' '.join(map(str, words))}:\n{done.stdout}"
    return done.stdout


def owner(path):
    """The package of a file, which dpkg may know by its path before /usr was merged."""
    path = str(Path(path).resolve())
    for spelling in (path, path.removeprefix("/usr")):
        found = subprocess.run(["dpkg", "-S", spelling], capture_output=True, text=True)
        if found.returncode == 0:
            return re.split("[:,]", found.stdout)[0]
    raise AssertionError(f"{path} is of no package")


def linked(root):
    packages = set()
    own = {path.name for path in root.rglob("*")}
    for binary in root.rglob("*"):
        if binary.is_file() and binary.read_bytes()[:4] == b"\x7fELF":
            paths = dict(re.findall(r"(\S+) (?:=> )?(/\S+) \(0x", "libc-loader /none (0x\n" + run("ldd", binary)))
            for name in re.findall(r"\(NEEDED\).*\[(.*)\]", run("readelf", "-d", binary)):
                if name not in own:
                    packages.add(owner(paths.get(name, f"/lib64/{name}")))
    return packages


def compare(debian_package, folder):
    name = run("dpkg-deb", "-f", debian_package, "Package").strip()
    root = folder / name
    run("dpkg-deb", "-x", debian_package, root)
    listing = root / f"usr/share/doc/{name}/sbom.spdx.json"
    told = json.loads(listing.read_text())
    assert told["spdxVersion"] == "SPDX-2.3" and told["SPDXID"] == "SPDXRef-DOCUMENT"
    elements = {one["SPDXID"]: one for one in told["packages"] + told["files"]}
    assert len(elements) == len(told["packages"]) + len(told["files"]), "two have one name"

    def related(kind):
        return [elements[one["relatedSpdxElement"]] for one in told["relationships"] if one["relationshipType"] == kind]

    assert [one["name"] for one in related("DESCRIBES")] == [name]
    files = {one["fileName"]: one["checksums"][1] for one in related("CONTAINS")}
    assert set(files) == {f"./{path.relative_to(root)}" for path in root.rglob("*") if path.is_file() and path != listing}
    for file, sum_of in files.items():
        assert sum_of == {"algorithm": "SHA256", "checksumValue": hashlib.sha256((root / file).read_bytes()).hexdigest()}, file

    libraries = {one["name"] for one in related("DYNAMIC_LINK")}
    assert libraries == linked(root), f"{name} links {linked(root)}, and says {libraries}"
    depends = run("dpkg-deb", "-f", debian_package, "Depends")
    asked_for = {re.split(r"[ |(:]", one.strip())[0] for one in depends.split(",") if one.strip()} - {"pocl-opencl-icd", "openssl"}
    provided = {}
    for library in libraries:
        words = run("dpkg-query", "-W", "-f", "${Package}, ${Provides}\n", library).replace("\n", ",").split(",")
        provided[library] = {word.split()[0] for word in words if word.strip()}
    assert all(asked_for & names for names in provided.values()), f"{name} depends on {asked_for}, and links {libraries}"
    assert asked_for <= set().union(*provided.values()), f"{name} depends on {asked_for}, and links {libraries}"

    inside = {one["name"] for one in related("STATIC_LINK")}
    if name != "teletact-dev":
        expected = HEADERS | (OPENCL if name == "teletact-service" else set())
        assert {owner(path) for path in expected} <= inside, f"{name}: {inside}"
        unexpected = (NEVER | OPENCL) - expected
        assert not {owner(path) for path in unexpected} & inside, f"{name}: {inside}"
    for one in told["packages"][1:]:
        assert one["versionInfo"] == run("dpkg-query", "-W", "-f", "${Version}", one["name"]), one["name"]
    assert any(one["licenseDeclared"] == "MPL-2.0" for one in related("STATIC_LINK")) or name == "teletact-dev"
    print(f"{name}: {len(files)} files, {len(libraries)} packages linked, {len(inside)} compiled in")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--build", type=Path, required=True)
    options = parser.parse_args()
    if missing := [tool for tool in ("dpkg-shlibdeps", "readelf", "cpack", "ninja") if not shutil.which(tool)]:
        print(f"SKIPPED: no {', '.join(missing)} here (packages dpkg-dev, binutils, cmake, ninja-build)")
        return 77
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        run("cpack", "--config", options.build.resolve() / "CPackConfig.cmake", "-B", folder / "packed",
            "-D", "CPACK_PACKAGING_INSTALL_PREFIX=/usr")
        packages = sorted((folder / "packed").glob("*.deb"))
        assert len(packages) == 3, packages
        for package in packages:
            compare(package, folder)
    return 0


sys.exit(main())
