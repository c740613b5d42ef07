"""The engine reproduces printed numbers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import root

from gym_passive_walker import Outcome, lab_walker_from_parts, stride


def test_the_appendix_fixed_point_returns_to_itself():
    """Subsection 4.10.1, at the slope 0.036 of its comment.

    Its angles are of the stance leg, and of thigh and shank relative to the link before; the thigh
    is opposite the stance leg at pi, less the angle of the foot.
    """
    walker = lab_walker_from_parts()
    stance, stance_rate = 0.24395121657117, -1.04911493167539
    thigh_rate = stance_rate + 0.74757611863057
    shank_rate = thigh_rate - 1.18161338996657
    state = [stance, -stance, -stance, stance_rate, thigh_rate, shank_rate]
    after = stride(walker, 0.036, state)
    assert after.outcome == Outcome.HEELSTRIKE
    np.testing.assert_allclose(after.state, state, rtol=0.0, atol=3e-5)


@pytest.mark.parametrize(
    ("stance", "rate"),
    [
        pytest.param(0.20031090, -0.19983247, id="long"),
        pytest.param(0.19393737, -0.20386693, id="short"),
    ],
)
def test_the_simplest_walkers_fixed_points_are_as_printed(stance, rate):
    """Garcia, Chatterjee, Ruina and Coleman (1998), at the slope 0.009, in units of l and g."""
    unit = np.sqrt(9.81)

    def change(section):
        """Over one stride; the swing rate on the section follows from the stance leg's."""
        angle, rate = section
        swing_rate = np.cos(2.0 * angle) * rate
        state = [angle, -angle, -angle, rate * unit, swing_rate * unit, swing_rate * unit]
        after = stride("D", 0.009, state, tolerance=1e-13)
        assert after.outcome == Outcome.HEELSTRIKE
        return after.state[[0, 3]] / [1.0, unit] - section

    printed = np.array([stance, rate])
    assert np.abs(change(printed)).max() < 3e-8
    fixed = root(change, printed, tol=1e-13).x
    assert np.abs(change(fixed)).max() < 1e-12
    np.testing.assert_allclose(fixed, printed, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize(
    ("slope", "period", "length", "speed", "froude_speed", "stance"),
    [
        (0.034, 0.77, 0.38, 0.49, 0.17, 0.24),
        (0.045, 0.72, 0.44, 0.61, 0.22, 0.27),
        (0.052, 0.68, 0.46, 0.68, 0.24, 0.29),
    ],
)
def test_the_laboratorys_walker_walks_as_tabulated(
    slope, period, length, speed, froude_speed, stance
):
    """The simulation column of Table 4.2, within its two digits, once the gait has settled."""
    walker = lab_walker_from_parts()
    state = [0.244, -0.244, -0.244, -1.049, -0.302, -1.483]
    for _ in range(60):
        last = stride(walker, slope, state)
        assert last.outcome == Outcome.HEELSTRIKE
        state = last.state
    found_speed = last.step_length / last.duration
    found = [
        last.duration,
        last.step_length,
        found_speed,
        found_speed / np.sqrt(walker.gravity * walker.leg_length),
        last.state[0],
    ]
    printed = [period, length, speed, froude_speed, stance]
    np.testing.assert_allclose(found, printed, rtol=0.0, atol=0.01)
