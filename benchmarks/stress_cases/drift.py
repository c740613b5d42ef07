"""Accumulated error over a hundred thousand swings, or a million strides."""

from __future__ import annotations

import numpy as np

from benchmarks.stress_cases.case import Finding, case
from benchmarks.stress_cases.flight import flock
from benchmarks.stress_cases.gaits import every_gait, start
from gym_passive_walker import Outcome, Walker
from gym_passive_walker.engine.run import new_records
from gym_passive_walker.models.equations.systems import SYSTEMS

TOPIC = "Drift"
TICK = 50.0  # time in sqrt(l/g) of one call for a swinging walker

ROCKER = Walker(
    thigh_length=0.05, shank_length=0.95, foot_radius=0.94, thigh_mass=0.01, shank_mass=1.0,
    shank_com=0.6, shank_gyration=0.2, shank_offset=0.15, knees=False, gravity=1.0,
)  # fmt: skip
"""A walker that rocks on its round foot; its other leg hangs forward, so there is no impact."""

HANGER = Walker(
    thigh_length=0.5, shank_length=0.5, thigh_mass=1.0, thigh_com=-0.3, thigh_gyration=0.2,
    thigh_offset=-0.15, shank_mass=0.01, shank_com=0.3, knees=False, gravity=1.0,
)  # fmt: skip
"""A walker hung up by its foot, a double pendulum: its legs' centres of mass are past the hip."""


def swing_on(walker: Walker, gravity: float, angles: tuple[float, float], swings: int) -> Finding:
    """Simulate a locked walker, and compare its energy with the initial energy at each `TICK`.

    Args:
        walker: The walker.
        gravity: 1 for a standing walker, -1 for a hanging one.
        angles: Initial angles of stance and swing leg in rad, at rest.
        swings: Duration in units of 2π √(l/g).
    """
    mine = flock(walker)
    state = np.array([[angles[0], angles[1], angles[1], 0.0, 0.0, 0.0]])
    record = new_records(state, 0.0, end=0.0)[:, 0]
    record["ground"][..., :2] = 0.0, gravity
    worst = largest = 0.0
    for tick in range(1, int(swings * 2.0 * np.pi / TICK) + 2):
        record["end"] = TICK * tick
        mine.go_on(record, tolerance=1e-15)
        if record["outcome"][0] != Outcome.RUNNING:
            return Finding(swings, 1)
        kinetic = float(mine.kinetic_energy(record["state"])[0])
        largest = max(largest, kinetic)
        worst = max(worst, abs(kinetic - float(mine.gravity_work(state, record)[0])))
    return Finding(swings, 0, worst / largest)


@case(
    TOPIC,
    "A locked walker that rocks on its foot keeps its energy, swing after swing",
    quick=200, long=100_000, bound=1e-10, unit="largest kinetic energy",
)  # fmt: skip
def rocking(count: int, rng: np.random.Generator) -> Finding:
    """Test a walker that starts off balance, with a swinging leg."""
    return swing_on(ROCKER, 1.0, (0.15, 0.4), count)


@case(
    TOPIC,
    "A locked walker that hangs from its foot keeps its energy, swing after swing",
    quick=200, long=100_000, bound=1e-10, unit="largest kinetic energy",
)  # fmt: skip
def hanging(count: int, rng: np.random.Generator) -> Finding:
    """Test a walker that swings as a double pendulum."""
    return swing_on(HANGER, -1.0, (0.15, 0.6), count)


@case(
    TOPIC,
    "A stable gait stays on its fixed point, stride after stride",
    quick=1_000, long=1_000_000, bound=1e-12, unit="angles and rates",
)  # fmt: skip
def million_strides(count: int, rng: np.random.Generator) -> Finding:
    """Test all stable gaits of the presets, in batches."""
    stable = [gait for _, gait in every_gait() if gait.stable]
    tried, failed, worst = 0, 0, 0.0
    kinds = {gait.walker.equations().name for gait in stable}
    for system in (SYSTEMS[name] for name in sorted(kinds)):
        own = [gait for gait in stable if gait.walker.equations() is system]
        mine = flock(*(gait.walker for gait in own))
        points = np.array([start(gait) for gait in own])
        records = new_records(points, [gait.slope for gait in own])[:, 0]
        least, most = points.copy(), points.copy()
        for _ in range(count):
            records["time"] = records["outcome"] = 0
            mine.go_on(records, tolerance=1e-14, from_section=True)
            failed += int((records["outcome"] != Outcome.HEELSTRIKE).sum())
            np.minimum(least, records["state"], out=least)
            np.maximum(most, records["state"], out=most)
        tried += count * len(own)
        worst = max(worst, float((most - points).max()), float((points - least).max()))
    return Finding(tried, failed, worst)
