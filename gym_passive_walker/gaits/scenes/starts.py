"""Initial states of episodes: near the passive gait (limit cycle) of the walker at its slope.

Agents do not learn from initial states far from any gait. If a slope has no gait, such as level
ground, the walker starts with the gait of another slope.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cache, cached_property, lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.engine.jit import Kernel, jitted
from gym_passive_walker.engine.layout import layout_of
from gym_passive_walker.gaits.find.search import seek
from gym_passive_walker.gaits.scenes.randomization import SLOPE, Randomization
from gym_passive_walker.gaits.scenes.scene import SCENES, Scene, SceneError, make_scene
from gym_passive_walker.models.walkers import WALKERS, Walker

REFERENCE_SLOPES = (0.01, 0.02, 0.036, 0.06, 0.09, 0.005, 0.0025)
"""Slopes in rad of substitute gaits for slopes without a gait. Level ground and uphill slopes use
the first slope that has one."""

NODES = 13
"""Number of slopes in a range at which gaits are computed; initial states between are
interpolated."""

DRAWS = 4
"""Number of random numbers per start in every scene: one for the slope, and three for deviations
from the gait. These are of the angles, the angular velocity of the stance leg, and those of the
swing leg."""

Start = tuple[float, ...]

_KNOWN = Path(__file__).parent / "starts.json"


@cache
def known_gaits() -> dict[tuple[Walker, float], Start | None]:
    """Return precomputed gaits of the named scenes, so that a first episode needs no search.

    The keys are walker and slope; the value is None if there is no gait. ``python -m
    gym_passive_walker.gaits.scenes.starts`` writes the file.
    """
    known = json.loads(_KNOWN.read_text(encoding="utf-8"))
    return {
        (WALKERS[name], float(slope)): None if state is None else tuple(state)
        for name, gaits in known.items()
        for slope, state in gaits.items()
    }


@lru_cache(maxsize=4096)
def searched_gait(walker: Walker, slope: float, guess: Start | None = None) -> Start | None:
    """Search for the state of a walker's long passive gait on the Poincaré section.

    Args:
        walker: The walker.
        slope: Slope in rad.
        guess: State of a gait nearby, which shortens the search.

    Returns:
        The state, with angular velocities in units of 1/sqrt(l/g) as in the guess. None if the
        search finds no gait.
    """
    if "step kinds" not in walker.supports and walker.start is None and guess is None:
        return None
    half = walker.size // 2
    units = np.array([*[1.0] * half, *[walker.time_unit] * half])
    for start in (None,) if guess is None else (np.array(guess) / units, None):
        gait = seek(walker, slope, guess=start).gait
        if gait is not None and gait.kind == "long":
            return tuple((gait.state * units).tolist())
    return None


def gait_near(walker: Walker, slope: float, guess: Start | None = None) -> Start:
    """Return the passive gait at a slope, or at the nearest reference slope that has one.

    A `System` without a gait uses its own start.

    Raises:
        SceneError: if the walker has no gait at any of these slopes, and no start.
    """
    gentle = max(slope, REFERENCE_SLOPES[0])
    others = sorted(REFERENCE_SLOPES, key=lambda reference: abs(reference - gentle))
    known = known_gaits()
    for candidate in (slope, *others):
        if (walker, candidate) in known:
            state = known[walker, candidate]
        else:
            state = searched_gait(walker, candidate, guess if candidate == slope else None)
        if state is not None:
            return state
    if walker.start is not None:
        return tuple(map(float, walker.start))
    raise SceneError(
        f"this walker has no passive gait at slope {slope:g} nor at any of {REFERENCE_SLOPES}: "
        "give the scene a start"
    )


class Starts:
    """Initial states of the episodes of a scene.

    Args:
        scene: The scene.
        walker: Walker that replaces the scene's.
        slope: Slope in rad that replaces the scene's.

    Attributes:
        randomization: The draws of domain randomization; None without it.
    """

    def __init__(
        self, scene: Scene, walker: Walker | None = None, slope: float | None = None
    ) -> None:
        self.scene = scene
        self.walker = scene.walker if walker is None else walker
        chosen = scene.slope if slope is None else slope
        self.low, self.high = chosen if isinstance(chosen, tuple) else (chosen, chosen)
        self.randomization: Randomization | None = None
        if scene.domain_randomization:
            self.randomization = Randomization(scene, self.walker, self.low)
            if SLOPE in self.randomization.names:
                self.low, self.high = self.randomization.ends(SLOPE)
        self._only_slope = np.array([self.low]) if self.low == self.high else None

    def slopes(self, shares: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return slopes in rad at shares from 0 to 1 of the range; (1,) for a single slope."""
        if self._only_slope is not None:
            return self._only_slope
        return self.low + (self.high - self.low) * shares

    def states(self, slopes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return initial states on the Poincaré section at slopes of the scene's range.

        Args:
            slopes: Slopes in rad, (n,).

        Returns:
            States, (n, 6), with angular velocities in units of 1/sqrt(l/g). The shape is (1, 6) if
            all walkers have the same initial state. Those of a `System` are as `as_recorded`
            returns them.
        """
        nodes, states = self.nodes
        if len(nodes) == 1:
            return states
        found = np.empty((len(slopes), states.shape[1]))
        between(nodes, states, slopes, found)
        return found

    def state(self, slope: float) -> Start:
        """Return the initial state on the Poincaré section at any slope in rad."""
        return gait_near(self.walker, slope) if self.scene.start is None else self.scene.start

    @property
    def node_slopes(self) -> list[float]:
        """Slopes in rad of the range at which gaits are computed."""
        return np.linspace(self.low, self.high, NODES if self.high > self.low else 1).tolist()

    @cached_property
    def nodes(self) -> tuple[NDArray, NDArray]:
        """Slopes of the range in rad, (nodes,), and the initial states there, (nodes, 6)."""
        if self.scene.start is not None:
            return np.array([self.low]), as_recorded(self.walker, [self.scene.start])
        states: list[Start] = []
        for slope in reversed(self.node_slopes):
            states.insert(0, gait_near(self.walker, slope, states[0] if states else None))
        return np.array(self.node_slopes), as_recorded(self.walker, states)


def as_recorded(walker: Walker, states: Sequence[Start]) -> NDArray[np.float64]:
    """Return states (n, 2 m) in rows of a record's length, which can be longer."""
    found = np.array(states, dtype=float)
    room, half = layout_of(walker.equations()).links, walker.coordinates
    rows = np.zeros((len(found), 2 * room))
    rows[:, :half], rows[:, room : room + half] = found[:, :half], found[:, half:]
    return rows


@jitted
def interpolate_states(nodes, states, slopes, found):
    """Implement `between` for compiled callers."""
    last = len(nodes) - 1
    for i in range(len(slopes)):
        right = 1
        while right < last and slopes[i] >= nodes[right]:
            right += 1
        share = (slopes[i] - nodes[right - 1]) / (nodes[right] - nodes[right - 1])
        for k in range(states.shape[1]):
            found[i, k] = (1.0 - share) * states[right - 1, k] + share * states[right, k]


@Kernel
def between(nodes, states, slopes, found):
    """Interpolate initial states between those of nodes, and write them to `found`, (n, 6)."""
    interpolate_states(nodes, states, slopes, found)


def write_known_gaits() -> None:
    """Compute the initial gaits of the named scenes, and write them to the package's file."""
    known: dict[str, dict[str, Start | None]] = {}
    for name in SCENES:
        scene = make_scene(name)
        walker = next(key for key, value in WALKERS.items() if value == scene.walker)
        starts = Starts(scene)
        for slope in sorted({*starts.node_slopes, REFERENCE_SLOPES[0]}):
            known.setdefault(walker, {})[repr(slope)] = searched_gait(scene.walker, slope)
    lines = [
        f"  {json.dumps(walker)}: {{\n"
        + ",\n".join(
            f"    {json.dumps(s)}: {json.dumps(gaits[s])}" for s in sorted(gaits, key=float)
        )
        + "\n  }"
        for walker, gaits in known.items()
    ]
    _KNOWN.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    write_known_gaits()
