"""Steps of an environment and their derivatives, against differences of the same steps."""

import numpy as np
import pytest

from gym_passive_walker.envs.evaluation import linearization
from gym_passive_walker.envs.evaluation.linearization import StepRecorder
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.scenes import rules
from gym_passive_walker.gaits.scenes.scene import SceneError, make_scene

COUNT, STEPS, WIDTH = 6, 75, 1e-6
STRIDES = {"control": "stride", "max_hip_torque": 0.005}


def world(**changes):
    """Walkers near their gait; the step that ends an episode begins the next one."""
    scene = make_scene(**{"slope": 0.01, "tolerance": 1e-12} | changes)
    return PassiveWalkerVectorEnv(COUNT, scene, autoreset_mode="SameStep")


def gains(linear):
    """What a walk earns by each of its actions: the chain rule, backwards, (T, n)."""
    found, ahead = np.empty(linear.rewards_by_action.shape), np.zeros((COUNT, 6))
    for step in reversed(range(len(found))):
        found[step] = linear.rewards_by_action[step]
        found[step] += np.einsum("ni,ni->n", linear.states_by_action[step], ahead)
        ahead = np.einsum("nij,ni->nj", linear.states_by_state[step], ahead)
        ahead += linear.rewards_by_state[step]
    return found


@pytest.mark.parametrize(
    "changes",
    [
        {}, {"energy": "positive"}, {"energy": "net"}, {"walker": "A", "slope": 0.02},
        {"domain_randomization": {"foot_radius": 0.1}}, {"slope": (0.0, 0.03)}, {"slope": 0.09,
        **STRIDES},
        {"energy_weight": 0.0, "slope": 0.0, "reset_noise_scale": 0.3}, {"command": 0.16},
        {"command": (0.05, 0.3), "command_weight": 1.3, "observe_body": ("foot_radius",)},
    ],
)  # fmt: skip
def test_what_a_walk_earns_changes_with_each_action_as_differences_say(changes):
    """Where distance alone counts also walks that fall, which give back what the stride brought."""
    env = world(**changes)
    env.reset(seed=2)
    strides = changes.get("control") == "stride"
    actions = np.random.default_rng(3).uniform(-0.2, 0.6, (6 if strides else STEPS, COUNT, 1))
    recorder, states, fell = StepRecorder(env), [], []
    for action in actions:
        states.append(env.get_state())
        recorder.record(action)
        fell.append(env.step(action)[2])
    exact = gains(recorder.linearize())
    compared = np.ones(COUNT, bool) if env.scene.energy_weight == 0.0 else ~np.any(fell, axis=0)
    assert compared.sum() >= COUNT // 2 and (env.scene.energy_weight > 0.0 or np.any(fell))
    for step in range(0, len(actions), 1 if strides else 7):
        earned = []
        for sign in (1.0, -1.0):
            env.set_state(states[step])
            changed = actions[step:].copy()
            changed[0] += sign * WIDTH
            earned.append(sum(env.step(action)[1] for action in changed))
        difference = (earned[0] - earned[1]) / (2.0 * WIDTH)
        np.testing.assert_allclose(
            exact[step, compared], difference[compared], rtol=1e-4, atol=1e-7
        )


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"actions": ("hip", "push_off")}, "by the hip alone"),
        ({"observation_noise": 0.1}, "without"),
    ],
)
def test_steps_that_are_not_the_walker_s_and_its_hip_s_alone_are_refused(changes, words):
    with pytest.raises(SceneError, match=words):
        StepRecorder(PassiveWalkerVectorEnv(2, "level", **changes))


def test_without_the_bound_derivatives_point_to_a_speed_that_is_far_away(monkeypatch):
    """Strides of half the commanded speed earn nothing, whatever they do."""
    monkeypatch.setattr(linearization, "_last", lambda *_: 0.0)  # no stride after the last step
    env = world(command=0.5, energy_weight=0.0)
    scene, actions = env.scene, np.full((STEPS, COUNT, 1), 0.2)

    def walk(actions, recorder=None):
        """What strides earn without the bound, (COUNT,)."""
        env.reset(seed=2)
        earned = np.zeros(COUNT)
        for action in actions:
            if recorder is not None:
                recorder.record(action)
            _, rewards, terminated, _, infos = env.step(action)
            assert not terminated.any()
            length, period = (
                infos.get(name, np.zeros(COUNT)) for name in ("step_length", "step_period")
            )
            error = scene.command_weight * rules.command_error(length, period, scene.command)
            earned += rewards + np.minimum(error, length) - error
        return earned

    found = {}
    for learning in (True, False):
        recorder = StepRecorder(env, learning=learning)
        walk(actions, recorder)
        found[learning] = gains(recorder.linearize())[0]
    earned = []
    for sign in (1.0, -1.0):
        changed = actions.copy()
        changed[0] += sign * WIDTH
        earned.append(walk(changed))
    difference = (earned[0] - earned[1]) / (2.0 * WIDTH)
    np.testing.assert_allclose(found[True], difference, rtol=1e-4, atol=1e-7)
    assert (abs(found[True]) > 2.0 * abs(found[False])).all()


def test_a_stride_that_goes_on_has_the_derivative_of_the_stride_before():
    """On a gait all strides are alike, so it is what the end of the stride will show."""
    env = world(command=0.1, energy_weight=0.0, reset_noise_scale=0.0)
    by_stance = {}
    for steps in (STEPS, 2 * STEPS):
        env.reset(seed=2)
        recorder, begun, strides = StepRecorder(env, learning=True), [], np.full(COUNT, -1)
        for _ in range(steps):
            now = env.batch.ledger["strides"].copy()
            begun.append(now > strides)
            strides = now
            recorder.record(np.zeros((COUNT, 1)))
            env.step(np.zeros((COUNT, 1)))
        last = max(np.flatnonzero(np.any(begun[:STEPS], axis=1)))
        by_stance[steps] = recorder.linearize().rewards_by_state[last, :, 0]
    assert (by_stance[STEPS] != 0.0).all()
    np.testing.assert_allclose(by_stance[STEPS], by_stance[2 * STEPS], rtol=1e-3)


def by_stance(recorder, monkeypatch, *, going=True):
    """Derivatives of rewards by the stance angle, with what strides that go on will earn or not."""
    with monkeypatch.context() as changed:
        if not going:
            changed.setattr(linearization, "_last", lambda *_: 0.0)
        return recorder.linearize().rewards_by_state[..., 0]


def test_a_stride_that_ends_with_the_last_step_is_not_counted_twice(monkeypatch):
    env = world(command=0.16)
    env.reset(seed=2)
    recorder, ended = StepRecorder(env, learning=True), np.zeros(COUNT, bool)
    while len(recorder._records) < STEPS or not ended.any():
        recorder.record(np.zeros((COUNT, 1)))
        infos = env.step(np.zeros((COUNT, 1)))[-1]
        ended = infos["step_period"] > 0.0
    found, without = (by_stance(recorder, monkeypatch, going=going) for going in (True, False))
    differ = (found != without).any(axis=0)
    assert not ended.all()
    np.testing.assert_array_equal(differ, ~ended)


def test_a_stride_of_an_earlier_episode_says_nothing_of_the_next(monkeypatch):
    scene = make_scene(slope=0.01, command=(0.05, 0.3), reset_noise_scale=0.0)
    env = PassiveWalkerVectorEnv(COUNT, scene, autoreset_mode="SameStep", max_episode_steps=STEPS)
    env.reset(seed=2)
    recorder = StepRecorder(env, learning=True)
    for step in range(STEPS + 5):
        recorder.record(np.zeros((COUNT, 1)))
        env.step(np.zeros((COUNT, 1)))
        if step >= STEPS - 6:
            found, without = (by_stance(recorder, monkeypatch, going=x) for x in (True, False))
            assert np.any(found != without) == (step < STEPS)


def test_what_was_noted_stays_when_the_array_it_came_in_changes():
    linear = []
    for reused in (False, True):
        env, actions = world(), np.full((COUNT, 1), 0.3)
        env.reset(seed=2)
        recorder = StepRecorder(env)
        recorder.record(actions)
        env.step(actions)
        if reused:
            actions[:] = -0.5
        linear.append(recorder.linearize())
    for name, values in linear[0]._asdict().items():
        np.testing.assert_array_equal(getattr(linear[1], name), values)
