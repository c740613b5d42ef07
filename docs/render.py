"""Write the pages that are made from other files; `make docs` does this before it builds the site.

    python docs/render.py                  pages, and notebooks with outputs (extra docs)
    python docs/render.py --notebooks      pages alone
    python docs/render.py --out FOLDER     into another folder than docs

The reference of `PassiveWalker-v0` on environment.md is the docstring of `PassiveWalkerEnv`. The
arguments on commands.md are those of the parsers of `passive-walker`. reference.md has the
signature and the docstring of each name on docs/api.md. Each notebook of docs/notebooks is
executed, and written as .ipynb with its outputs.
"""

from __future__ import annotations

import argparse
import importlib
import inspect
import json
import os
import re
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from enum import Enum
from functools import cached_property
from itertools import groupby
from pathlib import Path
from types import FunctionType
from typing import Any, NamedTuple

os.environ["NUMBA_ENABLE_CUDASIM"] = "1"  # names of the GPU are imported where there is none

from gym_passive_walker._tools.shown import DRAWERS, picture
from gym_passive_walker.models.units import KINDS, PROPORTIONS, UNITS
from gym_passive_walker.models.walkers import PARAMETERS, Walker

for _drawer in DRAWERS:  # they register the plots that the reference lists
    importlib.import_module(_drawer)

DOCS = Path(__file__).resolve().parent
BEGIN, END = "copies it here.\n\n", "## Named scenes\n"
"""Texts before and after the reference on docs/environment.md."""
ARGUMENTS = "## Arguments\n\n"
"""Title of the last part of docs/commands.md."""
_FENCE = re.compile(r"```\{code-cell\}[^\n]*\n(.*?)```\n?", re.S)
_KINDS = {"class": "class ", "exception": "exception "}
_CROSS = re.compile(r"``([^`]+)``")
_SI = {
    "angle": "rad", "length": "m", "mass": "kg", "gravity": "m/s²", "torque": "N m",
    "friction": "N m s",
}  # fmt: skip
PACKAGE = "gym_passive_walker"


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


def commands() -> str:
    """The page of the command line with the arguments of today's commands."""
    from gym_passive_walker.apps.cli import COMMANDS, parser

    (chosen,) = (each for each in parser()._actions if isinstance(each.choices, dict))
    found: dict[tuple[str, str], list[str]] = {}
    for name, command in chosen.choices.items():
        for each in command._actions:
            values = f"{{{','.join(each.choices)}}}" if each.choices else each.metavar or ""
            word = " ".join([*each.option_strings[-1:], values]).strip().replace("|", "\\|")
            about = str(each.help) % {"default": each.default}
            found.setdefault((word, about), []).append(name)
    rows = [
        f"| `{word}` | {about} | {'all' if len(of) == len(COMMANDS) else ', '.join(of)} |\n"
        for (word, about), of in found.items()
    ]
    text = (DOCS / "commands.md").read_text(encoding="utf-8")
    head = "| argument | meaning (default) | commands |\n|---|---|---|\n"
    return f"{text.split(ARGUMENTS)[0]}{ARGUMENTS}{head}{''.join(rows)}"


def _parameters(found: Any) -> dict[str, inspect.Parameter]:
    """The parameters of a function or class; those of `__init__` if `__new__` takes any."""
    try:
        known = dict(inspect.signature(found).parameters)
    except (TypeError, ValueError):
        return {}
    several = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    if inspect.isclass(found) and known and all(each.kind in several for each in known.values()):
        known = dict(inspect.signature(found.__init__).parameters)
        known.pop("self")
    return known


def _signature(found: Any) -> str:
    """The parameters of a function or class with their defaults, without types."""
    try:
        inspect.signature(found)
    except (TypeError, ValueError):
        return ""
    words, keyword = [], False
    for each in _parameters(found).values():
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


class Name(NamedTuple):
    """A name on docs/api.md.

    Attributes:
        section: Heading above it.
        kind: Its directive without "auto": "class", "function", "exception", "method" or "data".
        short: Full name without the package's.
        found: The object; None if the page describes it itself.
        text: Description on the page; empty for an object with a docstring.
    """

    section: str
    kind: str
    short: str
    found: Any
    text: str = ""

    @property
    def head(self) -> str:
        """Kind, if it is not obvious, and name: a heading of docs/reference.md."""
        return f"{_KINDS.get(self.kind, '')}`{self.short}`"

    @property
    def call(self) -> str:
        """The name with its parameters."""
        plain = self.found is None or self.kind == "exception"
        enum = inspect.isclass(self.found) and issubclass(self.found, Enum)
        return self.short if plain or enum else self.short + _signature(self.found)

    @property
    def link(self) -> str:
        """Anchor of its heading on docs/reference.md."""
        return re.sub(r"[^\w\- ]", "", self.head.lower()).replace(" ", "-")


def listed() -> Iterator[Name]:
    """All names on docs/api.md, in its order; methods that it names follow their class."""
    module, section, last = PACKAGE, "", Name("", "", "", None)
    api = (DOCS / "api.md").read_text(encoding="utf-8")
    for line in api.splitlines():
        if line.startswith("## "):
            section = line
        if members := re.match(r" +:members: (.+)", line):
            for each in members[1].split(", "):
                yield Name(section, "method", f"{last.short}.{each}", getattr(last.found, each))
        if not (found := re.match(r"\.\. (?:py:)?(\w+):: ([\w.]+)", line)):
            continue
        kind, name = found.groups()
        full = name if name.startswith(PACKAGE) else f"{module}.{name}"
        short = full.removeprefix(f"{PACKAGE}.")
        if kind == "currentmodule":
            module = name
        elif kind == "automodule":
            functions = importlib.import_module(name)
            for each in functions.__all__:
                yield Name(section, "function", f"{short}.{each}", getattr(functions, each))
        elif kind in ("data", "function"):
            text = re.search(rf"^\.\. py:{kind}:: {re.escape(name)}.*\n\n +(.*)", api, re.M)
            assert text, name
            yield Name(section, kind, short, None, text[1])
        elif kind.startswith("auto"):
            where, _, own = full.rpartition(".")
            there = getattr(importlib.import_module(where), own)
            last = Name(section, kind.removeprefix("auto"), short, there)
            yield last


def _summary(name: Name) -> str:
    """A row of a table of names: signature, linked to its entry, and first paragraph."""
    paragraph = name.text or (inspect.getdoc(name.found) or "").partition("\n\n")[0]
    first = " ".join(paragraph.split()).replace("|", "\\|")
    return f"| {_KINDS.get(name.kind, '')}[`{name.call}`](#{name.link}) | {first} |"


def reference() -> str:
    """The docstrings of all names on docs/api.md, with parameters and fields as tables.

    Each section begins with a table of its names.
    """
    lines = [
        "# Reference",
        "",
        "The documentation of every public name; each section begins with a list of its names.",
        "They are attributes of `gym_passive_walker`, which is usually imported as `gpw`.",
        "Strides, gaits and analyses are in the walker's own units: metres, seconds and kilograms,",
        "or another consistent set. Environments, rewards and policies are dimensionless, in leg",
        "lengths l, masses m and sqrt(l/g). Angles are in rad. Entries say where units differ.",
        "",
        "*`make docs` writes this page from the docstrings.*",
    ]
    for section, group in groupby(listed(), lambda name: name.section):
        entries = [*group]
        lines += ["", section, "", "| name | description |", "|---|---|"]
        lines += [_summary(name) for name in entries]
        for name in entries:
            lines += ["", f"### {name.head}", ""]
            if name.text:
                lines.append(name.text)
                continue
            if name.call != name.short:
                lines += ["```text", name.call, "```", ""]
            lines += _described(name)
    return "\n".join(lines) + "\n"


def _described(name: Name) -> list[str]:
    """The docstring of a name in Markdown."""
    lines: list[str] = []
    text = _CROSS.sub(r"`\1`", inspect.getdoc(name.found) or "")
    for part in re.split(r"\n\n(?=\S)", text):
        title, _, rest = part.partition("\n")
        body = inspect.cleandoc(rest)
        if title in ("Args:", "Attributes:"):
            lines += _table(name.found, title[:-1], body)
        elif title in ("Example:", "Examples:"):
            lines += ["```pycon", body, "```"]
        elif title in ("Raises:", "Yields:", "Returns:"):
            lines += [f"**{title[:-1]}**", ""]
            errors = _entries(body) if title == "Raises:" else []
            lines += [f"- `{error}`: {why}" for error, why in errors] or [body]
        else:
            lines.append(part)
        lines.append("")
    lines += _members(name)
    if inspect.isclass(name.found) and issubclass(name.found, Enum):
        lines += [f"`{'`, `'.join(each.name for each in name.found)}`", ""]
    return lines[:-1]


def _members(name: Name) -> list[str]:
    """A table of the properties and methods of a class, with their first paragraphs."""
    if name.kind != "class":
        return []
    kinds = (property, cached_property, FunctionType, classmethod)
    rows = []
    for own, member in vars(name.found).items():
        text = (inspect.getdoc(member) or "").partition("\n\n")[0]
        if not own.startswith("_") and isinstance(member, kinds) and text:
            bound = "" if isinstance(member, kinds[:2]) else _signature(getattr(name.found, own))
            call = re.sub(r"^\(self(?:, )?", "(", bound)
            text = " ".join(text.split()).replace("|", "\\|")
            rows.append(f"| `{own}{call}` | {text} |")
    if (drawn := picture.dispatch(name.found)) is not picture.dispatch(object):
        options = _signature(drawn).partition(", ")[2]  # after the object
        text = " ".join((inspect.getdoc(drawn) or "").partition("\n\n")[0].split())
        entry = next(each for each in listed() if each.short.endswith("Shown.plot"))
        rows.append(f"| [`plot({options}`](#{entry.link}) | {text} |")
    head = ["| property or method | meaning |", "| --- | --- |"]
    return [*head, *rows, ""] if rows else []


def _entries(body: str) -> list[tuple[str, str]]:
    """Names and descriptions of a section of a docstring."""
    parts = re.split(r"^(\**[\w., ]+): ", re.sub(r"\n +", " ", body), flags=re.M)[1:]
    return [(key, " ".join(parts[2 * i + 1].split())) for i, key in enumerate(parts[::2])]


def _table(found: Any, title: str, body: str) -> list[str]:
    """Parameters or fields of a name, a row for each."""
    known, own = _parameters(found), found is Walker
    columns = ["parameter" if title == "Args" else "field", "default", "meaning"]
    if own:
        columns[1:1] = ["unit", "randomized", "observed"]
    rows = [columns, ["---"] * len(columns)]
    for key, text in _entries(body):
        default = getattr(known.get(key.strip("*")), "default", inspect.Parameter.empty)
        given = default is not inspect.Parameter.empty
        shown = f"`{_default(default)}`".replace("|", "\\|") if given else "required" * own
        row = [f"`{key}`", shown, text.replace("|", "\\|")]
        if own:
            row[1:1] = _of_walker(key)
        rows.append(row)
    if all(not row[-2] for row in rows[2:]):
        rows = [[*row[:-2], row[-1]] for row in rows]
    return [f"| {' | '.join(row)} |" for row in rows]


def _of_walker(parameter: str) -> list[str]:
    """Unit of a parameter of a walker, whether it can be randomized, and how it is observed."""
    if parameter not in PARAMETERS:
        return ["", "", ""]
    kind = KINDS[parameter]
    observed = f"over {UNITS[kind][0]}" if parameter in PROPORTIONS else ""
    return [_SI[kind], "yes", "in rad" if kind == "angle" else observed]


def cells(notebook: Path) -> list[tuple[str, str]]:
    """Kinds ("markdown", "code") and texts of the cells of a notebook in MyST."""
    parts = _FENCE.split(notebook.read_text(encoding="utf-8").split("---\n", 2)[2])
    kinds = ("markdown", "code")
    both = [(kinds[i % 2], part.strip("\n")) for i, part in enumerate(parts)]
    return [(kind, part) for kind, part in both if part]


def _is_timed(output: dict) -> bool:
    widget = "application/vnd.jupyter.widget-view+json"
    return output.get("name") == "stderr" or widget in output.get("data", {})


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
    # When a cell's text comes in pieces depends on the machine, and so do times: those on stderr,
    # and those of progress bars, which are widgets.
    client = NotebookClient(
        book, timeout=600, resources=where, coalesce_streams=True, store_widget_state=False
    )
    client.execute()
    for cell in book.cells:
        cell.metadata.clear()
        if "outputs" in cell:
            cell.outputs = [each for each in cell.outputs if not _is_timed(each)]
        for output in cell.get("outputs", ()):
            if "image/png" in (data := output.get("data", {})):
                data.pop("text/html", None)  # the picture is enough
    return json.dumps(book, indent=1, ensure_ascii=False, sort_keys=True) + "\n"


def main() -> int:
    """Write the pages and the notebooks."""
    books = {path.stem: path for path in sorted((DOCS / "notebooks").glob("*.md"))}
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=DOCS, metavar="FOLDER", help="default: docs")
    parser.add_argument(
        "--notebooks", nargs="*", choices=[*books], default=[*books], metavar="NAME",
        help="notebooks to execute; all by default, none if no name follows",
    )  # fmt: skip
    arguments = parser.parse_args()
    (arguments.out / "notebooks").mkdir(parents=True, exist_ok=True)
    for make in (environment, commands, reference):
        page, text = arguments.out / f"{make.__name__}.md", make()
        if not page.exists() or page.read_text(encoding="utf-8") != text:  # lint may be reading it
            page.write_text(text, encoding="utf-8")
    os.environ["MPLBACKEND"] = "module://matplotlib_inline.backend_inline"
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # each waits for a process of its own
        texts = pool.map(run, map(books.__getitem__, arguments.notebooks))
        for name, text in zip(arguments.notebooks, texts, strict=True):
            target = arguments.out / "notebooks" / f"{name}.ipynb"
            target.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
