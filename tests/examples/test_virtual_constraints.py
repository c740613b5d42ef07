"""A biped under virtual constraints, with an impact at an angle, has the gait of a quadrature."""

import numpy as np
import pytest
import scipy

import gym_passive_walker as gpw
from examples.virtual_constraints import (
    BIPED,
    Stance,
    before_impact,
    inertia,
    main,
    moments,
    strike,
    work,
)
from gym_passive_walker.modeling import Ground


@pytest.mark.parametrize("slope", [0.0, 0.03])
def test_the_momentum_of_the_gait_is_that_of_a_quadrature(slope):
    body, ground = BIPED.body, Ground(np.sin(slope), np.cos(slope))

    def moment(angle):
        by_sine, by_cosine, rest = moments(body, ground)
        return by_sine * np.sin(angle) + by_cosine * np.cos(angle) + rest

    gained, _ = scipy.integrate.quad(
        lambda angle: inertia(body, angle) * moment(angle), -body.impact, body.impact
    )
    ends = [work(body, sign * body.impact, ground) for sign in (1.0, -1.0)]
    assert ends[0] - ends[1] == pytest.approx(gained, rel=1e-12)
    gait = gpw.find_gait(BIPED, slope)
    kept = gait.multipliers[0].real
    momentum = inertia(body, body.impact) * before_impact(gait)
    assert 0.5 * momentum**2 * (1.0 - kept) == pytest.approx(gained, rel=1e-10)
    assert gait.stable and gait.stance_angle == pytest.approx(-body.impact)


def test_an_impact_keeps_the_momentum_about_the_new_foot():
    """From the velocities of the four masses, of which the swing leg mirrors the stance leg."""
    body, angle, rate = BIPED.body, BIPED.body.impact, 0.4
    up = np.array([np.sin(angle), np.cos(angle)])
    way = rate * np.array([np.cos(angle), -np.sin(angle)])
    foot = np.array([2.0 * np.sin(angle), 0.0])
    mirrored, back = np.array([-up[0], up[1]]), rate * np.array([-np.cos(angle), -np.sin(angle)])
    torso = up + body.height * np.array([np.sin(body.lean), np.cos(body.lean)])
    parts = [
        (body.hip, up, way), (body.leg, 0.5 * up, 0.5 * way), (body.torso, torso, way),
        (body.leg, up - 0.5 * mirrored, way - 0.5 * back),
    ]  # fmt: skip
    momentum = sum(m * ((p - foot)[1] * v[0] - (p - foot)[0] * v[1]) for m, p, v in parts)
    after = strike(body, Stance(angle, rate), 0.0, Ground(0.0, 1.0)).after
    assert inertia(body, after.stance) * after.stance_rate == pytest.approx(momentum, rel=1e-12)


def test_it_prints_its_gait(capsys):
    main()
    assert "before an impact 1.60525399 rad/s" in capsys.readouterr().out
