"""Write the pages that are readable in the repository from their sources.

    python docs/render.py                  the environment's reference and the list of names
    python docs/render.py --notebooks      the notebooks too, with outputs; requires the extra docs
    python docs/render.py --check          report pages that differ from their sources

The reference of `PassiveWalker-v0` on docs/environment.md is the docstring of `PassiveWalkerEnv`.
docs/names.md has the signature and the summary of each name on docs/api.md. docs/rendered has each
notebook of docs/notebooks as .ipynb with its outputs.
"""

from __future__ import annotations

import argparse
import importlib
import inspect
import json
import os
import re
import sys
from enum import Enum
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parent
BEGIN, END = "copies it here.\n\n", "## Named scenes\n"
"""Texts before and after the reference on docs/environment.md."""
_FENCE = re.compile(r"```\{code-cell\}[^\n]*\n(.*?)```\n?", re.S)
_KINDS = {"class": "class ", "exception": "exception "}


def environment() -> str:
    """The page of the environment with the reference of today's docstring."""
    from gym_passive_walker.envs.walker_env import PassiveWalkerEnv

    text = (DOCS / "environment.md").read_text(encoding="utf-8")
    above, below = text.split(BEGIN)[0], text.split(END)[1]
    reference = inspect.getdoc(PassiveWalkerEnv) or ""
    reference = re.sub(r"\A[^\n]*\n+", "", reference)  # its first line repeats the page's title
    reference = re.sub(r"^(?:>>> |\.\.\. )", "", reference, flags=re.M)  # code to copy
    reference = re.sub(r"\n\n```$", "\n```", reference, flags=re.M)
    return f"{above}{BEGIN}{reference.rstrip()}\n\n{END}{below}"


def _signature(found: Any) -> str:
    """The parameters of a function or class with their defaults, without types."""
    try:
        parameters = inspect.signature(found).parameters.values()
    except (TypeError, ValueError):
        return ""
    words, keyword = [], False
    for each in parameters:
        if each.kind is each.KEYWORD_ONLY and not keyword:
            words.append("*")
        keyword |= each.kind in (each.KEYWORD_ONLY, each.VAR_POSITIONAL)
        mark = {each.VAR_POSITIONAL: "*", each.VAR_KEYWORD: "**"}.get(each.kind, "")
        default = "" if each.default is each.empty else f"={_default(each.default)}"
        words.append(f"{mark}{each.name}{default}")
    return f"({', '.join(words)})"


def _default(value: Any) -> str:
    name = getattr(value, "__name__", None)
    if name is None and repr(value).startswith("<"):
        name = str(getattr(value, "value", "..."))
    return name or repr(value)


def _entry(kind: str, name: str, found: Any) -> str:
    exception = kind == "exception" or (inspect.isclass(found) and issubclass(found, Enum))
    signature = "" if exception else _signature(found)
    paragraph = (inspect.getdoc(found) or "").partition("\n\n")[0]
    first = " ".join(paragraph.split()).replace("|", "\\|")
    short = name.removeprefix("gym_passive_walker.")
    return f"| {_KINDS.get(kind, '')}`{short}{signature}` | {first} |"


def names() -> str:
    """The list of all names on docs/api.md, in its order, with signatures and first sentences."""
    lines = [
        "# Names in short",
        "",
        "Signature and summary of every public name, in the order of [the full page](api.md).",
        "Names are attributes of `gym_passive_walker`, which is usually imported as `gpw`.",
        "",
        "*`python docs/render.py` writes this page.*",
    ]
    module = "gym_passive_walker"
    api = (DOCS / "api.md").read_text(encoding="utf-8")
    for line in api.splitlines():
        if line.startswith("## "):
            lines += ["", line, "", "| name | description |", "|---|---|"]
        if not (found := re.match(r"\.\. (?:py:)?(\w+):: ([\w.]+)", line)):
            continue
        kind, name = found.groups()
        full = name if name.startswith("gym_passive_walker") else f"{module}.{name}"
        if kind == "currentmodule":
            module = name
        elif kind == "automodule":
            for each in importlib.import_module(name).__all__:
                function = getattr(importlib.import_module(name), each)
                lines.append(_entry("function", f"{name}.{each}", function))
        elif kind in ("data", "function"):
            text = re.search(rf"^\.\. py:{kind}:: {re.escape(name)}.*\n\n +(.*)", api, re.M)
            assert text, name
            lines.append(f"| `{full.removeprefix('gym_passive_walker.')}` | {text[1]} |")
        elif kind.startswith("auto"):
            where, _, last = full.rpartition(".")
            there = getattr(importlib.import_module(where), last)
            lines.append(_entry(kind.removeprefix("auto"), full, there))
    return "\n".join(lines) + "\n"


def cells(notebook: Path) -> list[tuple[str, str]]:
    """Kinds ("markdown", "code") and texts of the cells of a notebook in MyST."""
    text = notebook.read_text(encoding="utf-8").split("---\n", 2)[2]
    text = re.sub(r"^Download \{nb-download\}.*\n\n", "", text, flags=re.M)
    parts = _FENCE.split(text)
    kinds = ("markdown", "code")
    both = [(kinds[i % 2], part.strip("\n")) for i, part in enumerate(parts)]
    return [(kind, part) for kind, part in both if part]


def run(notebook: Path) -> str:
    """Execute a notebook; returns it as .ipynb with outputs."""
    import nbformat
    from nbclient import NotebookClient

    book = nbformat.v4.new_notebook()
    new = {"code": nbformat.v4.new_code_cell, "markdown": nbformat.v4.new_markdown_cell}
    book.cells = [new[kind](text) for kind, text in cells(notebook)]
    for number, cell in enumerate(book.cells):
        cell.id = f"cell-{number}"
    book.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    where = {"metadata": {"path": str(notebook.parent)}}
    NotebookClient(book, timeout=600, kernel_name="python3", resources=where).execute()
    for cell in book.cells:
        cell.metadata.clear()
        for output in cell.get("outputs", ()):
            if "image/png" in (data := output.get("data", {})):
                data.pop("text/html", None)  # the picture is enough
    return json.dumps(book, indent=1, ensure_ascii=False, sort_keys=True) + "\n"


def main() -> int:
    """Write the pages."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--notebooks", nargs="*", metavar="NAME", help="execute these, or all")
    parser.add_argument("--check", action="store_true", help="write nothing; 1 if a page is stale")
    arguments = parser.parse_args()
    os.environ["NUMBA_ENABLE_CUDASIM"] = "1"  # names of the GPU are imported where there is none
    stale = []
    for name, text in (("environment", environment()), ("names", names())):
        page = DOCS / f"{name}.md"
        if not arguments.check:
            page.write_text(text, encoding="utf-8")
        elif not page.exists() or page.read_text(encoding="utf-8") != text:
            stale.append(page.name)
    if stale:
        print(f"{' and '.join(stale)}: run python docs/render.py")
        return 1
    if arguments.notebooks is not None:
        os.environ["MPLBACKEND"] = "module://matplotlib_inline.backend_inline"
        (DOCS / "rendered").mkdir(exist_ok=True)
        for source in sorted((DOCS / "notebooks").glob("*.md")):
            if not arguments.notebooks or source.stem in arguments.notebooks:
                target = DOCS / "rendered" / f"{source.stem}.ipynb"
                target.write_text(run(source), encoding="utf-8")
                print(target.relative_to(DOCS.parent))
    return 0


if __name__ == "__main__":
    sys.exit(main())
