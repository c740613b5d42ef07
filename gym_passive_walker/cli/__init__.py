"""The command line: walkers, their gaits, walks and pictures, without writing Python.

A command is a function in one of these modules: it takes a parser, asks it for what it needs, and
returns what to do with the answers. Its docstring is its help: a line, and examples. `COMMANDS`
lists them all.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from textwrap import dedent, indent
from typing import NoReturn

import gym_passive_walker
from gym_passive_walker import console
from gym_passive_walker.cli.gaits import basin, bifurcation, check, family, gait, walkers
from gym_passive_walker.cli.pictures import figures, play, strobe, video
from gym_passive_walker.cli.report import plain
from gym_passive_walker.cli.sweeps import sweep
from gym_passive_walker.cli.tries import robustness
from gym_passive_walker.cli.walks import evaluate, scene, simulate
from gym_passive_walker.cli.warmup import warmup
from gym_passive_walker.gaits.gait import GaitNotFound

COMMANDS = (
    walkers, gait, family, bifurcation, basin, check, robustness, sweep, scene, simulate, strobe,
    video, figures, evaluate, play, warmup,
)  # fmt: skip
"""What the command line can do, by the functions' names."""

_PROGRAM = "passive-walker"


class _Parser(argparse.ArgumentParser):
    """A parser that says in one sentence what it did not understand."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"error: {message} (see {self.prog} --help)\n")


def parser() -> argparse.ArgumentParser:
    """What the command line understands."""
    top = _Parser(prog=_PROGRAM, description="Passive walkers and their gaits.")
    version = f"{_PROGRAM} {gym_passive_walker.__version__}"
    top.add_argument("--version", action="version", version=version)
    commands = top.add_subparsers(metavar="COMMAND", title="commands")
    for command in COMMANDS:
        summary, _, examples = (command.__doc__ or "").partition("\n\n")
        below = commands.add_parser(
            command.__name__,
            help=summary[0].lower() + summary[1:].rstrip("."),
            description=summary,
            epilog="examples:\n" + indent(dedent(examples), "  ").rstrip(),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        below.set_defaults(run=command(below))
        below.add_argument("--json", action="store_true", help="print JSON, for programs")
    return top


def main(words: Sequence[str] | None = None) -> int:
    """Run a command; bad input ends with a sentence, not a traceback.

    Args:
        words: What stands behind the program's name; `sys.argv` if None.

    Returns:
        The exit status: 0; 1 where there is no such gait; 2 where the input is at fault or a file
        cannot be written; 130 after Ctrl-C.
    """
    refusals = {GaitNotFound: 1, ValueError: 2, ImportError: 2, OSError: 2}
    return console.run(lambda: _command(words), refusals=refusals)


def _command(words: Sequence[str] | None) -> None:
    """Print what a command found, and write its files."""
    top = parser()
    arguments = top.parse_args(words)
    if "run" not in arguments:
        top.print_help()
        return
    report = arguments.run(arguments)
    print(json.dumps(plain(report.data)) if arguments.json else report.text, flush=True)
    for path, write in report.files.items():
        write(path)
        if not arguments.json:
            print(f"\nsaved {path}")
