"""The command line `passive-walker`: walkers, gaits, walks and pictures without writing Python.

A command is a function in one of these modules. Its signature makes its arguments, and it returns
its report. Its docstring is its help: a summary line, then examples. `COMMANDS` lists all commands.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from textwrap import dedent, indent

from gym_passive_walker._tools import console
from gym_passive_walker._version import __version__
from gym_passive_walker.apps.cli.arguments import Parser, add_arguments, call_with
from gym_passive_walker.apps.cli.disturbances import gauntlet, robustness
from gym_passive_walker.apps.cli.gaits import (
    basin,
    bifurcation,
    check,
    family,
    gait,
    table,
    walkers,
)
from gym_passive_walker.apps.cli.pictures import figures, play, strobe, video
from gym_passive_walker.apps.cli.report import plain
from gym_passive_walker.apps.cli.sweeps import sweep
from gym_passive_walker.apps.cli.walks import compare, evaluate, export, scene, simulate
from gym_passive_walker.apps.cli.warmup import warmup
from gym_passive_walker.gaits.gait import GaitNotFound

COMMANDS = (
    walkers, gait, family, bifurcation, basin, check, robustness, gauntlet, sweep, scene, simulate,
    strobe, video, figures, table, evaluate, compare, export, play, warmup,
)  # fmt: skip
"""All commands; each has the name of its function."""

_PROGRAM = "passive-walker"


def parser() -> argparse.ArgumentParser:
    """The parser of the command line, with all commands."""
    top = Parser(prog=_PROGRAM, description="Passive walkers and their gaits.")
    version = f"{_PROGRAM} {__version__}"
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
        add_arguments(below, command)
        below.set_defaults(command=command, by_option=below.by_option)
        below.add_argument("--json", action="store_true", help="print JSON, for programs")
    return top


def main(words: Sequence[str] | None = None) -> int:
    """Run a command; invalid input prints a sentence instead of a traceback.

    Args:
        words: Arguments after the program's name; those of `sys.argv` if None.

    Returns:
        The exit status: 0 on success; 1 if no gait is found; 2 if the input is invalid or a file
        cannot be written; 130 after Ctrl-C.
    """
    refusals = {GaitNotFound: 1, ValueError: 2, ImportError: 2, OSError: 2}
    return console.run(lambda: _command(words), refusals=refusals)


def _command(words: Sequence[str] | None) -> None:
    """Print the report of a command, and write its files."""
    top = parser()
    arguments = top.parse_args(words)
    if "command" not in arguments:
        top.print_help()
        return
    try:
        report = call_with(arguments.command, arguments)
    except (GaitNotFound, ValueError) as error:
        error.args = (arguments.by_option(str(error)), *error.args[1:])
        raise
    print(json.dumps(plain(report.data)) if arguments.json else report.text, flush=True)
    for path, write in report.files.items():
        write(path)
        if not arguments.json:
            print(f"\nsaved {path}")
    report.then()
