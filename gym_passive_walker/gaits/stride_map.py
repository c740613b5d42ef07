"""The stride map of a walker: from one heelstrike to the next, with its exact derivatives.

This is where analyses meet the engine: its records and bodies stay in this module. Derivatives are
carried beside the values through the flow, the collisions and the moments at which they happen
(which saltation matrices account for elsewhere). Everything is dimensionless (see `units`), and
strides lead from point to point of the `section`.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.engine.run import Seeds, advance, new_records
from gym_passive_walker.gaits.drive import PASSIVE, USES, Drive, for_each, to_dimensionless, to_own
from gym_passive_walker.gaits.passage import Change, Passage
from gym_passive_walker.gaits.samples import Samples, just_before, look_inside
from gym_passive_walker.gaits.section import Section
from gym_passive_walker.physics.hybrid import Outcome, System
from gym_passive_walker.physics.systems import bodies_by, system_of, varied_bodies
from gym_passive_walker.progress import progress
from gym_passive_walker.units import units_of
from gym_passive_walker.walkers import WalkerLike, as_walker

LONGEST = 20.0
"""Time in sqrt(l/g) after which a stride without heelstrike is given up; a usual one takes 3."""

_MOVED = ("state", "slope", *Drive._fields)  # to differentiate by, besides parameters
_FEW = 16
_DROWNED = 1e6
"""Push-off over the step length squared, of about 1 on most gaits; beyond, rounding is no less than
the accuracy of gaits."""
_OF_ONE_STRIDE = ("time", "step", "knee_time", "knee_loss", "friction_loss", "moved", "turned")
_FIELDS = [field.name for field in fields(Change)]
_STRUCK, _STALLED = int(Outcome.HEELSTRIKE), int(Outcome.STALLED)


@dataclass(frozen=True, eq=False, kw_only=True)
class StrideMap(Section):
    """The stride map of one walker, or of n that differ in one parameter; made by `of`.

    Attributes:
        walker: Who walks.
        parameter: The walkers' parameter that differs, if any.
        values: Its value for each of n points, (n,).
        tolerance: Error relative to the largest angle or rate.
        longest: Time after which a stride is given up.
        stub: Whether a kneed walker's locked swing leg below the ground ends the stride.
        drive: What its motors do in each stride, dimensionless. A part of it may be the `parameter`
            that differs.
    """

    tolerance: float = 1e-13
    longest: float = LONGEST
    stub: bool = False
    drive: Drive = PASSIVE

    @classmethod
    def of(
        cls,
        walker: WalkerLike,
        *,
        tolerance: float = 1e-13,
        longest: float = LONGEST,
        stub: bool = False,
        drive: Drive = PASSIVE,
    ) -> Self:
        """The stride map of a walker (see `as_walker`); a drive is in the walker's units."""
        walker = as_walker(walker)
        return cls(
            walker=walker, tolerance=tolerance, longest=longest, stub=stub,
            drive=drive if drive is PASSIVE else to_dimensionless(units_of(walker), drive),
        )  # fmt: skip

    def with_tolerance(self, tolerance: float) -> Self:
        """The same map, followed with another tolerance."""
        return replace(self, tolerance=tolerance)

    @property
    def system(self) -> System:
        """Which equations the walker obeys."""
        return self._system()

    def _system(self, moved: Collection[str] = ()) -> System:
        """Which equations it obeys as some of its parameters change."""
        differing = (*moved, self.parameter) if self.parameter else moved
        using = {USES.get(name, name) for name in differing}
        return system_of(self.walker, using=using.union(self.drive.using))

    def _drives(self, count: int) -> NDArray[np.float64]:
        """The drive of each of some points, (n, 3)."""
        drive = self.drive
        if self.parameter in Drive._fields:
            drive = drive._replace(**{self.parameter: self.values})  # type: ignore[dict-item]
        drives = np.empty((count, len(drive)))
        for column, part in zip(drives.T, drive, strict=True):
            column[:] = part
        return drives

    @cached_property
    def bodies(self) -> NDArray[np.float64]:
        """What the engine knows of the walkers, (1 or n, 1, constants): one for all, or each."""
        return varied_bodies(self.walker, self._parameters)[:, None]

    @property
    def _parameters(self) -> dict[str, NDArray]:
        """In what walkers differ."""
        if self.parameter is None or self.parameter in Drive._fields:
            return {}
        return {self.parameter: self.values}  # type: ignore[dict-item]

    def apply(self, points: NDArray, slopes: ArrayLike, *, strides: int = 1) -> Passage:
        """Take walkers through some strides.

        Args:
            points: Points of the section, (n, m).
            slopes: Slope in rad, one for all or (n,).
            strides: Strides to take.
        """
        slopes, drives = for_each(slopes, len(points)), self._drives(len(points))
        told, outcomes = self._follow(points, slopes, drives, self.bodies, strides)
        return Passage(**_named(told[0]), outcomes=outcomes)

    def linearise(
        self,
        points: NDArray,
        slopes: ArrayLike,
        *,
        strides: int = 1,
        by: Sequence[str] = ("state",),
        along: NDArray | None = None,
    ) -> tuple[Passage, Change]:
        """Take walkers through some strides, with exact derivatives.

        Args:
            points: Points of the section, (n, m).
            slopes: Slope in rad, one for all or (n,).
            strides: Strides to take.
            by: Columns of the derivatives, in order: "state" (one for each coordinate), "slope",
                a part of the drive, or a parameter of the walker, all else being held
                dimensionless.
            along: Directions for "state" instead of the coordinates, (n, m, k).

        Returns:
            The passage, and the derivatives of all in it.
        """
        slopes, drives = for_each(slopes, len(points)), self._drives(len(points))
        walking, outcomes = np.arange(len(points)), np.empty(len(points), np.int8)
        if len(points) > _FEW:
            # Without derivatives first: strides that fail cost as much as many that do not.
            plain, outcomes = self._follow(points, slopes, drives, self.bodies, strides)
            walking = np.flatnonzero(np.isfinite(plain[0, 0]))
        coordinates = self.dimension if along is None else along.shape[2]
        columns, of = _columns(tuple(by), coordinates)
        moved = np.zeros((len(walking), len(columns), self.dimension))
        if "state" in by:
            moved[:, of[0]] = (
                np.eye(coordinates) if along is None else along[walking].swapaxes(1, 2)
            )
        each = np.tile(of[1:].astype(float), (len(walking), 1, 1))
        seeds = Seeds(
            states=self.state(moved),
            slopes=each[:, 0],
            controls=each[:, 1:3].swapaxes(1, 2),
            push_offs=each[:, 3],
        )
        told, ended = self._follow(
            points[walking], slopes[walking], drives[walking],
            self._seeded_bodies(columns, walking), strides, seeds, by,
        )  # fmt: skip
        outcomes[walking] = ended
        # Whether a stride exists at all may differ by a rounding; then there is none.
        values = np.full((told.shape[1], len(points)), np.nan)
        derivatives = np.full((*values.shape, len(columns)), np.nan)
        values[:, walking] = told[0]
        derivatives[:, walking] = told[1:].transpose(1, 2, 0)
        derivatives[np.isnan(values)] = np.nan
        return Passage(**_named(values), outcomes=outcomes), Change(**_named(derivatives))

    def _seeded_bodies(self, columns: tuple[str, ...], lanes: NDArray) -> NDArray:
        """Bodies of some lanes, and behind each how it changes in the columns of derivatives."""
        parameters = [name for name in columns if name not in _MOVED]
        own = self.bodies if len(self.bodies) == 1 else self.bodies[lanes]
        if not parameters:
            return own
        rows = np.concatenate([own, np.zeros((len(own), len(columns), own.shape[2]))], axis=1)
        for name in parameters:
            change = bodies_by(self.walker, self._parameters, name)
            rows[:, 1 + columns.index(name)] = change if len(change) == 1 else change[lanes]
        return rows

    def _follow(
        self,
        points: NDArray,
        slopes: NDArray,
        drives: NDArray,
        bodies: NDArray,
        strides: int,
        seeds: Seeds | None = None,
        by: Sequence[str] = (),
    ) -> tuple[NDArray, NDArray[np.int8]]:
        """What `Change` tells, values before derivatives, (1 + k, m + 6, n); and the outcomes."""
        system = self._system(by)
        planes = 0 if seeds is None else seeds.states.shape[1]  # type: ignore[union-attr]
        walking = np.flatnonzero(np.isfinite(points).all(axis=1))
        outcomes = np.full(len(points), Outcome.DIVERGED, np.int8)
        outcomes[walking] = _STRUCK
        own = bodies[walking] if len(bodies) > 1 else bodies
        own_seeds = seeds and Seeds(*(None if s is None else s[walking] for s in seeds))
        records = new_records(
            self.state(points[walking]), slopes[walking], drives[walking, :2],
            push_off=drives[walking, 2], end=self.longest, seeds=own_seeds, planes=planes,
        )  # fmt: skip
        totals = np.zeros((5, len(walking), planes + 1))
        with np.errstate(all="ignore"), progress("strides", strides) as taken:
            for stride in range(strides):
                if len(walking) == 0:
                    break
                if stride:
                    for name in _OF_ONE_STRIDE:
                        records[name] = 0.0
                    records["outcome"] = 0
                advance(system, own, records, tolerance=self.tolerance, scuff=self.stub)
                self._add(totals, records)
                taken()
                outcomes[walking] = ended = _outcomes(records)
                on = ended == _STRUCK
                if not on.all():
                    walking, records, totals = walking[on], records[on], totals[:, on]
                    own = own[on] if len(own) > 1 else own
            imbalance = _imbalance(totals[2], totals[3], records["push_off"], totals[1])
        totals[4][totals[4][:, 0] == 0.0] = np.nan
        told = np.full((planes + 1, self.dimension + 6, len(points)), np.nan)
        ends = self.point(records["state"]).transpose(2, 0, 1)
        rows = np.concatenate([ends, totals, imbalance[None]])
        told[:, :, walking] = rows.transpose(2, 0, 1)
        return told, outcomes

    def _add(self, totals: NDArray, records: NDArray) -> None:
        """Add strides to what was told of those before."""
        durations, lengths, lost, supplied, knee_times = totals
        length, sine = records["step_length"], records["ground"][..., 0]
        durations += records["time"]
        lengths += length
        lost += records["knee_loss"] + records["heel_loss"] + records["friction_loss"]
        supplied += _product(sine, length)
        supplied += records["push_work"]
        works = np.array(self.system.works)  # a hip's not on feet of vanishing mass
        supplied += (works * _product(records["control"], records["moved"])).sum(axis=2)
        knee_times[:] = records["knee_time"]

    def sample(self, points: NDArray, slopes: ArrayLike, times: NDArray) -> Samples:
        """Look at strides inside: every sample is as exact as the map itself.

        Args:
            points: Where they start, (n, m).
            slopes: Slope in rad, one for all or (n,).
            times: Since the start, (n, k), in any order; later ones than a stride's end give the
                state that it ends with.
        """
        drives = self._drives(len(points))
        return look_inside(
            self.system, self.bodies, self.state(points), for_each(slopes, len(points)),
            drives[:, :2], times, tolerance=self.tolerance, stub=self.stub,
        )  # fmt: skip

    def before_strike(self, point: NDArray, slope: float, strike: float) -> NDArray[np.float64]:
        """The state (6,) on the verge of a strike, before the collision, exact to rounding.

        Args:
            point: Where the stride starts, (m,).
            slope: Slope in rad.
            strike: Time of the kneestrike or the heelstrike since the start.
        """
        units, start = self.units, self.states_at(point[None])[0]
        hip, ankle, _ = to_own(units, self.drive)
        state = just_before(
            self.walker, slope, start, strike * units.time, hip_torque=hip, ankle_torque=ankle,
            tolerance=self.tolerance,
        )  # fmt: skip
        return units.to_dimensionless(state)


@lru_cache
def _columns(by: tuple[str, ...], coordinates: int) -> tuple[tuple[str, ...], NDArray]:
    """What each column is a derivative by, and which of them are by each of `_MOVED`."""
    columns = tuple(x for name in by for x in [name] * (coordinates if name == "state" else 1))
    return columns, np.array([[x == name for x in columns] for name in _MOVED])


def _named(told: NDArray) -> dict[str, NDArray]:
    """The fields of `Change` from rows (m + 6, n), or from their derivatives (m + 6, n, k)."""
    rest = 1 - len(_FIELDS)
    return dict(zip(_FIELDS, [told[:rest].swapaxes(0, 1), *told[rest:]], strict=True))


def _product(a: NDArray, b: NDArray) -> NDArray:
    """The product of two quantities (n, 1 + k, ...), each with k derivatives behind its value."""
    product = a[:, :1] * b + a * b[:, :1]
    product[:, 0] *= 0.5
    return product


def _imbalance(lost: NDArray, supplied: NDArray, push_off: NDArray, lengths: NDArray) -> NDArray:
    """The difference of energy lost and supplied over their mean, (n, 1 + k).

    With legs nearly together, a strike takes back all that the push-off has just given. Compared
    with that alone, every walker that hardly steps would be in balance. So the difference is
    enlarged where steps are short for their push-off, which leaves those of gaits much as they are.
    """
    l0, s0 = lost[:, :1], supplied[:, :1]
    relative = 4.0 * (s0 * lost - l0 * supplied) / (l0 + s0) ** 2
    relative[:, 0] = 2.0 * (lost[:, 0] - supplied[:, 0]) / (lost[:, 0] + supplied[:, 0])
    if not np.any(push_off):
        return relative
    square = _product(lengths, lengths)
    enlarged = (push_off - push_off[:, :1] * square / square[:, :1]) / square[:, :1]
    enlarged[:, 0] = push_off[:, 0] / square[:, 0]
    drowned = enlarged[:, 0] > _DROWNED
    enlarged[:, 0] += 1.0
    enlarged[drowned] = np.nan
    return _product(relative, enlarged)


def _outcomes(records: NDArray) -> NDArray[np.int8]:
    """How strides ended; who is only out of time has stalled."""
    outcomes = records["outcome"][:, 0].astype(np.int8)
    outcomes[outcomes == Outcome.RUNNING] = _STALLED
    return outcomes
