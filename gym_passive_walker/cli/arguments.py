"""What commands ask for: walkers, slopes, gaits."""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.gaits.drive import Drive
from gym_passive_walker.gaits.fixed_point import find_gait
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.gaits.terrain import EXAMPLES, Terrain, terrain_from
from gym_passive_walker.walkers import WALKERS, Walker, as_walker, tune

A_WALKER = (
    f"{', '.join(WALKERS)}, or a JSON, YAML or TOML file of your own walker's parameters, such as "
    '{"preset": "C", "hip_mass": 1.0}'
)
"""What a walker is, to a command."""


def a_walker(text: str) -> Walker:
    """As `as_walker`, for parsers, which say what is wrong beside the argument's name."""
    try:
        return as_walker(text)
    except (ValueError, ImportError) as error:
        raise ArgumentTypeError(str(error)) from None


def a_terrain(text: str) -> Terrain:
    """As `terrain_from`, for parsers."""
    try:
        return terrain_from(text)  # type: ignore[return-value]
    except (ValueError, ImportError) as error:
        raise ArgumentTypeError(str(error)) from None


def add_terrain(command: ArgumentParser) -> None:
    """Ask for the ground."""
    about = f"{EXAMPLES}, or a mapping as JSON or in a file (smooth ground)"
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


def add_drive(command: ArgumentParser) -> None:
    """Ask for the walker's motors; `drive_of` returns them."""
    add = command.add_argument
    about = "{}, in every stride, in {} (%(default)s)"
    add("--torque", type=float, default=0.0, metavar="T", help=about.format("hip torque", "N m"))
    add("--ankle-torque", type=float, default=0.0, metavar="T",
        help=about.format("ankle torque, on point feet", "N m"))  # fmt: skip
    add("--push-off", type=float, default=0.0, metavar="P",
        help=about.format("impulse along the stance leg before heelstrike", "N s"))  # fmt: skip


def drive_of(arguments: Namespace) -> Drive:
    """The motors that were asked for."""
    return Drive(arguments.torque, arguments.ankle_torque, arguments.push_off)


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
