"""Steps of an environment and their derivatives, against differences of the same steps."""

import math

import numpy as np
import pytest

from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.scenes import rules
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.torch import linearization
from gym_passive_walker.torch.linearization import Linear, StepRecorder, left_out

COUNT, STEPS, WIDTH = 6, 75, 1e-6
STRIDES = {"control": "stride", "max_hip_torque": 0.005}


def world(**changes):
    """Walkers near their gait; the step that ends an episode begins the next one."""
    scene = make_scene(**{"slope": 0.01, "tolerance": 1e-12} | changes)
    return PassiveWalkerVectorEnv(COUNT, scene, autoreset_mode="SameStep")


def gains(linear):
    """What a walk earns by each of its actions: the chain rule, backwards, (T, n, k)."""
    found, ahead = np.empty(linear.rewards_by_action.shape), linear.ahead
    for step in reversed(range(len(found))):
        found[step] = linear.rewards_by_action[step]
        found[step] += np.einsum("nik,ni->nk", linear.states_by_action[step], ahead)
        ahead = np.einsum("nij,ni->nj", linear.states_by_state[step], ahead)
        ahead += linear.rewards_by_state[step]
    return found


ROUGH = {"terrain": {"rough": {"height_std": 0.001, "slope_std": 0.002}}, "terrain_lookahead": 2}
OFTEN = {"pushes": {"rate": 0.7, "impulse": (-0.003, 0.005)}}
NOISY = {"observation_noise": 0.01, "action_noise": 0.05, "action_delay": 2}
ALL = {"walker": "E", "slope": 0.009, "actions": ("hip", "ankle", "push_off"), "tick": 0.4,
       "reset_noise_scale": 0.003, "max_push_off": 0.005, "max_hip_torque": 0.003,
       "max_ankle_torque": 0.003}  # fmt: skip


SOME = {"tick": 0.1, "pushes": {"rate": 0.7, "impulse": 1e-4}, "action_noise": 0.01,
        "action_delay": 1}  # fmt: skip


def own_reward(step):
    """A reward of all that a step may depend on."""
    return (
        step.distance - 2.0 * step.energy - 0.1 * (step.action[0] - step.last_action[0]) ** 2
        + 0.02 * step.step_length * step.time + step.collision_loss - step.push * step.state.stance
    )  # fmt: skip


@pytest.mark.parametrize(
    "changes",
    [
        {}, {"energy": "positive"}, {"energy": "net"}, {"walker": "A", "slope": 0.02},
        {"domain_randomization": {"foot_radius": 0.1}}, {"slope": (0.0, 0.03)}, {"slope": 0.09,
        **STRIDES},
        {"energy_weight": 0.0, "slope": 0.0, "reset_noise_scale": 0.3}, {"command": 0.16},
        {"command": (0.05, 0.3), "command_weight": 1.3, "observe_body": ("foot_radius",)},
        {"domain_randomization": {"action_delay": {"choices": [0, 2], "operation": "abs"},
                                  "max_hip_torque": (0.5, 1.0), "thigh_mass": 0.1}},
        ROUGH, OFTEN, NOISY, ROUGH | OFTEN | NOISY | {"command": 0.2}, ALL, ALL | SOME,
        {"reward": own_reward}, ROUGH | OFTEN | NOISY | {"reward": own_reward},
        {"reward": {"distance": 1.0, "action_change": -0.3, "command": -1.0}, "command": 0.1},
        OFTEN | {"constraints": {"friction": "report"}}, STRIDES | OFTEN | {"slope": 0.05},
    ],
)  # fmt: skip
def test_what_a_walk_earns_changes_with_each_action_as_differences_say(changes):
    """Where distance alone counts also walks that fall, which give back what the stride brought."""
    env = world(**changes)
    env.reset(seed=2)
    strides = changes.get("control") == "stride"
    shape = 6 if strides else STEPS, COUNT, len(env.scene.actions)
    actions = np.random.default_rng(3).uniform(-0.2, 0.6, shape)
    recorder, states, fell = StepRecorder(env), [], []
    for action in actions:
        states.append(env.get_state())
        recorder.record(action)
        fell.append(env.step(action)[2])
    exact = gains(recorder.linearize())
    compared = np.ones(COUNT, bool) if env.scene.energy_weight == 0.0 else ~np.any(fell, axis=0)
    assert compared.sum() >= COUNT // 2 and (env.scene.energy_weight > 0.0 or np.any(fell))
    for step in range(0, len(actions), 1 if strides else 7):
        earned, which = [], step % shape[2]
        for sign in (1.0, -1.0):
            env.set_state(states[step])
            changed = actions[step:].copy()
            changed[0, :, which] += sign * WIDTH
            earned.append(sum(env.step(action)[1] for action in changed))
        difference = (earned[0] - earned[1]) / (2.0 * WIDTH)
        np.testing.assert_allclose(
            exact[step, compared, which], difference[compared], rtol=1e-4, atol=1e-7
        )


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
        found[learning] = gains(recorder.linearize())[0, :, 0]
    earned = []
    for sign in (1.0, -1.0):
        changed = actions.copy()
        changed[0] += sign * WIDTH
        earned.append(walk(changed))
    difference = (earned[0] - earned[1]) / (2.0 * WIDTH)
    np.testing.assert_allclose(found[True], difference, rtol=1e-4, atol=1e-7)
    assert (abs(found[True]) > 2.0 * abs(found[False])).all()


START = 6  # place of the stance angle with which a stride began, in the state of a `Linear`


def test_a_stride_that_goes_on_has_the_derivative_of_the_stride_before():
    """On a gait all strides are alike, so it is what the end of the stride will show."""
    env, found = world(command=0.1, energy_weight=0.0, reset_noise_scale=0.0), {}
    for steps in (STEPS, 2 * STEPS):
        env.reset(seed=2)
        recorder = StepRecorder(env, learning=True)
        for _ in range(steps):
            recorder.record(np.zeros((COUNT, 1)))
            env.step(np.zeros((COUNT, 1)))
        found[steps] = recorder.linearize()
    later = found[2 * STEPS].rewards_by_state[STEPS:, :, START]
    end = np.flatnonzero(later.any(axis=1))[0]  # all walkers are alike
    assert (later[end] != 0.0).all()
    np.testing.assert_allclose(found[STEPS].ahead[:, START], later[end], rtol=1e-3)


def test_a_stride_that_ends_with_the_last_step_is_not_counted_twice():
    env = world(command=0.16)
    env.reset(seed=2)
    recorder, ended, steps = StepRecorder(env, learning=True), np.zeros(COUNT, bool), 0
    while steps < STEPS or not ended.any():
        recorder.record(np.zeros((COUNT, 1)))
        ended, steps = env.step(np.zeros((COUNT, 1)))[-1]["step_period"] > 0.0, steps + 1
    assert not ended.all()
    np.testing.assert_array_equal(recorder.linearize().ahead.any(axis=1), ~ended)


def test_a_stride_of_an_earlier_episode_says_nothing_of_the_next():
    scene = make_scene(slope=0.01, command=(0.05, 0.3), reset_noise_scale=0.0)
    env = PassiveWalkerVectorEnv(COUNT, scene, autoreset_mode="SameStep", max_episode_steps=STEPS)
    env.reset(seed=2)
    recorder = StepRecorder(env, learning=True)
    for step in range(STEPS + 5):
        recorder.record(np.zeros((COUNT, 1)))
        env.step(np.zeros((COUNT, 1)))
        if step >= STEPS - 6:
            assert recorder.linearize().ahead.any() == (step < STEPS)


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


def test_a_push_scheduled_by_hand_is_refused():
    env = world(**OFTEN)
    env.reset(seed=0)
    env.batch.schedule_events(impulses=0.01)
    with pytest.raises(ValueError, match=r"scheduled pushes .* have no recorded derivative"):
        StepRecorder(env).record(np.zeros(COUNT))


def test_scenes_that_are_random_and_rough_leave_nothing_out():
    scene = make_scene(**ROUGH | OFTEN | NOISY, domain_randomization={"foot_radius": 0.1})
    assert left_out(scene) == []
    assert left_out(make_scene(scene, reward=own_reward)) == []


def plain(step):
    """A reward that takes single numbers."""
    return math.sin(float(step.distance))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"reward": plain}, "reward has no derivative, since it takes no tensors"),
        ({"reward": {"alive": 1.0}}, "reward is constant but for jumps"),
        ({"observation": lambda step: [step.state.stance, step.time, *step.action]},
         "observation: its derivative by time, action is left out; that by the state is not"),
        ({"terminated": lambda step: step.state.stance > 0.4}, "terminated: when it ends"),
        ({"constraints": {"friction": "end"}}, "constraints: when a violated one ends"),
        ({"command": 0.1}, "command: the bound of its penalty is left out"),
    ],
)  # fmt: skip
def test_each_part_without_a_derivative_has_its_sentence(changes, said):
    (sentence,) = left_out(make_scene(**changes))
    assert sentence.startswith(said) and sentence.endswith(".") and "\n" not in sentence


@pytest.mark.filterwarnings("ignore:reward cannot be compiled")
def test_a_reward_without_a_derivative_has_none():
    env = world(reward=plain)
    env.reset(seed=0)
    recorder = StepRecorder(env)
    recorder.record(np.full(COUNT, 0.2))
    env.step(np.full((COUNT, 1), 0.2))
    linear = recorder.linearize()
    assert not recorder.rewarded and linear.states_by_action.any()
    assert not linear.rewards_by_state.any() and not linear.rewards_by_action.any()


def test_observations_of_ones_own_have_their_derivative_by_the_state():
    def observe(step):
        return [step.state.stance**2, step.state.stance - step.state.thigh, 3.0, step.time]

    env = world(observation=observe)
    seen, _ = env.reset(seed=0)
    recorder = StepRecorder(env)
    recorder.record(np.zeros(COUNT))
    after = env.step(np.zeros((COUNT, 1)))[0]
    linear = recorder.linearize()
    for rows, found in ((seen, linear.seen_by_state), (after, linear.shown_by_state)):
        expected = np.zeros((COUNT, 4, 6))
        expected[:, 0, 0] = 2.0 * np.sqrt(rows[:, 0]) * np.sign(rows[:, 1])
        expected[:, 1, :2] = 1.0, -1.0
        np.testing.assert_allclose(found[0], expected, atol=1e-6)


@pytest.mark.filterwarnings("ignore:observation cannot be compiled")
def test_observations_of_the_policy_alone_have_derivatives():
    seen = {
        "policy": lambda step: [math.sin(float(step.state.stance)), step.time],
        "critic": lambda step: [step.state.stance, step.state.thigh, step.time],
    }
    env = world(observation=seen)
    env.reset(seed=0)
    recorder = StepRecorder(env)
    recorder.record(np.zeros(COUNT))
    assert recorder.linearize().seen_by_state.shape == (1, COUNT, 2, 6)


OTHER = {"max_hip_torque": 0.02, "energy_weight": 0.7}


def test_each_step_has_the_derivatives_of_the_scene_in_which_it_is_made():
    linear, action = [], np.full((COUNT, 1), 0.2)
    for scenes in ([{}], [{**OTHER, "energy": "net"}], [{}, OTHER]):
        env = world(**scenes[0])
        env.reset(seed=2)
        recorder = StepRecorder(env)
        for changes in scenes:
            if changes is not scenes[0]:
                env.set_scene(**changes)  # the next step ends all episodes
                recorder.record(action)
                env.step(action)
                env.reset(seed=2)
                env.set_energy_cost("net")
            for _ in range(3):
                recorder.record(action)
                env.step(action)
        linear.append(recorder.linearize())
    first, second, both = linear
    for name in Linear._fields[:-1]:
        found = getattr(both, name)
        np.testing.assert_allclose(found[:3], getattr(first, name), atol=1e-12)
        np.testing.assert_allclose(found[4:], getattr(second, name), atol=1e-12)
    np.testing.assert_allclose(both.ahead, second.ahead, atol=1e-12)
    assert abs(first.rewards_by_action - second.rewards_by_action).min() > 1e-4


def test_steps_of_scenes_with_other_states_are_differentiated_apart():
    env = world()
    env.reset(seed=0)
    recorder, action = StepRecorder(env), np.zeros((COUNT, 1))
    with pytest.raises(ValueError, match="linearize needs recorded steps"):
        recorder.linearize()
    for changes in ({}, {"pushes": {"rate": 0.1, "impulse": 0.01}}):
        env.set_scene(**changes)
        env.reset(seed=0)
        recorder.record(action)
        env.step(action)
    with pytest.raises(ValueError, match=r"scenes have \[7, 8\] numbers: call clear between"):
        recorder.linearize()
    recorder.clear()
    recorder.record(action)
    assert recorder.linearize().states_by_state.shape == (1, COUNT, 8, 8)


@pytest.mark.parametrize("command", [None, 0.16])
def test_an_episode_that_a_constraint_ends_gives_back_its_stride_s_distance_alone(command):
    ends = {"constraints": {"friction": "end"}, "friction": 0.3}
    env = world(**ends, energy_weight=0.0, command=command)
    env.reset(seed=1)
    recorder, ended = StepRecorder(env), []
    for _ in range(30):
        recorder.record(np.full(COUNT, 0.1))
        ended.append(env.step(np.full((COUNT, 1), 0.1))[2])
    with pytest.raises(ValueError, match="needs `violated`"):
        recorder.linearize()
    linear, over = recorder.linearize(np.stack(ended)), np.stack(ended)
    assert over.any()
    assert not linear.rewards_by_action[over].any()
    (progress,) = np.flatnonzero(linear.rewards_by_state[over][0])
    np.testing.assert_array_equal(np.nonzero(linear.rewards_by_state[over])[1], progress)
    assert (linear.rewards_by_state[over][:, progress] == -1.0).all()
    assert not linear.rewards_by_state[~over][:, progress].any()
