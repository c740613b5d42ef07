"""Dimensionless motion of many walkers at once, forwards and backwards in time."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from gym_passive_walker.physics.constants import Kind
from gym_passive_walker.physics.engine import advance
from gym_passive_walker.physics.ledger import kinetic_energies, ledgers
from gym_passive_walker.physics.record import new_records
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker import WALKERS, Walker
from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics import events as E
from gym_passive_walker.physics import record as R

BACKWARDS = np.array([1.0, 1.0, 1.0, -1.0, -1.0, -1.0])
"""Turns a state into the one of a film played backwards."""

STRAIGHT = {name: walker for name, walker in WALKERS.items() if not walker.knees}
KNEED = {name: walker for name, walker in WALKERS.items() if walker.knees}


class Flock(NamedTuple):
    """Walkers of one kind, alike or each with its own shape.

    Attributes:
        kind: Which equations they obey.
        constants: Shape (1, K.COUNT) or (n, K.COUNT).
    """

    kind: Kind
    constants: NDArray[np.float64]

    @property
    def straight_phase(self) -> int:
        """The phase that ends with a heelstrike."""
        return E.SIMPLEST if self.kind == Kind.SIMPLEST else E.LOCKED

    def kinetic_energy(self, states: NDArray) -> NDArray[np.float64]:
        """Kinetic energies / (m g l) of states (n, 6)."""
        energy = np.empty(len(states))
        kinetic_energies(int(self.kind), self.constants, np.ascontiguousarray(states), energy)
        return energy

    def gravity_work(self, starts: NDArray, records: NDArray) -> NDArray[np.float64]:
        """Work of gravity / (m g l) since the starts."""
        work, length = np.empty(len(starts)), np.empty(len(starts))
        starts = np.ascontiguousarray(starts)
        ledgers(int(self.kind), self.constants, starts, records, work, length)
        return work

    def follow(
        self,
        states: NDArray,
        time: ArrayLike = 100.0,
        *,
        slope: ArrayLike = 0.0,
        torque: ArrayLike = 0.0,
        phase: ArrayLike | None = None,
        tolerance: float = 1e-13,
        stub: bool = False,
    ) -> NDArray[np.float64]:
        """Records of walkers followed for some time, or to what ends their stride.

        Args:
            states: Dimensionless, (n, 6).
            time: Dimensionless, as slope in rad and dimensionless torque one or n of them.
            slope: See `time`.
            torque: See `time`.
            phase: In which the walkers are; just after heelstrike where None.
            tolerance: Of the integration.
            stub: As for `stride`.
        """
        records = new_records(states, np.asarray(slope, dtype=float), np.asarray(torque))
        records[:, R.END] = time
        if phase is not None:
            records[:, R.PHASE] = phase
        with np.errstate(all="ignore"):
            advance(
                self.kind, self.constants, records,
                tolerance=tolerance, stub=stub, from_section=phase is None,
            )  # fmt: skip
        return records

    def ledger(self, starts: NDArray, records: NDArray) -> NDArray[np.float64]:
        """What is missing in each ledger, relative to the energy that moved in it."""
        before = self.kinetic_energy(starts)
        ends = np.ascontiguousarray(records[:, :6])
        gained = self.kinetic_energy(ends) - before
        gravity = self.gravity_work(starts, records)
        torque = 0.0 if self.kind == Kind.SIMPLEST else records[:, R.TORQUE]
        hip, turned = torque * records[:, R.HIP_NET], np.abs(torque) * records[:, R.HIP_TURN]
        lost = records[:, R.KNEE_LOSS] + records[:, R.HEEL_LOSS]
        missing = np.abs(gravity + hip - gained - lost)
        return missing / (before + np.abs(gained) + np.abs(gravity) + turned + lost)


def flock(walker: Walker) -> Flock:
    """Any number of walkers that are alike."""
    return Flock(K.kind_of(walker), K.constants(walker)[None])


def random_shapes(rng: np.random.Generator, count: int, *, knees: bool) -> list[Walker]:
    """Walkers of ordinary proportions with masses on all sides and feet of all sizes."""
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


def flock_of(walkers: list[Walker]) -> Flock:
    """Walkers of one kind, each with its own shape."""
    return Flock(K.kind_of(walkers[0]), np.array([K.constants(walker) for walker in walkers]))


def mirrored(walker: Walker) -> Walker:
    """The walker seen in a mirror."""
    return replace(
        walker,
        thigh_offset=-walker.thigh_offset,
        shank_offset=-walker.shank_offset,
        foot_angle=-walker.foot_angle,
    )


def random_states(
    rng: np.random.Generator, count: int, *, straight: bool, angle: float = 1.5, rate: float = 1.5
) -> NDArray[np.float64]:
    """States with angles up to a size, moving at any pace."""
    states = np.concatenate(
        [rng.uniform(-angle, angle, (count, 3)), rng.normal(scale=rate, size=(count, 3))], axis=1
    )
    if straight:
        states[:, [2, 5]] = states[:, [1, 4]]
    return states
