"""A state that cannot be put back is refused with a sentence, and has changed nothing."""

import copy
import json

import gymnasium
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.envs.scene import SCENES
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv

DISTURBED = {
    "pushes": {"rate": 0.3, "impulse": (-0.02, 0.02)}, "action_delay": 2, "action_noise": 0.1,
    "command": (0.1, 0.2), "terrain": {"rough": {"height_std": 0.001, "slope_std": 0.001}},
}  # fmt: skip
SHARES = {"foot_radius": 0.1, "hip_mass": 0.2}


def many(**arguments):
    """Four walkers in the midst of their episodes."""
    made = PassiveWalkerVectorEnv(4, **arguments)
    made.reset(seed=0)
    for _ in range(7):
        made.step(made.action_space.sample() * 0.0 + 0.3)
    return made


def alone(**arguments):
    made = gymnasium.make("PassiveWalker-v0", **arguments).unwrapped
    made.reset(seed=0)
    made.step(np.full(made.action_space.shape, 0.3))
    return made


def refused(env, state, said, assert_same):
    """Assert that a state is refused with these words, and that nothing has changed by it."""
    before = env.get_state()
    with pytest.raises(ValueError, match=said):
        env.set_state(state)
    assert_same(env.get_state(), before)
    for _ in range(3):  # and that it is not the worse for it
        env.step(np.zeros(env.action_space.shape))


def tampered(array, name, value):
    def change(state):
        state[array][name][-1] = value

    return change


def without(name):
    return lambda state: state.pop(name)


def put(name, value):
    return lambda state: state.update({name: value})


def of_other_types(state):
    state["ledger"] = state["ledger"].view(np.float64).reshape(4, -1)


def of_another_generator(state):
    state["random"][1] = np.random.MT19937(0).state


TAMPERED = {
    "a phase that is none": (tampered("records", "phase", 7), r"records\['phase'\].*from 0 to 1"),
    "a phase below 0": (tampered("records", "phase", -1), r"environment 3 must be from 0 to 1"),
    "an outcome": (tampered("records", "outcome", 99), r"records\['outcome'\]"),
    "at rest": (tampered("records", "outcome", -1), "0 or 1 while the episode goes on"),
    "steps tried": (tampered("records", "steps", -1), r"records\['steps'\]"),
    "an angle": (tampered("records", "state", np.nan), r"records\['state'\].*a finite number"),
    "a rate": (tampered("records", "state", np.inf), r"records\['state'\].*a finite number"),
    "a time": (tampered("records", "time", -1.0), r"records\['time'\].*from 0 to 20"),
    "a later time": (tampered("records", "time", 21.0), r"records\['time'\].*from 0 to 20"),
    "a step": (tampered("records", "step", -0.1), r"records\['step'\]"),
    "a torque": (tampered("records", "control", 0.06), r"records\['control'\].*to 0.05"),
    "a push-off": (tampered("records", "push_off", 0.1), r"records\['push_off'\].*to 0"),
    "no ground": (tampered("records", "ground", 0.0), "sine and cosine of the slope"),
    "another slope": (tampered("ledger", "slope", 0.1), "sine and cosine of the slope"),
    "strides": (tampered("ledger", "strides", -1), r"ledger\['strides'\]"),
    "more strides than steps": (tampered("ledger", "strides", 8), "no more than the number"),
    "steps": (tampered("ledger", "steps", -5), r"ledger\['steps'\].*from 0 to 4000"),
    "steps beyond the limit": (tampered("ledger", "steps", 4001), r"from 0 to 4000"),
    "an ending": (tampered("ledger", "ending", 14), r"ledger\['ending'\].*from 0 to 13"),
    "an ending that is not said": (tampered("ledger", "ending", 3), "differ in which ended"),
    "what broke a rule": (tampered("ledger", "violated", -1), r"ledger\['violated'\]"),
    "truncated": (tampered("ledger", "truncated", 2), r"ledger\['truncated'\].*from 0 to 1"),
    "a sum": (tampered("ledger", "total", np.nan), r"ledger\['total'\].*a finite number"),
    "ended": (put("ended", np.array([True, False, False, False])), "differ in which ended"),
    "ended, but of three": (put("ended", np.zeros(3, bool)), "'ended' must be booleans of shape"),
    "begun": (put("begun", "yes"), "'begun' must be True or False, not 'yes'"),
    "no records": (without("records"), "it lacks records"),
    "something besides": (put("more", 1), "it has more"),
    "no scene": (without("scene"), "it lacks scene"),
    "a scene that is none": (put("scene", "level"), "'scene' describes no scene"),
    "fields that are none": (of_other_types, "'ledger' has other fields or types"),
    "words for records": (put("records", "all of them"), "'records' has other fields or types"),
    "walkers": (put("walkers", ["C"] * 4), "must be a row of 4 walkers"),
    "a walker": (put("walkers", [gpw.WALKERS["lab"]] * 4), "of another walker"),
    "no walkers": (put("walkers", None), "must be a row of 4 walkers"),
    "random numbers": (put("random", [{}] * 4), "environment 0 is no state of a PCG64"),
    "another generator": (of_another_generator, "environment 1 is no state of a PCG64"),
    "too few random numbers": (lambda state: state["random"].pop(), "must be 4 states"),
    "no random numbers": (put("random", 3), "must be 4 states of generators, not int"),
}  # fmt: skip


@pytest.mark.parametrize("name", TAMPERED)
def test_a_state_that_was_tampered_with_is_refused_and_nothing_is_changed(name, assert_same):
    change, said = TAMPERED[name]
    env = many()
    state = env.get_state()
    change(state)
    refused(env, state, said, assert_same)


FATES = {
    "pushes": (tampered("disturbances", "pushes", -1), r"disturbances\['pushes'\]"),
    "idle": (tampered("disturbances", "idle", 2), r"disturbances\['idle'\].*from 0 to 1"),
    "a push that is long overdue": (
        tampered("disturbances", "due", -1e300),
        "no earlier than the walker",
    ),
    "a push at no time": (tampered("disturbances", "due", np.nan), r"disturbances\['due'\]"),
    "a command": (
        tampered("disturbances", "command", 0.3),
        r"disturbances\['command'\].*from 0.1 to 0.2",
    ),
    "a place": (tampered("disturbances", "x", np.inf), r"disturbances\['x'\].*a finite number"),
    "late actions": (put("pending", np.full((4, 2, 1), 2.0)), "pending.*shares from -1 to 1"),
    "fewer late actions": (put("pending", np.zeros((4, 1, 1))), "'pending' has shape"),
    "no disturbances": (without("disturbances"), "it lacks disturbances"),
}


@pytest.mark.parametrize("name", FATES)
def test_disturbances_that_were_tampered_with_are_refused(name, assert_same):
    change, said = FATES[name]
    env = many(**DISTURBED)
    state = env.get_state()
    change(state)
    refused(env, state, said, assert_same)


@pytest.mark.parametrize("make", [many, alone])
@pytest.mark.parametrize(
    ("ours", "theirs", "said"),
    [
        ({}, DISTURBED, "of another .*pushes"),
        (DISTURBED, {}, "of another .*pushes"),
        ({}, {"tick": 0.2}, r"of another scene \(of another tick\)"),
        ({"walker": "lab"}, {"walker": "C"}, "of another walker"),
        ({"domain_randomization": SHARES}, {}, "of another domain_randomization"),
        ({"walker": "A"}, {"walker": "D"}, "of another walker"),
    ],
)  # fmt: skip
def test_a_state_of_another_scene_is_refused_by_the_name_of_what_differs(
    make, ours, theirs, said, assert_same
):
    refused(make(**ours), make(**theirs).get_state(), said, assert_same)


def test_a_state_that_lacks_an_argument_of_the_scene_is_of_another_scene(assert_same):
    env = many(tick=0.2)
    state = env.get_state()
    reported = json.loads(str(state["scene"]))
    del reported["tick"]
    state["scene"] = np.array(json.dumps(reported))
    refused(env, state, r"of another scene \(of another tick\)", assert_same)


def test_a_state_of_more_or_of_fewer_walkers_is_refused(assert_same):
    few = PassiveWalkerVectorEnv(3)
    few.reset(seed=0)
    refused(few, many().get_state(), "of 4 walkers, and here are 3", assert_same)
    refused(many(), few.get_state(), "of 3 walkers, and here are 4", assert_same)
    refused(alone(), few.get_state(), "'ready'|another kind", assert_same)
    refused(few, alone().get_state(), "another kind of environment: it lacks begun", assert_same)
    refused(few, None, "a state is what get_state returned, a mapping, not None", assert_same)


def test_random_walkers_are_put_back_and_others_refused(assert_same):
    env, other = many(domain_randomization=SHARES), many(domain_randomization=SHARES)
    state = env.get_state()
    env.reset(seed=7)
    env.set_state(copy.deepcopy(state))
    assert_same(env.get_state(), state)
    state["walkers"][2] = gpw.WALKERS["lab"]
    refused(other, state, "environment 2: its thigh_offset", assert_same)
    own = PassiveWalkerVectorEnv(2, walkers=["C", "lab"])
    own.reset(seed=0)
    state = own.get_state()
    state["walkers"] = state["walkers"][::-1]
    refused(own, state, "of another walker than that of environment 0", assert_same)


def test_a_single_walker_is_not_ready_where_its_episode_has_ended(assert_same):
    env = alone()
    state = env.get_state()
    state["ledger"]["ending"] = 3
    refused(env, state, "the state is 'ready', and its episode has ended", assert_same)
    state["ready"] = 1
    refused(env, state, "'ready' must be True or False", assert_same)


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_every_state_that_walkers_come_to_can_be_put_back(scene, mode, assert_same):
    """After falls, resets, time limits, and pushes in the midst of a step."""
    env = PassiveWalkerVectorEnv(8, scene, max_episode_steps=40, autoreset_mode=mode)
    twin = PassiveWalkerVectorEnv(8, scene, max_episode_steps=40, autoreset_mode=mode)
    twin.set_state(env.get_state())  # of walkers that have not begun
    random = np.random.default_rng(0)
    env.reset(seed=0)
    for _ in range(100):
        _, _, terminated, truncated, _ = env.step(random.uniform(-2.0, 2.0, env.action_space.shape))
        state = env.get_state()
        json.loads(state["scene"])
        twin.set_state(state)
        assert_same(twin.get_state(), state)
        if mode == "Disabled" and (terminated | truncated).any():
            env.reset(options={"reset_mask": terminated | truncated})


def test_a_walker_that_diverged_can_be_put_back():
    env = alone()
    state = env.get_state()
    state["records"]["state"], state["ledger"]["ending"] = np.nan, 9
    state["ready"] = False
    env.set_state(state)
    assert np.isnan(env.get_state()["records"]["state"]).all()
    env.reset()
    env.step(np.zeros(1))


@pytest.mark.parametrize("made", [many, alone])
def test_a_saved_state_shares_nothing_with_the_environment(made, assert_same):
    env = made(**DISTURBED)
    state = env.get_state()
    kept = copy.deepcopy(state)
    for _ in range(5):
        env.step(np.full(env.action_space.shape, -0.7))
    assert_same(state, kept)
