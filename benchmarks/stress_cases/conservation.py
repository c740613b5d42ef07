"""Invariants of the motion: energy, momenta, time reversal and mirror symmetry."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.stress_cases.bodies import Bodies
from benchmarks.stress_cases.case import Finding, case
from benchmarks.stress_cases.flight import (
    BACKWARDS,
    FREE,
    Flock,
    flock,
    mirrored,
    random_shapes,
    random_states,
)
from benchmarks.stress_cases.gaits import every_gait
from gym_passive_walker import WALKERS, Outcome, stride
from gym_passive_walker.engine.run import new_records

TOPIC = "Conservation and symmetry"
SIMPLEST = WALKERS["D"]


def flocks(rng: np.random.Generator, count: int) -> list[Flock]:
    """Walkers of each kind, with random shapes."""
    n = max(1, count // 3)
    return [
        flock(*random_shapes(rng, n, knees=True)),
        flock(*random_shapes(rng, n, knees=False)),
        flock(*[SIMPLEST] * n),
    ]


def thrown(rng: np.random.Generator, mine: Flock) -> NDArray[np.float64]:
    """States on the Poincaré section, (n, 6), so near to a gait that many reach a heelstrike."""
    n = len(mine.bodies)
    angle = rng.uniform(0.05, 0.5, n)
    rates = rng.normal(size=(n, 3)) * 0.3 - np.stack([angle * 3.5 + 0.2, angle, angle], axis=1)
    states = np.concatenate([np.outer(angle, [1.0, -1.0, -1.0]), rates], axis=1)
    if mine.straight_phase == FREE:
        states[:, 5] = states[:, 4]
    return states


@case(
    TOPIC,
    "The energy of a stride balances: work of gravity and hip is motion gained and energy lost",
    quick=3_000, long=300_000, bound=1e-12, unit="energy that moved",
)  # fmt: skip
def energy_balance(count: int, rng: np.random.Generator) -> Finding:
    """Test random shapes, torques and slopes, for any end of the stride."""
    tried, worst = 0, 0.0
    for mine in flocks(rng, count):
        starts = thrown(rng, mine)
        n = len(starts)
        torque = rng.choice([0.0, 0.1], n) * rng.normal(size=n)
        ends = mine.follow(starts, slope=rng.uniform(-0.1, 0.3, n), torque=torque, tolerance=1e-14)
        tried += n
        worst = max(worst, float(mine.balance_error(starts, ends).max()))
    return Finding(tried, 0, worst)


@case(
    TOPIC,
    "Heelstrike conserves angular momentum: the whole's about the new contact, the new swing leg's "
    "about the hip, its free shank's about the knee",
    quick=3_000, long=100_000, bound=1e-13, unit="m l² rate",
)  # fmt: skip
def heelstrike_momenta(count: int, rng: np.random.Generator) -> Finding:
    """Test momenta summed over `Bodies`, from a state a rounding error before heelstrike."""
    tried, failed, worst = 0, 0, 0.0
    for knees in (True, False):
        walkers = random_shapes(rng, max(1, count // 2), knees=knees)
        mine, n = flock(*walkers), len(walkers)
        angle = rng.uniform(0.0, 1.0, n)
        rates = rng.normal(size=(n, 3))
        before = np.concatenate([np.outer(angle, [-1.0, 1.0, 1.0]), rates], axis=1)
        before[:, 1:3] += 1e-15
        before[:, 4] = before[:, 5] = rng.uniform(-2.0, -0.5, n) - before[:, 3]
        records = mine.follow(before, 1e-14, phase=mine.straight_phase)
        old, new = Bodies(walkers, before), Bodies(walkers, records["state"])
        kept = [
            old.momentum(old.swing.contact) - new.momentum(0.0 * new.hip),
            old.stance.momentum(old.hip) - new.swing.momentum(new.hip),
        ]
        if knees:
            shank, same = old.stance, new.swing
            kept.append(shank.shank.momentum(shank.knee) - same.shank.momentum(same.knee))
        tried += n
        failed += int((records["outcome"] != Outcome.HEELSTRIKE).sum())
        worst = max(worst, float(np.abs(kept / old.scale()).max()))
    return Finding(tried, failed, worst)


@case(
    TOPIC,
    "Kneestrike conserves angular momentum: the whole's about the contact, the swing leg's about "
    "the hip",
    quick=3_000, long=100_000, bound=1e-13, unit="m l² rate",
)  # fmt: skip
def kneestrike_momenta(count: int, rng: np.random.Generator) -> Finding:
    """Test a shank that is a rounding error away from its stop, so that only the impact acts."""
    walkers = random_shapes(rng, count, knees=True)
    before = random_states(rng, count, straight=True, angle=1.0)
    before[:, 2] -= 1e-15
    before[:, 5] = before[:, 4] + rng.uniform(0.5, 2.0, count)
    records = flock(*walkers).follow(before, 1e-14, phase=FREE)
    old, new = Bodies(walkers, before), Bodies(walkers, records["state"])
    kept = [
        old.momentum(0.0 * old.hip) - new.momentum(0.0 * new.hip),
        old.swing.momentum(old.hip) - new.swing.momentum(new.hip),
    ]
    locked = (records["phase"] != FREE) & (records["state"][:, 5] == records["state"][:, 4])
    return Finding(count, int((~locked).sum()), float(np.abs(kept / old.scale()).max()))


def in_flight(rng: np.random.Generator, mine: Flock) -> tuple[NDArray, int]:
    """States (n, 6) that move for some time without an event, and their phase."""
    n, free = len(mine.bodies), mine.kneed
    states = random_states(rng, n, straight=not free, angle=0.3, rate=0.3)
    states[:, 1] = np.abs(states[:, 0]) + 0.6  # far from an impact
    states[:, 2] = states[:, 1] - 0.5 if free else states[:, 1]
    return states, FREE if free else mine.straight_phase


@case(
    TOPIC,
    "A motion between events, reversed in time, leads back to its start",
    quick=3_000, long=300_000, bound=1e-12, unit="angles and rates",
)  # fmt: skip
def time_reversal(count: int, rng: np.random.Generator) -> Finding:
    """Test random torques and slopes."""
    tried, worst = 0, 0.0
    for mine in flocks(rng, count):
        states, phase = in_flight(rng, mine)
        n = len(states)
        options = {
            "slope": rng.uniform(-0.3, 0.3, n), "torque": rng.uniform(-0.02, 0.02, n),
            "phase": phase, "tolerance": 1e-14,
        }  # fmt: skip
        there = mine.follow(states, 0.7, **options)
        back = mine.follow(there["state"] * BACKWARDS, 0.7, **options)
        flown = np.all([r["outcome"] == Outcome.RUNNING for r in (there, back)], axis=0)
        flown &= (there["phase"] == phase) & (back["phase"] == phase)
        tried += int(flown.sum())
        worst = max(worst, float(np.abs(back["state"] * BACKWARDS - states)[flown].max()))
    return Finding(tried, 0, worst)


@case(
    TOPIC,
    "A motion seen in a mirror is the motion of the mirrored walker",
    quick=600, long=60_000, bound=1e-12, unit="angles and rates",
)  # fmt: skip
def mirror(count: int, rng: np.random.Generator) -> Finding:
    """Test mirrored walkers with mirrored slope and torque."""
    tried, worst = 0, 0.0
    for knees in (True, False):
        walkers = random_shapes(rng, max(1, count // 2), knees=knees)
        here, there = flock(*walkers), flock(*map(mirrored, walkers))
        states, _ = in_flight(rng, here)
        states[:, 2], states[:, 5] = states[:, 1], states[:, 4]  # a knee bends one way only
        n = len(states)
        slope, torque = rng.uniform(-0.3, 0.3, n), rng.uniform(-0.02, 0.02, n)
        time, options = 0.4, {"phase": here.straight_phase, "tolerance": 1e-14}
        one = here.follow(states, time, slope=slope, torque=torque, **options)
        other = there.follow(-states, time, slope=-slope, torque=-torque, **options)
        flown = np.all([r["outcome"] == Outcome.RUNNING for r in (one, other)], axis=0)
        tried += int(flown.sum())
        worst = max(worst, float(np.abs(one["state"] + other["state"])[flown].max()))
    return Finding(tried, 0, worst)


@case(
    TOPIC,
    "Legs have roles, not names: over many strides gravity's work is weight times descent",
    quick=20, long=200, bound=1e-13, unit="gravity's work a stride",
)  # fmt: skip
def swapped_legs(count: int, rng: np.random.Generator) -> Finding:
    """Test that the exchange of the legs' roles at heelstrike does not move the hip."""
    tried, worst = 0, 0.0
    for _, gait in every_gait():
        if not gait.stable:
            continue
        state, height, work = gait.state, 0.0, 0.0
        for _ in range(count):
            found = stride(gait.walker, gait.slope, state, tolerance=1e-12)
            height += found.step_length * np.sin(gait.slope)
            work += found.gravity_work
            state = found.state
        descent = found.weight * height
        mine = flock(gait.walker)
        units = np.repeat([1.0, gait.walker.time_unit], 3)
        starts = np.array([gait.state * units])
        moved = new_records((state * units)[None], gait.slope)[:, 0]
        inside = mine.gravity_work(starts, moved)[0] * found.weight * gait.walker.leg_length
        tried += count
        worst = max(worst, abs(work - descent - inside) / found.gravity_work / np.sqrt(count))
    return Finding(tried, 0, worst)
