"""The walkers of Garcia (1999), chapter 4, and the forms in which functions accept a walker."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias, TypeGuard

from gym_passive_walker._tools.arguments import near, shown
from gym_passive_walker._tools.console import cut
from gym_passive_walker._tools.loading import SUFFIXES, is_file, read_content
from gym_passive_walker.models.model import Model
from gym_passive_walker.models.walkers.walker import Walker, WalkerError


def _point_foot(foot_mass: float, hip_mass: float, foot_radius: float = 0.0) -> Walker:
    """A straight-legged walker of point masses: at the hip, and at the bottom of each foot."""
    return Walker(
        thigh_length=0.5,
        thigh_mass=0.5 * hip_mass,
        shank_length=0.5,
        shank_mass=foot_mass,
        shank_com=0.5,
        foot_radius=foot_radius,
        knees=False,
    )


_LAB = Walker(
    thigh_length=0.35,
    thigh_offset=0.0,
    thigh_mass=2.345,
    thigh_gyration=0.099,
    thigh_com=0.091,
    shank_length=0.46,
    shank_offset=0.025,
    shank_mass=1.013,
    shank_gyration=0.197,
    shank_com=0.17,
    foot_radius=0.2,
    foot_angle=0.097,
)

_TUNED = replace(
    _LAB,
    thigh_offset=-0.023,
    thigh_gyration=0.1882,
    thigh_com=0.084,
    shank_offset=0.022,
    shank_gyration=0.1226,
)

WALKERS: dict[str, Walker] = {
    "A": replace(_TUNED, knees=False),
    "B": _point_foot(foot_mass=0.1, hip_mass=0.8, foot_radius=0.2),
    "C": _TUNED,
    "D": Walker(
        thigh_length=0.5,
        thigh_mass=0.0,
        shank_length=0.5,
        shank_mass=0.0,
        hip_mass=1.0,
        knees=False,
    ),
    "E": _point_foot(foot_mass=0.1, hip_mass=0.8),
    "F": _point_foot(foot_mass=0.05, hip_mass=0.9),
    "lab": _LAB,
    "lab-straight": replace(_LAB, knees=False),
}
"""The walkers of Garcia (1999), chapter 4: A to E of Table 4.1, F of Fig. 4.5, and the laboratory's
walker of Fig. 4.3 with its knees free and locked."""

ABOUT: dict[str, str] = {
    "A": "straight legs with round feet, masses as the laboratory's walker; tuned",
    "B": "straight legs with round feet, point masses at hip and feet; tuned",
    "C": "knees, round feet, masses near those of the laboratory's walker; tuned",
    "D": "the simplest walker: straight legs without mass, point feet, all mass at the hip",
    "E": "straight legs, point feet, point masses: 0.1 at each foot, 0.8 at the hip",
    "F": "as E with lighter feet: 0.05 at each foot, 0.9 at the hip",
    "lab": "the laboratory's machine as it was built: knees, round feet, not tuned",
    "lab-straight": "the laboratory's machine with its knees locked",
}
"""Descriptions of the `WALKERS` by name. Tuned walkers may walk at vanishing slope (`tune`)."""


WalkerLike: TypeAlias = Model | str | Mapping[str, Any] | PathLike[str]
"""The forms in which functions accept a walker; see `as_walker`."""


def is_walker(value: Any) -> TypeGuard[WalkerLike]:
    """Whether a value is a walker, the name of a preset, or a file that is not a policy."""
    if isinstance(value, Walker | Mapping | Model):
        return True
    return (isinstance(value, str) and value in WALKERS) or (
        is_file(value)
        and not os.path.isdir(value)
        and Path(value).suffix.lower() not in (".onnx", ".zip")  # policies
    )


def as_walker(walker: WalkerLike) -> Walker:
    """Return a walker from any form in which functions accept it.

    Args:
        walker: A `Walker`, or a `System`; the name of a preset, one of `WALKERS`; a mapping of
            parameters of `Walker`; or the path of a JSON, YAML or TOML file of such a mapping. A
            mapping has all parameters without a default, or names a preset to change, as
            ``{"preset": "C", "foot_radius": 0.25}``. It may have a "title", the name of the walker
            in messages and pictures. The title of a file is its name without the ending.

    Raises:
        WalkerError: if there is no such preset or file, or the parameters are invalid.
        ImportError: if the file is YAML and pyyaml is not installed.
    """
    if isinstance(walker, Walker):
        return walker
    if isinstance(walker, Mapping):
        return _of_parameters(walker)
    if isinstance(walker, str) and walker in WALKERS:
        return WALKERS[walker]
    if is_file(walker):
        return _of_file(walker)
    if isinstance(walker, Model):
        return walker  # type: ignore[return-value]
    raise WalkerError(
        f"no walker {shown(walker)}{near(walker, WALKERS)}: give a Walker, one of the names "
        f"{', '.join(WALKERS)}, a mapping of parameters, or a file of them ({', '.join(SUFFIXES)})"
    )


def _of_parameters(given: Mapping[str, Any]) -> Walker:
    parameters = dict(given)
    preset, title = parameters.pop("preset", None), parameters.pop("title", "")
    if preset is not None and not (isinstance(preset, str) and preset in WALKERS):
        raise WalkerError(f"no preset {shown(preset)}: choose from {', '.join(WALKERS)}")
    if not isinstance(title, str):
        raise WalkerError(f"a walker's title must be text, not {shown(title)}")
    try:
        made = Walker(**parameters) if preset is None else replace(WALKERS[preset], **parameters)
    except TypeError as error:
        raise WalkerError(
            f"no walker {shown(dict(given))}: {error}; change a preset, one of "
            f'{", ".join(WALKERS)}, as in {{"preset": "lab", "foot_radius": 0.25}}'
        ) from None
    return made.titled(title) if title else made


def _of_file(path: str | PathLike[str]) -> Walker:
    name = cut(os.fsdecode(path))
    try:
        parameters = read_content(path)
    except ValueError as error:
        raise WalkerError(f"no walker: {error}") from None
    if not isinstance(parameters, dict):
        raise WalkerError(f"{name} must name a walker's parameters, as in " + '{"preset": "lab"}')
    try:
        return _of_parameters({"title": Path(path).stem, **parameters})
    except WalkerError as error:
        raise WalkerError(f"{name}: {error}") from None
