"""Design by gradient: walkers that do something best within bounds, and tuned walkers that walk.

Every walker tried is judged by its gait and the gait's derivatives; SciPy's SLSQP (D. Kraft, 1988)
chooses the next (see `design_nlp`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import boolean, gait_kind, number, one_slope, shown, whole
from gym_passive_walker._tools.progress import said
from gym_passive_walker.gaits.branches.sensitivity import SLOPE, place_near
from gym_passive_walker.gaits.design.design_nlp import Candidates, DesignProblem, Judged, slsqp
from gym_passive_walker.gaits.design.objectives import (
    OF_ONE_STRIDE,
    QUANTITIES,
    SPECTRAL_RADIUS,
    spectral_radius,
)
from gym_passive_walker.gaits.find.fixed_point import find_gait
from gym_passive_walker.gaits.find.search import seek
from gym_passive_walker.gaits.gait import Gait, GaitKind, GaitNotFound, gait_at
from gym_passive_walker.gaits.stride_map import MapLike, map_of
from gym_passive_walker.models.model import check_supports
from gym_passive_walker.models.walkers import (
    Walker,
    WalkerLike,
    as_walker,
    describe,
    tune,
)

Range = float | tuple[float | None, float | None]
"""Constraint of a quantity: a value, or (low, high) of which one may be None."""

_MET = 1e-6  # by what share of its size a constraint may be missed; multipliers, a circle
_OF_THE_SIMPLEST = (SLOPE, "thigh_length", "shank_length", "hip_mass", "gravity")
_OF_THE_SIMPLEST += ("hip_stiffness", "hip_friction")
_MOVED = ("thigh_com", "thigh_gyration", "shank_com", "shank_gyration")
_TUNED = (*_MOVED, "thigh_offset", "shank_offset")
_SHARES = (0.05, 0.6)  # of a segment's length: where such designs are looked for
_LOOKS = 128  # designs evaluated


@dataclass(frozen=True)
class Design:
    """Result of `optimize_walker`: the walker with the best value of an objective.

    Attributes:
        objective: Name of the objective.
        start: The gait that the search began with.
        gait: The gait of the walker found.
        values: The objective and the constrained quantities, before and after, by name.
        tried: Number of walkers tried.
        converged: Whether the search ended at an optimum. Otherwise it was given up, or ended at
            an edge beyond which there is no gait.
        message: SciPy's message about the end of the search.
    """

    objective: str
    start: Gait
    gait: Gait
    values: dict[str, tuple[float, float]]
    tried: int
    converged: bool
    message: str

    @property
    def walker(self) -> Walker:
        """The walker found."""
        return self.gait.walker


def optimize_walker(
    walker: MapLike,
    objective: str,
    parameters: Sequence[str],
    bounds: Sequence[tuple[float, float]],
    *,
    slope: float | None = None,
    kind: GaitKind = "long",
    constraints: Mapping[str, Range] | None = None,
    maximize: bool = False,
    iterations: int = 200,
) -> Design:
    """Find the walker, within bounds, with the best gait by some objective.

    The optimum is a local one, reached from the walker's own gait by its exact derivatives.

    Args:
        walker: The walker to begin with, in a form that `as_walker` takes; or a map of
            `stride_map` with its controller.
        objective: Quantity to minimize: "cost_of_transport", "slope", "speed", "froude_speed",
            "step_length", "step_period", "stance_angle" as in `Gait`; "leg_length", "total_mass" as
            in `Walker`; "clearance", the least height of the passing swing foot as in
            `RealityCheck`; "knee_margin", the time from kneestrike to heelstrike over the stride's;
            or "spectral_radius", the modulus of the largest multiplier.
        parameters: Parameters that may change: "slope", and numerical parameters of the walker.
        bounds: Lowest and highest value of each of them, in the walker's own units.
        slope: Slope in rad; if it may change, that to begin with. The map's own when None.
        kind: Gait, "long" or "short".
        constraints: For any of the objectives a value, or lowest and highest value of which one
            may be None. The spectral radius has a highest value only.
        maximize: Whether to maximize the objective instead.
        iterations: Largest number of iterations of SLSQP.

    Returns:
        The design; its gait meets the constraints to a millionth.

    Raises:
        GaitNotFound: if the walker has no such gait to begin with, or the constraints are not met
            where the search ends.
        ValueError: if an argument is none of those above.
    """
    stride_map = map_of(walker, tolerance=1e-13)
    walker, slope = stride_map.walker, stride_map.chosen(slope)
    _known(objective)
    maximize, iterations = boolean(maximize, "maximize"), whole(iterations, "iterations")
    kind = gait_kind(kind)
    ranges = _ranges({} if constraints is None else constraints)
    box = _box(walker, slope, parameters, bounds)
    if objective == SPECTRAL_RADIUS and (maximize or SPECTRAL_RADIUS in ranges):
        raise ValueError("a spectral radius is made least without a bound: maximize something else")
    names = {objective, *ranges}
    if "knee_margin" in names and not walker.knees:
        raise ValueError("knee_margin is of walkers with knees, and this one has none")
    if "clearance" in names:
        check_supports(walker, "reality check")
    if (count := len(stride_map.ground)) > 1 and (ill := sorted(names & {*OF_ONE_STRIDE})):
        raise ValueError(
            f"{ill[0]} is of gaits that repeat after one stride, and here they do after {count}: "
            "choose another quantity"
        )
    if SPECTRAL_RADIUS in names and stride_map.dimension > 4:
        raise ValueError(
            f"spectral_radius is of walkers with up to three multipliers that are not zero, and "
            f"{describe(walker)} has more: choose another quantity"
        )
    before = find_gait(stride_map, slope, kind)
    judged_by = sorted(names - {SPECTRAL_RADIUS})
    candidates = Candidates(
        before, parameters, box, judged_by, multipliers=SPECTRAL_RADIUS in names
    )
    problem = DesignProblem(candidates, objective, -1.0 if maximize else 1.0, ranges)
    found = problem.solve(iterations)
    missed = problem.missed(found.x)
    last = candidates.at(found.x[: len(parameters)])
    if last is None:
        raise GaitNotFound(
            f"the search came to values of {', '.join(parameters)} with which no gait of "
            f"{describe(walker)} is found: choose bounds that are nearer to it"
        )
    if not missed < _MET:
        raise GaitNotFound(
            f"no walker like {describe(walker)} with {', '.join(parameters)} in these bounds meets "
            f"the constraints: the search ended {missed:.1e} of their size from it "
            f"({found.message}); widen the bounds, or begin with a walker that is nearer to it"
        )
    return Design(
        objective=objective,
        start=before,
        gait=gait_at(last.gait.place, last.gait.place.section.slope, 1),
        values={name: (_value(problem.first, name), _value(last, name)) for name in sorted(names)},
        tried=candidates.tried,
        converged=bool(found.success),
        message=str(found.message),
    )


def _value(judged: Judged, name: str) -> float:
    """Return one of a candidate's quantities."""
    if name == SPECTRAL_RADIUS:
        return spectral_radius(judged.gait.map)
    return float(judged.quantities[name][0])


def _known(name: str) -> None:
    """Refuse an unknown quantity."""
    if not isinstance(name, str) or (name != SPECTRAL_RADIUS and name not in QUANTITIES):
        raise ValueError(
            f"objective and constraints: no quantity {shown(name)} to design by: choose from "
            f"{SPECTRAL_RADIUS}, {', '.join(QUANTITIES)}"
        )


def _ranges(constraints: Mapping[str, Range]) -> dict[str, tuple[float | None, float | None]]:
    """Check constraints, and return the lowest and highest value of each."""
    if not isinstance(constraints, Mapping):
        raise ValueError(
            "constraints must map quantities to values or to (lowest, highest), not "
            f"{shown(constraints)}"
        )
    ranges = {}
    for name, allowed in constraints.items():
        _known(name)
        pair = isinstance(allowed, tuple | list)
        if pair and len(allowed) != 2:
            raise ValueError(f"constraints[{name!r}] must be a value or two, not {shown(allowed)}")
        low, high = allowed if pair else (allowed, allowed)
        low, high = (x if x is None else number(x, name) for x in (low, high))
        if name == SPECTRAL_RADIUS and (high is None or low is not None):
            raise ValueError("spectral_radius has a highest value only: give it as (None, 0.9)")
        if low is None and high is None:
            raise ValueError(f"{name} needs a value, or a lowest and a highest one")
        if low is not None and high is not None and low > high:
            raise ValueError(f"{name} cannot lie from {low:g} to {high:g}: give the lowest first")
        ranges[name] = low, high
    return ranges


def _box(
    walker: Walker, slope: float, parameters: Sequence[str], bounds: Sequence[tuple[float, float]]
) -> NDArray[np.float64]:
    """Check bounds of parameters, and return them, (k, 2)."""
    allowed = _OF_THE_SIMPLEST if walker.massless_legs else (SLOPE, *walker.parameters)
    listed = isinstance(parameters, Sequence) and not isinstance(parameters, str | bytes)
    names = list(parameters) if listed else []
    if not all(isinstance(name, str) for name in names) or not 0 < len(names) == len(set(names)):
        raise ValueError(
            f"parameters must be different names, a list of them, not {shown(parameters)}"
        )
    for name in parameters:
        if name not in allowed:
            raise ValueError(
                f"parameters: cannot vary {shown(name)} of this walker: choose from "
                f"{', '.join(allowed)}"
            )
    given = np.iterable(bounds) and not isinstance(bounds, str | bytes | Mapping)
    if not given or [np.shape(pair) for pair in bounds] != [(2,)] * len(parameters):
        raise ValueError(
            f"bounds must be a pair (lowest, highest) for each of the {len(parameters)} parameters"
        )
    box = []
    for name, (low, high) in zip(parameters, bounds, strict=True):
        here = slope if name == SLOPE else walker.parameters[name]
        low, high = number(low, f"lowest {name}"), number(high, f"highest {name}")
        if not (-np.inf < low < high < np.inf and low <= here <= high):
            raise ValueError(
                f"{name} is {here:g} to begin with: give finite bounds low <= {here:g} <= high"
            )
        box.append((low, high))
    return np.array(box)


def tune_to_walk(walker: WalkerLike, slope: float, *, radius: float = 0.8) -> Gait:
    """Find the nearest tuned walker that walks stably at a slope; return its long-step gait.

    `tune` moves offsets alone, and what it makes of a walker that walks may have no gait. Here the
    centres of mass and the gyrations of thigh and shank change as well, as little as need be: by
    the root of the sum of squares of all changes from `tune(walker)`. Lengths, masses and feet
    stay. If `tune(walker)` walks so itself, it is the result.

    Args:
        walker: The walker, in a form that `as_walker` takes.
        slope: Slope in rad.
        radius: The largest modulus that a multiplier may have. Nearer to 1 the walk is lost by ever
            smaller changes of the design, which is hardly nearer for it; but at vanishing slopes
            every tuned walker needs that.

    Returns:
        The gait; `gait.walker` is the design. It is nearest among those near it; the search, of
        some seconds, begins at the nearest of 128 designs that walk so.

    Raises:
        GaitNotFound: if none of these walks.
        WalkerError: if the walker cannot be tuned.
    """
    walker, slope = check_supports(as_walker(walker), "McGeer's parameters"), one_slope(slope)
    radius = number(radius, "radius", above=0.0)
    tuned = tune(walker)
    gait = seek(tuned, slope).gait
    if gait is not None and np.abs(gait.multipliers[0]) <= radius:
        return gait
    with said(f"tuned, this walker does not walk so at slope {slope:g} rad: looking for one"):
        start = _start(tuned, slope, radius)
        if start is not None:
            return _nearest(start, tuned, radius) or start
    raise GaitNotFound(
        f"no tuned walker near {describe(walker)} has a long-step gait at slope {slope:g} "
        f"rad with multipliers up to {radius:g}: none of {_LOOKS} with their segments' centres "
        "of mass and gyrations elsewhere; change lengths, masses or the foot, or the slope"
    )


def _parts(walker: Walker) -> NDArray[np.float64]:
    """Return the parameters that change, (6,)."""
    return np.array([getattr(walker, name) for name in _TUNED])


def _start(tuned: Walker, slope: float, radius: float) -> Gait | None:
    """Return the gait of a tuned walker, the nearest of many that walk."""
    if tuned.massless_legs:  # nothing to move
        return None
    lengths = np.repeat([tuned.thigh_length, tuned.shank_length], 2)
    low, high = _SHARES
    places = (
        low + (high - low) * scipy.stats.qmc.Halton(4, scramble=False).random(_LOOKS)
    ) * lengths
    walkers = [
        tune(replace(tuned, **dict(zip(_MOVED, place, strict=True)))) for place in places.tolist()
    ]
    walkers.sort(key=lambda walker: float(np.linalg.norm(_parts(walker) - _parts(tuned))))
    for walker in walkers:
        gait = seek(walker, slope, quick=True).gait
        if gait is not None and np.abs(gait.multipliers[0]) <= radius:
            return gait
    return None


def _nearest(start: Gait, tuned: Walker, radius: float) -> Gait | None:
    """Return the gait of the nearest tuned walker to which a gait can be followed."""
    length = tuned.leg_length
    box = length * np.array([[0.0 if name.endswith("gyration") else -1.0, 1.0] for name in _TUNED])
    candidates = Candidates(start, _TUNED, box, (), multipliers=True)
    width = box[:, 1] - box[:, 0]
    goal = (_parts(tuned) - box[:, 0]) / width

    def tied(x: NDArray) -> NDArray:
        here = box[:, 0] + width * x
        walker = replace(tuned, **dict(zip(_MOVED, here[:4].tolist(), strict=True)))
        return (here[4:] - _parts(tune(walker))[4:]) / length

    # Offsets of tuned walkers are linear in the centres of mass.
    ties = np.stack([tied(x) - tied(np.zeros(6)) for x in np.eye(6)], axis=1)

    def circle(x: NDArray) -> tuple[NDArray, NDArray]:
        values, by = candidates.inside(x, radius)
        return values, by[:, :6]

    def distance(x: NDArray) -> tuple[float, NDArray]:
        away = (x - goal) * width / length
        if candidates.at(x) is None:
            return np.inf, np.zeros(6)
        return float(away @ away), 2.0 * away * width / length

    found = slsqp(
        distance, candidates.first, [(0.0, 1.0)] * 6,
        equal=lambda x: (tied(x), ties), beyond=circle, iterations=200,
    )  # fmt: skip
    judged = candidates.at(found.x)
    if judged is None or circle(found.x)[0].min() < -_MET:
        return None
    place = judged.gait.place
    tuned_map = place.section.with_walker(tune(place.section.walker))
    exact = place_near(tuned_map, tuned_map.slope, place.search[0])  # tuned to the last digit
    return exact and gait_at(exact, tuned_map.slope, 1)
