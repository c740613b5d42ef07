"""What an agent does, sees and is paid for."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from gym_passive_walker import WALKERS, find_gait, stride, tune
from gym_passive_walker.envs.batch import Batch
from gym_passive_walker.gaits.scenes import rules
from gym_passive_walker.gaits.scenes.scene import Scene
from gym_passive_walker.models.equations.hybrid import Outcome

SCENES = {
    "C": {"walker": "C", "slope": 0.02},
    "lab": {"walker": "lab", "slope": 0.036},
    "A": {"walker": "A", "slope": 0.02},
    "D": {"walker": "D", "slope": 0.009},
}
WHOLE_MOTION = {"tolerance": 1e-12, "reset_noise_scale": 0.0}


def strides(walk):
    """The infos of completed strides."""
    return [info for *_, info in walk if info.get("outcome") == "heelstrike"]


def until_heelstrike(env, torque):
    """Ticks with one torque, up to the heelstrike."""
    ticks = 0
    while True:
        *_, terminated, _, info = env.step(np.array([torque]))
        ticks += 1
        if terminated or info["outcome"]:
            return ticks, info


@pytest.mark.parametrize("torque", [0.0, 0.3])
@pytest.mark.parametrize("name", SCENES)
def test_ticks_with_one_torque_make_a_stride_with_that_torque(make, name, torque):
    env = make(**SCENES[name], **WHOLE_MOTION, max_hip_torque=0.01)
    env.reset(seed=0)
    walker, state = env.walker, env.state
    per_unit = walker.gravity * walker.leg_length
    per_unit *= 1.0 if walker.massless_legs else walker.total_mass
    whole = stride(walker, env.slope, state, hip_torque=torque * 0.01 * per_unit, tolerance=1e-12)
    _, info = until_heelstrike(env, torque)
    np.testing.assert_allclose(env.state, whole.state, atol=1e-10 / walker.time_unit)
    length = walker.leg_length
    assert info["step_length"] == pytest.approx(whole.step_length / length, abs=1e-10)
    assert info["step_period"] == pytest.approx(whole.duration / walker.time_unit, abs=1e-10)
    assert info["speed"] == pytest.approx(info["step_length"] / info["step_period"])
    weight = whole.weight * whole.step_length
    assert info["gravity_cost"] == pytest.approx(whole.gravity_work / weight, abs=1e-10)
    assert info["collision_cost"] == pytest.approx(whole.collision_loss / weight, abs=1e-10)
    charge = 0.0 if walker.massless_legs else whole.hip_work_absolute / weight
    assert info["hip_cost"] == pytest.approx(charge, abs=1e-10)
    assert info["net_hip_cost"] == pytest.approx(whole.hip_work / weight, abs=1e-10)
    assert info["cost_of_transport"] == info["gravity_cost"] + info["hip_cost"]
    if walker.knees:
        since = whole.kneestrike_time / walker.time_unit
        assert info["kneestrike_time"] == pytest.approx(since, abs=1e-10)


def test_the_clock_starts_again_at_each_heelstrike(make):
    env = make(**SCENES["C"], **WHOLE_MOTION)
    env.reset(seed=0)
    for _ in range(5):
        ticks, info = until_heelstrike(env, 0.0)
        assert ticks == math.ceil(info["step_period"] / 0.1)
        assert env.batch.records["time"][0, 0] == 0.0
    # ... so that a gait is a periodic sequence of observations.
    first = [env.step(np.zeros(1))[0] for _ in range(ticks)]
    second = [env.step(np.zeros(1))[0] for _ in range(ticks)]
    np.testing.assert_allclose(first, second, atol=1e-6)


def test_only_a_heelstrike_shortens_a_tick(make):
    env = make(**SCENES["C"], tick=0.1, reset_noise_scale=0.0)
    env.reset(seed=0)
    before = 0.0
    for k in range(200):
        *_, info = env.step(np.array([0.1 * math.sin(k)]))
        now = env.batch.records["time"][0, 0]
        if info.get("outcome") == "heelstrike":
            assert 0.0 < info["step_period"] - before <= 0.1 + 1e-12
        else:
            assert now - before == pytest.approx(0.1, abs=1e-12)
        before = now


@pytest.mark.parametrize("energy", ["absolute", "positive", "net"])
@pytest.mark.parametrize("name", SCENES)
def test_reward_is_distance_less_the_weight_of_energy(make, play, name, energy):
    env = make(**SCENES[name], energy=energy, energy_weight=3.0)
    walk = play(env, lambda k, _: math.cos(0.3 * k), steps=400, seed=1)
    rewards = [reward for _, reward, *_ in walk]
    infos = [info for *_, info in walk]
    for reward, info in zip(rewards, infos, strict=True):
        terms = info["distance"] - 3.0 * info["energy"]
        assert type(reward) is float and reward == pytest.approx(terms, abs=1e-15)
    last = infos[-1]
    assert last["episode_distance"] == pytest.approx(sum(i["distance"] for i in infos))
    assert last["episode_energy"] == pytest.approx(sum(i["energy"] for i in infos))
    assert sum(rewards) == pytest.approx(
        last["episode_distance"] - 3.0 * last["episode_energy"], abs=1e-12
    )


@pytest.mark.parametrize("energy", ["absolute", "positive", "net"])
def test_strides_add_up_to_the_episode(make, play, energy):
    """Their costs times their lengths, and how far each went from heelstrike to heelstrike."""
    env = make(scene="lab", energy=energy, reset_noise_scale=0.02)
    done = strides(play(env, lambda k, _: 0.1 * math.cos(0.3 * k), steps=400, seed=1))
    assert len(done) > 8
    for before, info in pairwise(done):
        charged = info["episode_energy"] - before["episode_energy"]
        assert info["hip_cost"] * info["step_length"] == pytest.approx(charged, rel=1e-9)
        walked = info["episode_distance"] - before["episode_distance"]
        assert info["step_length"] == pytest.approx(walked, abs=0.05)
        assert energy != "net" or info["net_hip_cost"] == info["hip_cost"]


def test_energies_are_parts_of_one_ledger(make, play):
    def infos(energy):
        env = make(**SCENES["C"], energy=energy)
        return [i for *_, i in play(env, lambda k, _: math.cos(0.3 * k), steps=100, seed=1)]

    for a, p, n in zip(infos("absolute"), infos("positive"), infos("net"), strict=True):
        assert p["energy"] == pytest.approx(0.5 * (a["energy"] + n["energy"]), abs=1e-15)
        assert 0.0 <= p["energy"] <= a["energy"] and abs(n["energy"]) <= a["energy"] + 1e-15


def test_a_motor_pays_with_gravity_for_what_a_stride_loses_and_gains(make):
    env = make(**SCENES["C"], **WHOLE_MOTION, control="stride")
    env.reset(seed=0)
    *_, first = env.step(np.array([0.02]))
    *_, second = env.step(np.array([0.02]))
    for _ in range(200):  # settles on a gait with a motor
        before, second = second, env.step(np.array([0.02]))[-1]
    assert second["step_length"] == pytest.approx(before["step_length"], rel=1e-6)
    assert second["step_length"] != pytest.approx(first["step_length"], rel=1e-3)
    paid = second["gravity_cost"] + second["net_hip_cost"]
    assert paid == pytest.approx(second["collision_cost"], rel=1e-5)
    assert abs(second["net_hip_cost"]) > 1e-4


def test_the_simplest_walker_pays_nothing_for_its_torque(make, play):
    walk = play(make(**SCENES["D"], max_hip_torque=0.05), 1.0, steps=50, seed=0)
    assert all(info["energy"] == 0.0 for *_, info in walk)
    passive = play(make(**SCENES["D"], max_hip_torque=0.0), 1.0, steps=50, seed=0)
    assert not np.array_equal(walk[-1][0], passive[-1][0])


@pytest.mark.parametrize("name", SCENES)
def test_without_a_motor_actions_change_nothing(make, play, assert_same, name):
    env = make(**SCENES[name], max_hip_torque=0.0)
    idle = play(env, 0.0, steps=100, seed=3)
    assert_same(play(env, 1.0, steps=100, seed=3), idle)
    assert all(info["energy"] == 0.0 for *_, info in idle)


def test_the_hip_goes_on_through_heelstrikes(make, play):
    env = make(**SCENES["lab"], reset_noise_scale=0.0)
    walk = play(env, steps=200, seed=0)
    moved = [info["distance"] for *_, info in walk]
    per_time = [d / 0.1 for d, (*_, i) in zip(moved, walk, strict=True) if not i["outcome"]]
    assert min(per_time) > 0.0
    done = strides(walk)
    before = [i["episode_distance"] for i in done]
    np.testing.assert_allclose(np.diff(before), [i["step_length"] for i in done[1:]], rtol=1e-6)


@pytest.mark.parametrize("torque", [1.0, -1.0])
def test_a_stride_that_ends_in_a_fall_counts_for_nothing(make, play, torque):
    env = make(walker="C", slope=0.05, max_hip_torque=0.3, end_on_toe_stub=False)
    walk = play(env, torque, seed=2)
    *_, terminated, truncated, info = walk[-1]
    assert terminated and not truncated and info["outcome"] != "heelstrike"
    kept = strides(walk)[-1]["episode_distance"] if strides(walk) else 0.0
    assert info["episode_distance"] == pytest.approx(kept, abs=1e-12)


def test_truncation_takes_nothing_back(make, play):
    env = make(**SCENES["C"])
    walk = play(env, steps=15, seed=0)
    assert walk[-1][-1]["episode_distance"] > 0.0


@pytest.mark.parametrize(
    ("arguments", "state", "outcome"),
    [
        ({"walker": "A"}, [-1.2, -1.2, -1.2, -1.0, 0.0, 0.0], "fell_forward"),
        ({"walker": "A"}, [1.2, -1.2, -1.2, 1.0, 0.0, 0.0], "fell_backward"),
        ({"walker": "A"}, [0.2, 2.9, 2.9, -1.0, 9.0, 9.0], "swing_overrotation"),
        ({"end_on_toe_stub": False}, [-0.18, 0.14, 0.12, -2.9, 1.1, 1.6], "knee_not_locked"),
        ({"max_stride_time": 0.5}, None, "stalled"),
        ({"max_stride_time": 0.5, "control": "stride"}, None, "stalled"),
    ],
)
def test_an_episode_ends_as_what_it_is(make, play, arguments, state, outcome):
    options = None if state is None else {"state": state}
    walk = play(make(**arguments), seed=0, options=options)
    *_, terminated, truncated, info = walk[-1]
    assert terminated and not truncated
    assert info["outcome"] == outcome
    assert not any(step[2] for step in walk[:-1])


def test_a_locked_leg_below_the_ground_is_a_stubbed_toe(make, play):
    """The exploit: snap the knee shut at once, and sweep a stiff leg through the floor."""
    state = find_gait("C", 0.02).state
    snapped = np.array([*state[:2], state[1] - 1e-3, *state[3:5], state[4] + 1.0])
    options = {"state": snapped, "slope": 0.02}
    walk = play(make(), seed=0, options=options)
    assert walk[0][0][6] == 1.0  # locked within the first tick, with the foot behind
    assert walk[-1][-1]["outcome"] == "stubbed_toe" and walk[-1][-1]["strides"] == 0
    allowed = play(make(end_on_toe_stub=False), steps=len(walk) + 5, seed=0, options=options)
    assert len(allowed) > len(walk)


def test_straight_legs_pass_through_the_ground(make, play):
    assert len(strides(play(make(**SCENES["A"], reset_noise_scale=0.02), steps=200, seed=0))) > 3


def test_an_observation_is_the_state_in_dimensionless_numbers(make):
    env = make(**SCENES["lab"])
    observation, _ = env.reset(seed=0)
    state = env.state
    state[3:] *= env.walker.time_unit
    np.testing.assert_array_equal(observation[:6], state.astype(np.float32))
    assert observation[6] == 0.0 and observation[7] == np.float32(0.036)
    locked = False
    while not locked:
        observation, *_, info = env.step(np.zeros(1))
        assert not info["outcome"]
        locked = bool(observation[6])
    assert observation[1] == observation[2] and observation[4] == observation[5]


@pytest.mark.parametrize("name", ["lab", "lab-straight", "B", "E"])
def test_one_agent_fits_walkers_of_any_size(make, play, name):
    """A walker on the moon, a hundred times as large, is the same to its agent."""
    walker = WALKERS[name]
    lengths = [f for f in vars(walker) if f.split("_")[-1] in ("length", "offset", "com", "radius")]
    lengths += ["thigh_gyration", "shank_gyration"]
    masses = ["thigh_mass", "shank_mass", "hip_mass"]
    large = replace(
        walker,
        gravity=1.62,
        **{f: 100.0 * getattr(walker, f) for f in lengths},
        **{f: 7.0 * getattr(walker, f) for f in masses},
    )
    act = lambda k, _: math.sin(0.2 * k)  # noqa: E731
    start = [0.2, -0.2, -0.2, -0.3, -0.2, -0.4]
    here = play(make(walker=walker, slope=0.01, start=start), act, steps=60, seed=0)
    there = play(make(walker=large, slope=0.01, start=start), act, steps=60, seed=0)
    assert len(here) == len(there)
    for (seen, *_), (seen_there, *_) in zip(here, there, strict=True):
        np.testing.assert_allclose(seen, seen_there, atol=1e-5)


def test_level_ground_takes_ever_smaller_passive_steps(make, play):
    """Of the tuned walker for ever; C as printed is mistuned, and stubs its toe in the end."""
    env = make(walker=tune(WALKERS["C"]), reset_noise_scale=0.0)
    done = strides(play(env, steps=3000, seed=0))
    lengths = [i["step_length"] for i in done]
    assert len(lengths) > 80 and lengths[-1] < 0.35 * lengths[0]
    assert all(later < earlier for earlier, later in pairwise(lengths[2:]))
    assert done[-1]["speed"] < 0.35 * done[0]["speed"]


def test_the_steep_slope_fells_most_within_ten_strides():
    count = 200
    batch = Batch(Scene(slope=0.11, control="stride"), count)
    batch.randoms = [np.random.default_rng(i) for i in range(count)]
    observations = np.empty(8 * count, np.float32)
    batch.start(range(count), observations)
    for _ in range(10):
        batch.step(np.zeros(count), observations, np.empty(count), *np.empty((2, count), bool))
    assert batch.over.mean() > 0.9


def test_the_lab_walker_walks_on_and_settles_on_its_gait(make, play):
    done = strides(play(make(scene="lab", reset_noise_scale=0.02), steps=2000, seed=0))
    assert len(done) > 60
    gait = find_gait("lab", 0.036)
    length = gait.step_length / WALKERS["lab"].leg_length
    assert done[-1]["step_length"] == pytest.approx(length, rel=1e-6)


def test_a_stride_stalls_when_its_time_is_up_and_not_at_the_end_of_a_tick(make, play):
    walk = play(make(max_stride_time=0.55, reset_noise_scale=0.0), seed=0)
    held = play(make(max_stride_time=0.55, reset_noise_scale=0.0, control="stride"), seed=0)
    assert len(walk) == 6 and len(held) == 1
    np.testing.assert_allclose(walk[-1][0], held[-1][0], atol=1e-6)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-12])
def test_a_scene_is_as_exact_as_it_is_asked_to_be(make, tolerance):
    env = make(scene="lab", control="stride", tolerance=tolerance, reset_noise_scale=0.2)
    env.reset(seed=1)
    expected = stride(env.walker, env.slope, env.state, tolerance=tolerance, end_on_toe_stub=True)
    env.step(np.zeros(1))
    np.testing.assert_allclose(env.state, expected.state, rtol=1e-13, atol=1e-13)


def test_positive_work_is_that_of_a_motor_that_drives_and_then_brakes(make, play):
    env = make(scene="lab", energy="positive", control="stride", tolerance=1e-10)
    env.reset(seed=0)
    unit = env.walker.total_mass * env.walker.gravity * env.walker.leg_length
    torque = 0.03 * 0.3
    walked = stride(env.walker, env.slope, env.state, hip_torque=torque * unit, tolerance=1e-10)
    *_, info = env.step(np.array([0.3]))
    assert 0.0 < abs(walked.hip_work) < 0.99 * walked.hip_work_absolute
    assert info["energy"] * unit == pytest.approx(walked.hip_work_positive, rel=1e-8)


def test_numbers_are_clipped_to_their_bounds():
    cases = [(-2.0, -1.0), (-1.0, -1.0), (0.3, 0.3), (0.5, 0.5), (0.7, 0.5), (math.nan, -1.0),
             (math.inf, 0.5), (-math.inf, -1.0)]  # fmt: skip
    for value, expected in cases:
        assert rules.clip(value, -1.0, 0.5) == expected
    assert rules.foothold(2.0, -3.0) == (1.0, -math.pi / 2)
    assert rules.foothold(-0.1, 0.2) == (-0.1, 0.2) and rules.foothold(-2.0, 3.0)[0] == -1.0
    assert rules.proportion(101.0) == 100.0 == -rules.proportion(-1e9)
    state = (9.0, -9.0, 9.0, -99.0, 99.0, 9.5)
    right = math.pi / 2
    expected = (right, -math.pi, math.pi, -10.0, 10.0, 9.5, 1.0, -right)
    assert rules.observation(state, 1.0, -5.0) == expected


def test_a_control_step_ends_with_its_tick_or_with_the_time_of_the_stride():
    assert rules.step_end(1.0, 0.25, 20.0) == 1.25 and rules.step_end(19.9, 0.25, 20.0) == 20.0
    for outcome in Outcome:
        stalls = outcome == Outcome.RUNNING
        for time in (20.0, 20.5):
            expected = Outcome.STALLED if stalls else outcome
            assert rules.outcome_of(int(outcome), time, 20.0) == expected
        assert rules.outcome_of(int(outcome), np.nextafter(20.0, 0.0), 20.0) == outcome
        ends = outcome not in (Outcome.RUNNING, Outcome.HEELSTRIKE)
        assert rules.ends_episode(int(outcome)) == ends


@pytest.mark.parametrize("torque", [-0.3, 0.0, 0.2])
def test_actuators_are_charged_for_the_work_of_their_kind(torque):
    """A torque over ways forth and back does positive and negative work, in turn."""
    ways = np.array([0.5, -0.7, 0.1])
    work = torque * ways
    moved, turned = ways.sum(), np.abs(ways).sum()
    assert rules.work_of(torque, moved, turned) == pytest.approx((work.sum(), np.abs(work).sum()))
    expected = {"absolute": np.abs(work).sum(), "positive": work[work > 0.0].sum(),
                "net": work.sum()}  # fmt: skip
    for kind, energy in expected.items():
        charged = rules.motor_charge(rules.ENERGIES.index(kind), torque, moved, turned)
        assert charged == pytest.approx(energy, abs=1e-15)


def test_rewards_and_penalties_are_those_of_their_formulas():
    assert rules.reward(0.3, 0.02, 10.0) == pytest.approx(0.1)
    assert rules.distance_of(False, 0.3, 0.5) == 0.3 and rules.distance_of(True, 0.3, 0.5) == -0.5
    for length, period, command in ((0.5, 3.0, 0.1), (0.5, 3.0, 0.2), (0.5, 2.5, 0.2)):
        error = abs(length - period * command)
        assert rules.command_error(length, period, command) == pytest.approx(error)
        for weight in (0.0, 2.0, 50.0):
            found = rules.command_penalty(length, period, command, weight)
            assert found == pytest.approx(min(weight * error, length))


@pytest.mark.parametrize("name", ["push_off", "hip", "ankle"])
def test_each_actuator_has_its_own_largest_value(make, name):
    """Half of an action of twice the largest value is the action itself."""
    largest = {"push_off": 0.04, "hip": 0.03, "ankle": 0.02}
    order = tuple(largest)
    walks = []
    for factor in (1.0, 2.0):
        values = {**largest, name: factor * largest[name]}
        env = make(walker="E", slope=0.012, actions=order, reset_noise_scale=0.0,
                   max_push_off=values["push_off"], max_hip_torque=values["hip"],
                   max_ankle_torque=values["ankle"])  # fmt: skip
        env.reset(seed=0)
        act = np.array([0.3, 0.1, -0.2])
        act[order.index(name)] /= factor
        walks.append([env.step(act)[:2] for _ in range(25)])
    for (seen, reward), (other, same) in zip(*walks, strict=True):
        np.testing.assert_allclose(seen, other, rtol=1e-6, atol=1e-7)
        assert reward == pytest.approx(same, rel=1e-9, abs=1e-12)
