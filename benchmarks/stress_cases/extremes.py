"""Walkers and slopes of extreme size, and initial states far from any gait."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.stress_cases.case import Finding, case
from benchmarks.stress_cases.flight import flock
from benchmarks.stress_cases.gaits import every_gait, gaits, near, start
from gym_passive_walker import WALKERS, Outcome, Walker, stride
from gym_passive_walker.engine.run import LONGEST_STRIDE

TOPIC = "Extremes"
LENGTHS = (
    "thigh_length", "thigh_offset", "thigh_gyration", "thigh_com", "shank_length", "shank_offset",
    "shank_gyration", "shank_com", "foot_radius",
)  # fmt: skip
MASSES = ("thigh_mass", "shank_mass", "hip_mass")
NO_ENDINGS = (Outcome.RUNNING, Outcome.KNEESTRIKE, Outcome.DIVERGED)
ENDINGS = [int(outcome) for outcome in Outcome if outcome not in NO_ENDINGS]


def resized(walker: Walker, length: float, mass: float, gravity: float) -> Walker:
    """The walker with its lengths, masses and gravity multiplied by factors."""
    factor = dict.fromkeys(LENGTHS, length) | dict.fromkeys(MASSES, mass) | {"gravity": gravity}
    changes = {
        field.name: factor[field.name] * getattr(walker, field.name)
        for field in fields(walker)
        if field.name in factor
    }
    return replace(walker, **changes)


def ended(records: NDArray) -> NDArray[np.bool_]:
    """Whether each stride has a valid outcome, a permitted duration and finite numbers, (n,)."""
    outcome = records["outcome"].copy()
    outcome[outcome == Outcome.RUNNING] = Outcome.STALLED
    in_time = (records["time"] >= 0.0) & (records["time"] <= LONGEST_STRIDE * (1.0 + 1e-15))
    finite = np.ones(len(records), bool)
    for name in records.dtype.names or ():
        if name != "step":
            finite &= np.isfinite(records[name]).reshape(len(records), -1).all(axis=1)
    return np.isin(outcome, ENDINGS) & in_time & finite


def random_throws(rng: np.random.Generator, count: int, straight: bool):
    """Random states (n, 6), slopes and torques: ordinary, violent, or almost at rest."""
    pace = 10.0 ** rng.uniform(-6.0, 2.0, (count, 1))
    angles = rng.uniform(-1.0, 1.0, (count, 3)) * [0.5 * np.pi, np.pi, np.pi]
    angles *= np.minimum(1.0, 10.0 ** rng.uniform(-6.0, 1.0, (count, 1)))
    states = np.concatenate([angles, pace * rng.normal(size=(count, 3))], axis=1)
    section = rng.random(count) < 0.5
    states[section, 1:3] = -states[section, :1]
    if straight:
        states[:, [2, 5]] = states[:, [1, 4]]
    slope = rng.choice([1e-10, 1e-3, 0.1, 1.0, 1.5], count) * rng.uniform(-1.0, 1.0, count)
    torque = rng.choice([0.0, 0.01, 1.0, 100.0], count) * rng.normal(size=count)
    return states, slope, torque


@case(
    TOPIC,
    "Any throw ends: an outcome for each, in bounded time, with finite numbers; none diverges",
    quick=100_000, long=10_000_000,
)  # fmt: skip
def any_throw(count: int, rng: np.random.Generator) -> Finding:
    """Test every preset, with and without `end_on_toe_stub`, at coarse and fine tolerances."""
    tried = failed = 0
    portion = 20_000
    names = list(WALKERS)
    for turn in range(max(1, count // portion)):
        walker = WALKERS[names[turn % len(names)]]
        mine, n = flock(walker), min(portion, count)
        states, slope, torque = random_throws(rng, n, not walker.knees)
        tolerance = float(rng.choice([1e-3, 1e-8, 1e-12]))
        end_on_toe_stub = bool(rng.random() < 0.5)
        walks = mine.follow(
            states, slope=slope, torque=torque, tolerance=tolerance,
            end_on_toe_stub=end_on_toe_stub,
        )  # fmt: skip
        tried += n
        failed += int((~ended(walks)).sum())
    return Finding(tried, failed)


@case(
    TOPIC,
    "A torque of a hundred times weight times leg: every stride ends, and its energy balances",
    quick=2_000, long=200_000, bound=1e-12, unit="energy that moved",
)  # fmt: skip
def huge_torque(count: int, rng: np.random.Generator) -> Finding:
    """Test torques of both signs, from states near a gait."""
    tried, failed, worst = 0, 0, 0.0
    for _, gait in every_gait():
        n = count // len(WALKERS)
        states = near(gait, rng, n, 0.1)
        torque = rng.choice([-100.0, 100.0], n)
        mine = flock(gait.walker)
        walks = mine.follow(states, slope=gait.slope, torque=torque, tolerance=1e-14)
        tried += n
        failed += int((~ended(walks)).sum())
        worst = max(worst, float(mine.balance_error(states, walks).max()))
    return Finding(tried, failed, worst)


@case(
    TOPIC,
    "A swing leg thrown past the upright is followed to it, with its energy",
    quick=2_000, long=200_000, bound=1e-12, unit="rad, energy that moved",
)  # fmt: skip
def swing_overrotation(count: int, rng: np.random.Generator) -> Finding:
    """Test swing legs with angular velocities of 30 to 100 √(g/l), forward or backward."""
    tried, failed, worst = 0, 0, 0.0
    for walker in WALKERS.values():
        mine, n = flock(walker), count // len(WALKERS)
        states = np.zeros((n, 6))
        states[:, 0] = rng.uniform(-0.2, 0.2, n)
        states[:, 1] = states[:, 2] = rng.uniform(0.3, 0.6, n)
        states[:, 4] = states[:, 5] = rng.choice([-1.0, 1.0], n) * 10.0 ** rng.uniform(1.5, 2.0, n)
        walks = mine.follow(states, slope=rng.uniform(-0.1, 0.1, n), tolerance=1e-14)
        over = walks["outcome"] == Outcome.SWING_OVERROTATION
        tried += n
        forward = states[:, 4] > 0.0  # backwards the foot may touch the ground first
        failed += int((~over & forward).sum())
        beyond = np.abs(np.abs(walks["state"][over, 1:3]).max(axis=1) - np.pi)
        worst = max(worst, float(beyond.max()))
        if mine.works:  # the simplest walker's energy balance does not include the swing leg
            worst = max(worst, float(mine.balance_error(states, walks).max()))
    return Finding(tried, failed, worst)


@case(
    TOPIC,
    "On slopes of 10⁻¹⁰ to 10⁻² gaits come back to themselves and lose weight × step × sin γ; from "
    "10⁻⁸ on the long step is the cube root of the slope, within 15 %",
    quick=5, long=80, bound=1e-12, unit="state, energy lost",
)  # fmt: skip
def shallow_slopes(count: int, rng: np.random.Generator) -> Finding:
    """Test the presets that can stand upright on level ground."""
    tried, failed, worst = 0, 0, 0.0
    for name in ("B", "D", "E", "F"):
        for slope in np.geomspace(1e-10, 1e-2, count):
            found = gaits(name, float(slope))
            long = found[0].stance_angle / np.cbrt(slope) if found else 0.0
            tried += max(1, len(found))
            failed += int(not found or (slope >= 1e-8 and not 0.85 < long < 1.15))
            for gait in found:
                end = stride(name, slope, gait.state, tolerance=1e-14)
                failed += int(end.outcome != Outcome.HEELSTRIKE)
                off = np.abs(end.state - gait.state).max() / np.abs(gait.state).max()
                loss = abs(end.collision_cost / np.sin(slope) - 1.0)
                worst = max(worst, float(off), float(loss))
    return Finding(tried, failed, worst)


@case(
    TOPIC,
    "On slopes of 10⁻¹⁰ to 0.5 every stride from near a gait ends, and its energy balances",
    quick=2_000, long=200_000, bound=1e-12, unit="energy that moved",
)  # fmt: skip
def slopes_without_gaits(count: int, rng: np.random.Generator) -> Finding:
    """Test slopes downhill and uphill, also slopes without a gait."""
    tried, failed, worst = 0, 0, 0.0
    for _, gait in every_gait():
        n = count // len(WALKERS)
        slope = 10.0 ** rng.uniform(-10.0, np.log10(0.5), n) * rng.choice([-1.0, 1.0], n)
        shrunk = np.minimum(1.0, 3.0 * np.cbrt(np.abs(slope)))  # as gaits shrink
        states = near(gait, rng, n, 0.1, size=shrunk)
        mine = flock(gait.walker)
        walks = mine.follow(states, slope=slope, tolerance=1e-14)
        tried += n
        failed += int((~ended(walks)).sum())
        worst = max(worst, float(mine.balance_error(states, walks).max()))
    return Finding(tried, failed, worst)


@case(
    TOPIC,
    "Feet of 10⁻¹² to 1 of the hip's mass walk as near to the simplest walker as they are light",
    quick=25, long=400, bound=30.0, unit="mass of the foot / mass of the hip",
)  # fmt: skip
def vanishing_feet(count: int, rng: np.random.Generator) -> Finding:
    """Test the difference, which is hidden below the rounding error of the motion, 10⁻¹³."""
    walker, gait = WALKERS["D"], gaits("D")[0]
    time, failed, worst = np.repeat([1.0, walker.time_unit], 3), 0, 0.0
    exact = stride(walker, gait.slope, gait.state, hip_torque=0.1, tolerance=1e-14)
    for mass in np.geomspace(1e-12, 1.0, count):
        feet = replace(walker, shank_mass=mass, shank_com=walker.shank_length)
        torque = 0.1 * mass
        found = stride(feet, gait.slope, gait.state, hip_torque=torque, tolerance=1e-14)
        off = np.abs((found.state - exact.state) * time).max()
        if found.outcome == Outcome.HEELSTRIKE:
            worst = max(worst, float(off) / (mass + 1e-13))
        elif mass < 1e-3:
            failed += 1
    return Finding(count, failed, worst)


@case(
    TOPIC,
    "Legs of 10⁻³ to 10³, masses of 10⁻⁶ to 10⁶, gravity of 10⁻³ to 10³ walk the same walk",
    quick=20, long=1_000, bound=1e-12, unit="dimensionless state and energies",
)  # fmt: skip
def sizes(count: int, rng: np.random.Generator) -> Finding:
    """Test equality up to rounding errors, which the stride map of an unstable gait amplifies."""
    tried, failed, worst = 0, 0, 0.0
    for _, gait in every_gait():
        walker = gait.walker
        here = walked(walker, gait.slope, start(gait))
        for _ in range(count):
            length, mass, gravity = 10.0 ** (rng.uniform(-1.0, 1.0, 3) * [3.0, 6.0, 3.0])
            giant = resized(walker, length, mass, gravity)
            there = walked(giant, gait.slope, start(gait))
            tried += 1
            if here[0] != there[0]:
                failed += 1
            worst = max(worst, float(np.abs(there - here).max()))
    return Finding(tried, failed, worst)


def walked(walker: Walker, slope: float, state: NDArray) -> NDArray[np.float64]:
    """A driven stride in dimensionless numbers: outcome, times, lengths, energies and state."""
    units = np.repeat([1.0, walker.time_unit], 3)
    energy = walker.total_mass * walker.gravity * walker.leg_length
    torque = 0.003 * (walker.gravity * walker.leg_length if walker.massless_legs else energy)
    found = stride(walker, slope, state / units, hip_torque=torque, tolerance=1e-13)
    numbers = [
        float(found.outcome), found.duration / walker.time_unit,
        found.step_length / walker.leg_length, found.hip_work / energy,
        found.collision_loss / energy, found.gravity_work / energy,
    ]  # fmt: skip
    return np.concatenate([numbers, found.state * units])
