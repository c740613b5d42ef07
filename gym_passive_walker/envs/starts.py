"""Where episodes start: near the passive gait of the walker at its slope.

Starts far from any gait never learn, so where no gait exists at a slope (level ground, most often)
the walker starts with the gait of a slope that has one.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from gym_passive_walker.envs.scene import Scene, SceneError
from gym_passive_walker.gaits.fixed_point import find_gait
from gym_passive_walker.gaits.gait import GaitNotFound
from gym_passive_walker.walkers import Walker, WalkerError

REFERENCE_SLOPES = (0.01, 0.02, 0.036, 0.06, 0.09, 0.005, 0.0025)
"""Slopes whose gait a walker may start with where its own slope has none; on level ground and
uphill, the first that has one."""

NODES = 13
"""Slopes of a range at which gaits are sought; between them, starts are interpolated."""

DRAWS = 4
"""Random numbers that every start takes, whatever the scene; a varied walker takes more."""

State = tuple[float, ...]


@lru_cache(maxsize=4096)
def passive_gait(walker: Walker, slope: float, guess: State | None = None) -> State | None:
    """The section state of a walker's long passive gait, if it has one.

    Args:
        walker: The walker.
        slope: Slope in rad.
        guess: A gait nearby, which saves most of the search.

    Returns:
        The state, rates in units of 1/sqrt(l/g) as in the guess.
    """
    units = np.array([1.0, 1.0, 1.0, *[walker.time_unit] * 3])
    for start in (None,) if guess is None else (np.array(guess) / units, None):
        try:
            gait = find_gait(walker, slope, kind="long", guess=start)
        except GaitNotFound:
            continue
        if gait.kind == "long":
            return tuple((gait.state * units).tolist())
    return None


def gait_near(walker: Walker, slope: float, guess: State | None = None) -> State:
    """The passive gait at a slope, or else at the nearest reference slope that has one.

    Raises:
        SceneError: if the walker has no gait at any of them.
    """
    gentle = max(slope, REFERENCE_SLOPES[0])
    others = sorted(REFERENCE_SLOPES, key=lambda reference: abs(reference - gentle))
    for candidate in (slope, *others):
        state = passive_gait(walker, candidate, guess if candidate == slope else None)
        if state is not None:
            return state
    raise SceneError(
        f"this walker has no passive gait at slope {slope:g} nor at any of {REFERENCE_SLOPES}: "
        "give the scene a start"
    )


class Starts:
    """Draws the starts of a scene's episodes.

    Args:
        scene: The scene.
        walker: A walker to use instead of the scene's.
        slope: A slope to use instead of the scene's.
    """

    def __init__(
        self, scene: Scene, walker: Walker | None = None, slope: float | None = None
    ) -> None:
        self.scene = scene
        self.walker = scene.walker if walker is None else walker
        chosen = scene.slope if slope is None else slope
        self.low, self.high = chosen if isinstance(chosen, tuple) else (chosen, chosen)
        self._nodes: tuple[list[float], list[State]] | None = None

    def draw(
        self, rng: np.random.Generator, slope: float | None = None, *, gait: bool = True
    ) -> tuple[Any, ...]:
        """A walker, a slope, and a section state near the walker's gait there.

        Args:
            rng: Where random numbers come from; the same count of them whatever is asked.
            slope: A slope that was asked for, instead of one drawn.
            gait: Whether the state is wanted.

        Returns:
            The walker, the slope in rad, and the six numbers of the state if they are wanted,
            rates in units of 1/sqrt(l/g).
        """
        where, *shifts = rng.random(DRAWS).tolist()
        walker = self._varied(rng)
        drawn = self.low + (self.high - self.low) * where if slope is None else slope
        if not gait:
            return walker, drawn
        if self.scene.start is not None:
            nominal = self.scene.start
        elif slope is None:
            nominal = self._between(drawn)
        else:
            nominal = gait_near(self.walker, slope)
        size = self.scene.perturbation
        a, b, c = [1.0 + size * (2.0 * shift - 1.0) for shift in shifts]
        # Thigh and shank share a factor: the knee of a leg that has just left the ground opens.
        q0, q1, q2, w0, w1, w2 = nominal
        return walker, drawn, a * q0, a * q1, a * q2, b * w0, c * w1, c * w2

    def _varied(self, rng: np.random.Generator) -> Walker:
        """The walker with its parameters varied, if the scene asks for it."""
        shares = self.scene.randomise
        if not shares:
            return self.walker
        for _ in range(100):
            factors = 1.0 + np.array(list(shares.values())) * rng.uniform(-1.0, 1.0, len(shares))
            changed = {
                name: getattr(self.walker, name) * factor
                for name, factor in zip(shares, factors.tolist(), strict=True)
            }
            try:
                return replace(self.walker, **changed)
            except WalkerError:
                continue
        raise SceneError(f"randomise: hardly any walker lies within {shares} of this one")

    def _between(self, slope: float) -> State:
        """The gait at a slope of the scene's range, between the gaits of its nodes."""
        if self._nodes is None:
            count = NODES if self.high > self.low else 1
            slopes = np.linspace(self.low, self.high, count).tolist()
            states: list[State] = []
            for node in reversed(slopes):
                states.insert(0, gait_near(self.walker, node, states[0] if states else None))
            self._nodes = slopes, states
        slopes, states = self._nodes
        if len(slopes) == 1:
            return states[0]
        right = min(max(bisect_right(slopes, slope), 1), len(slopes) - 1)
        share = (slope - slopes[right - 1]) / (slopes[right] - slopes[right - 1])
        return tuple(
            (1.0 - share) * a + share * b
            for a, b in zip(states[right - 1], states[right], strict=True)
        )


def checked_state(state: Sequence[float], walker: Walker) -> State:
    """A state that a user gave, with its rates in units of 1/sqrt(l/g).

    Args:
        state: [stance, thigh, shank] angles in rad and their rates, shape (6,).
        walker: Whose state it is. A straight-legged walker's shank is ignored.

    Raises:
        ValueError: if it is no state of an upright walker.
    """
    given = np.asarray(state, dtype=float)
    if given.shape != (6,) or not np.all(np.isfinite(given)):
        raise ValueError(
            "options['state'] must be 6 finite numbers, [stance, thigh, shank] angles and their "
            f"rates, not {state!r}"
        )
    stance, thigh, shank, *rates = given.tolist()
    if not walker.knees:
        shank, rates[2] = thigh, rates[1]
    if abs(stance) >= 0.5 * math.pi or abs(thigh) >= math.pi or abs(shank) >= math.pi:
        raise ValueError(f"options['state'] is of a walker that has fallen: {given.tolist()}")
    if shank > thigh or (shank == thigh and rates[2] > rates[1]):
        raise ValueError(
            "options['state'] bends the knee backwards: the shank must be behind the thigh, or "
            f"falling behind it: {given.tolist()}"
        )
    return (stance, thigh, shank, *(walker.time_unit * rate for rate in rates))
