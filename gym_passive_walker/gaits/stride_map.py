"""The stride map of a walker: from one heelstrike to the next, with its exact derivatives.

This is where analyses meet the engine: its records, constants and numbers with a derivative stay in
this module. A derivative is an infinitesimal imaginary part that passes through the flow, the
collisions and the moments at which they happen (which saltation matrices account for elsewhere).
Everything is dimensionless (see `units`), and strides lead from point to point of the `section`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from types import SimpleNamespace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.gaits.passage import Change, Passage, Samples
from gym_passive_walker.gaits.section import Section
from gym_passive_walker.physics import constants as column
from gym_passive_walker.physics import record as entry
from gym_passive_walker.physics.constants import Kind, constants_from, kind_of
from gym_passive_walker.physics.engine import advance
from gym_passive_walker.physics.events import Outcome
from gym_passive_walker.physics.record import new_records
from gym_passive_walker.physics.trajectory import just_before
from gym_passive_walker.walkers import Walker, as_walker

LONGEST = 20.0
"""Time in sqrt(l/g) after which a stride without heelstrike is given up; a usual one takes 3."""

INFINITESIMAL = 1e-100
"""Imaginary part that carries a derivative; its square is nothing beside any real part."""

_CONTROLS = ("state", "slope", "torque")  # to differentiate by, besides parameters
_FEW = 4  # strides that are so rarely all in vain that it does not pay to try them first
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
    """

    tolerance: float = 1e-13
    longest: float = LONGEST
    stub: bool = False

    @classmethod
    def of(
        cls,
        walker: Walker | str,
        *,
        tolerance: float = 1e-13,
        longest: float = LONGEST,
        stub: bool = False,
    ) -> Self:
        """The stride map of a walker, or of a preset's name."""
        return cls(walker=as_walker(walker), tolerance=tolerance, longest=longest, stub=stub)

    def with_tolerance(self, tolerance: float) -> Self:
        """The same map, followed with another tolerance."""
        return replace(self, tolerance=tolerance)

    @cached_property
    def kind(self) -> Kind:
        """Which equations the walker obeys."""
        return kind_of(self.walker)

    @cached_property
    def constants(self) -> NDArray[np.float64]:
        """What the engine knows of the walkers: one row for all, or one for each."""
        return self._constants()

    def _constants(self, moved: str | None = None) -> NDArray:
        """Constants of the walkers, with an infinitesimal step in one of their parameters."""
        rows = []
        for value in [None] if self.values is None else self.values.tolist():
            body = SimpleNamespace(**vars(self.walker))
            if self.parameter is not None:
                setattr(body, self.parameter, value)
            if moved is not None:
                setattr(body, moved, getattr(body, moved) + 1j * INFINITESIMAL)
            rows.append(constants_from(body, knees=self.walker.knees))
        return np.array(rows)

    def apply(
        self, points: NDArray, slopes: ArrayLike, *, torque: ArrayLike = 0.0, strides: int = 1
    ) -> Passage:
        """Take walkers through some strides.

        Args:
            points: Points of the section, (n, m).
            slopes: Slope in rad, one for all or (n,).
            torque: Hip torque held all along, likewise.
            strides: Strides to take.
        """
        slopes, torques = _for_each(slopes, len(points)), _for_each(torque, len(points))
        told, outcomes = self._follow(points, slopes, torques, self.constants, strides)
        return Passage(**_named(told), outcomes=outcomes)

    def linearise(
        self,
        points: NDArray,
        slopes: ArrayLike,
        *,
        torque: ArrayLike = 0.0,
        strides: int = 1,
        by: Sequence[str] = ("state",),
        along: NDArray | None = None,
    ) -> tuple[Passage, Change]:
        """Take walkers through some strides, with exact derivatives.

        Args:
            points: Points of the section, (n, m).
            slopes: Slope in rad, one for all or (n,).
            torque: Hip torque held all along, likewise.
            strides: Strides to take.
            by: Columns of the derivatives, in order: "state" (one for each coordinate), "slope",
                "torque", or a parameter of the walker, all else being held dimensionless.
            along: Directions for "state" instead of the coordinates, (n, m, k).

        Returns:
            The passage, and the derivatives of all in it.
        """
        slopes, torques = _for_each(slopes, len(points)), _for_each(torque, len(points))
        walking, outcomes = np.arange(len(points)), np.empty(len(points), np.int8)
        if len(points) > _FEW:
            # Without derivatives first: strides that fail cost as much as many that do not.
            plain, outcomes = self._follow(points, slopes, torques, self.constants, strides)
            walking = np.flatnonzero(np.isfinite(plain[0]))
        coordinates = self.dimension if along is None else along.shape[2]
        columns, of_state, of_slope, of_torque = _columns(tuple(by), coordinates)
        seeds = np.zeros((len(points), len(columns), self.dimension))
        if "state" in by:
            seeds[:, of_state] = np.eye(coordinates) if along is None else along.swapaxes(1, 2)
        step = 1j * INFINITESIMAL
        dual, ended = self._follow(
            (points[walking, None] + step * seeds[walking]).reshape(-1, self.dimension),
            (slopes[walking, None] + step * of_slope).ravel(),
            (torques[walking, None] + step * of_torque).ravel(),
            self._seeded_constants(columns, walking),
            strides,
        )
        dual = dual.reshape(len(dual), len(walking), len(columns))
        # Whether a stride exists at all may differ by a rounding; then there is none.
        dual[:, np.isnan(np.real(dual[0])).any(axis=1)] = np.nan
        outcomes[walking] = ended[:: len(columns)]
        values = np.full((len(dual), len(points)), np.nan)
        derivatives = np.full((*values.shape, len(columns)), np.nan)
        values[:, walking] = np.real(dual[:, :, 0])
        derivatives[:, walking] = np.imag(dual) / INFINITESIMAL
        derivatives[np.isnan(values)] = np.nan
        return Passage(**_named(values), outcomes=outcomes), Change(**_named(derivatives))

    def _seeded_constants(self, columns: tuple[str, ...], lanes: NDArray) -> NDArray:
        """Constants of some lanes, each repeated with the parameter moved that a column moves."""
        moved = [None if name in _CONTROLS else name for name in columns]
        if not any(moved):
            own = self.constants
            return own if len(own) == 1 else np.repeat(own[lanes], len(moved), axis=0)
        rows = np.stack([self._constants(name) for name in moved], axis=1)
        rows = rows[lanes] if len(rows) > 1 else np.repeat(rows, len(lanes), axis=0)
        return rows.reshape(-1, rows.shape[2])

    def _follow(
        self, points: NDArray, slopes: NDArray, torques: NDArray, constants: NDArray, strides: int
    ) -> tuple[NDArray, NDArray[np.int8]]:
        """What `Change` tells, real or complex, in rows (m + 6, n); and the outcomes (n,)."""
        dtype = np.result_type(points, slopes, torques, constants)
        walking = np.flatnonzero(np.isfinite(points).all(axis=1))
        outcomes = np.full(len(points), Outcome.DIVERGED, np.int8)
        outcomes[walking] = _STRUCK
        slopes, torques, own = (
            slopes[walking],
            torques[walking],
            constants.astype(dtype, copy=False),
        )
        own = own[walking] if len(own) > 1 else own
        states = self.state(points[walking].astype(dtype, copy=False))
        totals = np.zeros((5, len(walking)), dtype)
        with np.errstate(all="ignore"):
            for _ in range(strides):
                if len(walking) == 0:
                    break
                records = new_records(states, slopes, torques, end=self.longest)
                advance(self.kind, own, records, tolerance=self.tolerance, stub=self.stub)
                self._add(totals, states, records, own)
                states = records[:, :6]
                outcomes[walking] = ended = _outcomes(records)
                on = ended == _STRUCK
                if not on.all():
                    walking, states, totals = walking[on], states[on], totals[:, on]
                    slopes, torques = slopes[on], torques[on]
                    own = own[on] if len(own) > 1 else own
            _, _, lost, supplied, knee_times = totals
            imbalance = 2.0 * (lost - supplied) / (lost + supplied)
        knee_times[knee_times == 0.0] = np.nan
        told = np.full((self.dimension + 6, len(points)), np.nan, dtype)
        told[:, walking] = np.vstack([self.point(states).T, totals, imbalance])
        return told, outcomes

    def _add(self, totals: NDArray, starts: NDArray, records: NDArray, constants: NDArray) -> None:
        """Add strides to what was told of those before."""
        durations, lengths, lost, supplied, knee_times = totals
        length = _step_length(constants, starts[:, 0], records[:, 0])
        durations += records[:, entry.TIME]
        lengths += length
        lost += records[:, entry.KNEE_LOSS] + records[:, entry.HEEL_LOSS]
        supplied += records[:, entry.SIN_SLOPE] * length
        if self.kind != Kind.SIMPLEST:  # its torque works on feet of vanishing mass
            supplied += records[:, entry.TORQUE] * records[:, entry.HIP_NET]
        knee_times[:] = records[:, entry.KNEE_TIME]

    def sample(
        self, points: NDArray, slopes: ArrayLike, times: NDArray, *, torque: ArrayLike = 0.0
    ) -> Samples:
        """Look at strides inside: every sample is as exact as the map itself.

        Args:
            points: Where they start, (n, m).
            slopes: Slope in rad, one for all or (n,).
            times: Since the start, (n, k), in any order; later ones than a stride's end give the
                state that it ends with.
            torque: Hip torque held all along, one for all or (n,).
        """
        count, looks = times.shape
        slopes, torques = (np.repeat(_for_each(x, count), looks) for x in (slopes, torque))
        records = new_records(np.repeat(self.state(points), looks, axis=0), slopes, torques)
        records[:, entry.END] = times.ravel()
        own = self.constants
        own = own if len(own) == 1 else np.repeat(own, looks, axis=0)
        records[~np.isfinite(records[:, entry.END])] = 0.0  # nothing to follow
        advance(self.kind, own, records, tolerance=self.tolerance, stub=self.stub)
        phases = records[:, entry.PHASE].astype(np.int64).reshape(count, looks)
        return Samples(records[:, :6].reshape(count, looks, 6), phases)

    def before_strike(
        self, point: NDArray, slope: float, strike: float, *, torque: float = 0.0
    ) -> NDArray[np.float64]:
        """The state (6,) on the verge of a strike, before the collision, exact to rounding.

        Args:
            point: Where the stride starts, (m,).
            slope: Slope in rad.
            strike: Time of the kneestrike or the heelstrike since the start.
            torque: Hip torque held all along.
        """
        units, start = self.units, self.states_at(point[None])[0]
        torque, tolerance = torque * units.torque, self.tolerance
        state = just_before(
            self.walker, slope, start, strike * units.time, hip_torque=torque, tolerance=tolerance
        )
        return units.to_dimensionless(state)


@lru_cache
def _columns(
    by: tuple[str, ...], coordinates: int
) -> tuple[tuple[str, ...], NDArray, NDArray, NDArray]:
    """What each column is a derivative by, and which of them are by state, slope and torque."""
    columns = tuple(x for name in by for x in [name] * (coordinates if name == "state" else 1))
    state, slope, torque = (np.array([x == name for x in columns]) for name in _CONTROLS)
    return columns, state, slope, torque


def _named(told: NDArray) -> dict[str, NDArray]:
    """The fields of `Change` from rows (m + 6, n), or from their derivatives (m + 6, n, k)."""
    rest = 1 - len(_FIELDS)
    return dict(zip(_FIELDS, [np.moveaxis(told[:rest], 0, 1), *told[rest:]], strict=True))


def _step_length(constants: NDArray, before: NDArray, after: NDArray) -> NDArray:
    """Length of a step between two heelstrikes, by the stance angles just after them."""
    leg, radius = constants[:, column.LEG], constants[:, column.FOOT_RADIUS]
    return 2.0 * leg * np.sin(after) + radius * (before + after)


def _outcomes(records: NDArray) -> NDArray[np.int8]:
    """How strides ended; who is only out of time has stalled."""
    outcomes = np.real(records[:, entry.OUTCOME]).astype(np.int8)
    outcomes[outcomes == 0] = _STALLED  # Outcome.RUNNING
    return outcomes


def _for_each(value: ArrayLike, count: int) -> NDArray:
    """A number, or one for each of some points, as one for each."""
    values = np.asarray(value, dtype=float)
    return values if values.ndim else np.full(count, values)
