#!/usr/bin/env python3
"""The site of the docs: it builds without a warning, its links lead somewhere, the contract is whole in it, it loads
nothing from elsewhere; and what is wrong in a page stops it.

Exits with 77, and says so, where docs/site/build finds no Sphinx.
"""
import html.parser, pathlib, re, shutil, subprocess, sys, tempfile, urllib.parse

ROOT = pathlib.Path(__file__).resolve().parents[2]
FAULTS = {  # what a page says wrongly, and what the build says of it
    "[a page](no-such.md)": "no-such.md",
    "[a heading](limits.md#no-such-heading)": "no-such-heading",
    "[a heading](#none-here)": "none-here",
    "[a file](../../client/no_such.h)": "no_such.h",
    "[a folder](../../no_such_folder)": "no_such_folder",
    "![a picture](../pictures/no-such.png)": "no-such.png",
}


class Page(html.parser.HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.ids, self.links, self.loads, self.text = set(), [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        self.ids.add(attributes.get("id"))
        if tag == "a" and "href" in attributes:
            self.links.append(attributes["href"])
        self.loads += [attributes[name] for name in ("src", "srcset") if name in attributes]
        if tag == "link":
            self.loads.append(attributes.get("href", ""))

    def handle_data(self, data):
        self.text.append(data)


def build(tree, out):
    run = subprocess.run([tree / "docs/site/build", out], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if run.returncode == 77:
        print(run.stdout, end="")
        sys.exit(77)
    return run


def copied(folder):
    """The checkout: its docs copied, so that they can be spoilt, and links to the rest."""
    tree = folder / "tree"
    tree.mkdir()
    for entry in ROOT.iterdir():
        if entry.name == "docs":
            shutil.copytree(entry, tree / "docs")
        elif not re.match(r"build|out|demo-out|\.git$|shared$", entry.name):
            (tree / entry.name).symlink_to(entry)
    return tree


def links_lead_somewhere(site, pages):
    for file, page in pages.items():
        for link in page.links:
            place = urllib.parse.urlsplit(link)
            if place.scheme:
                continue
            target = (file.parent / urllib.parse.unquote(place.path)).resolve() if place.path else file
            assert target.exists(), f"{file.relative_to(site)}: {link} leads nowhere"
            if place.fragment and target in pages:
                assert place.fragment in pages[target].ids, f"{file.relative_to(site)}: {link}: no such place"


def contract_is_whole(site, pages):
    """Of each proto: every service, call, message, field and value; found without protoc."""
    names = 0
    for proto in sorted((ROOT / "proto/teletact/v1").glob("*.proto")):
        source = re.sub(r"//[^\n]*", "", proto.read_text())
        said = set(re.split(r"[^\w]+", " ".join(pages[site / f"proto/teletact/v1/{proto.stem}.html"].text)))
        found = re.findall(r"\b(?:service|rpc|message|enum)\s+(\w+)", source) + re.findall(r"(\w+)\s*=\s*\d+\s*;", source)
        assert len(found) > 10, f"{proto.name}: {found}"
        assert not set(found) - said, f"{proto.name}: not in the reference: {sorted(set(found) - said)}"
        names += len(found)
    said = " ".join(" ".join(pages[site / "proto/teletact/v1/palpation.html"].text).split())
    assert "is never more than credit answers behind" in said.replace("  ", " "), "comments are not in the reference"
    return names


def main():
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        tree, site = copied(folder), (folder / "site").resolve()
        run = build(tree, site)
        assert run.returncode == 0, run.stdout
        pages = {file: Page(file.read_text()) for file in site.rglob("*.html")}
        for source in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]:
            assert site / source.relative_to(ROOT).with_suffix(".html") in pages, f"{source} is no page"
        assert site / "index.html" in pages
        links_lead_somewhere(site, pages)
        names = contract_is_whole(site, pages)
        elsewhere = {load for page in pages.values() for load in page.loads if re.match(r"(https?:)?//", load)}
        assert not elsewhere, f"loaded from elsewhere: {elsewhere}"

        with open(tree / "docs/reference/messages.md", "a") as page:
            page.write("\n\n" + "\n\n".join(FAULTS) + "\n")
        (tree / "docs/guide/in_no_list.md").write_text("# A page that the sidebar lacks\n")
        run = build(tree, site)
        assert run.returncode != 0, "a spoilt page was built"
        for fault in [*FAULTS.values(), "in_no_list.md"]:
            assert any(fault in line and "WARNING" in line for line in run.stdout.splitlines()), f"{fault}:\n{run.stdout}"
        print(f"{len(pages)} pages, {names} names of the contract, {len(FAULTS) + 1} faults noticed")


main()
