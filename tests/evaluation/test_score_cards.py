"""Score cards of controllers, their statistics and their pictures, against plain arithmetic."""

import csv
import math
from types import SimpleNamespace

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.five_links import FIVE_LINKS
from gym_passive_walker.envs.evaluation import gauntlet as gauntlets
from gym_passive_walker.envs.evaluation import robustness as measures
from gym_passive_walker.envs.evaluation.gauntlet import TESTS, Gauntlet
from gym_passive_walker.envs.evaluation.robustness import Robustness, _Tries, robustness
from gym_passive_walker.envs.evaluation.walks import (
    TIME_LIMIT,
    Walks,
    score_table,
    simulate_episodes,
)
from gym_passive_walker.envs.policies import policy_folder
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.control.baselines import Passive
from gym_passive_walker.gaits.scenes.scene import make_scene


def first_strike(transition):
    """Whether a stride has ended."""
    return transition.heelstrike


def walks(reached, count=8, *, lost=0, seed=0):
    """Invented walks, the first of which reach the time limit; some make no stride."""
    rng = np.random.default_rng(seed)
    names = ("reward", "distance", "length", "duration", "motor_work", "net_work", "gravity_work")
    values = {name: rng.uniform(1.0, 2.0, count) for name in names}
    if lost:
        values["length"][-lost:] = 0.0
    ends = [TIME_LIMIT] * reached + ["fell forward"] * (count - reached)
    whole = {name: np.arange(count) for name in ("seeds", "slopes", "strides")}
    return Walks(**values, **whole, endings=ends)


EACH = {
    "own scene": walks(8, seed=1), "rough": walks(0, lost=8, seed=2),
    "a much longer name": walks(3, lost=2, seed=3),
}  # fmt: skip
CARD = Gauntlet("mine", make_scene("lab"), EACH)


def wilson(hits, count):
    """Wilson's 95 % interval in closed form."""
    z, share = 1.959963984540054, hits / count
    middle = (share + z * z / (2 * count)) / (1 + z * z / count)
    half = z / (1 + z * z / count)
    half *= math.sqrt(share * (1 - share) / count + z * z / (4 * count * count))
    return max(0.0, middle - half), min(1.0, middle + half)


def test_survival_and_its_intervals_are_those_of_wilson_test_by_test():
    np.testing.assert_allclose(CARD.survival, [1.0, 0.0, 3 / 8])
    intervals = [wilson(hits, 8) for hits in (8, 0, 3)]
    np.testing.assert_allclose(CARD.survival_interval, intervals, atol=1e-9)
    assert CARD.score == pytest.approx(11 / 24)
    assert CARD.score_interval == pytest.approx(wilson(11, 24))
    low, high = wilson(11, 24)
    assert CARD.facts() == {
        "controller": "mine", "walker": "lab", "score": f"{11 / 24:.3f} ({low:.3f} to {high:.3f})"
    }  # fmt: skip


def test_the_columns_are_medians_and_costs_of_walks_with_a_stride():
    columns = CARD.columns()
    assert list(columns) == ["test", "survival", "low", "high", "distance", "cost_of_transport"]
    assert columns["test"].tolist() == list(EACH)
    np.testing.assert_array_equal(columns["low"], CARD.survival_interval[:, 0])
    np.testing.assert_array_equal(columns["high"], CARD.survival_interval[:, 1])
    for i, each in enumerate(EACH.values()):
        assert columns["distance"][i] == np.median(each.distance)
        some = each.length > 0.0
        costs = (each.motor_work + each.gravity_work)[some] / each.length[some]
        wanted = np.median(costs) if len(costs) else np.nan
        np.testing.assert_equal(columns["cost_of_transport"][i], wanted)


def test_the_printed_card_has_a_line_for_each_test_under_its_heads(tmp_path):
    first, head, *lines, score = str(CARD).splitlines()
    assert first == "mine, walker 'lab': 8 walks of 100 sqrt(l/g) in each test"
    assert head.split("  ")[0].strip() == "test" and len(lines) == 3
    columns = CARD.columns()
    for i, line in enumerate(lines):
        name = columns["test"][i]
        share, low, to, high, distance, cost = line.removeprefix(name).split()
        assert (share, low, high) == tuple(
            f"{100 * columns[key][i]:.1f}%" for key in ("survival", "low", "high")
        )
        assert to == "to" and distance == f"{columns['distance'][i]:.1f}"
        assert cost == ("-" if i == 1 else f"{columns['cost_of_transport'][i]:.4f}")
        assert len(line) == len(head)
    assert score.split(maxsplit=1) == ["score", CARD.facts()["score"]]
    CARD.to_csv(tmp_path / "card.csv")
    with (tmp_path / "card.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["test"] for row in rows] == list(EACH)
    assert [float(row["survival"]) for row in rows] == CARD.survival.tolist()


def test_each_test_changes_its_one_thing_and_begins_with_the_same_seeds(monkeypatch):
    asked = []

    def noted(policy, arena, *, seed):
        limit = int(arena.batch.rules["step_limit"][0])
        asked.append((policy, arena.num_envs, arena.scene, limit, seed))
        return walks(1, 3)

    monkeypatch.setattr(gauntlets, "simulate_episodes", noted)
    own = make_scene("lab", slope=0.03, tick=0.25)
    found = gpw.gauntlet(Passive(), own, walkers=3)
    assert tuple(found.episodes) == tuple(TESTS) and found.scene == own
    for (_, count, scene, limit, seed), changes in zip(asked, TESTS.values(), strict=True):
        assert (count, limit, seed) == (3, 400, 7_202_611)  # 100 sqrt(l/g) of 0.25 each
        if "domain_randomization" in changes:  # this walker has no mass at its hip
            share = changes["domain_randomization"]["foot_radius"]
            changes = {"domain_randomization": {"foot_radius": share}}
        assert scene == make_scene(own, **changes)
    asked.clear()
    gpw.gauntlet(Passive(), make_scene("steep"), walkers=1)
    assert {limit for _, _, _, limit, _ in asked} == {33}
    asked.clear()
    gpw.gauntlet(Passive(), make_scene("lab", tick=0.3), walkers=1)
    assert {limit for _, _, _, limit, _ in asked} == {333}


def test_bodies_that_no_tolerance_changes_walk_as_they_are(monkeypatch):
    asked = []
    monkeypatch.setattr(
        gauntlets, "simulate_episodes", lambda _, arena, seed: asked.append(arena.scene)
    )
    bodies = {name: changes for name, changes in TESTS.items() if "bodies" in name}
    monkeypatch.setattr(gauntlets, "TESTS", bodies)
    points = gpw.WALKERS["lab-straight"].with_body({"foot_radius": 0.0})  # no mass at its hip
    drawn = {"domain_randomization": {"thigh_mass": 0.1}, "randomization_pool": 2}
    gpw.gauntlet(Passive(), make_scene("steep", walker=points, **drawn), walkers=1)
    assert asked == [make_scene("steep", walker=points)] * 2


def test_a_card_has_the_name_of_its_controller_however_it_is_given(monkeypatch, tmp_path):
    class Nameless:
        """A controller without a name."""

        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            """No torque."""
            return np.zeros((len(observation), 1)), state

    monkeypatch.setattr(gauntlets, "simulate_episodes", lambda *_, seed: walks(1, 1))
    folder = policy_folder("steep-ppo")
    for controller, scene, title in (
        ("steep-sac", None, "steep-sac"), (folder, None, str(folder)),
        (gpw.load_policy("steep-ppo"), None, "steep-ppo"), (Nameless(), "lab", "Nameless"),
        ("lqr", "steep", "lqr"), (Passive(), "lab", "passive"),
    ):  # fmt: skip
        assert gpw.gauntlet(controller, scene, walkers=1).controller_name == title


@pytest.mark.parametrize("walkers", [-1, 1.5, 100_001, "many"])
def test_a_number_of_walks_out_of_range_is_refused(walkers):
    with pytest.raises(ValueError, match="walkers must be a whole number from 1 "):
        gpw.gauntlet("steep-ppo", walkers=walkers)


# Episodes.


def test_rows_are_rounded_as_asked_and_in_one_order():
    some = walks(2, 3)
    names = [
        "agent", "seeds", "slopes", "reward", "distance", "strides", "speed", "cost_of_transport",
        "gravity_cost", "ending",
    ]  # fmt: skip
    for digits in (None, 2, 6):
        rows = some.rows("me", digits)
        assert [list(row) for row in rows] == [names] * 3
        for i, row in enumerate(rows):
            assert row["agent"] == "me" and row["ending"] == some.endings[i]
            for name in names[1:-1]:
                value = getattr(some, name)[i]
                assert row[name] == (value if digits is None else np.round(value, digits))
    assert some.rows("me") == some.rows("me", 6)


def test_the_table_has_medians_and_ranges_and_endings_by_how_frequent_they_are():
    some, other = walks(3, 5, lost=1), walks(1, 4, seed=5)
    lines = score_table("title", {"one": some, "another": other}).splitlines()
    assert lines[0] == "title" and len({*map(len, lines[1:])}) == 1
    body = [line.strip() for line in lines[4:-1]]
    labels = [
        "distance / leg length", "strides", "speed / √(g l)", "cost of transport",
        "of it gravity's", "return", "fell forward", TIME_LIMIT,
    ]  # fmt: skip
    quantities = [
        (lambda w: w.distance, ".1f"), (lambda w: w.strides, ".0f"), (lambda w: w.speed, ".3f"),
        (lambda w: w.cost_of_transport[w.reached_limit], ".4f"),
        (lambda w: w.gravity_cost[w.reached_limit], ".4f"), (lambda w: w.reward, ".2f"),
    ]  # fmt: skip
    for line, label, (of, form) in zip(body, labels, quantities, strict=False):
        assert line.startswith(label)
        for each in (some, other):
            values = sorted(of(each))
            middle = f"{np.median(values):{form}}"
            low, high = f"{values[0]:{form}}", f"{values[-1]:{form}}"
            assert (middle if low == high else f"{middle} ({low} to {high})") in line
    counts = [" ".join(line.split()) for line in body[6:]]
    two, three, most, one = (wilson(*each) for each in ((2, 5), (3, 5), (3, 4), (1, 4)))
    some, other = ([f"({low:.0%} to {high:.0%})" for low, high in each]
                   for each in ((two, three), (most, one)))  # fmt: skip
    assert counts == [
        f"fell forward 2 of 5 {some[0]} 3 of 4 {other[0]}",
        f"{TIME_LIMIT} 3 of 5 {some[1]} 1 of 4 {other[1]}",
    ]
    frequent = score_table("", {"one": walks(4, 5)}).splitlines()
    assert frequent[-2].startswith("fell forward") and frequent[-3].startswith(TIME_LIMIT)


def test_a_hundred_strides_are_enough_and_half_of_the_walks_may_be_few():
    values = walks(4, 4)
    counted = Walks(**{**vars(values), "strides": np.array([99, 100, 101, 7])})
    assert counted.summary()["hundred_strides"] == 0.5
    assert counted.summary()["strides"] == 99.5
    assert counted.summary()["reward"] == pytest.approx(np.mean(values.reward))
    assert counted.summary()["cost_of_transport"] == np.median(values.cost_of_transport)


@pytest.mark.parametrize("actions", [("hip", "push_off"), ("ankle",)])
def test_work_of_every_motor_counts_in_a_walk(actions):
    class Constant:
        """A small share of each motor's largest."""

        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            """A tenth."""
            return np.full((len(observation), len(actions)), 0.1, np.float32), state

    scene = make_scene("lab", walker="E", slope=0.009, actions=actions, reset_noise_scale=0.0)
    found = simulate_episodes(
        Constant(), PassiveWalkerVectorEnv(2, scene, max_episode_steps=200), seed=0
    )
    envs = PassiveWalkerVectorEnv(2, scene, max_episode_steps=200)
    envs.reset(seed=0)
    sums = dict.fromkeys(("motor_work", "net_work"), 0.0)
    names = {
        "motor_work": ("hip_cost", "ankle_cost", "push_off_cost"),
        "net_work": ("net_hip_cost", "net_ankle_cost", "push_off_cost"),
    }
    for _ in range(200):
        _, _, terminated, _, infos = envs.step(np.full((2, len(actions)), 0.1, np.float32))
        if infos["step_period"][0] > 0.0:
            for name, costs in names.items():
                sums[name] += sum(infos[cost][0] for cost in costs) * infos["step_length"][0]
        if terminated[0]:
            break
    assert sums["motor_work"] > 0.0 and found.strides[0] > 1
    for name, value in sums.items():
        assert getattr(found, name)[0] == pytest.approx(value, rel=1e-12)


def test_work_of_all_motors_of_a_system_counts_in_a_walk():
    class Constant:
        """A torque at the swing knee alone, the last of four controls."""

        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            """A small share of the largest."""
            return np.tile(np.float32([0.0, 0.0, 0.0, 0.1]), (len(observation), 1)), state

    scene = make_scene(system=FIVE_LINKS, slope=0.05, reset_noise_scale=0.0)
    envs = PassiveWalkerVectorEnv(1, scene, max_episode_steps=60)
    found = simulate_episodes(Constant(), envs, seed=0)
    envs.reset(seed=0)
    work = 0.0
    for _ in range(60):
        *_, infos = envs.step(np.array([[0.0, 0.0, 0.0, 0.1]]))
        work += (infos["cost_of_transport"] - infos["gravity_cost"])[0] * infos["step_length"][0]
    assert found.strides[0] > 0 and work > 1e-5
    assert found.motor_work[0] == pytest.approx(work) and np.isnan(found.net_work[0])


def test_a_walk_that_the_scene_s_own_rule_ends_at_a_heelstrike_has_stopped():
    scene = make_scene("lab", terminated=first_strike, reset_noise_scale=0.0)
    found = simulate_episodes(Passive(scene), PassiveWalkerVectorEnv(2, scene), seed=0)
    assert found.endings == ["stopped"] * 2 and found.strides.tolist() == [1, 1]


# Robustness.


class Passage:
    """A mean first passage."""

    mean = 40.0

    def __str__(self):
        return "40 strides"


def invented(**changes):
    """Measures that are all different."""
    values = dict(
        controller_name="mine", walker=gpw.WALKERS["lab"], slope=0.0361, step_length=0.51,
        step_period=2.52,
        roughness=0.0025, first_passage=Passage(), survivors=0.9 ** np.arange(1, 31),
        sensitivity=12.3, period_response=np.linspace(-3.0, 2.0, 60), step_up=0.0123,
        step_down=0.0456, push_phases=np.array([0.0, 0.25, 0.5]),
        push_forward=np.array([0.3, 0.1, 0.2]), push_backward=np.array([0.03, 0.02, 0.05]),
        initial_error=0.25, recovered=0.625, recovered_error=0.031, recovery=7.0,
    )  # fmt: skip
    return Robustness(**(values | changes))


def test_measures_of_robustness_are_listed_each_with_its_unit():
    assert invented().facts() == {
        "controller": "mine, walker lab",
        "downhill": "0.0361 rad",
        "step length": "0.51 l",
        "step period": "2.52 √(l/g)",
        "rough ground": "heights differ by 0.0025 l",
        "first passage": "40 strides there",
        "gait sensitivity norm": "12.3 √(l/g) per l",
        "step up": "0.0123 l",
        "step down": "0.0456 l",
        "push forward": "0.1 to 0.3 m √(g l)",
        "push backward": "0.02 to 0.05 m √(g l)",
        "starts": "0.625 ± 0.031 of those up to 25% off keep walking",
        "recovery": "7 strides to a tenth",
    }
    columns = invented().columns()
    for name, of in ((x, x) for x in ("push_phases", "push_forward", "push_backward")):
        np.testing.assert_array_equal(columns[name], getattr(invented(), of))


def test_the_picture_of_robustness_shows_each_measure_on_its_axes():
    found = invented()
    survival, response, pushes, results = found.plot()
    walkers, rate = survival.lines
    strides = np.arange(1, 31)
    np.testing.assert_array_equal(walkers.get_xdata(), strides)
    np.testing.assert_allclose(walkers.get_ydata(), found.survivors)
    np.testing.assert_array_equal(rate.get_xdata(), strides)
    ends = found.survivors[10] * (1.0 - 1.0 / 40.0) ** (strides - 11.0)
    np.testing.assert_allclose(rate.get_ydata(), ends)
    assert rate.get_label() == "rate 1/40" and survival.get_yscale() == "log"
    assert survival.get_ylim() == pytest.approx((0.7 * found.survivors.min(), 1.3))
    assert "σ = 0.0025 l" in survival.get_xlabel() and "not fallen" in survival.get_ylabel()
    bars = [(bar.get_x() + bar.get_width() / 2, bar.get_height()) for bar in response.patches]
    wanted = [(k + 1.0, found.period_response[k]) for k in range(15)]
    np.testing.assert_allclose(bars, wanted)
    assert "stride" in response.get_xlabel() and "√(l/g) per l" in response.get_ylabel()
    assert [line.get_label() for line in pushes.lines] == ["forward", "backward"]
    np.testing.assert_allclose(pushes.lines[0].get_xdata(), [0.0, 25.0, 50.0])
    np.testing.assert_allclose(pushes.lines[1].get_ydata(), found.push_backward)
    assert "%" in pushes.get_xlabel() and "m √(g l)" in pushes.get_ylabel()
    assert pushes.get_ylim()[0] == 0.0
    names, values = (text.get_text().split("\n") for text in results.texts)
    assert dict(zip(names, values, strict=True)) == found.facts()
    title = survival.figure.get_suptitle()
    assert title == "Walker lab at slope 0.0361 rad, mine"


def test_a_picture_of_walkers_that_all_last_or_all_fall_can_be_drawn():
    lasting = Passage()
    lasting.mean = math.inf
    survival = invented(first_passage=lasting, survivors=np.ones(3)).plot()[0]
    assert len(survival.lines) == 1
    fallen = invented(survivors=np.array([0.5, 0.0, 0.0])).plot()[0]
    assert fallen.get_ylim() == pytest.approx((0.35, 1.3))
    import matplotlib.pyplot as plt

    _, ax = plt.subplots()
    assert invented().plot(ax) is ax and len(ax.lines) == 2  # pushes alone on axes of one's own


def test_measures_are_of_the_middle_of_a_range_of_slopes_and_of_nothing_else_random():
    scene = make_scene(
        "lab", slope=(0.03, 0.042), observation_noise=0.1, action_noise=0.2,
        domain_randomization={"foot_radius": 0.1}, constraints={"friction": "end"},
    )  # fmt: skip
    alone = measures._alone(scene)
    assert alone.slope == pytest.approx(0.036)
    plain = make_scene("lab", slope=alone.slope, reset_noise_scale=0.0)
    for name in ("observation_noise", "action_noise", "domain_randomization", "constraints"):
        assert getattr(alone, name) == getattr(plain, name)
    assert alone.reset_noise_scale == 0.0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"first_passage": "drawn"}, 'first_passage must be "sampled" or "mesh", not \'drawn\''),
        ({"initial_error": 0.0}, "initial_error must be a share between 0 and 0.9"),
        ({"initial_error": 0.9}, "initial_error must be a share between 0 and 0.9"),
        ({"strides": 0}, "strides must be a whole number from 1"),
        ({"starts": 1}, "starts must be a whole number from 2"),
        ({"walkers": 0}, "walkers must be a whole number from 1"),
        ({"seed": -1}, "seed"),
    ],
)
def test_each_option_out_of_its_range_is_refused_by_its_name(options, words):
    with pytest.raises(ValueError, match=words):
        robustness("lab", slope=0.036, **options)


def test_maps_bring_their_walker_and_smooth_ground():
    smooth, uneven = gpw.stride_map("lab"), gpw.stride_map("lab", terrain=gpw.stairs(0.001))
    with pytest.raises(ValueError, match="leave the scene out"):
        robustness(smooth, "lab", slope=0.036)
    with pytest.raises(ValueError, match="give a map of smooth ground"):
        robustness(uneven, slope=0.036)


def test_the_error_of_a_share_is_that_of_a_binomial_sample():
    tries = _Tries(Passive(), make_scene("lab"))
    tries.gait = gpw.find_gait("lab", 0.036).state
    made = np.array([measures.AFTER] * 5 + [3] * 15)
    tries.walk = lambda starts, strides: SimpleNamespace(made=made)
    assert tries.recovered(0.3, 20, 0) == pytest.approx((0.25, math.sqrt(0.25 * 0.75 / 20)))


def test_starts_near_a_gait_differ_by_seed_and_by_no_more_than_their_share():
    tries = _Tries(Passive(), make_scene("lab"))
    tries.gait = gpw.find_gait("lab", 0.036).state
    first, again, other = (tries.near(0.2, 400, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    shares = first / tries.gait
    assert shares.min() == pytest.approx(0.8, abs=0.01)
    assert shares.max() == pytest.approx(1.2, abs=0.01)
    for same in ((0, 1), (0, 2), (4, 5)):  # both feet stay down, and the knee locked
        np.testing.assert_allclose(shares[:, same[0]], shares[:, same[1]])
    assert abs(np.corrcoef(shares[:, 0], shares[:, 3])[0, 1]) < 0.2


def test_a_response_is_infinite_if_a_walker_falls_and_else_the_difference_by_the_step():
    tries = _Tries(Passive(), make_scene("lab"))
    periods, asked = np.random.default_rng(0).uniform(1.0, 2.0, (2, 60)), []

    def walk(starts, strides, **way):
        asked.append((len(starts), strides, way))
        return SimpleNamespace(made=made, periods=periods)

    tries.walk, made = walk, np.array([60, 60])
    np.testing.assert_allclose(tries.period_response(), (periods[0] - periods[1]) / 2e-4)
    assert asked == [(2, 60, {"height_changes": [1e-4, -1e-4]})]
    made = np.array([60, 59])
    assert np.isinf(tries.period_response()).all()
