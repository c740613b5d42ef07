"""A user's own system walks under a controller as the environment has it walk."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.gaits.control.maps import acting_as
from gym_passive_walker.gaits.map_result import Change
from tests.own import statements
from tests.own.statements import DRIVEN

SLOPE = 0.03
SCENES = {name: {**scene, "tolerance": 1e-10} for name, scene in statements.SCENES.items()}


@pytest.fixture(params=SCENES)
def scene(request):
    """The arguments of a scene in which a user's system walks, at a small tolerance."""
    return SCENES[request.param]


class Linear:
    """Actions that are linear in the observation, with or without a derivative."""

    name = "linear"

    def __init__(self, scene, *, exact=True, double=True):
        self.scene, self.double = scene, double
        system = scene["system"]
        shape = (len(system.controls), 2 * system.coordinates + 1)
        self.gain = 0.05 * np.random.default_rng(3).uniform(-1.0, 1.0, shape)
        if exact:
            self.linearize = lambda seen: (
                self._actions(seen),
                np.broadcast_to(self.gain, (len(seen), *shape)),
            )

    def _actions(self, seen):
        return seen @ self.gain.T

    def predict(self, seen, state=None, episode_start=None, deterministic=True):
        """Return actions and the state."""
        return self._actions(seen), state


def test_a_stride_under_a_controller_is_that_of_the_environment(scene):
    control = Linear(scene, exact=False, double=False)
    strides = gpw.stride_map(controller=control, scene=scene, tolerance=1e-10)
    env = gym.make("PassiveWalker-v0", **scene, reset_noise_scale=0.0).unwrapped
    seen, _ = env.reset(seed=0)
    start = env.state
    for _ in range(500):
        seen, _, ended, _, info = env.step(control.predict(seen[None])[0][0].astype(np.float32))
        assert not ended
        if info["step_period"]:
            break
    found = strides.stride(start)
    assert found.outcome == gpw.Outcome.HEELSTRIKE
    # The environment takes actions in single precision.
    np.testing.assert_allclose(found.state, env.state, atol=3e-6)
    assert found.duration == pytest.approx(info["step_period"], abs=3e-6)
    work = found.hip_work - found.heelstrike_loss - found.friction_loss
    work += found.gravity_work + found.spring_work
    kinetic = [
        scene["system"].hybrid.kinetic_energy(scene["system"].body, scene["system"].State(*state))
        for state in (start, found.state)
    ]
    assert work == pytest.approx(kinetic[1] - kinetic[0], abs=1e-8)


def test_exact_derivatives_under_a_controller_are_those_of_differences(scene):
    exact, differences = (
        gpw.stride_map(controller=Linear(scene, exact=exact), scene=scene)
        for exact in (True, False)
    )
    assert exact.exact and not differences.exact
    points = exact.beginning(scene["slope"])
    for parameter in ("slope", next(iter(exact.parameters))):
        found, expected = (
            each.linearize(points, by=("state", parameter))[1] for each in (exact, differences)
        )
        for field in Change.__dataclass_fields__:
            values = getattr(found, field), getattr(expected, field)
            np.testing.assert_allclose(*values, rtol=1e-5, atol=1e-6, err_msg=field)


def test_analyses_of_a_system_take_its_controller():
    scene = SCENES["compass"]
    strides = gpw.stride_map(controller=Linear(scene), scene=scene)
    gait = gpw.find_gait(strides)
    assert gait.stride_map.controller_name == "linear"
    family = gpw.gait_family(strides, 0.028, 0.032)
    assert len(family) > 1
    by_mass = gpw.parameter_family(strides, "hip", 0.64, 0.69, slope=SLOPE)
    assert len(by_mass) > 1
    assert gpw.basin_of_attraction(strides, resolution=4, strides=2).slope == SLOPE
    assert np.isfinite(gpw.lyapunov_exponents(DRIVEN, [SLOPE], strides=5, n_transient=2)).all()
    walk = gpw.simulate(gait, strides=2)
    columns = walk.columns()
    assert set(columns) >= {"stance", "swing", "hip"}
    assert np.ptp(columns["hip"]) > 0.0


def test_a_strike_just_after_a_step_of_the_integration_has_its_derivatives():
    """The last step is then as short as rounding; one of fourteen strides ends so here."""
    scene = SCENES["five links"]
    strides = gpw.stride_map(controller=Linear(scene), scene=scene)
    points = np.repeat(strides.beginning(scene["slope"]), 200, axis=0)
    points *= 1.0 + 1e-4 * np.random.default_rng(0).normal(size=points.shape)
    taken, change = strides.linearize(points, scene["slope"], by=("state",))
    assert np.isfinite(taken.durations).all()
    assert np.abs(change.durations).max(axis=1).min() > 1.0


def test_held_controls_are_a_controller_of_a_system():
    strides = gpw.stride_map(DRIVEN, SLOPE, controller={"hip": 0.01})
    gait = gpw.find_gait(strides)
    assert strides.exact and gait.cycle.hip_work[0] > 0.0
    assert gpw.stride_map(DRIVEN, SLOPE, controller={"hip": 0.0}).passive
    on_any = gpw.stride_map(DRIVEN, controller={"hip": 0.01})
    assert on_any.slope is None
    assert gpw.find_gait(on_any, SLOPE).state == pytest.approx(gait.state, rel=1e-12)
    family = gpw.gait_family(on_any, SLOPE, SLOPE + 1e-3, resolution=1.0)
    assert family.at(SLOPE)[0].state == pytest.approx(gait.state, rel=1e-9)
    with pytest.raises(ValueError, match="has no knee; it has hip"):
        gpw.stride_map(DRIVEN, SLOPE, controller={"knee": 0.01})
    with pytest.raises(ValueError, match="hip must be one number"):
        gpw.stride_map(DRIVEN, SLOPE, controller={"hip": "much"})
    with pytest.raises(ValueError, match="play shows gaits"):
        gpw.play(gait, seconds=0.1)


def test_a_map_of_another_walker_has_the_scene_in_which_it_acts():
    heavier = replace(DRIVEN, body=DRIVEN.body._replace(hip=1.0))
    strides = gpw.stride_map(DRIVEN, SLOPE, controller={"hip": 0.01}).with_walker(heavier)
    _, scene = acting_as(strides, SLOPE)
    assert strides.scene.walker is scene.walker is heavier
    assert scene.largest("hip") == pytest.approx(0.01, rel=1e-14)
