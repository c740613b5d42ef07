"""What commands ask for: walkers, slopes, gaits."""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.control.baselines import BASELINES
from gym_passive_walker.control.maps import stride_map
from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.gaits.fixed_point import find_gait
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.gaits.stride_map import StrideMap
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


def add_motors(command: ArgumentParser, *, push_off: bool = True) -> None:
    """Ask for what works the walker's motors; `map_of` returns the stride map."""
    add = command.add_argument
    about = "{}, in every stride, in {} (%(default)s)"
    add("--torque", type=float, default=0.0, metavar="T", help=about.format("hip torque", "N m"))
    add("--ankle-torque", type=float, default=0.0, metavar="T",
        help=about.format("ankle torque, on point feet", "N m"))  # fmt: skip
    if push_off:
        what = about.format("impulse along the stance leg before heelstrike", "N s")
        add("--push-off", type=float, default=0.0, metavar="P", help=what)
    add_controller(command)


def add_controller(command: ArgumentParser) -> None:
    """Ask for a controller; `map_of` returns the stride map."""
    command.add_argument(
        "--controller", metavar="NAME", help="what works the motors: a feedback "
        f"({', '.join(BASELINES)}), a trained policy or its folder"
    )  # fmt: skip
    command.add_argument(
        "--scene", metavar="SCENE", help="in which a controller acts (its own, or level)"
    )


def map_of(arguments: Namespace, slope: float | None = None) -> StrideMap:
    """The stride map of the walker, its motors or its controller that were asked for.

    Raises:
        ValueError: if there are both motors and a controller.
    """
    parts = (getattr(arguments, name, 0.0) for name in ("torque", "ankle_torque", "push_off"))
    held, walker = Actuation(*parts), walker_of(arguments)
    if arguments.controller is None:
        return stride_map(walker, slope, controller=None if held.passive else held)
    if not held.passive:
        raise ValueError("--controller works the motors: leave torques and the push-off out")
    return stride_map(walker, slope, controller=arguments.controller, scene=arguments.scene)


def gait_of(arguments: Namespace) -> Gait:
    """The gait of the walker, slope and kind that were asked for.

    Raises:
        GaitNotFound: if there is none.
    """
    return find_gait(map_of(arguments, arguments.slope), kind=arguments.kind)


def add_walk(command: ArgumentParser, *, strides: int) -> None:
    """Ask for a walk."""
    add_walker(command)
    add_slope(command)
    add_kind(command)
    add = command.add_argument
    add("--strides", type=int, default=strides, metavar="N", help="at most (%(default)s)")
    add("--state", type=float, nargs=6, metavar="X", help="stance, thigh and shank angle in rad, "
        "then their rates in rad/s, just after heelstrike (those of the gait)")  # fmt: skip
    add_motors(command)
    add_terrain(command)
    add(
        "--terrain-seed",
        type=int,
        default=0,
        metavar="N",
        help="which ground at random (%(default)s)",
    )


def start_of(arguments: Namespace) -> NDArray[np.float64]:
    """Where a walk starts: at the state that was asked for, or on the gait."""
    if arguments.state is not None:
        return np.array(arguments.state)
    walks = map_of(arguments, arguments.slope)
    # Motors that are held push a walker off its passive gait, and it is looked at as it goes.
    passive = walker_of(arguments) if not walks.controlled else walks
    return find_gait(passive, arguments.slope, kind=arguments.kind).state
