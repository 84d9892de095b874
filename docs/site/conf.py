"""The docs as a site: the same Markdown that a checkout has, and the contract's reference out of the protos' comments.

Built by `docs/site/build`. A page that no list below names, and a link or an anchor that leads nowhere, are warnings,
and warnings are errors.
"""

import functools
import pathlib
import posixpath
import re
import shutil
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import contract

ROOT = pathlib.Path(__file__).resolve().parents[2]

project = "teletact"
version = release = re.search(r"^project\(teletact VERSION ([0-9.]+)", (ROOT / "CMakeLists.txt").read_text(), re.M)[1]
html_title = f"teletact {version}"
html_theme = "furo"
html_show_copyright = html_copy_source = html_show_sourcelink = False
extensions = ["myst_parser"]
myst_heading_anchors = 6  # links name headings as a forge does
highlight_language = "none"
source_suffix = {".md": "markdown", ".proto": "markdown"}
root_doc = "README"
include_patterns = ["README.md", "CHANGELOG.md", "docs/**.md", "proto/teletact/v1/*.proto"]
exclude_patterns = [folder.name for folder in ROOT.iterdir() if folder.is_dir() and folder.name not in ("docs", "proto")]

# The sidebar. In a checkout README.md says what to read, in words.
CONTENTS = {
    "README": {
        "Guides": ["/docs/guide/service", "/docs/guide/compute-node", "/docs/guide/patient-side",
                   "/docs/guide/operator-side", "/docs/guide/page", "/docs/guide/python", "/docs/guide/slicer", "/docs/guide/ros",
                   "/docs/guide/recorded-data", "/docs/guide/recorded-sets", "/docs/guide/experiment"],
        "Reference": ["/docs/glossary", "/docs/reference/contract", "/docs/reference/messages",
                      "/docs/reference/limits", "/docs/reference/safety",
                      "/docs/reference/environment"],
        "How it works": ["/docs/architecture", "/docs/theory", "/docs/decisions/README", "/docs/results/README"],
        "Develop": ["/docs/develop/add-a-device", "/docs/develop/add-a-model", "/docs/develop/add-a-kernel", "/docs/develop/add-a-refusal",
                    "/docs/develop/testing", "/docs/develop/benchmarking", "/docs/develop/packaging",
                    "/docs/develop/site", "/CHANGELOG"],
    },
    "docs/decisions/README": {"": ["[0-9]*", "appendix/*"]},
    "docs/results/README": {"": ["[a-z]*"]},
    "docs/reference/contract": {"": ["/proto/teletact/v1/*"]},
}


@functools.cache
def described():
    return contract.described(ROOT / "proto")


def read(app, docname, source):
    """A proto becomes its reference; a page that has others below it gets the list of them."""
    if docname.startswith("proto/"):
        source[0] = contract.page(described(), docname.removeprefix("proto/") + ".proto")
    for caption, pages in CONTENTS.get(docname, {}).items():
        options = [":hidden:", ":glob:"] + [f":caption: {caption}"] * bool(caption)
        source[0] += "\n\n```{toctree}\n" + "\n".join([*options, "", *pages]) + "\n```\n"


def folder(app, env, node, shown):
    """A link to a folder leads to its README; the name of a folder that has none stands there without a link."""
    name = posixpath.normpath(posixpath.join(posixpath.dirname(node["refdoc"]), node["reftarget"]))
    if name.startswith("..") or not (ROOT / name).is_dir():
        return None
    page = posixpath.join(name, "README")
    if page not in env.found_docs:
        return shown
    reference = app.builder.get_relative_uri(node["refdoc"], page)
    from docutils import nodes
    return nodes.reference("", "", shown, refuri=reference, internal=True)


def finished(app, exception):
    if not exception and app.builder.name == "html":  # where a browser looks first
        shutil.copyfile(pathlib.Path(app.outdir) / "README.html", pathlib.Path(app.outdir) / "index.html")


def setup(app):
    app.connect("source-read", read)
    app.connect("missing-reference", folder)
    app.connect("build-finished", finished)
