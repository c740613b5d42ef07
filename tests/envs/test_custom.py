"""Rewards, observations and endings of one's own: the same everywhere, and heard."""

import pickle
import warnings
from functools import partial

import gymnasium
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.envs.registration import ID
from gym_passive_walker.envs.rule import Rule
from gym_passive_walker.envs.transitions import BOOLEANS, NOTE, SEVERAL
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.envs.views import Shape, of_notes
from gym_passive_walker.gaits.scenes import rules
from gym_passive_walker.gaits.scenes.checks import SceneError
from gym_passive_walker.gaits.scenes.rewards import TERMS
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.gaits.scenes.transition import Transition

COUNT, STEPS = 5, 40
SCENES = {
    "level": {},
    "push-off": {"actions": ("hip", "push_off"), "slope": 0.02, "energy": "positive"},
    "rough": {
        "scene": "rough", "terrain_lookahead": 0, "pushes": {"rate": 0.3, "impulse": (-0.02, 0.02)},
    },
    "point feet": {"walker": "E", "slope": 0.009, "actions": ("hip", "ankle", "push_off")},
    "simplest": {"walker": "D", "slope": 0.009, "actions": ("hip", "ankle", "push_off")},
    "strides": {"scene": "steep"},
    "commanded": {"command": (0.1, 0.2)},
}  # fmt: skip


def own(step):
    """The environment's own reward."""
    return step.distance - 10.0 * step.energy


def flat(step):
    """All numbers of a transition, in order."""
    return [x for part in step for x in (part if isinstance(part, tuple) else (part,))]


def everything(step):
    """All of it as an observation."""
    return tuple(gpw.math.where(x, 1.0, 0.0) if is_truth(x) else x for x in flat(step))


def is_truth(x):
    return getattr(x, "op", "") in ("<", "<=", ">", ">=") or np.asarray(x).dtype == bool


def scene_of(name, **rules):
    arguments = dict(SCENES[name])
    return make_scene(arguments.pop("scene", "level"), **arguments, **rules)


def walked(scene, steps=STEPS, seed=2, **options):
    """Observations, rewards, endings and infos of some walkers."""
    env = PassiveWalkerVectorEnv(COUNT, scene, **options)
    reported = [(env.reset(seed=seed)[0],)]
    shares = np.random.default_rng(1).uniform(-0.5, 0.7, (steps, *env.action_space.shape))
    for share in shares:
        reported.append(env.step(share))
    return reported, env


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("name", ["level", "push-off", "strides"])
def test_the_own_reward_as_a_function_has_the_same_bits(name, mode):
    plain, _ = walked(scene_of(name), autoreset_mode=mode)
    weights = {"distance": 1.0, "energy": -10.0}
    for rule in (own, weights):
        found, env = walked(scene_of(name, reward=rule), autoreset_mode=mode)
        for expected, reported in zip(plain[1:], found[1:], strict=True):
            for part in range(4):
                np.testing.assert_array_equal(reported[part], expected[part])
            assert reported[4].keys() == expected[4].keys()
        assert env.batch.custom.native


@pytest.mark.parametrize("name", SCENES)
def test_native_code_gets_the_numbers_of_arrays_and_single_walkers(name):
    """Every field, compiled, with arrays, and walker by walker; through falls and new episodes."""
    native, env = walked(scene_of(name, observation=everything, reward=own))
    assert all(rule.native for rule in env.batch.custom.rules.values())
    reported = []

    def recorded(step):
        reported.append(np.stack([np.asarray(x, float) for x in flat(step)], axis=-1))
        return np.zeros(len(step.distance))

    with pytest.warns(UserWarning, match="with arrays"):
        walked(scene_of(name, reward=recorded))
    own_steps = reported[-STEPS:]
    for (seen, *_), expected in zip(native[1:], own_steps, strict=True):
        # An episode that has just begun has no step to report.
        same = np.isclose(seen, expected, rtol=1e-6, atol=1e-6).all(axis=1)
        begun = seen[:, list(Transition._fields).index("steps") + 10] == 0.0
        assert (same | begun).all()


def test_fields_are_those_of_the_infos_and_close_the_energy_balance():
    scene = scene_of("push-off", reward=own, observation=everything)
    env = PassiveWalkerVectorEnv(COUNT, scene, autoreset_mode="Disabled")
    env.reset(seed=0)
    lost, time, strikes = np.zeros(COUNT), np.zeros(COUNT), 0
    for k in range(30):
        share = np.full((COUNT, 2), 0.1 * (k % 3))
        before = env.batch.records["state"][:, 0].copy()
        _, rewards, ended, _, infos = env.step(share)
        step = of_notes(env.batch.custom.notes, Shape(2))
        time, lost = time + step.duration, lost + step.collision_loss
        np.testing.assert_array_equal(np.transpose(step.before), before)
        np.testing.assert_array_equal(step.distance, infos["distance"])
        np.testing.assert_array_equal(step.energy, infos["energy"])
        np.testing.assert_array_equal(rewards, own(step))
        np.testing.assert_allclose(step.time, time, rtol=1e-12)
        np.testing.assert_allclose(np.transpose(step.action), share)
        charged = 0.5 * (step.hip_work_absolute + step.hip_work) + step.push_off_work
        np.testing.assert_allclose(step.energy, charged, rtol=1e-12, atol=1e-15)
        struck = infos["step_period"] > 0.0
        np.testing.assert_array_equal(step.heelstrike, struck)
        if struck.any():
            strikes += struck.sum()
            np.testing.assert_array_equal(step.step_length[struck], infos["step_length"][struck])
            np.testing.assert_array_equal(step.step_period[struck], infos["step_period"][struck])
            cost = infos["collision_cost"] * infos["step_length"]
            np.testing.assert_allclose(lost[struck], cost[struck], rtol=1e-12)
            lost[struck] = 0.0
        if ended.any():
            break
    assert strikes


@pytest.mark.parametrize("name", SCENES)
def test_a_walk_on_tensors_is_judged_alike(name):
    """Reward of all fields, observation and ending, of the environment and of `torch.rollout`."""
    torch = pytest.importorskip("torch")
    from gym_passive_walker.torch import rollout

    def reward(step):
        return sum(0.1 * (i + 1) * x for i, x in enumerate(everything(step)))

    def observation(step):
        return (*step.state, step.slope, *step.last_action, step.time, step.collision_loss)

    def late(step):
        return (step.steps > 45) & step.knee_locked

    scene = scene_of(name, reward=reward, observation=observation, terminated=late)
    scene = make_scene(scene, pushes={}, end_on_toe_stub=False)
    size, torques = 9 + len(scene.actions), 0.05 * np.random.default_rng(0).normal(size=(40, 3))
    policy = lambda seen: torch.tanh(seen @ torch.from_numpy(torques[:size, : len(scene.actions)]))  # noqa: E731
    walk = rollout(policy, scene, 60, count=COUNT, seed=3)
    env = PassiveWalkerVectorEnv(COUNT, scene)
    seen, _ = env.reset(seed=3)
    strides = np.zeros(COUNT)
    for k in range(60):
        going = walk.going[k].numpy()
        np.testing.assert_allclose(walk.observations[k][going], seen[going], atol=2e-6)
        seen, rewards, ended, *_ = env.step(policy(torch.from_numpy(seen).double()).numpy())
        np.testing.assert_allclose(walk.rewards[k][going], rewards[going], rtol=2e-6, atol=5e-6)
        np.testing.assert_array_equal(walk.outcomes[k][going] > 1, ended[going])
        strides[going] = env.batch.ledger["strides"][going]
    assert strides.max() >= 1 and not walk.going[-1].all()


def late(step):
    """An ending by the clock."""
    return step.time > 1.05


def test_an_ending_of_ones_own_ends_an_episode():
    env = gymnasium.make(ID, terminated=late, max_episode_steps=50)
    env.reset(seed=0)
    for k in range(11):
        _, _, ended, cut, info = env.step(np.zeros(1, np.float32))
        assert ended == (k == 10) and not cut
    assert info["outcome"] == "stopped"
    with pytest.raises(Exception, match="call reset"):
        env.step(np.zeros(1, np.float32))


def test_a_state_after_an_ending_of_ones_own_can_be_put_back():
    env = PassiveWalkerVectorEnv(COUNT, make_scene(terminated=late))
    env.reset(seed=0)
    for _ in range(11):
        *_, ended, _, _ = env.step(np.zeros((COUNT, 1)))
    assert ended.all()
    state = env.get_state()
    expected = env.step(np.full((COUNT, 1), 0.2))[0]
    env.set_state(state)
    np.testing.assert_array_equal(env.step(np.full((COUNT, 1), 0.2))[0], expected)


def struck(step):
    """An ending with the first stride."""
    return step.heelstrike


def test_an_ending_at_a_heelstrike_hides_nothing_of_the_stride():
    plain, env = (PassiveWalkerVectorEnv(COUNT, make_scene(terminated=r)) for r in (None, struck))
    plain.reset(seed=2), env.reset(seed=2)
    landed = np.zeros(COUNT, bool)
    while not landed.any():
        expected, (_, _, ended, _, infos) = (
            each.step(np.full((COUNT, 1), 0.1)) for each in (plain, env)
        )
        landed = expected[4]["step_period"] > 0.0
        np.testing.assert_array_equal(ended, landed | expected[2])
    for name in ("step_length", "collision_cost", "outcome"):
        np.testing.assert_array_equal(infos[name][landed], expected[4][name][landed])


def shown(step):
    """What an agent sees: rates, and what it did last."""
    return *step.state[3:], *step.last_action, *step.action


def test_an_observation_of_ones_own_has_its_space_and_begins_without_actions():
    env = gymnasium.make(ID, observation=shown)
    assert env.observation_space == gymnasium.spaces.Box(-np.inf, np.inf, (5,), np.float32)
    first, _ = env.reset(seed=0)
    assert (first[3:] == 0.0).all() and (first[:3] != 0.0).all()
    for share in (0.5, -0.25, 3.0):
        seen, *_ = env.step(np.array([share], np.float32))
    assert seen[3:].tolist() == [-0.25, 1.0]
    assert (env.reset()[0][3:] == 0.0).all()
    env = PassiveWalkerVectorEnv(3, make_scene(observation=shown), autoreset_mode="Disabled")
    env.reset(seed=0)
    env.step(np.full((3, 1), 0.5))
    seen, _ = env.reset(options={"reset_mask": np.array([True, False, False])})
    np.testing.assert_array_equal(seen[:, 4], [0.0, 0.5, 0.5])


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_an_episode_begins_without_the_actions_of_the_one_before(mode):
    """Of any motor, wherever the episode begins: in `reset`, or as the one before ends."""

    def acted(step):
        return *step.last_action, *step.action

    scene = make_scene(
        walker="E", slope=0.009, actions=("hip", "ankle", "push_off"), observation=acted
    )
    envs = PassiveWalkerVectorEnv(4, scene, autoreset_mode=mode)
    envs.reset(seed=0)
    given, begun = np.tile([0.5, -1.0, 1.0], (4, 1)), np.zeros(4, bool)
    for _ in range(200):
        seen, _, terminated, truncated, _ = envs.step(given)
        over = terminated | truncated
        if mode == "SameStep":
            begun = over
        np.testing.assert_array_equal(seen[begun], 0.0)
        np.testing.assert_array_equal(seen[~begun, 3:], given[~begun])
        if begun.any():
            break
        begun = over
    assert begun.any()
    np.testing.assert_array_equal(envs.reset()[0], 0.0)


GIVEN = ("before", "state", "knee_locked", "slope", "height_change", "slope_change", "command")
"""Fields of a transition that are not zero when an episode begins."""


@pytest.mark.parametrize("name", SCENES)
def test_nothing_has_happened_when_an_episode_begins(name):
    def happened(step):
        return everything(step._replace(**dict.fromkeys(GIVEN, 0.0)))

    def knee(step):
        return gpw.math.where(step.knee_locked, 1.0, 0.0), *step.state

    envs = PassiveWalkerVectorEnv(COUNT, scene_of(name, observation=knee))
    locked, *state = envs.reset(seed=0)[0].T
    np.testing.assert_array_equal(locked, not envs.scene.walker.knees)
    np.testing.assert_allclose(state, envs.get_state()["records"]["state"][:, 0].T, rtol=1e-6)
    envs = PassiveWalkerVectorEnv(COUNT, scene_of(name, observation=happened))
    for _ in range(2):
        np.testing.assert_array_equal(envs.reset(seed=0)[0], 0.0)
        for _ in range(STEPS):
            seen, *_ = envs.step(np.full(envs.action_space.shape, 0.3))
        assert (seen != 0.0).any(axis=0).sum() > 5


def changes(step):
    """A reward that remembers the action before."""
    return -((step.action[0] - step.last_action[0]) ** 2)


def test_a_state_that_is_put_back_goes_on_with_its_last_action():
    scene = make_scene(reward=changes, observation=shown, terminated=late)
    env, twin = (PassiveWalkerVectorEnv(COUNT, scene) for _ in range(2))
    env.reset(seed=0), twin.reset(seed=5)
    env.step(np.full((COUNT, 1), 0.4))
    twin.set_state(env.get_state())
    for share in np.linspace(-1.0, 1.0, 20):
        for found, expected in zip(
            twin.step(np.full((COUNT, 1), share))[:4], env.step(np.full((COUNT, 1), share))[:4],
            strict=True,
        ):  # fmt: skip
            np.testing.assert_array_equal(found, expected)
    state = env.get_state()
    state["ledger"]["ending"] = 15
    with pytest.raises(ValueError, match="ending"):
        twin.set_state(state)
    with pytest.raises(ValueError, match="another reward"):
        PassiveWalkerVectorEnv(COUNT, make_scene(scene, reward=own)).set_state(env.get_state())


def test_environments_with_functions_are_pickled_and_made_from_their_spec():
    env = gymnasium.make(ID, reward=changes, observation=shown, terminated=late)
    again = gymnasium.make(env.spec)
    copy = pickle.loads(pickle.dumps(env.unwrapped))
    reported = []
    for world in (env, again, copy):
        world.reset(seed=1)
        reported.append([world.step(np.array([s], np.float32))[:2] for s in (0.1, 0.7)])
    for other in reported[1:]:
        assert all(
            (a[0] == b[0]).all() and a[1] == b[1] for a, b in zip(reported[0], other, strict=True)
        )
    assert reported[0][1][1] == pytest.approx(-0.36)
    by_weights = gymnasium.make(ID, reward={"alive": 1.0})
    assert gymnasium.make(type(env.spec).from_json(by_weights.spec.to_json())).reset(seed=0)


def test_terms_are_what_they_say():
    env = gymnasium.make(
        ID, reward=dict.fromkeys(TERMS, 1.0), actions=("hip", "push_off"), command=0.15
    ).unwrapped
    env.reset(seed=0)
    env.step(np.array([0.5, 0.25], np.float32))
    _, reward, *_ = env.step(np.array([0.0, 0.5], np.float32))
    terms = env.reward_terms
    assert reward == pytest.approx(sum(terms.values()))
    assert terms["alive"] == 1.0 and terms["fell"] == 0.0 and terms["action"] == 0.25
    assert terms["action_change"] == pytest.approx(0.25 + 0.0625)
    plain = gymnasium.make(ID).unwrapped
    plain.reset(seed=0)
    _, reward, *_ = plain.step(np.array([0.5], np.float32))
    assert sum(plain.reward_terms.values()) == pytest.approx(reward)
    assert plain.reward_terms.keys() == {"distance", "energy"}


def with_numpy(step):
    """Of arrays."""
    return np.exp(-np.asarray(step.distance))


def with_branches(step):
    """Of one walker's numbers alone."""
    return 1.0 if step.distance > 0.01 else step.state.stance


@pytest.mark.parametrize(
    ("rule", "how"), [(with_numpy, "with arrays"), (with_branches, "walker by")]
)
def test_what_cannot_be_compiled_is_called_and_says_so_once(rule, how):
    scene = make_scene(reward=rule, terminated=lambda step: step.distance > 10.0)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        reported, _ = walked(scene)
    assert [how in str(warning.message) for warning in said] == [True]
    (warning,) = said
    where = rule.__code__.co_filename, rule.__code__.co_firstlineno
    assert (warning.filename, warning.lineno) == where
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("default")
        for _ in range(3):
            PassiveWalkerVectorEnv(1, scene)
    assert len(said) == 1
    plain, _ = walked(make_scene())
    over = np.zeros(COUNT, bool)
    for (_, rewards, *_), (_, _, ended, cut, infos) in zip(reported[1:], plain[1:], strict=True):
        mine, over = ~over, ended | cut  # the others begin
        if rule is with_numpy:
            np.testing.assert_allclose(rewards[mine], np.exp(-infos["distance"][mine]))
        assert (rewards[~mine] == 0.0).all()


class Own:
    """A rule that is no plain function."""

    def __call__(self, step):
        """As an object."""
        return with_numpy(step)

    def rule(self, step):
        """As a method."""
        return with_numpy(step)


@pytest.mark.parametrize("given", [Own(), Own().rule, partial(with_numpy)])
def test_a_rule_that_cannot_be_compiled_may_be_any_callable(given):
    with pytest.warns(UserWarning, match="reward cannot be compiled") as said:
        env = PassiveWalkerVectorEnv(2, reward=given)
    (warning,) = said
    mine = warning.filename, warning.lineno
    code = Own.rule.__code__
    assert (mine == (code.co_filename, code.co_firstlineno)) == hasattr(given, "__func__")
    env.reset(seed=0)
    assert (env.step(np.zeros((2, 1)))[1] > 0.0).all()


@pytest.mark.parametrize("axis", [0, -1])
@pytest.mark.parametrize("same", [lambda x: x, np.positive])
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_an_observation_may_be_an_array(axis, same):
    def seen(step):
        return same(np.stack([step.state.stance, step.state.thigh], axis=axis))

    for count in (1, 2, 3):
        plain, own = PassiveWalkerVectorEnv(count), PassiveWalkerVectorEnv(count, observation=seen)
        expected, found = plain.reset(seed=0)[0], own.reset(seed=0)[0]
        np.testing.assert_array_equal(found, expected[:, :2])


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_an_observation_is_called_with_walkers_of_an_episode_alone():
    """Before the first reset all angles are 0, of which this one has no value."""

    def seen(step):
        return 1.0 / float(step.state.stance)

    env = PassiveWalkerVectorEnv(2, observation=seen)
    expected = 1.0 / PassiveWalkerVectorEnv(2).reset(seed=0)[0][:, :1]
    np.testing.assert_allclose(env.reset(seed=0)[0], expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("rules", "said"),
    [
        ({"reward": {"distanc": 1.0}}, r"distanc \(distance\?\)"),
        ({"reward": {}}, "weights of some of distance, energy"),
        ({"reward": {"alive": np.nan}}, r"reward\['alive'\] must be"),
        ({"reward": 3.0}, "reward must be a function of a step, or weights by name, not 3.0"),
        ({"observation": {"state": 1.0}}, "observation must be a function of a step, or have"),
        ({"terminated": "never"}, "terminated must be a function of a step, not 'never'"),
        ({"reward": lambda step: step.nothing}, "has no attribute 'nothing'"),
        ({"reward": lambda step: (step.distance, step.energy)}, "reward fails: .*2 numbers"),
        ({"observation": lambda step: ()}, "observation fails: .*0 numbers"),
        ({"reward": lambda step: "much"}, "reward must return numbers, and <lambda> returns .much"),
        ({"observation": lambda step: np.zeros((2, 2, 2))}, "gives arrays of shape"),
    ],
)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_what_is_no_rule_is_refused_in_a_sentence(rules, said):
    with pytest.raises(SceneError, match=said):
        gymnasium.make(ID, **rules)


def test_functions_that_need_the_users_own_rules_say_so():
    with pytest.raises(SceneError, match=r"go without observation.*observation=None"):
        gpw.stride_map(controller="level-ppo", scene=make_scene(observation=shown))


@pytest.mark.parametrize("function", [f for f in gpw.math.__all__ if f not in ("where",)])
def test_functions_are_the_same_of_numbers_arrays_tensors_and_in_native_code(function):
    torch = pytest.importorskip("torch")
    values = np.linspace(0.1, 2.0, 7)
    given = getattr(gpw.math, function)
    of = (lambda x: given(x, 0.7)) if function in ("minimum", "maximum") else given
    expected = np.array([of(float(x)) for x in values])
    np.testing.assert_allclose(of(values), expected, rtol=1e-15)
    np.testing.assert_allclose(of(torch.from_numpy(values)).numpy(), expected, rtol=1e-15)
    notes = np.zeros(len(values), NOTE)
    notes["time"] = values
    rule = Rule("observation", lambda step: of(step.time), Shape(1))
    numbers = np.empty((len(values), 1))
    from gym_passive_walker.envs.transitions import look

    look(notes, rule.native, numbers)
    np.testing.assert_allclose(numbers[:, 0], expected, rtol=1e-15)


def test_every_field_of_a_transition_is_described_and_kept():
    assert set(BOOLEANS) | set(SEVERAL) <= set(Transition._fields) <= set(NOTE.names)
    for name in Transition._fields:
        assert f"        {name}: " in Transition.__doc__


@pytest.mark.parametrize("count", [1, 3])
def test_each_term_of_a_weighted_reward_is_what_the_infos_report(count):
    weights = {name: 0.3 * (-1) ** k * (k + 1) for k, name in enumerate(TERMS)}
    scene = make_scene(
        "commanded", slope=0.02, command=(0.1, 0.3), actions=("push_off", "hip"), reward=weights
    )
    env = PassiveWalkerVectorEnv(count, scene, autoreset_mode="Disabled")
    env.reset(seed=4)
    last, lost = np.zeros((count, 2)), np.zeros(count)
    random, strikes, ended = np.random.default_rng(0), 0, np.zeros(count, bool)
    while not ended.any():
        given = random.uniform(-0.3, 1.3, (count, 2))
        _, rewards, ended, _, infos = env.step(given)
        acts = np.clip(given, [0.0, -1.0], 1.0)
        struck = infos["step_period"] > 0.0
        strides = {name: np.where(struck, infos.get(name, 0.0), 0.0)
                   for name in ("step_length", "step_period", "push_off_cost")}  # fmt: skip
        length = strides["step_length"]
        expected = {
            "distance": infos["distance"],
            "energy": infos["energy"],
            "alive": np.where(ended, 0.0, 1.0),
            "fell": np.where(ended, 1.0, 0.0),
            "command": abs(length - infos["command"] * strides["step_period"]),
            "action": (acts**2).sum(axis=1),
            "action_change": ((acts - last) ** 2).sum(axis=1),
            "push_off_work": strides["push_off_cost"] * length,
        }
        found = env.reward_terms
        assert list(found) == list(TERMS)
        for name, values in expected.items():
            np.testing.assert_allclose(
                found[name], weights[name] * values, rtol=1e-6, atol=1e-12, err_msg=name
            )
        np.testing.assert_allclose(rewards, sum(found.values()), rtol=1e-12, atol=1e-14)
        lost += found["collision_loss"] / weights["collision_loss"]
        if struck.any():
            whole = infos["collision_cost"] * infos["step_length"]
            np.testing.assert_allclose(lost[struck], whole[struck], rtol=1e-9)
            assert (lost[struck] > 0.0).all()
            lost[struck] = 0.0
        last, strikes = acts, strikes + struck.sum()
    assert strikes >= count


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("command", [None, 0.1])
@pytest.mark.filterwarnings("ignore:reward cannot be compiled")
@pytest.mark.parametrize("reward", [None, own, with_numpy, {"alive": 1.0, "energy": -2.0}])
def test_a_reward_is_the_sum_of_its_terms_also_where_episodes_end_and_begin(reward, command, mode):
    env = PassiveWalkerVectorEnv(
        3, reward=reward, command=command, autoreset_mode=mode, max_episode_steps=7
    )
    env.reset(seed=0)
    env.set_elapsed_steps([0, 2, 4])
    paid = 0
    for k in range(20):
        if k == 10:
            env.set_scene(slope=0.01)
        rewards = env.step(np.full((3, 1), 0.2))[1]
        paid += np.count_nonzero(rewards)
        if (mode, k) != ("SameStep", 10):  # its rewards are of the scene before
            np.testing.assert_allclose(sum(env.reward_terms.values()), rewards, rtol=1e-12)
    env.reset(options={"reset_mask": np.array([True, False, False])})
    terms = sum(env.reward_terms.values())
    assert terms[0] == 0.0 and 40 < paid <= 60
    np.testing.assert_allclose(terms[1:], rewards[1:], rtol=1e-12)


@pytest.mark.parametrize("reward", [None, own, {"distance": 1.0, "energy": -2.0}])
def test_terms_that_were_returned_are_the_callers_to_keep(reward):
    env = PassiveWalkerVectorEnv(3, reward=reward, command=0.1)
    env.reset(seed=0)
    env.step(np.full((3, 1), 0.2))
    terms = env.reward_terms
    kept = {name: term.copy() for name, term in terms.items()}
    env.step(np.full((3, 1), -0.7))
    for name, term in terms.items():
        assert term.shape == (3,) and term.dtype == np.float64
        np.testing.assert_array_equal(term, kept[name])
    for term in env.reward_terms.values():
        term[:] = 7.0
    assert all((term != 7.0).all() for term in env.reward_terms.values())


CALLS = []


def counted(step):
    """An observation that changes from call to call."""
    CALLS.append(step)
    return 0.0 * step.time + len(CALLS)


def as_many_as_walkers(step):
    """One number for each walker in the batch."""
    return np.stack([np.asarray(step.time, float)] * np.size(step.time))


def test_functions_that_are_not_of_the_step_alone_are_not_compiled():
    with pytest.warns(UserWarning, match="it gives another result each time"):
        rule = Rule("observation", counted, Shape(1))
    assert rule.native == 0
    with pytest.warns(UserWarning, match="walker by walker"):
        rule = Rule("observation", as_many_as_walkers, Shape(1))
    assert rule.size == 1


@pytest.mark.parametrize("slow", ["reward", "terminated"])
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_compiled_and_called_functions_go_together(slow):
    def paid(step):
        return 2.0 * step.distance + 0.1

    def stops(step):
        return step.steps > 6.5

    rules = {"reward": paid, "terminated": stops}
    called = {**rules, slow: lambda step: np.asarray(rules[slow](step), float)}
    expected, _ = walked(make_scene(**rules), steps=20)
    found, env = walked(make_scene(**called), steps=20)
    assert not env.batch.custom.native and env.batch.custom.rules[slow].native == 0
    for one, other in zip(expected[1:], found[1:], strict=True):
        for part in range(4):
            np.testing.assert_array_equal(one[part], other[part])
    assert sum(step[2].sum() for step in found[1:]) == 2 * COUNT


def test_transitions_of_walkers_that_go_on_are_kept_at_another_s_reset():
    scene = make_scene("commanded", observation=lambda s: (s.steps, s.command, s.slope, s.time))
    env = PassiveWalkerVectorEnv(3, scene, autoreset_mode="Disabled")
    env.reset(seed=0)
    seen, *_ = env.step(np.zeros((3, 1)))
    again, _ = env.reset(seed=9, options={"reset_mask": np.array([False, True, False])})
    np.testing.assert_array_equal(again[[0, 2]], seen[[0, 2]])
    assert again[1, 0] == again[1, 3] == 0.0 and again[1, 1] != seen[1, 1]
    later, *_ = env.step(np.zeros((3, 1)))
    np.testing.assert_array_equal(later[:, 0], [2.0, 1.0, 2.0])
    np.testing.assert_allclose(later[:, 3], [0.2, 0.1, 0.2], rtol=1e-6)


def test_states_and_ground_of_a_step_are_those_that_the_environment_observes():
    """The same walk by its default observation, with the next foothold, and by all fields."""
    arguments = {
        "scene": "rough", "pushes": {"rate": 0.4, "impulse": (-0.003, 0.003)},
        "terrain": {"rough": {"height_std": 0.001, "slope_std": 0.002}}, "terrain_lookahead": 1,
        "command": (0.1, 0.2),
    }  # fmt: skip
    plain = PassiveWalkerVectorEnv(3, autoreset_mode="Disabled", **arguments)
    arguments |= {"observation": everything, "terrain_lookahead": 0}
    env = PassiveWalkerVectorEnv(3, autoreset_mode="Disabled", **arguments)
    expected, found = plain.reset(seed=5)[0], env.reset(seed=5)[0]
    last, pushed, strikes, before = expected, 0, 0, np.zeros(3)
    for k in range(60):
        if k:
            given = np.full((3, 1), 0.1 * np.sin(k))
            expected, rewards, ended, _, infos = plain.step(given)
            found, *_ = env.step(given)
            if ended.any():
                break
        step = dict(zip(NAMES, found.T, strict=True))
        columns = [step[f"{part} {i}"] for part in ("before", "state") for i in range(6)]
        columns += [step["knee_locked"], step["slope"], step["command"]]
        columns += [step["height_change"], step["slope_change"]]
        same = np.column_stack([last[:, :6], expected])
        np.testing.assert_allclose(np.transpose(columns), same, rtol=1e-6, atol=1e-7)
        assert (step["steps"] == k).all()
        last = expected
        if not k:
            continue
        np.testing.assert_allclose(step["action 0"], given[:, 0], rtol=1e-6)
        np.testing.assert_allclose(step["last_action 0"], before, rtol=1e-6)
        np.testing.assert_array_equal(step["strides"], infos["strides"])
        np.testing.assert_array_equal(step["push"] != 0.0, infos["push_work"] != 0.0)
        np.testing.assert_allclose(
            step["push"], plain.batch.disturbances.states["impulse"], rtol=1e-6
        )
        clock = plain.batch.ledger["clock"] + plain.batch.records["time"][:, 0]
        np.testing.assert_allclose(step["time"], clock, rtol=1e-6)
        np.testing.assert_allclose(step["reward"], rewards, rtol=1e-5, atol=1e-7)
        pushed += (step["push"] != 0.0).sum()
        strikes += step["heelstrike"].sum()
        before = given[:, 0]
    assert pushed > 2 and strikes >= 3


NAMES = [
    f"{name} {i}" if name in SEVERAL else name
    for name in Transition._fields
    for i in range({"before": 6, "state": 6}.get(name, 1))
]
"""Names of the numbers in `everything`, of a scene with one action."""


@pytest.mark.parametrize("size", [1, 40])
def test_an_own_observation_and_the_default_one_have_room_of_their_own(size):
    """Kernels write the default observation, which may have more numbers or fewer."""
    envs = gymnasium.make_vec(ID, num_envs=5, observation=lambda step: [step.time] * size)
    seen, _ = envs.reset(seed=0)
    batch = envs.unwrapped.batch
    assert batch.arrays["observations"].shape == (5 * rules.SIZE,)
    assert batch.observations.shape == (5 * size,) and seen.shape == (5, size)
    seen, *_ = envs.step(np.zeros((5, 1), np.float32))
    assert (seen == seen[:, :1]).all() and (seen > 0.0).all()
