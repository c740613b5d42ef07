"""Check the prose of documentation, docstrings, comments and messages for words to avoid.

    python -m tests.words                  every page and module
    python -m tests.words FILE...          some of them

The words are those for which the literature has a term, and those that make a sentence unclear.
Sentences of pages and docstrings must not be long either.
"""

from __future__ import annotations

import ast
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
LONGEST = 30
"""Words in a sentence."""

AVOIDED = {
    r"whoever|whom|whose": "of which, its, each; 'who' is a person",
    r"(?<!people )(?<!someone )(?<!users )(?<!readers )(?<!those )"
    r"(?<!engineers )(?<!scientists )who": "that; a person",
    r"befall\w*|befell": "disturbances",
    r"fates?": "disturbance state",
    r"told|tells?|telling": "returns, reports, shows",
    r"anew": "again; recomputed",
    r"likewise": "name it",
    r"as of": "as in, see, of",
    r"nonsense": "invalid input",
    r"strobe pictures?": "stroboscopic picture",
    r"(?:seed|source) documents?": "Garcia (1999), chapter 4",
    r"on the level": "on level ground",
    r"doors?": "entry point",
    r"crowd": "batch",
    r"truths?": "boolean",
    r"looked at": "checked, read",
    r"programmes?": "program; nonlinear program",
    r"(?:optim|random|normal|minim|maxim|initial|vector|general)is\w+": "-ize",
}
"""Words to avoid, as regular expressions, and what to write instead."""

_PAGES = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "docs/*.md", "docs/notebooks/*.md")
_MODULES = ("gym_passive_walker", "agents", "benchmarks", "docs", "examples", "tests", "validation")
_EXAMPLES = ("tests/words.py", "tests/docs/test_rendered.py")
"""Modules that have the words to avoid as data."""
_CODE = re.compile(r"```.*?```|~~~.*?~~~|<!--.*?-->|\$\$.*?\$\$", re.S)
_INLINE = re.compile(r"`[^`]*`|\$[^$\n]*\$|\[([^\]]*)\]\([^)]*\)|https?://\S+|<[^>\n]*>")
_ENDS = re.compile(r"(?<=[.!?:;])\s+|\n\s*\n|\n\s*(?:[-*]|\d+\.)\s|\n\s*\|[^\n]*")


def prose(text: str) -> Iterator[str]:
    """Sentences of a text in Markdown, code left out."""
    text = _CODE.sub("\n\n", text)
    text = re.sub(r"^(?: {4,}|\t|>>>|\.\.\. |\||#|:::|```).*$", "\n", text, flags=re.M)
    text = _INLINE.sub(lambda found: found[1] or " x ", text)
    for sentence in _ENDS.split(text):
        if words := re.findall(r"[A-Za-z0-9][\w'’/^.,-]*", sentence or ""):
            yield " ".join(words)


def docstrings(path: Path) -> Iterator[tuple[int, str]]:
    """Lines and texts of the docstrings of a module, its attributes' included."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant):
                if isinstance(text := child.value.value, str):
                    yield child.lineno, text


def remarks(path: Path) -> Iterator[tuple[int, str]]:
    """Lines and texts of the comments of a module, and of its strings of more than a word."""
    with tokenize.open(path) as file:
        for token in tokenize.generate_tokens(file.readline):
            if token.type == tokenize.COMMENT:
                yield token.start[0], token.string.lstrip("# ")
    known = {text for _, text in docstrings(path)}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Constant) and isinstance(text := node.value, str):
            if " " in text.strip() and text not in known:
                yield node.lineno, text


def _entries(text: str) -> str:
    """A docstring as Markdown: sections are paragraphs, each argument is one."""
    lines = []
    for line in text.splitlines():
        stripped = line.strip()
        if re.fullmatch(
            r"(Args|Attributes|Returns|Raises|Yields|Example|Examples|Note):", stripped
        ):
            lines.append("")
        elif stripped.startswith((">>>", "...")) or re.match(r"\*{0,2}\w+: ", stripped):
            lines += [
                "",
                "" if stripped.startswith((">>>", "...")) else stripped.partition(": ")[2],
            ]
        else:
            lines.append(stripped)
    return "\n".join(lines)


def faults(path: Path) -> Iterator[str]:
    """What is wrong in a file, a line for each fault."""
    short: list[tuple[int, str]] = []
    if path.suffix == ".py":
        texts = [(line, _entries(text)) for line, text in docstrings(path)]
        short = list(remarks(path))
    else:
        texts = [(1, path.read_text(encoding="utf-8"))]
    name = path.relative_to(ROOT)
    for line, text in texts + short:
        for sentence in prose(text):
            for avoided, instead in AVOIDED.items():
                if found := re.search(rf"\b(?:{avoided})\b", sentence, re.I):
                    yield f"{name}:{line}: {found[0]!r} (write: {instead}) in: {sentence[:90]}"
    for line, text in texts:
        for sentence in prose(text):
            if (count := len(sentence.split())) > LONGEST:
                yield f"{name}:{line}: a sentence of {count} words: {sentence[:90]} ..."


def files() -> list[Path]:
    """Every page and module."""
    pages = [path for pattern in _PAGES for path in sorted(ROOT.glob(pattern))]
    modules = [path for folder in _MODULES for path in sorted((ROOT / folder).rglob("*.py"))]
    modules = [path for path in modules if path not in {ROOT / name for name in _EXAMPLES}]
    return [*pages, *modules, ROOT / "train.py"]


def main() -> int:
    """Print all faults; returns 1 if there are some."""
    found = 0
    for path in [Path(word).resolve() for word in sys.argv[1:]] or files():
        for fault in faults(path):
            print(fault)
            found += 1
    return int(found > 0)


if __name__ == "__main__":
    sys.exit(main())
