"""Springs and friction at the joints: their forces, energies and losses."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from gym_passive_walker import (
    WALKERS,
    WalkerError,
    find_gait,
    parameter_family,
    stride,
    stride_jacobian,
)
from gym_passive_walker.engine.run import advance, new_records
from gym_passive_walker.gaits.look.forces import forces
from gym_passive_walker.models.equations.systems import FITTINGS, SYSTEMS
from gym_passive_walker.models.model import bodies
from tests.equations.examples import GAITS, KNEED, LONG_GAITS, MASSIVE, fitted
from tests.instants import states_at


@pytest.mark.parametrize("name", MASSIVE)
def test_friction_takes_the_integral_of_its_power(name):
    """By Gauss's quadrature over the stride, phase by phase."""
    gait, walker = LONG_GAITS[name], fitted(WALKERS[name])
    walk = stride(walker, gait.slope, gait.state, tolerance=1e-13)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    edges = [0.0, float(walk.kneestrike_time), float(walk.duration)]
    edges = edges if walker.knees else [0.0, edges[-1]]
    taken = 0.0
    for start, end in pairwise(edges):
        times = 0.5 * (end - start) * nodes + 0.5 * (end + start)
        states, _ = states_at(walker, gait.slope, gait.state, times, tolerance=1e-13)
        opening = states[:, 4] - states[:, 3]
        taken += 0.5 * (end - start) * weights @ (walker.hip_friction * opening**2)
    assert walk.friction_loss == pytest.approx(taken, rel=1e-12)


@pytest.mark.parametrize("gait", GAITS, ids=str)
def test_springs_without_stiffness_change_no_bit_of_a_walk(gait):
    """The code with springs and friction, and the code without."""
    walker = WALKERS[gait.walker]
    ends = []
    for system in (walker.equations(), walker.equations(FITTINGS)):
        records = new_records(walker.units.to_dimensionless(gait.state)[None], gait.slope, 1e-3)
        ends.append(advance(system, bodies(walker), records, tolerance=1e-10)["state"])
    assert system is not walker.equations()
    np.testing.assert_array_equal(*ends)


@pytest.mark.parametrize("name", WALKERS)
def test_a_passive_gait_with_springs_and_friction_costs_the_sine_of_the_slope(name):
    slope = LONG_GAITS[name].slope
    gait = find_gait(fitted(WALKERS[name], spring=0.003, friction=0.0005), slope)
    for walk in (gait, gait.stride):
        assert walk.cost_of_transport == pytest.approx(np.sin(slope), rel=1e-9)
    assert abs(gait.stride.spring_work) < 1e-11 * gait.stride.gravity_work
    assert (gait.friction_loss > 0.0) == (name in MASSIVE)


@pytest.mark.parametrize("wrt", FITTINGS)
@pytest.mark.parametrize("name", ["lab", "A", "D"])
def test_a_walker_answers_to_a_spring_that_it_has_not_yet(name, wrt):
    """The derivative at zero stiffness, against a one-sided difference of the second order."""
    gait, walker = LONG_GAITS[name], WALKERS[name]
    if wrt == "knee_stiffness" and not walker.knees:
        return
    units = walker.units
    unit = units.torque * (units.time if wrt == "hip_friction" else 1.0)
    by = unit * stride_jacobian(walker, gait.slope, gait.state, wrt=wrt)[:, 0]
    step = 1e-4
    ends = [
        stride(replace(walker, **{wrt: i * step * unit}), gait.slope, gait.state, tolerance=1e-13)
        for i in range(3)
    ]
    kept = [0, 3, 4, 5] if walker.knees else [0, 3, 4]
    zero, one, two = (end.state[kept] for end in ends)
    difference = (-1.5 * zero + 2.0 * one - 0.5 * two) / step
    np.testing.assert_allclose(by, difference, rtol=0.0, atol=1e-4 * np.abs(by).max())


def test_a_family_begins_without_a_spring_and_folds_where_friction_takes_too_much():
    walker = WALKERS["A"]
    units = walker.units
    most = 0.2 * units.torque
    springs = parameter_family(walker, "hip_stiffness", 0.0, most, slope=0.03)
    assert springs.value[0] == 0.0 and springs.value[-1] == pytest.approx(most)
    assert np.all(np.diff(springs.step_period) <= 1e-13)  # a spring makes steps quicker
    friction = parameter_family(
        walker, "hip_friction", 0.0, 0.01 * units.torque * units.time, slope=0.03
    )
    (fold,) = friction.folds
    assert friction.value[0] == friction.value[-1] == pytest.approx(0.0, abs=1e-12)
    turn = int(np.argmax(friction.value)) + 1
    expected = np.interp(0.9 * fold, friction.value[:turn], friction.stance_angle[:turn])
    near = find_gait(replace(walker, hip_friction=0.9 * fold), 0.03)
    assert near.stance_angle == pytest.approx(expected, rel=5e-3)


@pytest.mark.parametrize("name", KNEED)
def test_a_spring_straightens_a_free_knee_and_its_stop_carries_nothing(name):
    gait, walker = LONG_GAITS[name], WALKERS[name]
    sprung = fitted(walker, spring=0.0, friction=0.0)
    plain, found = (stride(w, gait.slope, gait.state) for w in (walker, sprung))
    assert found.kneestrike_time < plain.kneestrike_time
    times = np.linspace(0.05, 0.95, 7) * float(found.kneestrike_time)
    states, phases = states_at(sprung, gait.slope, gait.state, times)
    carried = forces(sprung, gait.slope, states, phases)
    pull = sprung.knee_stiffness * (states[:, 1] - states[:, 2])
    assert np.abs(carried.swing_knee).max() < 1e-12 * pull.max()


@pytest.mark.parametrize("name", FITTINGS)
def test_no_joint_pushes_or_gives_energy(name):
    with pytest.raises(WalkerError, match=f"{name} must not be negative"):
        replace(WALKERS["C"], **{name: -1.0})


def test_the_code_without_springs_knows_none_of_them():
    for kind in ("kneed", "straight", "simplest"):
        assert set(FITTINGS) < set(SYSTEMS[kind].absent)
        assert set(FITTINGS).isdisjoint(SYSTEMS[f"{kind}-fitted"].absent)
        assert SYSTEMS[f"{kind}-uneven"].absent == ()
