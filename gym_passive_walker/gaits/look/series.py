"""Quantities of a walk over time: forces, energies, powers and the centre of mass.

Nothing here is computed unless it is asked for. All is in the walker's own units.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.shown import Table
from gym_passive_walker.gaits.flow import STATE_BEFORE
from gym_passive_walker.gaits.look.dense_stride import (
    Impulse,
    TimedExtremum,
    clearance_of,
    heelstrike_impulses,
    kneestrike_impulses,
)
from gym_passive_walker.gaits.look.forces import Reactions, centre_of_mass, forces
from gym_passive_walker.gaits.measures import InUnits
from gym_passive_walker.gaits.stride import Stride
from gym_passive_walker.gaits.stride_map import Samples, StrideMap
from gym_passive_walker.gaits.terrain import Terrain, ground_of
from gym_passive_walker.models.equations.hybrid import SMOOTH, Ground, Outcome
from gym_passive_walker.models.equations.numbers import complex_step, step_derivative
from gym_passive_walker.models.model import check_supports
from gym_passive_walker.models.walkers import Walker, name_of

SERIES = {
    "forces": ("normal_force", "tangential_force"),
    "torques": ("hip_joint_torque", "stance_knee_torque", "swing_knee_torque"),
    "path": ("com_x", "com_y"),
    "hodograph": ("com_velocity_x", "com_velocity_y"),
    "energy": ("kinetic_energy", "potential_energy", "spring_energy", "mechanical_energy"),
    "power": ("friction_power",),
    "clearance": ("foot_clearance",),
}
"""Quantities over time, by the plot that shows them; those of actuators join the powers."""

_NUMBERS = "normal_impulse", "tangential_impulse", "stance_knee_impulse", "loss"
"""Quantities of impacts and push-offs."""


@dataclass(frozen=True, repr=False)
class Strikes(InUnits, Table):
    """Impacts of a walk and push-offs, in order of time, in the walker's own units.

    The impulses of a heelstrike are in the frame of the foothold that is struck, those of the
    others in that of the stance foot.

    Attributes:
        walker: The walker.
        times: Time of each since the start, (n,).
        stride_index: Number of its stride, from 0, (n,).
        kinds: "kneestrike", "push-off" or "heelstrike", (n,).
        normal_impulse: Impulse of the ground away from it: on the new stance foot at a heelstrike,
            on the old one at a push-off, (n,).
        tangential_impulse: Impulse of the ground along it, positive downhill, (n,).
        stance_knee_impulse: Impulse on the stop of the same leg's knee, positive when it is
            pressed, (n,); NaN without knees.
        loss: Energy lost, (n,); negative is the work of a push-off.
    """

    walker: Walker
    times: NDArray[np.float64]
    stride_index: NDArray[np.int64]
    kinds: NDArray[Any]
    normal_impulse: NDArray[np.float64]
    tangential_impulse: NDArray[np.float64]
    stance_knee_impulse: NDArray[np.float64]
    loss: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.times)

    def facts(self) -> dict[str, str]:
        """Number of each kind."""
        kinds, counts = np.unique(self.kinds, return_counts=True)
        found = {f"{kind}s": str(count) for kind, count in zip(kinds, counts, strict=True)}
        return {"walker": name_of(self.walker), **found}

    def columns(self) -> dict[str, NDArray]:
        """One row for each impact or push-off."""
        return {
            "time": self.times,
            "stride": self.stride_index,
            "strike": self.kinds,
            **{name: getattr(self, name) for name in _NUMBERS},
        }


@dataclass(frozen=True, repr=False)
class OverTime(InUnits):
    """Quantities of a walk at n instants; `Trajectory` says what the attributes are."""

    walker: Walker
    slope: float
    times: NDArray[np.float64]
    states: NDArray[np.float64]
    contact_x: NDArray[np.float64]
    contact_y: NDArray[np.float64]
    tilts: NDArray[np.float64]
    stride_index: NDArray[np.int64]
    phases: NDArray[np.int64]
    torques: NDArray[np.float64]
    taken: Stride
    terrain: Terrain | None
    terrain_seed: int
    _map: StrideMap

    @cached_property
    def _reactions(self) -> Reactions:
        check_supports(self.walker, "ground force")
        there = self.slope + self.tilts
        return self._by_leg(forces, there, self.states, self.phases, self.torques)

    @property
    def normal_force(self) -> NDArray[np.float64]:
        """Force of the ground on the stance foot away from its foothold, (n,)."""
        return self._reactions.normal

    @property
    def tangential_force(self) -> NDArray[np.float64]:
        """Force of the ground on the stance foot along its foothold, positive downhill, (n,)."""
        return self._reactions.tangential

    @property
    def hip_joint_torque(self) -> NDArray[np.float64]:
        """Torque between the legs at the hip, of actuator, spring and friction, (n,).

        It is positive when it opens the legs; NaN for a `System`.
        """
        return self._reactions.hip

    @property
    def stance_knee_torque(self) -> NDArray[np.float64]:
        """Torque on the stance knee's stop, positive when it is pressed, (n,).

        It is NaN without knees.
        """
        return self._reactions.stance_knee

    @property
    def swing_knee_torque(self) -> NDArray[np.float64]:
        """Torque on the swing knee's stop, positive when it is pressed, (n,).

        It is 0 while the knee is free, and NaN without knees.
        """
        return self._reactions.swing_knee

    @cached_property
    def centre_of_mass(self) -> NDArray[np.float64]:
        """Position of the centre of mass from the first contact point, (n, 2).

        The components are along the slope, positive downhill, and away from it.
        """
        contact = np.stack([self.contact_x, self.contact_y], axis=-1)
        return contact + self._on_slope(self._by_leg(centre_of_mass, self.states))

    @cached_property
    def centre_of_mass_velocity(self) -> NDArray[np.float64]:
        """Velocity of the centre of mass, (n, 2), in components as `centre_of_mass`."""
        moving = step_derivative(self._by_leg(centre_of_mass, self._moving))
        coordinates = self.states.shape[1] // 2
        moving[:, 0] -= self.walker.foot_radius * self.states[:, coordinates]  # the foot rolls
        return self._on_slope(moving)

    @property
    def com_x(self) -> NDArray[np.float64]:
        """Centre of mass along the slope from the first contact point, positive downhill, (n,)."""
        return self.centre_of_mass[:, 0]

    @property
    def com_y(self) -> NDArray[np.float64]:
        """Height of the centre of mass over the slope through the first contact point, (n,)."""
        return self.centre_of_mass[:, 1]

    @property
    def com_velocity_x(self) -> NDArray[np.float64]:
        """Velocity of the centre of mass along the slope, positive downhill, (n,)."""
        return self.centre_of_mass_velocity[:, 0]

    @property
    def com_velocity_y(self) -> NDArray[np.float64]:
        """Velocity of the centre of mass away from the slope, (n,)."""
        return self.centre_of_mass_velocity[:, 1]

    @property
    def kinetic_energy(self) -> NDArray[np.float64]:
        """Kinetic energy, (n,); of the simplest walker, that of its hip mass."""
        energy = self.walker.equations().kinetic_energy(self._body, self._state)
        return self._each(energy) * self.units.energy

    @property
    def potential_energy(self) -> NDArray[np.float64]:
        """Weight times the height that the centre of mass has gained since the start, (n,)."""
        along, up = (self.centre_of_mass - self.centre_of_mass[0]).T
        return self.weight * (up * np.cos(self.slope) - along * np.sin(self.slope))

    @property
    def spring_energy(self) -> NDArray[np.float64]:
        """Energy of the springs, less that at coordinates of 0, (n,)."""
        system = self.walker.equations()
        if system.spring_gain is None:
            return np.zeros(len(self.times))
        relaxed = system.State(*np.zeros_like(self.states).T)
        energy = system.spring_gain(self._body, relaxed, self._state)
        return self._each(energy) * self.units.energy

    @property
    def mechanical_energy(self) -> NDArray[np.float64]:
        """Sum of kinetic, potential and spring energy, (n,)."""
        return self.kinetic_energy + self.potential_energy + self.spring_energy

    @property
    def friction_power(self) -> NDArray[np.float64]:
        """Power that friction takes, (n,); of a `System`, less the power of its own `forces`."""
        system = self.walker.equations()
        if system.friction_power is None:
            return np.zeros(len(self.times))
        power = system.friction_power(self._body, self._state)
        return self._each(power) * self.units.energy / self.units.time

    @property
    def powers(self) -> NDArray[np.float64]:
        """Power of each control, (n, controls), in the order of `torques`.

        That of the simplest walker's hip torque is 0: it acts on feet without mass.
        """
        system, units = self.walker.equations(), self.units
        moved = system.travel(system.State(*self._moving.T))
        rates = [self._each(step_derivative(each)) for each in moved]
        held = self.torques / self.walker.control_units * np.array([*system.works])
        return held * np.reshape(rates, held.shape[::-1]).T * units.energy

    @property
    def foot_clearance(self) -> NDArray[np.float64]:
        """Height of the swing foot over the stance foot's foothold, (n,).

        The foot is a whole circle here.
        """
        return self._by_leg(lambda walker, states: clearance_of(walker, states)[0], self.states)

    @cached_property
    def strikes(self) -> Strikes:
        """Impacts and push-offs, with their impulses and losses: a table with a row for each."""
        check_supports(self.walker, "ground force")
        walker, taken, units = self.walker, self.taken, self.units
        system, began = walker.equations(), np.cumsum([0.0, *taken.duration])
        resets = {phase.stage: phase.resets for phase in system.phases}
        rows: list[tuple[float, int, str, float, float, float, float]] = []

        def enter(k: int, kind: str, given: tuple[Impulse, TimedExtremum], loss: NDArray) -> None:
            (normal, tangential, time), (stop, _) = given
            rows.append((time, k, kind, normal, tangential, stop, float(loss[k])))

        knees = np.isfinite(taken.kneestrike_time).any()
        folded, stages, _ = self._before(taken.kneestrike_time if knees else taken.duration)
        landing, _, push_offs = self._before(taken.duration)
        for k, (_, rise, turn) in enumerate(self._ground[: len(taken.outcome)].tolist()):
            if taken.kneestrike_time[k] > 0.0:
                reset = resets[stages[k]][Outcome.KNEESTRIKE]
                state = system.State(*units.to_dimensionless(folded[k]))
                own = walker.in_stride(k)
                after = units.to_own([*reset.strike(own.body, state, 0.0, SMOOTH).after])
                time = float(began[k] + taken.kneestrike_time[k])
                given = kneestrike_impulses(own, folded[k], after, time)
                enter(k, "kneestrike", given, taken.kneestrike_loss)
            if taken.outcome[k] == Outcome.HEELSTRIKE:
                heel, push = heelstrike_impulses(
                    walker.in_stride(k), landing[k], taken.state[k], float(began[k + 1]),
                    push_offs[k], Ground(0.0, 1.0, rise, turn),
                )  # fmt: skip
                if push_offs[k]:
                    enter(k, "push-off", push, -taken.push_off_work)
                enter(k, "heelstrike", heel, taken.heelstrike_loss)
        times, strides, kinds, *numbers = zip(*rows, strict=True) if rows else [()] * 7
        return Strikes(
            walker=walker,
            times=np.array(times, dtype=float),
            stride_index=np.array(strides, dtype=np.int64),
            kinds=np.array(kinds, dtype=str),
            **{name: np.array(x, dtype=float) for name, x in zip(_NUMBERS, numbers, strict=True)},
        )

    @cached_property
    def _ground(self) -> NDArray[np.float64]:
        """Footholds as from `ground_of`, with those that a controller observes ahead."""
        count = len(self.taken.outcome) + self._map.terrain_lookahead
        return ground_of(self.terrain, self.terrain_seed, count)

    def within(self, times: NDArray) -> Samples:
        """Return samples at any instants, dimensionless.

        Args:
            times: Times since the start of each stride, in the walker's unit of time, of shape
                (strides made, k). A time after the end of a stride gives its final state.

        Returns:
            `states` (strides made, k, 6), `stages` and `controls`.
        """
        _, first = np.unique(self.stride_index, return_index=True)
        return look_at(self._map, self.slope, self.states[first], self._ground, times)

    def _before(self, times: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Return states just before impacts at a time in each stride, stages, and push-offs.

        The integration stops shortly before the impact. The accelerations there give the rest.
        """
        walker = self.walker
        early = times * (1.0 - STATE_BEFORE - 10.0 * self._map.tolerance)
        seen = self.within(early[:, None])
        states, stages, controls = (part[:, 0] for part in seen)
        states, left = self.units.to_own(states), (times - early)[:, None]
        held = controls[:, : len(walker.controls)] * walker.control_units
        there = self.slope + self._ground[: len(times), 0]
        each = np.arange(len(times))
        turns = by_leg(walker, each, forces, there, states, stages, held).accelerations
        angles, rates = np.split(states, 2, axis=1)
        ends = [angles + (rates + 0.5 * left * turns) * left, rates + left * turns]
        pushes = controls[:, 2] if "actuation" in walker.supports else np.zeros(len(times))
        return np.concatenate(ends, axis=1), stages, pushes

    def _by_leg(self, function: Callable[..., Any], *given: NDArray) -> Any:
        """A function of the walker and of each sample, with the legs in their roles there."""
        return by_leg(self.walker, self.stride_index, function, *given)

    @property
    def _body(self) -> Any:
        """Constants of the walker in each sample; numbers if its legs are alike."""
        if self.walker.legs_alike:
            return self.walker.body
        bodies = np.array([self.walker.body, self.walker.swapped.body], dtype=float)
        return self.walker.equations().Body(*bodies[self.stride_index % 2].T)

    @property
    def _state(self) -> Any:
        """Dimensionless states, as the equations take them."""
        return self.walker.equations().State(*self.units.to_dimensionless(self.states).T)

    @property
    def _moving(self) -> NDArray[Any]:
        """States with coordinates that move infinitesimally by their rates."""
        coordinates, rates = np.split(self.states, 2, axis=1)
        return np.concatenate([complex_step(coordinates, rates), rates], axis=1)

    def _each(self, values: Any) -> NDArray[np.float64]:
        return np.array(np.broadcast_to(values, self.times.shape), dtype=float)

    def _on_slope(self, vectors: NDArray) -> NDArray[np.float64]:
        """Vectors (n, 2) in the frames of footholds, in that of the slope."""
        turned = (vectors[:, 0] + 1j * vectors[:, 1]) * np.exp(-1j * self.tilts)
        return np.stack([turned.real, turned.imag], axis=-1)

    def series(self) -> dict[str, NDArray[np.float64]]:
        """Quantities over time that exist for this walker, by name, each (n,)."""
        supports = self.walker.supports
        absent = set() if self.walker.knees else {"stance_knee_torque", "swing_knee_torque"}
        if "ground force" not in supports:
            absent |= {*SERIES["forces"]}
        if "McGeer's parameters" not in supports:
            absent.add("hip_joint_torque")
        names = [name for group in SERIES.values() for name in group if name not in absent]
        powers = zip(self.walker.controls, self.powers.T, strict=True)
        return {name: getattr(self, name) for name in names} | {
            f"{control.removesuffix('_torque')}_power": power for control, power in powers
        }


def by_leg(owner: Any, strides: NDArray, function: Callable[..., Any], *given: NDArray) -> Any:
    """Evaluate a function of a walker or its map and of n samples, with the legs in their roles.

    Args:
        owner: The walker or the stride map.
        strides: Number of each sample's stride, (n,).
        function: Function of the owner and of some samples; it returns an array or a named tuple of
            arrays, each (n, ...).
        *given: Arrays (n, ...).
    """
    if owner.swapped is owner:
        return function(owner, *given)
    legs = [(own, here) for own, turn in ((owner, 0), (owner.swapped, 1))
            if len(here := np.flatnonzero(strides % 2 == turn))]  # fmt: skip
    found = [function(own, *(each[here] for each in given)) for own, here in legs]
    places = np.argsort(np.concatenate([here for _, here in legs]))
    if isinstance(found[0], tuple):
        return found[0]._make(np.concatenate(each)[places] for each in zip(*found, strict=True))  # type: ignore[attr-defined]
    return np.concatenate(found)[places]


def look_at(
    stride_map: StrideMap, slope: float, starts: NDArray, ground: NDArray, times: NDArray
) -> Samples:
    """Return samples of strides over footholds.

    Args:
        stride_map: The stride map; its actuation is one for all strides, or has one for each.
        slope: Slope of the walk in rad.
        starts: States at which strides begin, (n, 6), in the walker's own units.
        ground: Footholds, as from `ground_of`, (n, 3) or with more of them ahead.
        times: Times since the start of each stride, (n, k), in the walker's own units.
    """
    count, seen_ahead = len(starts), stride_map.terrain_lookahead
    ahead = np.array([ground[k : k + seen_ahead, 1:].ravel() for k in range(count)])
    here = ground[:count]
    uneven = bool(here.any())

    def look(own: StrideMap, states: NDArray, *rest: NDArray) -> Samples:
        slopes, instants, rises, ahead = rest
        return own.look(states, slopes, instants, rises if uneven else None, ahead=ahead)

    return by_leg(
        stride_map, np.arange(count), look, stride_map.dimensionless(starts), slope + here[:, 0],
        times / stride_map.units.time, here[:, 1], ahead,
    )  # fmt: skip
