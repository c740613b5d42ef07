"""The stride map of a walker (Poincaré map of one step), with its exact derivatives.

A stride leads from one heelstrike to the next. All quantities are dimensionless (see `units`).
Points are coordinates of states on the Poincaré section (see `section`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import one_slope, unknown, whole
from gym_passive_walker._tools.progress import progress
from gym_passive_walker.gaits.actuation import (
    PASSIVE,
    Actuation,
    for_each,
    to_dimensionless,
    to_own,
)
from gym_passive_walker.gaits.flow import (
    STATE_BEFORE,
    Flow,
    Walkers,
    accelerations_at,
    flow,
    states_in,
)
from gym_passive_walker.gaits.given import Repeated
from gym_passive_walker.gaits.map_result import Change, Passage, imbalance, product
from gym_passive_walker.gaits.section import Points, Section
from gym_passive_walker.gaits.stride import Stride, stride
from gym_passive_walker.gaits.terrain import Terrain
from gym_passive_walker.models.equations.hybrid import Ground, Outcome, System
from gym_passive_walker.models.equations.numbers import complex_step, step_derivative
from gym_passive_walker.models.model import check_heights_only
from gym_passive_walker.models.units import unit_of
from gym_passive_walker.models.walkers import PARAMETERS, Walker, WalkerLike, as_walker

LONGEST = 20.0
"""Time limit in sqrt(l/g) of a stride without heelstrike; a usual stride takes 3."""

_FEW = 16
_ROUGHLY = 1e-6  # tolerance at which failed strides are found
_NO_SLOPE = "this map has no slope of its own: give one"
_FIELDS = [field.name for field in fields(Change)]
_STRUCK, _STALLED = int(Outcome.HEELSTRIKE), int(Outcome.STALLED)


class Samples(NamedTuple):
    """States and controls of n strides at k instants each, dimensionless.

    Attributes:
        states: Three angles and three angular velocities at each instant, (n, k, 6).
        stages: `Stage` of the swing leg, (n, k).
        controls: Hip torque, ankle torque and push-off, (n, k, 3).
    """

    states: NDArray[np.float64]
    stages: NDArray[np.int64]
    controls: NDArray[np.float64]


class Seeds(NamedTuple):
    """Changes of walkers along k tangents.

    Attributes:
        points: Changes of points of the section, (n, m, k).
        moving: Other quantities that change along a tangent, with its number.
    """

    points: NDArray[np.float64]
    moving: dict[str, int]

    @property
    def slope(self) -> NDArray[np.float64]:
        """Changes of the slope, (k,)."""
        return np.arange(self.points.shape[2]) == self.moving.get("slope", -1)


@dataclass(frozen=True, eq=False, kw_only=True)
class StrideMap(Section):
    """The stride map of one walker, or of n walkers that differ in some parameters; made by `of`.

    Attributes:
        walker: The walker.
        varied: Parameters in which the walkers differ: a value for each of n points, (n,).
        tolerance: Integration error relative to the largest angle or angular velocity.
        max_stride_time: Time in sqrt(l/g) after which a stride is given up.
        end_on_toe_stub: Whether a kneed walker's locked swing leg below the ground ends the stride.
        actuation: Torques and push-off in each stride, dimensionless. Its parts may be `varied`.
        slope: Slope in rad that is used if none is given to `apply`, `linearize` or an analysis.
        terrain: Footholds of uneven ground; None for smooth ground. The map leads from the first
            foothold through all of them until they repeat. On ground that repeats after L strides,
            one application is L strides, and a gait of period 1 repeats after L strides. Legs that
            differ count as ground does, with L = 2.
    """

    tolerance: float = 1e-13
    max_stride_time: float = LONGEST
    end_on_toe_stub: bool = False
    actuation: Actuation = PASSIVE
    slope: float | None = None
    terrain: Terrain | None = None

    controlled: ClassVar[bool] = False
    """Whether a controller observes the walker and sets its torques."""
    exact: ClassVar[bool] = True
    """Whether derivatives are exact."""
    closes: ClassVar[float] = 1e-9
    """Largest violation of the gait equations at which a point counts as a gait."""
    hold: ClassVar[float] = math.inf
    """Time for which torques are held; infinite if they are constant within a stride."""
    terrain_lookahead: ClassVar[int] = 0
    """Number of footholds ahead that a controller observes."""

    @classmethod
    def of(cls, walker: WalkerLike, *, controller: Actuation = PASSIVE, **fields: Any) -> Self:
        """Return the stride map of a walker in a form that `as_walker` takes.

        Args:
            walker: The walker.
            controller: Actuation in the walker's own units.
            **fields: Other fields of the map, such as `slope` and `tolerance`.
        """
        walker = as_walker(walker)
        if controller is not PASSIVE:
            fields["actuation"] = to_dimensionless(walker.units, controller)
        return cls(walker=walker, **fields)

    def with_tolerance(self, tolerance: float) -> Self:
        """Return this map with another integration tolerance."""
        return replace(self, tolerance=tolerance)

    def with_walker(self, walker: Walker) -> Self:
        """Return the map of another walker with the same dimensionless actuation."""
        return self if walker is self.walker else replace(self, walker=walker)

    @cached_property
    def swapped(self) -> Self:
        """This map of walkers with the legs exchanged; itself if they are alike."""
        if self.walker.legs_alike:
            return self
        varied = {self.walker.counterpart(name): value for name, value in self.varied.items()}
        return replace(self, walker=self.walker.swapped, varied=varied)

    def coarser(self) -> Self:
        """Return this map with differences over twice the distance, to estimate their error."""
        return self

    @cached_property
    def walkers(self) -> Walkers:
        """The walkers, with the tolerance and the rules of their integration."""
        driven = self._driven
        return Walkers(
            walker=self.walker,
            parameters={name: self.varied[name] for name in self.varied if name not in driven},
            using=(*self.actuation.using, *driven),
            tolerance=self.tolerance,
            end_on_toe_stub=self.end_on_toe_stub,
        )

    @property
    def _driven(self) -> dict[str, Any]:
        """Parts of `actuation` in which strides differ."""
        return {name: self.varied[name] for name in Actuation._fields if name in self.varied}

    @property
    def controller(self) -> Any:
        """The controller: an `Actuation` in the walker's units, or None if passive."""
        return None if self.passive else to_own(self.walker.units, self.actuation)

    @property
    def controller_name(self) -> str:
        """Name of the controller; empty if there is none."""
        return "" if self.passive else str(self.controller)

    @property
    def passive(self) -> bool:
        """Whether no actuator drives the walkers."""
        return not self._driven and self.actuation.passive

    @property
    def parameters(self) -> dict[str, float]:
        """Parameters of walker and constant actuation that may be varied, in the walker's units."""
        parameters = dict(self.walker.parameters)
        if self.controlled or "actuation" not in self.walker.supports:
            return parameters
        return parameters | to_own(self.walker.units, self.actuation)._asdict()

    def unit(self, parameter: str) -> float:
        """Return a parameter's unit in this map, in the walker's units; 1 for a walker's own."""
        return float(unit_of(self.walker, parameter)) if parameter in Actuation._fields else 1.0

    @cached_property
    def ground(self) -> NDArray[np.float64]:
        """Slope of each foothold, then height change and slope change to the next, (L, 3).

        Slopes are in rad beyond the slope of the walk, heights in leg lengths. An odd number of
        footholds is there twice for legs that differ.
        """
        count = 1 if self.terrain is None else len(self.terrain.rises)
        count = count if self.walker.legs_alike else math.lcm(count, 2)
        if self.terrain is None:
            return np.zeros((count, 3))
        return self.terrain.ground(0, np.arange(count))

    def ahead(self, place: int) -> NDArray[np.float64]:
        """Height and slope changes ahead of foothold `place`, (2 `terrain_lookahead`,)."""
        return self.ground[
            (place + np.arange(self.terrain_lookahead)) % len(self.ground), 1:
        ].ravel()

    def _trailing(
        self, angles: NDArray, place: int, lanes: NDArray | None
    ) -> tuple[NDArray, NDArray, NDArray]:
        """Angles of straight trailing legs for stance angles (...); derivatives by angle and leg.

        Both feet touch the ground at a heelstrike. The trailing foot stands on the previous
        foothold, so it is lower by the height change to this foothold.

        Args:
            angles: Angles of the stance leg in rad, from this foothold's normal, (...).
            place: Number of this foothold.
            lanes: Indices of the walkers, where they differ in a parameter; all when None.
        """
        _, height_change, slope_change = self.ground[place - 1]
        bodies = self.walkers.constants if lanes is None else self.walkers.bodies(lanes=lanes)
        leg = self.walkers.system().Body(*bodies[:, 0].T).leg
        leg = leg.reshape(-1, *[1] * (angles.ndim - 1)) if angles.ndim else leg[0]
        with np.errstate(invalid="ignore", divide="ignore"):
            behind = -np.arccos(np.cos(angles - slope_change) + height_change / leg)
            by_angle = np.sin(angles - slope_change) / np.sin(behind)
            return behind + slope_change, by_angle, height_change / (leg**2 * np.sin(behind))

    def state(
        self, points: NDArray, place: int = 0, lanes: NDArray | None = None
    ) -> NDArray[np.float64]:
        """Return dimensionless states (..., 6) at points (..., m), on foothold `place`."""
        states = super().state(points)
        if self.terrain is not None and self.chart.trailing_leg_follows:
            states[..., 1] = states[..., 2] = self._trailing(points[..., 0], place, lanes)[0]
        return states

    def seeds(self, n: int, by: Sequence[str], along: NDArray | None) -> Seeds:
        """Return tangents of n walkers by name, those of "point" along directions (n, m, k)."""
        m = self.dimension
        ways = np.broadcast_to(np.eye(m), (n, m, m)) if along is None else along
        parts, moving = [np.zeros((n, m, 0))], {}
        for name in by:
            if name != "point":
                moving[name] = sum(part.shape[2] for part in parts)
            parts.append(ways if name == "point" else np.zeros((n, m, 1)))
        return Seeds(np.concatenate(parts, axis=2), moving)

    def state_by(
        self, points: NDArray, seeds: Seeds, place: int, lanes: NDArray
    ) -> NDArray[np.float64]:
        """Return changes of states (n, 6, k) at points (n, m) along tangents."""
        states = super().state(seeds.points.swapaxes(1, 2)).swapaxes(1, 2)
        if self.terrain is None or not self.chart.trailing_leg_follows:
            return states
        # The trailing leg's angle depends on the points and on the leg length.
        _, by_angle, by_leg = self._trailing(points[:, 0], place, lanes)
        states[:, 1:3] = (by_angle[:, None] * seeds.points[:, 0])[:, None]
        for name in set(seeds.moving) & set(PARAMETERS):
            bodies = self.walkers.bodies((name,), lanes)
            where = self.walkers.system((name,)).Body._fields.index("leg")
            states[:, 1:3, seeds.moving[name]] += (by_leg * bodies[:, -1, where])[:, None]
        return states

    @property
    def system(self) -> System:
        """The hybrid system: the walker's equations."""
        return self.walkers.system()

    def chosen(self, slope: float | None) -> float:
        """Return one slope in rad; the map's own when None."""
        return one_slope(self.slope if slope is None else slope)

    def _actuations(self, lanes: NDArray) -> NDArray[np.float64]:
        """Return dimensionless hip torque, ankle torque and push-off of n points, (n, 3)."""
        each, n = self.actuation._replace(**self._driven), len(lanes)
        return np.stack([for_each(x[lanes] if np.ndim(x) else x, n) for x in each], axis=1)

    def _checked(
        self, points: ArrayLike | Points, slopes: ArrayLike | None, strides: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
        """Check points of the section, slopes, of which there is one for each, and strides."""
        given = points.values if isinstance(points, Points) else points
        points, slopes = np.asarray(given, dtype=float), self.slope if slopes is None else slopes
        if points.ndim != 2 or points.shape[1] != self.dimension:
            raise ValueError(
                f"points of the section must have the shape (n, {self.dimension}), got "
                f"{points.shape}; map.points_at(states) gives them"
            )
        if slopes is None:
            raise ValueError(_NO_SLOPE)
        return points, for_each(slopes, len(points)), whole(strides, "strides")

    def apply(
        self, points: NDArray | Points, slopes: ArrayLike | None = None, *, strides: int = 1
    ) -> Passage:
        """Apply the stride map to points of the section.

        Args:
            points: Points of the section, (n, m), such as the `point` of a gait.
            slopes: Slope in rad, one for all or (n,); the map's own when None.
            strides: How many times to apply the map, at least once.
        """
        points, slopes, strides = self._checked(points, slopes, strides)
        results, outcomes = self._follow(points, slopes, np.arange(len(points)), strides)
        return Passage(**_named(results[0]), outcomes=outcomes)

    def linearize(
        self,
        points: NDArray | Points,
        slopes: ArrayLike | None = None,
        *,
        strides: int = 1,
        by: Sequence[str] = ("state",),
        along: NDArray | None = None,
    ) -> tuple[Passage, Change]:
        """Apply the stride map to points of the section, with exact derivatives.

        Args:
            points: Points of the section, (n, m), such as the `point` of a gait.
            slopes: Slope in rad, one for all or (n,); the map's own when None.
            strides: How many times to apply the map, at least once.
            by: Columns of the derivatives, in order: "state" (one for each coordinate), "slope",
                a part of `Actuation`, or a parameter of the walker. All other dimensionless
                quantities are held constant.
            along: Directions for "state" instead of the coordinates, (n, m, k).

        Returns:
            The `Passage`, and a `Change` with the derivatives of its fields.
        """
        if tuple(by) != ("state",):
            known = "state", "slope", *self.parameters
            if strange := unknown(by, known, "by: this stride map"):
                raise ValueError(strange)
            if self.walker.massless_legs and (mass := {*by} & {"thigh_mass", "shank_mass"}):
                raise ValueError(
                    f"no derivative by {min(mass)}, as legs without mass have equations of their "
                    "own: give a walker with such mass"
                )
            if "ankle_torque" in by and self.walker.foot_radius:
                raise ValueError(
                    "no derivative by ankle_torque: a round foot rolls, and the ground under it "
                    "bears no torque; give a walker with foot_radius=0"
                )
        points, slopes, strides = self._checked(points, slopes, strides)
        walking, outcomes = np.arange(len(points)), np.empty(len(points), np.int8)
        if len(points) > _FEW:
            # Leave failed strides out, as each costs as much as many others.
            walking, outcomes = self._walking(points, slopes, strides)
        results, ended = self._follow(
            points[walking], slopes[walking], walking, strides,
            ["point" if name == "state" else name for name in by],
            None if along is None else along[walking],
        )  # fmt: skip
        outcomes[walking] = ended
        values, derivatives = results[0], results[1:].transpose(1, 2, 0)
        if len(walking) < len(points):
            walked = values, derivatives
            values = np.full((len(values), len(points)), np.nan)
            derivatives = np.full((*values.shape, len(results) - 1), np.nan)
            values[:, walking], derivatives[:, walking] = walked
        # Rounding may end a stride in only one of the two runs; such a stride counts as failed.
        derivatives[np.isnan(values)] = np.nan
        return Passage(**_named(values), outcomes=outcomes), Change(**_named(derivatives))

    @cached_property
    def _roughly(self) -> Self:
        """This map at a tolerance that finds nearly all strides that fail."""
        return self if self.tolerance >= _ROUGHLY else self.with_tolerance(_ROUGHLY)

    def _walking(self, points: NDArray, slopes: NDArray, strides: int) -> tuple[NDArray, NDArray]:
        """Return which points' strides end with a heelstrike, and the outcomes of the others."""
        rough, outcomes = self._roughly._follow(points, slopes, np.arange(len(points)), strides)
        lost = np.flatnonzero(np.isnan(rough[0, 0]))
        if len(lost) and self._roughly is not self:
            finer, outcomes[lost] = self._follow(points[lost], slopes[lost], lost, strides)
            rough[0, 0, lost] = finer[0, 0]
        return np.flatnonzero(np.isfinite(rough[0, 0])), outcomes

    def _follow(
        self,
        points: NDArray,
        slopes: NDArray,
        lanes: NDArray,
        strides: int,
        by: Sequence[str] = (),
        along: NDArray | None = None,
    ) -> tuple[NDArray, NDArray[np.int8]]:
        """Return fields of `Change`, values before derivatives, (1 + k, m + 7, n), and outcomes."""
        walking = np.flatnonzero(np.isfinite(points).all(axis=1))
        outcomes = np.full(len(points), Outcome.DIVERGED, np.int8)
        outcomes[walking] = _STRUCK
        actuations, ground, uneven = self._actuations(lanes[walking]), self.ground, {}
        if self.terrain is not None:
            uneven = {"rises": ground[0, 1], "turns": ground[0, 2]}
        moving = {}
        if by:
            seeds = self.seeds(len(walking), by, None if along is None else along[walking])
            moving = seeds.moving
            if along is not None or uneven:
                along = self.state_by(points[walking], seeds, 0, lanes[walking])
        slopes, begun = slopes[walking], self.state(points[walking], lanes=lanes[walking])
        with np.errstate(all="ignore"), progress("strides", strides) as taken:
            walked = flow(
                self.walkers, begun, slopes + ground[0, 0], **uneven,
                controls=actuations[:, :2], push_offs=actuations[:, 2], until=self.max_stride_time,
                by=by, along=along, lanes=lanes[walking],
            )  # fmt: skip
            planes = walked.records.shape[1]
            totals, on = np.zeros((6, len(walking), planes)), np.ones(len(walking), bool)
            for stride in range(strides * len(ground)):
                if stride:
                    tilt, *foothold = ground[stride % len(ground)]
                    slopes = slopes[on]
                    walked = walked.next_stride(on, (slopes + tilt, *foothold) if uneven else None)
                self._add(totals, walked, lanes[walking], moving, stride % len(ground))
                if (stride + 1) % len(ground) == 0:
                    taken()
                # A stride that only ran out of time counts as STALLED.
                ended = np.where(walked.outcomes == Outcome.RUNNING, _STALLED, walked.outcomes)
                outcomes[walking] = ended
                on = ended == _STRUCK
                if not on.all():
                    walking, totals = walking[on], totals[:, on]
                    if len(walking) == 0:
                        break
            records = walked.records if on.all() else walked.records[on]
            unbalanced = imbalance(totals[2], totals[3], records["push_off"], totals[1])
        totals[5][totals[5][:, 0] == 0.0] = np.nan
        ends = self.point(states_in(records, self.size // 2)).transpose(2, 0, 1)
        rows = np.concatenate([ends, totals, unbalanced[None]]).transpose(2, 0, 1)
        if len(walking) == len(points):
            return rows, outcomes
        results = np.full((planes, self.dimension + 7, len(points)), np.nan)
        results[:, :, walking] = rows
        return results, outcomes

    @property
    def weights(self) -> float | NDArray[np.float64]:
        """The walkers' weights over the unit of force: a number, or (n,)."""
        return 1.0 if "units" in self.walker.supports else self.walker.mass_with(**self.varied)

    def weighted(self, work: NDArray, lanes: NDArray, moving: dict[str, int]) -> NDArray:
        """Return gravity's work on walkers of weight 1 as that on these walkers, (n, 1 + k)."""
        if "units" in self.walker.supports:
            return work
        own, weights = {name: x[lanes] for name, x in self.varied.items()}, np.zeros_like(work)
        weights[:, 0] = self.walker.mass_with(**own)
        for name in moving.keys() & self.walker.parameters.keys():
            value = complex_step(own.get(name, self.walker.parameters[name]))
            weights[:, 1 + moving[name]] = step_derivative(
                self.walker.mass_with(**own | {name: value})
            )
        return product(weights, work)

    def _add(
        self, totals: NDArray, walked: Flow, lanes: NDArray, moving: dict[str, int], place: int
    ) -> None:
        """Add the measures of one stride each to the totals of the strides before, in place."""
        durations, lengths, lost, supplied, braked, knee_times = totals
        records = walked.records
        length, sine = records["step_length"], records["ground"][..., 0]
        durations += records["time"]
        lengths += length
        lost += records["knee_loss"] + records["heel_loss"] + records["friction_loss"]
        if self.terrain is not None:
            # The record holds the new foothold's slope: turn it back to the old foothold's.
            slope_change, cosine = self.ground[place, 2], records["ground"][..., 1]
            turned = sine * math.cos(slope_change) - cosine * math.sin(slope_change)
            cosine = cosine * math.cos(slope_change) + sine * math.sin(slope_change)
            sine = turned
            heights = self._heights(walked.bodies, records.shape, place)
            supplied -= self.weighted(product(cosine, heights), lanes, moving)
        supplied += self.weighted(product(sine, length), lanes, moving)
        supplied += records["push_work"]
        knee_times[:] = records["knee_time"]
        works = np.array(walked.system.works)  # no work of the hip on feet without mass
        each = slice(len(works))
        controls = records["control"][..., each]
        if not np.any(controls):
            return
        powers = product(controls, records["moved"][..., each])
        supplied += (works * powers).sum(axis=2)
        turned = product(np.sign(controls[:, :1]) * controls, records["turned"][..., each])
        braked += (works * (turned - powers)).sum(axis=2)

    def _heights(self, bodies: NDArray, shape: tuple[int, ...], place: int) -> NDArray[np.float64]:
        """Return heights of the next contact points over these, in leg lengths, (n, 1 + k)."""
        _, height_change, slope_change = self.ground[place]
        heights = np.zeros(shape)
        if slope_change:
            radii = bodies[..., self.walkers.system().Body._fields.index("foot_radius")]
            heights[:, : radii.shape[1]] = radii * (1.0 - math.cos(slope_change))
        heights[:, 0] += height_change
        return heights

    def walk(self, state: NDArray, slope: float, count: int) -> list[Stride]:
        """Return the strides of `count` applications from a state (6,) on the Poincaré section."""
        strides: list[Stride] = []
        now = self
        for tilt, height_change, slope_change in np.tile(self.ground, (count, 1)).tolist():
            rise, seen = height_change * self.walker.leg_length, self.ahead(len(strides))
            strides.append(now._taken(state, slope + tilt, rise, slope_change, seen))
            state, now = strides[-1].state, now.swapped
        return strides

    def steepness(self, points: NDArray, slopes: NDArray) -> NDArray[np.float64]:
        """How steeply the foot comes down, as `Flow.steepness`; the least of an application, (n,).

        Args:
            points: Points of the section where the strides start, (n, m).
            slopes: Slope in rad, (n,).
        """
        now, states, least = self, self.state(points), np.full(len(points), np.inf)
        uneven = self.terrain is not None
        for tilt, rise, turn in self.ground.tolist():
            foothold = {"rises": rise, "turns": turn} if uneven else {}
            walked = flow(
                now.walkers, states, slopes + tilt, until=self.max_stride_time, **foothold
            )
            least, states = np.minimum(least, walked.steepness), walked.states
            now = now.swapped
        return least

    def stride(
        self,
        state: ArrayLike,
        slope: ArrayLike | None = None,
        *,
        height_change: ArrayLike | None = None,
        slope_change: ArrayLike | None = None,
        ahead: NDArray | None = None,
    ) -> Stride:
        """Take one stride and return its energy balance, in the walker's own units.

        Args:
            state: States on the Poincaré section, (6,) or (n, 6), in the walker's own units.
            slope: Slope in rad; the map's own when None.
            height_change: Height of the next foothold, as for `gpw.stride`. If neither this nor
                `slope_change` is given, the stride begins on the first foothold of the map's
                terrain.
            slope_change: Slope of the next foothold beyond this one's, in rad.
            ahead: Changes to the footholds ahead that a controller observes, as for `look`.
        """
        slopes: Any = self.slope if slope is None else slope
        if slopes is None:
            raise ValueError(_NO_SLOPE)
        if height_change is None and slope_change is None and self.terrain is not None:
            tilt, up, slope_change = self.ground[0].tolist()
            slopes, height_change = np.add(slopes, tilt), up * self.walker.leg_length
        rise, turn = (0.0 if x is None else x for x in (height_change, slope_change))
        check_heights_only(self.walker, turn)
        return self._taken(state, slopes, rise, turn, self.ahead(0) if ahead is None else ahead)

    def _taken(
        self, state: ArrayLike, slope: ArrayLike, rise: ArrayLike, turn: ArrayLike, ahead: NDArray
    ) -> Stride:
        """Take the stride of `stride`, with known changes to the next foothold."""
        return stride(
            self.walker, slope, state,
            tolerance=self.tolerance, max_stride_time=self.max_stride_time,
            end_on_toe_stub=self.end_on_toe_stub, height_change=rise, slope_change=turn,
            **to_own(self.walker.units, self.actuation)._asdict(),
        )  # fmt: skip

    def look(
        self,
        states: NDArray,
        slopes: ArrayLike,
        times: NDArray,
        rises: ArrayLike | None = None,
        turns: ArrayLike | None = None,
        ahead: NDArray | None = None,
    ) -> Samples:
        """Sample strides from dimensionless states (n, 6), each to a foothold of its own.

        The arguments are those of `sample`, except the footholds. `rises` are in leg lengths and
        `turns` in rad. `ahead` holds the height change and the slope change to each foothold that
        a controller observes, (n, 2 `terrain_lookahead`) or (2 `terrain_lookahead`,) for all.
        """
        actuations = self._actuations(np.arange(len(states)))
        seen = flow(
            self.walkers, states, slopes, controls=actuations[:, :2], save_at=times, rises=rises,
            turns=turns,
        )  # fmt: skip
        if "actuation" not in self.walker.supports:
            actuations = np.zeros((len(states), len(self.walker.controls)))  # type: ignore[attr-defined]
        controls = np.broadcast_to(actuations[:, None, :], (*times.shape, actuations.shape[1]))
        return Samples(seen.states, seen.stages, controls)

    def sample(self, points: NDArray, slopes: ArrayLike, times: NDArray) -> Samples:
        """Sample strides at given times; every sample is as exact as the map itself.

        Args:
            points: Points of the section where the strides start, (n, m).
            slopes: Slope in rad, one for all or (n,).
            times: Times since the start, (n, k), in any order. A time after the end of a stride
                gives its final state.
        """
        slopes = for_each(slopes, len(points))
        if self.terrain is None:
            return self.look(self.state(points), slopes, times)
        tilt, height_change, slope_change = self.ground[0]
        return self.look(
            self.state(points), slopes + tilt, times, height_change, slope_change, self.ahead(0)
        )

    def before_strike(self, point: NDArray, slope: float, strike: float) -> NDArray[np.float64]:
        """Return the state (6,) just before an impact, exact to rounding.

        The integration stops shortly before the impact. The accelerations there give the rest.

        Args:
            point: Point of the section where the stride starts, (m,).
            slope: Slope in rad.
            strike: Time of the kneestrike or the heelstrike since the start.
        """
        time, here = strike * (1.0 - STATE_BEFORE), slope + self.ground[0, 0]
        seen, left = self.sample(point[None], slope, np.array([[time]])), strike - time
        states, stages, controls = (part[:, 0] for part in seen)
        phase = next(phase for phase in self.system.phases if phase.stage == stages[0])
        ground = Ground(np.sin(here), np.cos(here))
        bodies = self.walkers.constants[:, 0]
        change = left * accelerations_at(self.system, phase, bodies, states, controls, ground)[0]
        angles, rates = np.split(states[0], 2)
        return np.concatenate([angles + (rates + 0.5 * change) * left, rates + change])


MapLike: TypeAlias = WalkerLike | Section | Repeated
"""Type of the first argument of analyses: a map of `gpw.stride_map`, a gait of one, or a walker in
a form that `as_walker` takes. Such a walker is passive."""


def map_of(walker: MapLike, *, tolerance: float) -> StrideMap:
    """Return a given stride map, that of a given gait, or the passive map of a given walker.

    Args:
        walker: A map of `gpw.stride_map`, a `Gait`, or a walker in a form that `as_walker` takes.
        tolerance: Tolerance of the integration.

    Raises:
        WalkerError: if `walker` is none of them.
    """
    given: Any = getattr(walker, "stride_map", walker)
    if isinstance(given, Section):
        return given.with_tolerance(tolerance)  # type: ignore[attr-defined]
    return StrideMap.of(given, tolerance=tolerance)


def _named(results: NDArray) -> dict[str, NDArray]:
    """Split rows (m + 7, n), or their derivatives (m + 7, n, k), into the fields of `Change`."""
    rest = 1 - len(_FIELDS)
    return dict(zip(_FIELDS, [results[:rest].swapaxes(0, 1), *results[rest:]], strict=True))
