#!/usr/bin/env python3
"""The prose of documents and messages: sentences of usual length, plain English, and pages within their budgets.

tests/docs/prose.py [PAGE ...] checks these pages; without any, all pages, their total, and sources' messages.
If proselint is installed (apt-get install python3-proselint), its checks in proselint.json run too.
Phrases to avoid: dialect.txt.
"""
import bisect, itertools, json, math, os, pathlib, re, statistics, sys, tempfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
MEDIAN, P90, FEWEST = 15, 25, 10  # words of a page's sentences; a page with fewer sentences is not measured
ALL_WORDS, DECISION_WORDS, LINES = 50_000, 300, {"README.md": 70, "CHANGELOG.md": 60}
DIALECT = dict(line.split("  ->  ") for line in (HERE / "dialect.txt").read_text().splitlines() if "  ->  " in line)


def blocks(text):
    """(line, text, has it sentences): paragraphs, items, headings and rows of tables; no code, equations or labels."""
    found, fence, code = [None], False, False
    for number, line in enumerate(text.split("\n"), 1):
        if line.startswith("```"):
            fence, line = not fence, ""
        code = fence or line.startswith("    ") and (code or found[-1] is None)
        item = re.match(r" *([-*+]|\d+\.) +(\*[^*]+\*: |\*\*[^*]+\*\*:? )?|\*\*[^*]+\*\* ", line)
        if code or not line.strip() or line.startswith(("<!--", "![")):
            found.append(None)
        elif item or line.startswith(("#", "|")) or not found[-1] or not found[-1][2]:
            found.append((number, line[item.end() if item else 0:], not line.startswith(("#", "|"))))
        else:
            found[-1] = (found[-1][0], found[-1][1] + "\n" + line.strip(), True)
    for number, block, prose in filter(None, found):
        yield number, re.sub(r"\[([^\]]*)\]\([^)\s]*\)", r"\1", re.sub(r"(`+)[^`]+\1", "X", block)), prose


def sentences(number, block):
    """(line, sentence, words) of a block; sources and names of files are not sentences."""
    block = re.sub(r"\b(Source|Code): [^\n]*", "", block)
    block = re.sub(r"\b(e\.g|i\.e|et al|Fig|ch|eq|vs)\.", r"\1", block)
    for match in re.finditer(r"\S.*?([.!?][\"')*]*(?=\s)|$)", block, re.DOTALL):
        words = sum(bool(re.search(r"\w", word)) for word in match[0].split())
        if words:
            yield number + block.count("\n", 0, match.start()), " ".join(match[0].split()), words


def messages_of(name, text):
    """(name, line, text) of a source's literals that a person reads: three words or more; X is what is filled in."""
    text = re.sub(r'(?m)^\s*(//|#).*|"""[\s\S]*?"""', lambda gone: "\n" * gone[0].count("\n"), text)
    for literals in re.finditer(r'([fb]?"([^"\\\n]|\\.)*"\s*)+', text):
        words = "".join(each[1] for each in re.finditer(r'"((?:[^"\\\n]|\\.)*)"', literals[0]))
        words = re.sub(r"\{[^}]*\}|%[-+.\d]*\w", "X", words)
        if re.search(r"[a-z] [a-z]+ [a-z]", words):
            yield name, text.count("\n", 0, literals.start()) + 1, words


def faults(pages, lints, messages=()):
    """What is wrong with the pages, {name: text}, and with the messages, (file, line, text): a line each."""
    worded, figures = [], list(messages)  # (page, line, block)
    for name, text in pages.items():
        found = [each for number, block, prose in blocks(text) if prose for each in sentences(number, block)]
        lengths = sorted(words for _, _, words in found)
        if len(found) >= FEWEST:
            median, p90 = statistics.median(lengths), lengths[math.ceil(0.9 * len(found)) - 1]
            if median > MEDIAN or p90 > P90:
                yield f"{name}: sentences of {median:g} words (median; limit {MEDIAN}) and {p90} (p90; limit {P90}):"
                longest = max(5, sum(words > P90 for words in lengths))
                for line, sentence, words in sorted(found, key=lambda each: -each[2])[:longest]:
                    yield f"    {name}:{line}: {words} words: {sentence}"
        for number, block, prose in blocks(text):
            (worded if prose or re.search(r"[a-z] [a-z]+ [a-z]", block) else figures).append((name, number, block))
        if re.search(r"decisions/\d", name) and len(text.split()) > DECISION_WORDS:
            yield f"{name}: {len(text.split())} words; a decision has at most {DECISION_WORDS}"
        if len(text.splitlines()) > LINES.get(name, math.inf):
            yield f"{name}: {len(text.splitlines())} lines; at most {LINES[name]}"
    begins = [0, *itertools.accumulate(len(block) + 2 for _, _, block in worded + figures)]
    everything = "".join(block + "\n\n" for _, _, block in worded + figures)
    hits = [(hit.start(), f"'{hit[0]}': {better}") for pattern, better in DIALECT.items()
            for hit in re.finditer(pattern, everything, re.MULTILINE)]
    hits += [(start, f"{message} ({check})") for lint in lints
             for start, _, check, message, _ in lint(everything[:begins[len(worded)]])]
    for start, message in sorted(hits):
        at = bisect.bisect(begins, start) - 1
        name, number, _ = (worded + figures)[at]
        yield f"{name}:{number + everything.count(chr(10), begins[at], start)}: {message}"


def proselint():
    """Its chosen checks, as Debian 12 and 13 have them; none if it is not installed."""
    os.environ["XDG_CACHE_HOME"] = tempfile.gettempdir()
    sys.path.append("/usr/lib/python3/dist-packages")
    try:
        import proselint.tools as tools
    except ImportError:
        print("without proselint, which is not installed (apt-get install python3-proselint)")
        return []
    tools.memoize = lambda check: check  # its cache on disk is slower than its checks
    return tools.get_checks(json.loads((HERE / "proselint.json").read_text()))


def notices_faults(lints):
    """A check that cannot fail is none: each of these must be noticed, and nothing else."""
    long = "A sentence of twenty-six words" + ", one word" * 10 + " long. "
    bad = {"a.md": ("It is short. " * 8 + "\n" + long * 2, "a.md:2: 26 words: A sentence of"),
           "b.md": ("One sentence of two and three and four and five words, and of a few more. " * 10, "16 words"),
           "c.md": ("# Head\n\n- *Label*: what is measured\n  is told.\n", "c.md:4: 'told'"),
           "d.md": ("| a cell | of .14 m |", "d.md:1: '.14'"),
           "docs/decisions/0001-a.md": ("Short. " * 301, "301 words; a decision"),
           "CHANGELOG.md": ("Short.\n" * 61, "61 lines"),
           "e.md": ("It is an ATM machine.", "e.md:1: RAS syndrome" if lints else "")}
    good = "It is.\n\n    .14 is told\n\n```\ntold\n```\n\nA `.14`, [a link](.14/told.md), 0.14. " + "So. " * 9
    source = '// is told\n#include "a b/told.h"\nf("{told} of it is " "not told, is\\"t it", "%.2f told");\n'
    found = "\n".join(faults({**{name: text for name, (text, _) in bad.items()}, "good.md": good}, lints,
                             messages_of("a.cpp", source)))
    assert "a.cpp:3: 'told'" in found and found.count("a.cpp") == 1, found
    for _, fault in bad.values():
        assert fault in found, f"not noticed: {fault}\n{found}"
    assert "good.md" not in found, found


def main(names):
    lints = proselint()
    notices_faults(lints)
    top = [path for path in ROOT.iterdir() if not re.match(r"build|out|demo-out|shared|\.", path.name)]
    files = [pathlib.Path(name).resolve() for name in names] or [
        file for path in top for file in ([path] if path.suffix == ".md" else path.rglob("*.md"))]
    pages = {str(file.relative_to(ROOT)): file.read_text() for file in sorted(files)}
    folders = () if names else ("service", "client", "clients", "common")
    sources = [file for name in folders for file in sorted((ROOT / name).rglob("*"))
               if file.suffix in (".cpp", ".h", ".c", ".py")]
    messages = [each for file in sources for each in messages_of(str(file.relative_to(ROOT)), file.read_text())]
    found, words = list(faults(pages, lints, messages)), sum(len(text.split()) for text in pages.values())
    if words > ALL_WORDS:
        found.append(f"{words} words on all pages; at most {ALL_WORDS}")
    print("\n".join(found) or f"{len(pages)} pages, {words} words")
    sys.exit(bool(found))


main(sys.argv[1:])
