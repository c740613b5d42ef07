"""The first examples of libraries, as their own packages have them, with a walker in them.

An example is read from the installed package: from the description that its index shows, from a
docstring or from a file. So it is the example of the version that is tested.
"""

from __future__ import annotations

import doctest
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from importlib.metadata import metadata
from pathlib import Path

NAME = "gym_passive_walker:PassiveWalker-v0"


def _blocks(text: str) -> Iterator[str]:
    """Blocks of Python code in Markdown."""
    for found in re.finditer(r"^( *)```+ *python[^\n]*\n(.*?)^\1```", text, re.M | re.S):
        yield "\n".join(line.removeprefix(found[1]) for line in found[2].splitlines())


def described(package: str, word: str) -> str:
    """The first example with a word in a package's description."""
    data = metadata(package)
    text = data.get_payload() or data["Description"]
    return next(block for block in _blocks(str(text)) if word in block)


def documented(place: str, *words: str) -> str:
    """The lines from one with a word to one with another in a docstring, "module:name"."""
    module, name = place.split(":")
    text = getattr(import_module(module), name).__doc__
    lines = [each.source for each in doctest.DocTestParser().get_examples(text)]
    first, last = (next(i for i, line in enumerate(lines) if word in line) for word in words)
    return "".join(lines[first : last + 1])


def with_walker(example: str, changes: Mapping[str, str]) -> str:
    """An example with an environment's name, or a length of training, instead of its own."""
    for old, new in changes.items():
        assert old in example, f"the example has no {old!r} any more:\n{example}"
        example = example.replace(old, new)
    assert NAME in example
    return example


def run(example: str, folder: Path) -> str:
    """Run an example in a process of its own, in a folder; return what it prints."""
    script = folder / "example.py"
    script.write_text(example, encoding="utf-8")
    return _run(folder, str(script))


def run_module(module: str, folder: Path, *arguments: str) -> str:
    """Run a module's command line in a folder; return what it prints."""
    return _run(folder, "-m", module, *arguments)


def _run(folder: Path, *command: str) -> str:
    quiet = {"SDL_VIDEODRIVER": "dummy", "MPLBACKEND": "Agg"}
    done = subprocess.run(
        [sys.executable, *command], cwd=folder, env=os.environ | quiet, check=False,
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, f"{done.stdout[-2000:]}\n{done.stderr[-6000:]}"
    return done.stdout
