"""Dimensionless motion of batches of walkers, forwards and backwards in time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker import WALKERS, Walker
from gym_passive_walker.engine.run import LONGEST_STRIDE, advance, new_records
from gym_passive_walker.models.equations.hybrid import Ground, Outcome, State, System
from gym_passive_walker.models.model import bodies

FREE = 0
"""The phase in which a kneed walker's stride begins."""

BACKWARDS = np.array([1.0, 1.0, 1.0, -1.0, -1.0, -1.0])
"""Factors that reverse the velocities of a state, for motion backwards in time."""

_ROUNDING = 1e-14  # of energies over m g l; a walker almost at rest has much smaller energies

STRAIGHT = {name: walker for name, walker in WALKERS.items() if not walker.knees}
KNEED = {name: walker for name, walker in WALKERS.items() if walker.knees}


class Flock(NamedTuple):
    """Walkers of one kind, equal or each with its own shape.

    Attributes:
        system: Equations of motion.
        bodies: Constants of the walkers, (1 or n, 1, constants).
    """

    system: System
    bodies: NDArray[np.float64]

    @property
    def straight_phase(self) -> int:
        """The phase that ends with a heelstrike: the last."""
        return len(self.system.phases) - 1

    @property
    def kneed(self) -> bool:
        """Whether a stride begins with the knee free."""
        return self.straight_phase != FREE

    @property
    def works(self) -> bool:
        """Whether a hip torque does work and the swing leg has energy."""
        return bool(self.system.works.hip)

    @property
    def body(self) -> Any:
        """The constants in the form that the equations require, (1 or n,) each."""
        return self.system.Body(*self.bodies[:, 0].T)

    def kinetic_energy(self, states: NDArray) -> NDArray[np.float64]:
        """Kinetic energies / (m g l) of states (n, 6)."""
        return self.system.kinetic_energy(self.body, State(*states.T))

    def gravity_work(self, starts: NDArray, records: NDArray) -> NDArray[np.float64]:
        """Work of gravity / (m g l) from initial states (n, 6) to records (n,), shape (n,)."""
        start, end = State(*starts.T), State(*records["state"].T)
        gain = self.system.potential_gain(self.body, start, end, Ground(*records["ground"].T))
        struck = records["outcome"] == Outcome.HEELSTRIKE
        return np.where(struck, records["gravity_work"], -gain)

    def follow(
        self,
        states: NDArray,
        time: ArrayLike = LONGEST_STRIDE,
        *,
        slope: ArrayLike = 0.0,
        torque: ArrayLike = 0.0,
        rise: ArrayLike = 0.0,
        turn: ArrayLike = 0.0,
        phase: ArrayLike | None = None,
        tolerance: float = 1e-13,
        end_on_toe_stub: bool = False,
    ) -> NDArray:
        """Records (n,) of walkers simulated for some time, or to the end of their stride.

        Args:
            states: Dimensionless states, (n, 6).
            time: Dimensionless time; a number or (n,).
            slope: Slope in rad; a number or (n,).
            torque: Dimensionless hip torque; a number or (n,).
            rise: Dimensionless height change to the next foothold; a number or (n,).
            turn: Slope of the next foothold beyond this one's, in rad; a number or (n,).
            phase: Phase at the start; None is the phase just after heelstrike.
            tolerance: Tolerance of the integration.
            end_on_toe_stub: Whether a swing foot that touches the ground early ends the stride.
        """
        records = new_records(
            states, slope, torque, height_change=rise, slope_change=turn, end=time
        )
        if phase is not None:
            records["phase"][:, 0] = phase
        return self.go_on(
            records[:, 0],
            tolerance=tolerance,
            end_on_toe_stub=end_on_toe_stub,
            from_section=phase is None,
        )

    def go_on(
        self,
        records: NDArray,
        *,
        tolerance: float,
        end_on_toe_stub: bool = False,
        from_section: bool = False,
    ) -> NDArray:
        """Continue the integration of records (n,), in place."""
        with np.errstate(all="ignore"):
            advance(
                self.system, self.bodies, records[:, None],
                tolerance=tolerance, scuff=end_on_toe_stub, from_section=from_section,
            )  # fmt: skip
        return records

    def energy_balance(self, starts: NDArray, records: NDArray) -> tuple[NDArray, NDArray]:
        """Error of each energy balance, and its sum of absolute terms; both (n,) over m g l."""
        before = self.kinetic_energy(starts)
        gained = self.kinetic_energy(records["state"]) - before
        gravity = self.gravity_work(starts, records)
        torque = records["control"][:, 0] * self.works
        hip, turned = torque * records["moved"][:, 0], np.abs(torque) * records["turned"][:, 0]
        lost = records["knee_loss"] + records["heel_loss"]
        missing = np.abs(gravity + hip - gained - lost)
        return missing, before + np.abs(gained) + np.abs(gravity) + turned + lost

    def balance_error(self, starts: NDArray, records: NDArray) -> NDArray[np.float64]:
        """Error of each energy balance relative to its sum of absolute terms, (n,)."""
        missing, moved = self.energy_balance(starts, records)
        return missing / moved

    def error_over_tolerance(self, starts: NDArray, records: NDArray, tolerance: float) -> NDArray:
        """Error of each energy balance over that which the tolerance permits, (n,).

        The tolerance is relative to the largest angle or angular velocity, so a slow walker's error
        may exceed its energies.
        """
        missing, moved = self.energy_balance(starts, records)
        largest = np.maximum(np.abs(starts), np.abs(records["state"])).max(axis=1)
        return missing / (tolerance * (moved + largest**2) + _ROUNDING)


def flock(*walkers: Walker, using: tuple[str, ...] = ()) -> Flock:
    """Walkers of one kind: any number of one, or each of several once.

    `using` names items of `EXTRAS` and `UNEVEN`.
    """
    return Flock(walkers[0].equations(using), bodies(*walkers))


def random_shapes(rng: np.random.Generator, count: int, *, knees: bool) -> list[Walker]:
    """Walkers of ordinary proportions, with random offsets of masses and random foot radii."""
    walkers = []
    for _ in range(count):
        thigh, shank = rng.uniform(0.3, 0.7, 2)
        foot = rng.uniform(0.0, 0.6) * shank
        limit = min(0.4, np.arcsin(min(1.0, (shank - foot) / thigh)))
        walkers.append(
            Walker(
                thigh_length=thigh,
                thigh_offset=thigh * rng.uniform(-0.2, 0.2),
                thigh_mass=rng.uniform(0.2, 1.0),
                thigh_gyration=thigh * rng.uniform(0.1, 0.5),
                thigh_com=thigh * rng.uniform(0.0, 0.8),
                shank_length=shank,
                shank_offset=shank * rng.uniform(-0.2, 0.2),
                shank_mass=rng.uniform(0.1, 0.6),
                shank_gyration=shank * rng.uniform(0.1, 0.5),
                shank_com=shank * rng.uniform(0.1, 0.8),
                foot_radius=foot,
                foot_angle=limit * rng.uniform(-0.9, 0.9),
                hip_mass=rng.uniform(0.0, 3.0),
                knees=knees,
            )
        )
    return walkers


def mirrored(walker: Walker) -> Walker:
    """The mirror image of a walker."""
    return replace(
        walker,
        thigh_offset=-walker.thigh_offset,
        shank_offset=-walker.shank_offset,
        foot_angle=-walker.foot_angle,
    )


def random_states(
    rng: np.random.Generator, count: int, *, straight: bool, angle: float = 1.5, rate: float = 1.5
) -> NDArray[np.float64]:
    """Random states (count, 6), with angles up to `angle` and normal angular velocities."""
    states = np.concatenate(
        [rng.uniform(-angle, angle, (count, 3)), rng.normal(scale=rate, size=(count, 3))], axis=1
    )
    if straight:
        states[:, [2, 5]] = states[:, [1, 4]]
    return states
