"""Pictures of a run show what was measured, in its units."""

import gymnasium
import numpy as np
import pytest
from matplotlib import figure as figures

import gym_passive_walker as gpw
from agents import envs, pictures
from agents.config import configure
from gym_passive_walker.gaits.control.baselines import LinearFeedback, Passive
from gym_passive_walker.gaits.scenes.scene import make_scene


@pytest.fixture
def drawn(monkeypatch):
    """The figures that are saved."""
    found = []
    monkeypatch.setattr(pictures, "save", lambda figure, path: found.append(figure))
    return found


ROWS = [
    {"steps": 0, "seconds": 0.0, "distance": 1.0, "strides": 2, "speed": 0.3,
     "cost_of_transport": 4.0},
    {"steps": 5_000, "seconds": 1.4, "distance": 6.0, "strides": 7, "speed": 0.8,
     "cost_of_transport": 9.0},
    {"steps": 2_500_000, "seconds": 61.6, "distance": 11.0, "strides": 12, "speed": 1.3,
     "cost_of_transport": 14.0},
]  # fmt: skip
PASSIVE = {"distance": 0.5, "strides": 1.5, "speed": 0.25, "cost_of_transport": 2.5}
LABELS = {
    "distance": "distance walked / l", "strides": "strides", "speed": "speed v / √(g l)",
    "cost_of_transport": "cost of transport",
}  # fmt: skip


def test_a_learning_curve_shows_each_quantity_over_million_steps(drawn, tmp_path):
    pictures.learning_curve(tmp_path / "curve.png", ROWS, PASSIVE, "a title")
    (figure,) = drawn
    assert figure.get_suptitle() == "a title"
    labels = [ax.get_ylabel() for ax in figure.axes]
    assert labels == list(LABELS.values())
    for ax, name in zip(figure.axes, LABELS, strict=True):
        curve, passive = ax.lines
        assert curve.get_label() == "in training" and passive.get_label() == "passive"
        assert curve.get_xdata().tolist() == [0.0, 0.005, 2.5]
        assert list(curve.get_ydata()) == [row[name] for row in ROWS]
        assert set(passive.get_ydata()) == {PASSIVE[name]} and passive.get_linestyle() == "--"
        assert ax.get_ylim()[0] == 0.0
    for ax in figure.axes[2:]:
        assert ax.get_xlabel() == "million steps (62 s of training in all)"
        assert [text.get_text() for text in ax.get_legend().get_texts()] == [
            "in training", "passive"
        ]  # fmt: skip
    assert not any(ax.get_xlabel() for ax in figure.axes[:2])


class Recorded:
    """A policy that notes what it sees."""

    def __init__(self, policy):
        self.policy, self.seen, self.first, self.memory = policy, [], [], []

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """Actions of the policy, and the number of calls as memory."""
        self.seen.append(observation.copy())
        self.first.append(bool(episode_start[0]))
        self.memory.append(state)
        return self.policy.predict(observation)[0], len(self.seen)


@pytest.mark.parametrize("limit", [None, 150])
def test_a_gait_is_drawn_from_its_last_three_strides_after_the_transient(
    limit, drawn, monkeypatch, tmp_path
):
    given, strobe_of = [], pictures.strobe_of

    def strobed(walker, states, contacts, slope, *, strides, ax):
        given.append((walker, states, contacts, slope, strides))
        return strobe_of(walker, states, contacts, slope, strides=strides, ax=ax)

    monkeypatch.setattr(pictures, "strobe_of", strobed)
    scene = make_scene("lab", reset_noise_scale=0.02)
    changes = {} if limit is None else {"max_episode_steps": limit}
    policy = Recorded(Passive())
    world = gymnasium.make(envs.ID, scene=scene, **changes)
    pictures.gait(tmp_path / "gait.png", policy, world, seed=5, title="of a walker")
    (ax,) = drawn[0].axes
    assert (ax.get_title(), drawn[0].get_suptitle()) == ("of a walker", "")  # none over another
    assert policy.first == [True] + [False] * (len(policy.first) - 1)
    assert policy.memory == [None, *range(1, len(policy.memory))]
    walker, states, contacts, slope, strides = given[0]
    assert walker == scene.walker and slope == scene.slope
    other = gymnasium.make(envs.ID, scene=scene, **changes)
    other.reset(seed=5)
    walked, stride, over = [], 0, False
    while not over and stride < 23:
        walked.append((stride, other.unwrapped.state, other.unwrapped.contact))
        *_, terminated, truncated, info = other.step(np.zeros(1))
        stride, over = info["strides"], terminated or truncated
    assert len(walked) == len(policy.seen)
    last = walked[-1][0]
    assert last == 22 if limit is None else 2 < last < 22
    shown = [each for each in walked if each[0] > last - 3]
    apart = max(1, round(sum(each[0] == last - 2 for each in shown) / 8))
    assert strides.tolist() == [each[0] for each in shown[::apart]]
    np.testing.assert_array_equal(states, [each[1] for each in shown[::apart]])
    np.testing.assert_array_equal(contacts, [each[2] for each in shown[::apart]])


def test_a_stride_s_torque_is_drawn_in_the_walker_s_own_units(drawn, monkeypatch, tmp_path):

    given, strobe = [], pictures.strobe

    def strobed(walker, slope, state, **options):
        given.append((slope, state, options))
        return strobe(walker, slope, state, **options)

    monkeypatch.setattr(pictures, "strobe", strobed)
    scene = make_scene("steep", reset_noise_scale=0.0)
    policy = Recorded(LinearFeedback("steep"))
    world = gymnasium.make(envs.ID, scene=scene)
    pictures.gait(tmp_path / "gait.png", policy, world, seed=1, title="")
    ((slope, state, options),) = given
    assert slope == scene.slope and options["strides"] == 3 == len(options["hip_torque"])
    actions = [policy.policy.predict(seen)[0][0, 0] for seen in policy.seen[-3:]]
    scale = scene.walker.units.torque * scene.max_hip_torque
    np.testing.assert_allclose(options["hip_torque"], scale * np.array(actions), rtol=1e-6)
    units = scene.walker.units.to_dimensionless(state)
    np.testing.assert_allclose(units[[0, 3]], policy.seen[-3][0, [0, 3]], atol=1e-6)


def angle_and_slope(step):
    """An observation of the user's own."""
    return step.state.stance, step.slope


class Held:
    """A policy that returns the same action at each stride."""

    def __init__(self, *action):
        self.action = np.array(action)

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """The action for each walker."""
        return np.tile(self.action, (len(observation), 1)), state


@pytest.mark.parametrize("action", [{"push_off": 0.4}, {"hip": 0.02, "push_off": 0.4}], ids=repr)
@pytest.mark.parametrize("seen", [None, angle_and_slope], ids=["default", "own"])
def test_strides_of_other_actions_than_a_hip_torque_are_drawn_as_they_were_walked(
    action, seen, drawn, monkeypatch, tmp_path
):
    given = []
    for name in ("strobe", "strobe_of"):
        monkeypatch.setattr(
            pictures, name, lambda *walk, **how: given.append((walk, how)) or figures.Figure().gca()
        )
    scene = make_scene("push-off", actions=tuple(action), reset_noise_scale=0.0, observation=seen)
    world = gymnasium.make(envs.ID, scene=scene)
    pictures.gait(tmp_path / "gait.png", Held(*action.values()), world, seed=1, title="")
    walked = [world.reset(seed=1) and world.unwrapped.state]
    while len(walked) < 23:
        world.step(np.array([*action.values()]))
        walked.append(world.unwrapped.state)
    ((walk, how),) = given
    if seen is None:
        states = gpw.simulate(walk[0], state=how["state"], strides=3, samples=2).states[::2]
    else:
        states = walk[1]
    np.testing.assert_allclose(states, walked[20:], atol=1e-6)


@pytest.mark.parametrize(
    "changes",
    [{"action_noise": 0.2}, {"domain_randomization": {"max_push_off": (0.9, 1.1)}}],
    ids=repr,
)
def test_disturbed_strides_are_drawn_as_they_were_walked(changes, drawn, monkeypatch, tmp_path):
    given = []
    monkeypatch.setattr(
        pictures, "strobe_of", lambda *walk, **how: given.append(walk) or figures.Figure().gca()
    )
    world = gymnasium.make(envs.ID, scene=make_scene("push-off", reset_noise_scale=0.0, **changes))
    pictures.gait(tmp_path / "gait.png", Held(0.4), world, seed=1, title="")
    world.reset(seed=1)
    walked = [world.unwrapped.state]
    while len(walked) < 23 and not world.step(np.array([0.4]))[2]:
        walked.append(world.unwrapped.state)
    np.testing.assert_allclose(given[0][1], walked[-3:], atol=1e-12)


def test_a_run_is_drawn_with_the_passive_walker_of_its_final_evaluation(
    drawn, monkeypatch, tmp_path
):
    config, walked = configure("sac", "lab"), []
    monkeypatch.setattr(pictures, "learned", lambda run, trust: (config, Passive()))

    def short(config, count):
        walked.append(count)
        return gymnasium.make_vec(
            envs.ID, num_envs=2, scene=envs.scene_of(config), max_episode_steps=30
        )

    monkeypatch.setattr(envs, "arena", short)
    monkeypatch.setattr(pictures, "save", lambda figure, path: (drawn.append(figure), path.touch()))
    evaluate = pictures.simulate_episodes
    monkeypatch.setattr(
        pictures,
        "simulate_episodes",
        lambda *a, seed: (walked.append(seed), evaluate(*a, seed=seed))[1],
    )
    pictures.draw_run(tmp_path, ROWS)
    assert walked == [20, 1000]
    assert {path.name for path in tmp_path.iterdir()} == {"learning_curve.png", "gait.png"}
    curve, gait = drawn
    assert curve.get_suptitle() == envs.describe(config)
    assert gait.axes[0].get_title() == f"SAC on {envs.describe(config)}"
