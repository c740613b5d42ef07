"""`tolerance` bounds the error of the next state, up to a factor of 100."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gym_passive_walker import WALKERS, Outcome, stride
from gym_passive_walker.engine.run import options
from tests.equations import oracle
from tests.equations.examples import LONG_GAITS

TOLERANCES = 10.0 ** np.arange(-3.0, -13.5, -1.0)


def errors(name: str, torque: float) -> np.ndarray:
    """Errors of the next state near a gait, relative to its largest angle or rate."""
    walker, gait = WALKERS[name], LONG_GAITS[name]
    units = np.array([1.0] * 3 + [walker.time_unit] * 3)
    state = gait.state * [1.0, 1.0, 1.0, 1.01, 1.0, 1.0]
    exact = oracle.walk(walker, gait.slope, state, torque=torque).state * units
    found = [
        stride(walker, gait.slope, state, hip_torque=torque, tolerance=tolerance)
        for tolerance in TOLERANCES
    ]
    assert all(one.outcome == Outcome.HEELSTRIKE for one in found)
    return (
        np.array([np.abs(one.state * units - exact).max() for one in found]) / np.abs(exact).max()
    )


@pytest.mark.parametrize("torque", [0.0, 0.02], ids=["passive", "driven"])
@pytest.mark.parametrize("name", WALKERS)
def test_the_error_stays_within_a_hundred_tolerances(name, torque):
    assert np.all(errors(name, torque) < 100.0 * TOLERANCES)


@pytest.mark.parametrize("name", WALKERS)
def test_a_finer_tolerance_buys_a_smaller_error(name):
    found = errors(name, 0.0)
    assert found[0] > 1e2 * found[5] > 1e4 * found[9]  # steps of whole swings err little already


POISED = {
    **{name: WALKERS[name] for name in ("B", "D", "E", "F")},
    "lab, balanced": replace(WALKERS["lab"], thigh_offset=0.0, shank_offset=0.0, foot_angle=0.0),
}
"""Walkers that stand at rest with all angles 0."""


@pytest.mark.parametrize("walker", POISED.values(), ids=POISED)
def test_small_motions_are_resolved_as_well_as_large_ones(walker):
    """Near rest the equations are linear: a motion a millionth the size is the same motion."""
    units = np.array([1.0] * 3 + [walker.time_unit] * 3)
    state = np.array([1.0, -1.0, -1.0, 0.5, 3.0, 2.0]) / units

    def rocking(size, tolerance):
        found = stride(walker, 0.0, size * state, max_stride_time=1.0, tolerance=tolerance)
        assert found.outcome == Outcome.STALLED
        return found.state * units / size

    exact = rocking(1e-200, 1e-14)
    for tolerance in (1e-6, 1e-10):
        error = np.abs(rocking(1e-200, tolerance) - exact).max()
        assert 0.0 < error < 100.0 * tolerance * np.abs(exact).max()
    np.testing.assert_allclose(rocking(1e-6, 1e-14), exact, rtol=0.0, atol=1e-9)


def test_a_finer_tolerance_lands_nearer_to_an_event():
    # What a landing may be off by is of third order in the share of a step that it is moved by.
    fine, coarse = (options(tolerance)["landing"][0] for tolerance in (1e-8, 1e-4))
    assert fine**3 < 1e-8 < fine < coarse < 0.01
