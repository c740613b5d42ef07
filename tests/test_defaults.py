"""Arguments have the names, defaults and help that they had, in `tests/defaults.txt`.

python -m tests.test_defaults     Write the file again, for arguments that were meant to change.

Those are of public functions of the package, public functions and classes of `agents`, and commands
of `train.py`. docs/commands.md has those of `passive-walker`.
"""

import argparse
import inspect
import pkgutil
from collections.abc import Iterator
from contextlib import redirect_stderr, suppress
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from io import StringIO
from pathlib import Path
from typing import Any

import pytest

FILE = Path(__file__).with_name("defaults.txt")
ROOT = Path(__file__).parents[1]


def signatures() -> Iterator[str]:
    """Calls of all public functions with their defaults."""
    import agents

    spec: Any = spec_from_file_location("render", ROOT / "docs" / "render.py")
    render = module_from_spec(spec)
    spec.loader.exec_module(render)
    yield from (name.call for name in render.listed())
    for name in sorted(each.name for each in pkgutil.iter_modules(agents.__path__)):
        if name == "rllib":  # Ray need not be there
            continue
        module = import_module(f"agents.{name}")
        for own, found in sorted(vars(module).items()):
            public = inspect.isfunction(found) or inspect.isclass(found)
            if public and found.__module__ == module.__name__ and not own.startswith("_"):
                yield f"agents.{name}.{own}{render._signature(found)}"


def options() -> Iterator[str]:
    """Arguments of each command of `train.py`."""
    import train
    from agents.commands import COMMANDS

    found: list[argparse.ArgumentParser] = []

    def parsed(self: argparse.ArgumentParser, *_: Any) -> None:
        found.append(self)
        raise SystemExit

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(argparse.ArgumentParser, "parse_args", parsed)
        for words in ([], *([command] for command in COMMANDS)):
            with suppress(SystemExit), redirect_stderr(StringIO()):
                train.main(words)
    for parser in found:
        yield f"{parser.prog}: {' '.join((parser.description or '').split())}"
        for each in parser._actions[1:]:  # not --help
            named = " ".join(each.option_strings) or each.dest
            kind = getattr(each.type, "__name__", None)
            choices = None if each.choices is None else " ".join(map(str, each.choices))
            about = parser._get_formatter()._expand_help(each) if each.help else ""
            yield f"  {named} {each.nargs} {kind} {each.default} {each.const} [{choices}]: {about}"


def lines() -> list[str]:
    return [*signatures(), *options()]


def test_arguments_have_the_defaults_and_the_help_that_they_had() -> None:
    for library in ("stable_baselines3", "rsl_rl", "skrl", "torchrl", "anywidget"):
        pytest.importorskip(library)
    before = FILE.read_text("utf-8").splitlines()
    again = "run python -m tests.test_defaults if it was meant"
    for old, new in zip(before, lines(), strict=True):
        assert old == new, again


if __name__ == "__main__":
    FILE.write_text("\n".join(lines()) + "\n", "utf-8")
