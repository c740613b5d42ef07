"""What commands ask for: walkers, slopes, gaits."""

from __future__ import annotations

import json
import re
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.console import cut
from gym_passive_walker.envs.scene import walker_from
from gym_passive_walker.gaits.fixed_point import find_gait
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.gaits.terrain import Terrain, terrain_from
from gym_passive_walker.walkers import WALKERS, Walker, WalkerError, tune

A_WALKER = f"{', '.join(WALKERS)}, or a JSON or YAML file of your own walker's parameters"
"""What a walker is, to a command."""

_TERRAIN = "rough:height_std=0.002, stairs:rise=-0.01 or waves:height=0.01,strides=6"
_ARGUMENT = re.compile(r"(\w+)=(\[[^\]]*\]|[^,\[\]]+)(?:,|$)")  # a name and a number, or a list

_YAML = (".yaml", ".yml")
_FLOAT = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)[eE][-+]?\d+$")


def read_walker(text: str) -> Walker:
    """A walker by a preset's name, or from a JSON or YAML file of its parameters.

    A file holds parameters of `Walker` by name, in metres, kilograms, seconds and rad; all of
    them that have no default, or those that differ from a preset that it names as "preset".

    Raises:
        WalkerError: if there is no such preset or file, or it describes no walker.
        ImportError: if it is YAML and pyyaml is not installed.
    """
    path = Path(text)
    if path.suffix not in (".json", *_YAML):
        if text in WALKERS:
            return WALKERS[text]
        raise WalkerError(
            f"no walker {cut(text)!r}: choose from {', '.join(WALKERS)}, or give a JSON or YAML "
            "file of your own walker's parameters"
        )
    try:
        parameters = read_content(path)
    except ValueError as error:
        raise WalkerError(str(error)) from None
    if not isinstance(parameters, dict):
        raise WalkerError(f"{text} must name a walker's parameters, as in " + '{"preset": "lab"}')
    try:
        return walker_from(parameters)
    except WalkerError as error:
        raise WalkerError(f"{text}: {error}") from None


def read_content(path: Path) -> Any:
    """What is written in a JSON or YAML file.

    Raises:
        ValueError: if it cannot be read.
        ImportError: if it is YAML and pyyaml is not installed.
    """
    try:
        content = path.read_text(encoding="utf-8")
        return _yaml(str(path), content) if path.suffix in _YAML else json.loads(content)
    except OSError as error:
        raise ValueError(f"{cut(str(path))} cannot be read: {error.strerror}") from None
    except (RecursionError, ValueError) as error:
        raise ValueError(f"{cut(str(path))} cannot be read: {error}") from None


def _yaml(name: str, content: str) -> Any:
    try:
        import yaml
    except ImportError:
        raise ImportError(
            f"{name} needs pyyaml, which is not installed: pip install pyyaml, or write it as JSON"
        ) from None
    try:

        class Loader(yaml.SafeLoader):
            """YAML 1.1, and its numbers as YAML 1.2 and people write them: 2e-1, 1e6."""

        Loader.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list("-+0123456789."))
        return yaml.load(content, Loader)
    except yaml.YAMLError as error:
        raise ValueError(" ".join(str(error).split())) from None


def a_walker(text: str) -> Walker:
    """As `read_walker`, for parsers, which say what is wrong beside the argument's name."""
    try:
        return read_walker(text)
    except (ValueError, ImportError) as error:
        raise ArgumentTypeError(str(error)) from None


def read_terrain(text: str) -> Terrain:
    """Ground that is not smooth.

    Args:
        text: Its kind and arguments, as "rough:height_std=0.002,slope_std=0.01"; a mapping as
            scenes take it, as JSON; or a JSON or YAML file of such a mapping.

    Raises:
        ValueError: if it describes none.
        ImportError: if it is YAML and pyyaml is not installed.
    """
    path = Path(text)
    if text.lstrip().startswith("{"):
        try:
            given = json.loads(text)
        except ValueError as error:
            raise ValueError(f"{text} is no JSON: {error}") from None
    elif path.suffix in (".json", *_YAML):
        given = read_content(path)
    else:
        name, _, rest = text.partition(":")
        if _ARGUMENT.sub("", rest):
            raise ValueError(
                f"a terrain is written as {_TERRAIN}, or as a mapping in JSON, not {text!r}"
            )
        try:
            given = {name: {key: json.loads(value) for key, value in _ARGUMENT.findall(rest)}}
        except ValueError:
            raise ValueError(f"terrain {name} takes numbers, not {rest!r}") from None
    if given is None:
        raise ValueError(f"{text} describes no terrain")
    return terrain_from(given)  # type: ignore[return-value]


def a_terrain(text: str) -> Terrain:
    """As `read_terrain`, for parsers."""
    try:
        return read_terrain(text)
    except (ValueError, ImportError) as error:
        raise ArgumentTypeError(str(error)) from None


def add_terrain(command: ArgumentParser) -> None:
    """Ask for the ground."""
    about = f"{_TERRAIN}, or a mapping as JSON or in a file (smooth ground)"
    command.add_argument("--terrain", type=a_terrain, metavar="GROUND", help=about)


def add_walker(command: ArgumentParser) -> None:
    """Ask for a walker; `walker_of` gives it."""
    command.add_argument("walker", type=a_walker, metavar="WALKER", help=A_WALKER)
    command.add_argument(
        "--tune", action="store_true", help="first meet the conditions for walking at slope 0"
    )


def walker_of(arguments: Namespace) -> Any:
    """The walker that was asked for."""
    return tune(arguments.walker) if arguments.tune else arguments.walker


def add_slope(command: ArgumentParser) -> None:
    """Ask for a slope."""
    command.add_argument("slope", type=float, metavar="SLOPE", help="in rad, downhill")


def add_slopes(command: ArgumentParser) -> None:
    """Ask for a range of slopes."""
    command.add_argument("low", type=float, metavar="LOW", help="lowest slope in rad, above 0")
    command.add_argument("high", type=float, metavar="HIGH", help="highest slope in rad")


def add_kind(command: ArgumentParser) -> None:
    """Ask which of a slope's gaits is meant."""
    command.add_argument(
        "--kind", choices=("long", "short"), default="long", help="which gait (%(default)s step)"
    )


def gait_of(arguments: Namespace) -> Gait:
    """The gait of the walker, slope and kind that were asked for.

    Raises:
        GaitNotFound: if there is none.
    """
    return find_gait(walker_of(arguments), arguments.slope, arguments.kind)


def add_walk(command: ArgumentParser, *, strides: int) -> None:
    """Ask for a walk."""
    add_walker(command)
    add_slope(command)
    add_kind(command)
    add = command.add_argument
    add("--strides", type=int, default=strides, metavar="N", help="at most (%(default)s)")
    add("--state", type=float, nargs=6, metavar="X", help="stance, thigh and shank angle in rad, "
        "then their rates in rad/s, just after heelstrike (those of the gait)")  # fmt: skip
    add("--torque", type=float, default=0.0, help="held at the hip, in N m (%(default)s)")
    add_terrain(command)
    add("--key", type=int, default=0, metavar="N", help="which ground at random (%(default)s)")


def start_of(arguments: Namespace) -> NDArray[np.float64]:
    """Where a walk starts: at the state that was asked for, or on the gait."""
    return gait_of(arguments).state if arguments.state is None else np.array(arguments.state)
