"""Terrain: uneven ground as a sequence of footholds.

Each foothold has a height and a slope. A foothold depends on the terrain, on the key of the walk
and on its own number only. It depends neither on other walks nor on earlier motion.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from inspect import signature
from os import PathLike
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import boolean, number, shown, unknown, whole
from gym_passive_walker._tools.console import cut
from gym_passive_walker._tools.loading import is_file, once, parse_json, read_content
from gym_passive_walker.engine.counter_rng import normal
from gym_passive_walker.engine.jit import Kernel
from gym_passive_walker.models.walkers import Walker

_HEIGHTS, _SLOPES = 100, 101  # streams of random numbers
_HIGHEST = 1e3  # leg lengths
_LONGEST = 1_000_000  # footholds of a list or a wave


@dataclass(frozen=True)
class Terrain:
    """A sequence of footholds; made by `rough`, `stairs`, `waves` or `footholds`.

    Attributes:
        rises: Height change from each foothold to the next, in leg lengths, along the normal of
            the first of the two.
        slopes: Slope of each foothold beyond the slope of the walk, in rad, positive downhill.
        repeats: Whether the sequence repeats after its last foothold. Otherwise all that follow
            are like the last one.
        height_std: Standard deviation of independent normal deviations of the footholds' heights,
            in leg lengths. The first foothold has none.
        slope_std: Standard deviation of independent normal deviations of the footholds' slopes, in
            rad. The first foothold has none.
    """

    rises: tuple[float, ...] = (0.0,)
    slopes: tuple[float, ...] = (0.0,)
    repeats: bool = True
    height_std: float = 0.0
    slope_std: float = 0.0

    def __post_init__(self) -> None:
        """Check every argument."""
        for name, limit in (("rises", _HIGHEST), ("slopes", 0.5 * math.pi)):
            object.__setattr__(self, name, _row(getattr(self, name), name, limit))
        for name, limit in (("height_std", _HIGHEST), ("slope_std", 0.5 * math.pi)):
            given = number(getattr(self, name), name, least=0.0, most=limit)
            object.__setattr__(self, name, given)
        object.__setattr__(self, "repeats", boolean(self.repeats, "repeats"))
        if len(self.rises) != len(self.slopes):
            raise ValueError(f"{len(self.rises)} rises for {len(self.slopes)} slopes of footholds")

    @property
    def random(self) -> bool:
        """Whether footholds are random, so that each walk has its own."""
        return self.height_std > 0.0 or self.slope_std > 0.0

    @property
    def smooth(self) -> bool:
        """Whether all footholds are level with the slope of the walk."""
        return not (self.random or any(self.rises) or any(self.slopes))

    def arrays(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Arrays for the kernels: rise and slope of each foothold (n, 2), and other fields (3,)."""
        table = np.column_stack([self.rises, self.slopes])
        return table, np.array([float(self.repeats), self.height_std, self.slope_std])

    def ground(self, keys: ArrayLike, places: ArrayLike) -> NDArray[np.float64]:
        """Return slopes of footholds, and the changes to the next ones.

        Args:
            keys: Keys of the walks, whole numbers below 2^64; one for each, or one for all.
            places: Numbers of the footholds, from 0 on; one for each, or one for all.

        Returns:
            Slope of the foothold beyond the slope of the walk, in rad; height change to the next
            foothold, in leg lengths; slope change to the next foothold, in rad. Shape (..., 3).
        """
        keys, places = np.broadcast_arrays(np.asarray(keys, np.uint64), np.asarray(places))
        found = np.empty((keys.size, 3))
        grounds(*self.arrays(), keys.flatten(), places.flatten().astype(np.int64), found)
        return found.reshape(*keys.shape, 3)


def rough(height_std: float | None = None, slope_std: float | None = None) -> Terrain:
    """Return random footholds with normally distributed heights and slopes.

    At least one of the two standard deviations is required; the other one is 0.

    Example:
        >>> import gym_passive_walker as gpw
        >>> ground = gpw.rough(height_std=0.002)
        >>> slope, rise, turn = ground.ground(7, 0)
        >>> float(slope), float(turn), abs(float(rise)) < 0.01
        (0.0, 0.0, True)

    Args:
        height_std: Standard deviation of the heights, in leg lengths.
        slope_std: Standard deviation of the slopes, in rad.

    Raises:
        ValueError: if neither is given, or one is no number from 0 on.
    """
    if height_std is None and slope_std is None:
        raise ValueError("rough ground needs height_std in leg lengths, slope_std in rad, or both")
    heights, slopes = (0.0 if std is None else std for std in (height_std, slope_std))
    return Terrain(height_std=heights, slope_std=slopes)


def stairs(rise: float) -> Terrain:
    """Return footholds, each higher than the last by `rise` leg lengths; lower if negative."""
    return Terrain(rises=(number(rise, "rise", least=-_HIGHEST, most=_HIGHEST),))


def waves(height: float, strides: int) -> Terrain:
    """Return footholds on a sine of amplitude `height` (leg lengths) and period `strides`, >= 3."""
    count = whole(strides, "strides", 3, _LONGEST)  # of two, a sine is zero
    heights = number(height, "height", least=-_HIGHEST, most=_HIGHEST) * np.sin(
        2.0 * math.pi / count * np.arange(count + 1)
    )
    return Terrain(rises=tuple(np.diff(heights)), slopes=(0.0,) * count)


def footholds(
    heights: Sequence[float] | None = None, slopes: Sequence[float] | None = None
) -> Terrain:
    """Return a list of footholds; all that follow are like the last one.

    Args:
        heights: Height of each foothold, in leg lengths, (n,); all equal when None. The walk begins
            on the first.
        slopes: Slope of each foothold beyond the slope of the walk, in rad, (n,); 0 when None.

    Raises:
        ValueError: if neither is given, or their numbers differ.
    """
    given = [row for row in (heights, slopes) if row is not None]
    if not given:
        raise ValueError("footholds need heights in leg lengths, slopes in rad, or both")
    count = max(np.size(row) for row in given)
    level = (0.0,) * count
    high = _row(level if heights is None else heights, "heights", _HIGHEST)
    steep = _row(level if slopes is None else slopes, "slopes", 0.5 * math.pi)
    if len(high) != len(steep):
        raise ValueError(f"{len(high)} heights for {len(steep)} slopes of footholds")
    return Terrain(rises=(*np.diff(high), 0.0), slopes=steep, repeats=False)


def ground_of(terrain: TerrainLike | None, terrain_seed: int, strides: int) -> NDArray[np.float64]:
    """Return slope beyond the walk's, height change and slope change by stride, (strides, 3)."""
    terrain_seed = whole(terrain_seed, "terrain_seed", 0, 2**64 - 1)
    made = terrain_from(terrain)
    return np.zeros((strides, 3)) if made is None else made.ground(terrain_seed, np.arange(strides))


def contacts(walker: Walker, ground: NDArray, lengths: NDArray) -> NDArray[np.complex128]:
    """Return the contact points at which strides begin, the first at 0, in the walker's units.

    Args:
        walker: The walker.
        ground: Rows of `Terrain.ground`, one for each foothold in turn, (n, 3).
        lengths: Length of the step from each foothold, from contact to contact along the
            foothold's slope, (n,); the last is ignored.

    Returns:
        Contact points (n,): x along the slope of the walk as real part, height over it as
        imaginary part.
    """
    tilts, rises, turns = ground.T
    along = np.exp(-1j * tilts)
    # A round foot first touches a foothold of another slope away from its lowest point.
    heights = rises * walker.leg_length + walker.foot_radius * (1.0 - np.cos(turns))
    steps = (lengths + 1j * heights) * along
    return np.concatenate([[0.0], np.cumsum(steps[:-1])])


EXAMPLES = "rough:height_std=0.002, stairs:rise=-0.01 or waves:height=0.01,strides=6"
"""Examples of terrains as text, for error messages."""

_ARGUMENT = re.compile(r"(\w+)=(\[[^\]]*\]|[^,\[\]]+)(?:,|$)")  # a name and a number, or a list
_MADE = {"rough": rough, "stairs": stairs, "waves": waves, "footholds": footholds}


TerrainLike: TypeAlias = Terrain | Mapping[str, Any] | str | PathLike[str]
"""Type of terrain arguments; see `terrain_from`."""


def terrain_from(value: TerrainLike | None) -> Terrain | None:
    """Return a terrain from any form that it may be given in.

    Args:
        value: A `Terrain`; None for smooth ground; a mapping of one of rough, stairs, waves and
            footholds to its arguments, as ``{"rough": {"height_std": 0.01}}``; the text
            "rough:height_std=0.01"; the mapping as JSON text; or the path of a JSON, YAML or TOML
            file of the mapping.

    Raises:
        ValueError: if it describes no terrain.
        ImportError: if the file is YAML and pyyaml is not installed.
    """
    if value is None or isinstance(value, Terrain):
        return value
    if isinstance(value, str) and (value.lstrip().startswith("{") or not is_file(value)):
        return _of_text(value)
    if is_file(value):
        content = read_content(value)
        try:
            return _of_mapping(content)
        except ValueError as error:
            raise ValueError(f"{cut(os.fsdecode(value))}: {error}") from None
    return _of_mapping(value)


def _of_text(text: str) -> Terrain:
    if text.lstrip().startswith("{"):
        try:
            content = parse_json(text)
        except ValueError as error:
            raise ValueError(f"terrain {shown(text)} cannot be read: {error}") from None
        return _of_mapping(content)
    name, _, rest = text.partition(":")
    if _ARGUMENT.sub("", rest):
        raise ValueError(f"a terrain is written as {EXAMPLES}, or as a mapping, not {shown(text)}")
    try:
        arguments = [(key, parse_json(word)) for key, word in _ARGUMENT.findall(rest)]
    except ValueError:
        raise ValueError(f"terrain {cut(name)} takes numbers, not {shown(rest)}") from None
    try:
        once(arguments)
    except ValueError as error:
        raise ValueError(f"terrain {cut(name)}: {error}") from None
    return _of_mapping({name: dict(arguments)})


def _of_mapping(value: Any) -> Terrain:
    if isinstance(value, Mapping) and value.keys() == {field.name for field in fields(Terrain)}:
        return Terrain(**value)  # as `dataclasses.asdict` returns it
    if not isinstance(value, Mapping) or len(value) != 1:
        raise ValueError(
            "a terrain is a Terrain, None, or a mapping of one of rough, stairs, waves and "
            'footholds to its arguments, as {"rough": {"height_std": 0.01}}, or a file of one, '
            f"not {shown(value)}"
        )
    ((name, arguments),) = value.items()
    if said := unknown([name], tuple(_MADE), "terrain"):
        raise ValueError(said)
    if not isinstance(arguments, Mapping):
        raise ValueError(f"terrain {name} takes its arguments by name, not {shown(arguments)}")
    takes = signature(_MADE[name]).parameters
    if said := unknown(arguments, tuple(takes), f"terrain {name}"):
        raise ValueError(said)
    needed = [each for each, of in takes.items() if of.default is of.empty]
    if missing := [each for each in needed if each not in arguments]:
        raise ValueError(f"terrain {name} needs {' and '.join(missing)}, as in {EXAMPLES}")
    try:
        return _MADE[name](**arguments)
    except TypeError as error:
        raise ValueError(f"terrain {name}: {error}") from None


def _row(values: Any, name: str, limit: float) -> tuple[float, ...]:
    """Check a sequence of at least one number, each at most `limit` in size."""
    if isinstance(values, str | Mapping) or np.ndim(values) != 1 or np.size(values) == 0:
        raise ValueError(f"{name} must be numbers in a row, at least one, not {shown(values)}")
    if np.size(values) > _LONGEST:
        raise ValueError(f"{name} must be at most {_LONGEST} numbers, not {np.size(values)}")
    row = tuple(number(value, f"{name}[{i}]") for i, value in enumerate(values))
    if not max(map(abs, row)) <= limit:
        raise ValueError(f"{name} must lie between -{limit:g} and {limit:g}, not {shown(values)}")
    return row


@Kernel
def _foothold(table, spread, key, place):
    """Return the rise from a foothold to the next (leg lengths), and the foothold's slope (rad).

    Args:
        table: First array of `Terrain.arrays`, (n, 2).
        spread: Second array of `Terrain.arrays`, (3,).
        key: Key of the walk, 64 bits.
        place: Number of the foothold, from 0 on.
    """
    count = len(table)
    i = place % count if spread[0] else min(place, count - 1)
    rise, slope = table[i, 0], table[i, 1]
    if spread[1] > 0.0:
        here = normal(key, place, _HEIGHTS) if place else 0.0
        rise += spread[1] * (normal(key, place + 1, _HEIGHTS) - here)
    if spread[2] > 0.0 and place:
        slope += spread[2] * normal(key, place, _SLOPES)
    return rise, slope


@Kernel
def ground_at(table, spread, key, place):
    """Return a foothold's slope, and the rise (leg lengths) and the slope change to the next."""
    rise, slope = _foothold(table, spread, key, place)
    return slope, rise, _foothold(table, spread, key, place + 1)[1] - slope


@Kernel
def grounds(table, spread, keys, places, found):
    """Write what `ground_at` returns for walks and places, (n, 3)."""
    for i in range(len(keys)):
        found[i, 0], found[i, 1], found[i, 2] = ground_at(table, spread, keys[i], places[i])
