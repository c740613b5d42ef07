"""Apply the rules of `styles/Walker` to documentation, docstrings, comments and messages.

    python -m tests.words                  every page and module
    python -m tests.words FILE...          some of them

The rules are in the format of Vale (https://vale.sh): terms to avoid, and the longest sentence.
Comments and messages are exempt from the longest sentence.
"""

from __future__ import annotations

import ast
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).parents[1]
STYLE = ROOT / "styles" / "Walker"
RULES: list[dict[str, Any]] = [
    yaml.safe_load(path.read_text(encoding="utf-8")) for path in sorted(STYLE.glob("*.yml"))
]
"""Rules that extend Vale's `substitution` and `occurrence`."""

_PAGES = (
    "*.md",
    "benchmarks/*.md",
    "docs/*.md",
    "docs/notebooks/*.md",
    "changelog.d/*.md",
    "gym_passive_walker/devices/web/**/*.md",
)
_MODULES = ("gym_passive_walker", "agents", "benchmarks", "docs", "examples", "tests", "validation")
_EXAMPLES = ("tests/docs/test_words.py",)
"""Modules that have words to avoid as data."""
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


def breaches(sentence: str, short: bool = False) -> Iterator[str]:
    """What the rules say about a sentence; a short text may have sentences of any length."""
    for rule in RULES:
        if rule["extends"] == "occurrence":
            count = len(re.findall(rule["token"], sentence))
            if count > rule["max"] and not short:
                yield rule["message"] % count
            continue
        for avoided, instead in rule["swap"].items():
            flags = re.I if rule["ignorecase"] else 0
            if found := re.search(rf"\b(?:{avoided})\b", sentence, flags):
                yield rule["message"] % (instead, found[0])


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


def _cells(page: str) -> str:
    """Headings and cells of tables of a page, a paragraph each."""
    lines = re.findall(r"^(?:\||#+ ).*$", _CODE.sub("", page), re.M)
    return "\n\n".join(cell.strip("# ") for line in lines for cell in line.split("|"))


def faults(path: Path) -> Iterator[str]:
    """What is wrong in a file, a line for each fault."""
    page = path.read_text(encoding="utf-8")
    texts = [(1, page, False), (1, _cells(page), True)]
    if path.suffix == ".py":
        texts = [(line, _entries(text), False) for line, text in docstrings(path)]
        texts += [(line, text, True) for line, text in remarks(path)]
    for line, text, short in texts:
        for sentence in prose(text):
            for breach in breaches(sentence, short):
                yield f"{path.relative_to(ROOT)}:{line}: {breach} In: {sentence[:90]}"


def files() -> list[Path]:
    """Every page and module."""
    written = ROOT / "docs" / "reference.md"  # from docstrings, by `make docs`
    pages = [path for pattern in _PAGES for path in sorted(ROOT.glob(pattern)) if path != written]
    modules = [path for folder in _MODULES for path in sorted((ROOT / folder).rglob("*.py"))]
    built = ROOT / "docs" / "_build"  # copies of the site
    modules = [
        path
        for path in modules
        if path not in {ROOT / name for name in _EXAMPLES} and not path.is_relative_to(built)
    ]
    return [*pages, *modules, *sorted(ROOT.glob("*.py"))]


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
