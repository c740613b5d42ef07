"""A state that cannot be put back is refused with a sentence, and has changed nothing."""

import copy
import json
import pickle
import re
from dataclasses import fields, replace

import gymnasium
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.envs.saved import check_scene, described
from gym_passive_walker.envs.task import EVERY_STRIDE
from gym_passive_walker.envs.transitions import STOPPED
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.scenes.scene import SCENES, Scene, make_scene
from gym_passive_walker.models.equations.hybrid import Outcome
from tests.own.statements import DRIVEN

DISTURBED = {
    "pushes": {"rate": 0.3, "impulse": (-0.02, 0.02)}, "action_delay": 2, "action_noise": 0.1,
    "command": (0.1, 0.2), "terrain": {"rough": {"height_std": 0.001, "slope_std": 0.001}},
}  # fmt: skip
SHARES = {"foot_radius": 0.1, "thigh_mass": 0.2}


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
    "strides beyond the limit": (tampered("ledger", "strides", 4001), "from 0 to 4000"),
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
    "an energy cost": (put("energy_cost", "money"), "'energy_cost' must be 'absolute' or"),
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
    "late actions": (
        put("pending", np.full((4, 2, 1), 2.0)),
        "pending of environment 0.*from -1 to 1",
    ),
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


RESTLESS = {
    **DISTURBED, "reward": {"action_change": -1.0}, "slope": (0.0, 0.02),
    "domain_randomization": {"foot_radius": 0.1},
}  # fmt: skip


@pytest.mark.parametrize("scene", [*SCENES, RESTLESS], ids=[*SCENES, "restless"])
@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_every_state_that_walkers_come_to_can_be_put_back(scene, mode, assert_same):
    """After falls, resets, time limits, and pushes in the midst of a step."""
    env = PassiveWalkerVectorEnv(8, scene, max_episode_steps=40, autoreset_mode=mode)
    twin = PassiveWalkerVectorEnv(8, scene, max_episode_steps=40, autoreset_mode=mode)
    twin.set_state(env.get_state())  # of walkers that have not begun
    random, changed = np.random.default_rng(0), {"begun"}
    env.reset(seed=0)
    first = {name: pickle.dumps(entry) for name, entry in env.get_state().items()}
    for _ in range(100):
        _, _, terminated, truncated, _ = env.step(random.uniform(-2.0, 2.0, env.action_space.shape))
        state = env.get_state()
        json.loads(state["scene"])
        twin.set_state(state)
        assert_same(twin.get_state(), state)
        changed |= {name for name in first if pickle.dumps(state[name]) != first[name]}
        if mode == "Disabled" and (terminated | truncated).any():
            env.reset(options={"reset_mask": terminated | truncated})
    if scene is RESTLESS:  # each entry has been another one
        assert changed >= first.keys() - {
            "scene",
            "energy_cost",
            "draw_keys",
            *(["ended"] if mode == "SameStep" else []),
        }


@pytest.mark.parametrize("make", [many, alone])
def test_a_state_has_the_energy_cost_that_was_set(make, assert_same):
    env, twin = make(), make()
    env.set_energy_cost("net")
    state = env.get_state()
    twin.set_state({**state, "energy_cost": np.array(state["energy_cost"])})  # as files have it
    assert twin.energy_cost == "net"
    act = np.full(env.action_space.shape, -0.5)
    assert_same(twin.step(act), env.step(act))


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


MANY_STEPS = 2**53
LIMITS = {
    "records": {
        "phase": (0, 1), "outcome": (-1, len(Outcome) - 1), "steps": (0, MANY_STEPS),
        "time": (0.0, 20.0), "knee_time": (0.0, 20.0), "end": (0.0, 20.0), "step": (0.0, np.inf),
        "control": (-0.05, 0.05), "push_off": (0.0, 0.0),
    },
    "ledger": {
        "outcome": (0, STOPPED - 1), "ending": (0, STOPPED - 1), "violated": (0, STOPPED - 1),
        "truncated": (0, 1), "steps": (0, 4000), "strides": (0, 4000),
    },
    "disturbances": {"pushes": (0, MANY_STEPS), "idle": (0, 1), "command": (0.1, 0.2)},
}  # fmt: skip
"""Smallest and largest value of each field that has limits."""


@pytest.fixture(scope="module")
def disturbed():
    return many(**DISTURBED)


@pytest.mark.parametrize("array", LIMITS)
def test_each_field_is_valid_up_to_its_limits_and_not_beyond(array, disturbed):
    state = disturbed.get_state()
    for name, limits in LIMITS[array].items():
        for limit, side in zip(limits, (-1.0, 1.0), strict=True):
            for value, valid in ((limit, True), (beyond(state[array][name], limit, side), False)):
                if not np.isfinite(value) and valid:
                    continue
                given = copy.deepcopy(state)
                field = given[array][2, 0] if array == "records" else given[array][2]
                if np.ndim(field[name]):
                    field[name][0] = value
                else:
                    field[name] = value
                said = rf"the state's {array}\['{name}'\] of environment 2 must be from "
                try:
                    disturbed.set_state(given)
                except ValueError as error:
                    assert valid != bool(re.match(said, str(error))), (name, value, error)
                else:
                    assert valid, (name, value)
                finally:
                    disturbed.set_state(state)


def beyond(column, limit, side):
    """The nearest number of a column's type beyond a limit."""
    return limit + int(side) if column.dtype.kind == "i" else np.nextafter(limit, side * np.inf)


@pytest.mark.parametrize("array", ["records", "ledger", "disturbances"])
def test_numbers_of_a_running_episode_are_finite_in_each_field(array, disturbed):
    """But for the measures of the last stride, which the next step clears."""
    state = disturbed.get_state()
    for name in state[array].dtype.names:
        if state[array].dtype[name].base.kind != "f" or (array, name) == ("disturbances", "due"):
            continue
        given = copy.deepcopy(state)
        given[array][name][-1] = np.nan
        if array == "ledger" and name in EVERY_STRIDE:
            disturbed.set_state(given)
            disturbed.set_state(state)
            continue
        with pytest.raises(ValueError, match=rf"{array}\['{name}'\] of environment 3 must be"):
            disturbed.set_state(given)


def test_drawn_walkers_are_valid_up_to_their_shares_and_not_beyond():
    shares = {"foot_radius": 0.1, "shank_mass": 0.2}
    env = many(domain_randomization=shares)
    state = env.get_state()
    for name in ("foot_radius", "shank_mass", "thigh_mass"):
        share, nominal = shares.get(name, 0.0), getattr(gpw.WALKERS["C"], name)
        for sign in (-1.0, 1.0):
            given = {name: nominal * (1.0 + sign * share)}
            state["walkers"][1] = replace(gpw.WALKERS["C"], **given)
            env.set_state(state)
            assert getattr(env.walkers[1], name) == given[name]
            given = {name: nominal * (1.0 + sign * (share + 1e-6))}
            state["walkers"][1] = replace(gpw.WALKERS["C"], **given)
            with pytest.raises(ValueError, match=f"than that of environment 1: its {name} cannot"):
                env.set_state(state)


def test_a_state_from_before_the_first_reset_leaves_each_walker_its_own_draws():
    drawing = {"domain_randomization": {"foot_radius": 0.1}}
    env = PassiveWalkerVectorEnv(3, **drawing)
    env.set_state(PassiveWalkerVectorEnv(3, **drawing).get_state())
    env.reset()
    assert len({walker.foot_radius for walker in env.walkers}) == 3


def test_a_slope_that_a_reset_was_given_in_place_of_a_draw_is_put_back(assert_same):
    slopes = {"uniform": (0.0, 0.02), "operation": "abs"}
    env, twin = (
        PassiveWalkerVectorEnv(2, domain_randomization={"slope": slopes}) for _ in range(2)
    )
    env.reset(seed=0, options={"slope": 0.05})
    twin.set_state(env.get_state())
    assert twin.slopes.tolist() == [0.05] * 2
    assert_same(twin.step(np.ones((2, 1)))[:4], env.step(np.ones((2, 1)))[:4])


def test_bodies_of_a_system_are_put_back_and_others_refused(assert_same):
    def made(seed=0, system=DRIVEN, **arguments):
        envs = PassiveWalkerVectorEnv(
            3, system=system, slope=0.02, domain_randomization={"hip": 0.1}, **arguments
        )
        envs.reset(seed=seed)
        envs.step(np.full((3, 1), 0.3))
        return envs

    env, twin = made(), made(9)
    state = env.get_state()
    assert [w.body for w in twin.walkers] != [w.body for w in env.walkers]
    twin.set_state(pickle.loads(pickle.dumps(state)))
    assert [walker.body for walker in twin.walkers] == [walker.body for walker in env.walkers]
    for _ in range(5):
        assert_same(twin.step(np.ones((3, 1)))[:4], env.step(np.ones((3, 1)))[:4])
    name, *constants = state["walkers"][1]
    for wrong in (
        ("other", *constants), (name, *constants[:-1]), (name, *constants, 1.0),
        (name, 1, *constants[1:]), (), None, gpw.WALKERS["C"],
    ):  # fmt: skip
        given = copy.deepcopy(state)
        given["walkers"][1] = wrong
        refused(env, given, "must be a row of 3 walkers of this environment's kind", assert_same)
    given = copy.deepcopy(state)
    given["walkers"][2] = (name, 1.2 * DRIVEN.body.hip, *map(float, DRIVEN.body[1:]))
    refused(env, given, "than that of environment 2: its hip cannot be here", assert_same)


def one_reward(step):
    return step.distance


def other_reward(step):
    return -step.distance


@pytest.mark.parametrize("argument", [field.name for field in fields(Scene)])
def test_each_argument_of_a_scene_is_part_of_its_description(argument):
    plain, changed = base_of(argument), OTHER[argument]
    ours = make_scene(**plain)
    theirs = make_scene(ours, **{argument: changed})
    assert json.loads(described(ours)) != json.loads(described(theirs))
    with pytest.raises(ValueError, match=rf"\(of another {argument}\)"):
        check_scene(described(theirs), described(ours))
    check_scene(described(make_scene(**plain)), described(ours))


OTHER = {
    "walker": "lab", "slope": 0.02, "control": "stride", "tick": 0.2, "actions": ("push_off",),
    "max_hip_torque": 0.01, "max_ankle_torque": 0.01, "max_push_off": 0.01, "energy_weight": 1.0,
    "energy": "net", "end_on_toe_stub": False, "reset_noise_scale": 0.01,
    "domain_randomization": {"foot_radius": 0.2}, "randomization_pool": 3,
    "observe_body": ("foot_radius",), "start": (0.3, -0.3, -0.3, -0.42, -0.25, -0.4),
    "max_stride_time": 3.0, "tolerance": 1e-6, "pushes": {"rate": 0.1, "impulse": 0.1},
    "observation_noise": 0.1, "action_noise": 0.1, "action_delay": 1, "command": 0.1,
    "command_weight": 1.0, "constraints": {"friction": "report"},
    "terrain": {"rough": {"height_std": 0.02}}, "terrain_lookahead": 1, "friction": 0.5,
    "knee_latch": 0.5, "scuff_depth": 0.5, "reward": other_reward, "observation": other_reward,
    "terminated": other_reward, "reward_terms": True,
}  # fmt: skip
"""Another value of each argument."""


def base_of(argument):
    """Arguments of a scene in which another value of one argument is valid."""
    return {
        "randomization_pool": {"domain_randomization": {"foot_radius": 0.1}},
        "terrain_lookahead": {"terrain": {"rough": {"height_std": 0.01}}},
        "terrain": {"terrain": {"rough": {"height_std": 0.01}}},
        **{name: {name: one_reward} for name in ("reward", "observation", "terminated")},
    }.get(argument, {})


def test_each_actuator_has_its_own_limit_in_a_state():
    largest = {"hip": 0.07, "ankle": 0.02, "push_off": 0.1}
    env = PassiveWalkerVectorEnv(
        2, walker="E", slope=0.012, actions=("push_off", "ankle", "hip"), max_hip_torque=0.07,
        max_ankle_torque=0.02, max_push_off=0.1,
    )  # fmt: skip
    env.reset(seed=0)
    env.step(np.full((2, 3), 0.1))
    state = env.get_state()
    for name, limit in largest.items():
        for value, valid in ((limit, True), (limit + 1e-9, False), (-limit - 1e-9, False)):
            given = copy.deepcopy(state)
            row = given["records"][1, 0]
            if name == "push_off":
                row["push_off"] = value
            else:
                row["control"][0 if name == "hip" else 1] = value
            if valid:
                env.set_state(given)
                continue
            with pytest.raises(ValueError, match=r"records\['(control|push_off)'\] of environ"):
                env.set_state(given)
