"""How much a walk bears, and that each measure is what it is called."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.engine.run import LONGEST_STRIDE, advance, new_records
from gym_passive_walker.envs.evaluation.robustness import AFTER, _largest, _Tries, robustness
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.control.baselines import Passive
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.models.equations.hybrid import State
from gym_passive_walker.models.model import bodies

SLOPE = 0.036


@pytest.fixture(scope="module")
def lab():
    return robustness("lab", slope=SLOPE, walkers=500, strides=40, starts=64)


def walked(first: dict, state, count: int) -> int:
    """Strides that a passive lab walker makes, the first of them under some circumstances."""
    for made in range(count):
        end = gpw.stride("lab", SLOPE, state, tolerance=1e-8, **(first if made == 0 else {}))
        if end.outcome != gpw.Outcome.HEELSTRIKE:
            return made
        state = end.state
    return count


def test_the_gait_is_the_one_that_is_found(lab):
    gait = gpw.find_gait("lab", SLOPE)
    assert lab.step_length * gait.walker.leg_length == pytest.approx(gait.step_length, rel=1e-5)
    assert lab.step_period * gait.walker.time_unit == pytest.approx(gait.step_period, rel=1e-5)


def test_the_sensitivity_is_that_of_the_linearized_stride_map(lab):
    """Hobbelen and Wisse's norm of the response, put together from derivatives of strides."""
    gait, units = gpw.find_gait("lab", SLOPE), gpw.WALKERS["lab"].units
    small = 1e-6

    def changed(first=None, **ground):
        """How end and duration of a stride change, by central differences."""
        ends = []
        for way in (small, -small):
            state = gait.state + way * (0.0 if first is None else first)
            how = {name: way * value for name, value in ground.items()}
            ends.append(gpw.stride("lab", SLOPE, state, tolerance=1e-14, **how))
        state = (ends[0].state - ends[1].state) / (2.0 * small)
        return state, (ends[0].duration - ends[1].duration) / (2.0 * small) / units.time

    off, answer = changed(
        height_change=units.length
    )  # the legs of what follows do not mirror each other
    answers = [answer]
    off, answer = changed(off)
    answers.append(answer)
    jacobian = np.asarray(gpw.stride_jacobian("lab", SLOPE, gait.state))
    section = off[[0, 3, 4, 5]]
    for _ in range(40):
        state = np.array([section[0], -section[0], -section[0], *section[1:]])
        answers.append(changed(state)[1])
        section = jacobian @ section
    np.testing.assert_allclose(lab.period_response[:10], answers[:10], rtol=2e-3, atol=0.02)
    assert lab.sensitivity == pytest.approx(math.sqrt(np.square(answers).sum()), rel=1e-3)


def test_the_largest_steps_are_survived_and_larger_ones_are_not(lab):
    gait = gpw.find_gait("lab", SLOPE)
    length = gait.walker.leg_length
    for size, way in ((lab.step_up, 1.0), (lab.step_down, -1.0)):
        assert size > 0.0
        assert walked({"height_change": way * 0.99 * size * length}, gait.state, AFTER) == AFTER
        assert walked({"height_change": way * 1.02 * size * length}, gait.state, AFTER) < AFTER


def test_a_push_at_the_beginning_is_a_change_of_the_rates(lab):
    """The largest one forward, in a walk that begins with the rates it leaves behind."""
    gait, units = gpw.find_gait("lab", SLOPE), gpw.WALKERS["lab"].units
    system = gait.walker.equations()
    body = gait.walker.body
    state = units.to_dimensionless(gait.state)
    for impulse, way in ((lab.push_forward[0], 1.0), (lab.push_backward[0], -1.0)):
        for share, survives in ((0.98, True), (1.03, False)):
            jump = system.phases[0].push(
                body, gpw.models.equations.hybrid.State(*state), -way * share * impulse, 0.0
            )
            pushed = units.to_own(np.concatenate([state[:3], state[3:] + jump]))
            assert (walked({}, pushed, AFTER) == AFTER) is survives


@pytest.mark.parametrize("at", [2, 8], ids=["knee free", "knee locked"])
def test_pushes_come_at_their_share_of_the_stride(lab, at):
    gait, units = gpw.find_gait("lab", SLOPE), gpw.WALKERS["lab"].units
    system, body = gait.walker.equations(), bodies(gait.walker)
    start, time = units.to_dimensionless(gait.state)[None], lab.push_phases[at] * lab.step_period
    for share, survives in ((0.98, True), (1.03, False)):
        records = new_records(start, SLOPE, end=time)
        advance(system, body, records, tolerance=1e-10)
        record = records[0]
        push = system.phases[record["phase"][0]].push
        impulse = -share * lab.push_forward[at]
        jump = push(gait.walker.body, State(*record["state"][0]), impulse, 0.0)
        record["state"][0, 3:] += [jump[0], jump[1], jump[-1]]
        record["end"] = LONGEST_STRIDE
        advance(system, body, records, tolerance=1e-10, from_section=False)
        struck = record["outcome"][0] == gpw.Outcome.HEELSTRIKE
        following = walked({}, units.to_own(record["state"][0]), AFTER - 1) if struck else 0
        assert (following == AFTER - 1) is survives


def test_what_is_survived_ends_at_the_first_size_that_is_not():
    (largest,) = _largest(lambda sizes: (sizes < 0.2) | (sizes > 0.5), 1, 1.0)
    assert largest == pytest.approx(0.2, rel=0.01)


def test_starts_are_off_by_a_factor_for_the_angle_and_for_each_leg(lab):
    gait = gpw.find_gait("lab", SLOPE)
    off = np.random.default_rng(0).uniform(0.5, 1.5, (64, 3))
    made = [walked({}, gait.state * each[[0, 0, 0, 1, 2, 2]], AFTER) for each in off]
    assert abs(lab.recovered - np.mean(np.array(made) == AFTER)) <= 1.0 / 64.0


def test_rough_ground_is_survived_as_long_as_walkers_are_left(lab):
    assert lab.survivors.shape == (10 + 40,) and lab.survivors[0] == 1.0
    assert (np.diff(lab.survivors) <= 0.0).all()
    fell = lab.survivors[9] - lab.survivors[-1]
    assert lab.first_passage.falls == round(500 * fell)
    smoother = robustness("lab", slope=SLOPE, roughness=0.001, walkers=500, strides=40, starts=2)
    assert smoother.first_passage.mean > 2.0 * lab.first_passage.mean


def test_a_controller_that_does_nothing_withstands_what_the_passive_walker_does():
    """A policy that keeps the hip idle is tried in the environment alone."""
    scene = {"walker": "lab", "slope": SLOPE, "end_on_toe_stub": False, "control": "stride"}
    nobody = robustness("lab", scene, walkers=600, strides=40, starts=64)
    idle = robustness(
        gpw.gaits.control.baselines.Passive(), scene, walkers=600, strides=40, starts=64
    )
    assert idle.step_down == pytest.approx(nobody.step_down, rel=1e-9)
    np.testing.assert_allclose(idle.period_response, nobody.period_response)
    one, other = idle.first_passage, nobody.first_passage
    assert abs(one.mean - other.mean) < 4.0 * math.hypot(one.error, other.error)


class FasterIfToldSo:
    """A controller that heeds the commanded speed, the last number that it observes."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """Torques (n, 1)."""
        return observation[:, -1:] - 0.15 + 0.2 * observation[:, :1], state


def test_walkers_are_tried_in_the_middle_of_what_a_scene_draws():
    """One command, slope and body: else two walkers differ by more than their disturbances."""
    middle = make_scene("lab", control="stride", command=0.15)
    drawn = {"slope": (0.035, 0.037), "command": (0.1, 0.2), "randomization_pool": 3}
    drawn["domain_randomization"] = {"foot_radius": 0.1}
    one, other = (
        robustness(FasterIfToldSo(), make_scene(middle, **each), walkers=2, strides=2, starts=2)
        for each in ({}, drawn)
    )
    np.testing.assert_allclose(other.period_response, one.period_response, rtol=1e-6, atol=1e-6)
    assert other.sensitivity == pytest.approx(one.sensitivity, rel=1e-9)


def test_a_passive_walker_may_be_in_a_scene_of_which_a_critic_sees_the_draws():
    few = {"walkers": 2, "strides": 2, "starts": 2}
    seen = {"observation": {"policy": "default", "critic": "randomized"}}
    drawn = make_scene("lab", domain_randomization={"foot_radius": 0.1}, **seen)
    one, other = (robustness("lab", scene, **few) for scene in ("lab", drawn))
    assert one.step_down == other.step_down > 0.0


def test_it_has_a_table_and_a_picture(lab, tmp_path):
    assert "gait sensitivity norm" in repr(lab)
    lab.to_csv(tmp_path / "pushes.csv")
    written = (tmp_path / "pushes.csv").read_text()
    assert written.startswith("push_phases,push_forward,push_backward")
    panels = lab.plot()
    assert len(panels) == 4
    bars = [bar.get_height() for bar in panels[1].patches]
    np.testing.assert_allclose(bars, lab.period_response[: len(bars)])
    forward, backward = panels[2].lines
    for line, sizes in ((forward, lab.push_forward), (backward, lab.push_backward)):
        np.testing.assert_allclose(line.get_xdata(), 100.0 * lab.push_phases)  # % of the period
        np.testing.assert_allclose(line.get_ydata(), sizes)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("lab",), "needs a slope"),
        (("C", None, {"slope": 1e-5}), "falls after"),
        ((3, "level"), "predict"),
        (("lab", None, {"slope": SLOPE, "initial_error": 2.0}), "initial_error"),
        (("lab", None, {"slope": SLOPE, "roughness": -1.0}), "roughness"),
        ((gpw.gaits.control.baselines.Passive(),), "in which scene"),
    ],
)
def test_nonsense_is_refused_in_words(arguments, said):
    *positional, named = (*arguments, {}) if not isinstance(arguments[-1], dict) else arguments
    with pytest.raises(ValueError, match=said):
        robustness(*positional, **named)


def test_what_is_put_in_the_way_needs_a_scene_that_has_it():
    envs = PassiveWalkerVectorEnv(2)
    envs.reset(seed=0)
    envs.batch.schedule_events()
    with pytest.raises(ValueError, match="terrain"):
        envs.batch.schedule_events(height_changes=0.01)
    with pytest.raises(ValueError, match="pushes"):
        envs.batch.schedule_events(impulses=[0.0, 0.01])


@pytest.mark.parametrize("threshold", [3e-4, 0.0123, 0.31, 0.987])
def test_the_largest_size_is_just_below_the_first_that_is_not_survived(threshold):
    """To a hundredth, never above it; and an island beyond it does not count."""
    for island in (0.0, 0.3 * threshold):

        def survived(sizes, beyond=2.2 * threshold, island=island):
            return (sizes < threshold) | ((sizes > beyond) & (sizes < beyond + island))

        found = _largest(survived, 2, 1.0)
        assert np.all(found <= threshold)
        np.testing.assert_allclose(found, threshold, rtol=0.01)


def test_the_largest_size_is_all_that_was_tried_or_nothing():
    np.testing.assert_array_equal(_largest(lambda x: x >= 0.0, 3, 0.5), 0.5)
    np.testing.assert_array_equal(_largest(lambda x: x < 0.0, 3, 0.5), 0.0)


@pytest.mark.parametrize(
    ("share", "strides"), [(0.05, 1), (0.2, 2), (0.4, 3), (0.5, 4), (0.9, 22), (1.0, np.inf)]
)
def test_recovery_is_the_number_of_strides_after_which_an_error_is_a_tenth(share, strides):
    """Of errors that shrink by the same share in each stride."""
    tries = _Tries(Passive(), make_scene("lab"))
    tries.gait = gpw.find_gait("lab", 0.036).state

    def walk(starts, count):
        errors = (starts - tries.gait)[:, None] * share ** np.arange(1, count + 1)[:, None]
        return SimpleNamespace(states=tries.gait + errors)

    tries.walk = walk
    assert tries.recovery(0) == strides


@pytest.mark.parametrize("short", [0, 1, 2])
def test_a_start_is_recovered_from_that_is_walked_on_for_all_strides(short):
    tries = _Tries(Passive(), make_scene("lab"))
    tries.gait = gpw.find_gait("lab", 0.036).state
    made = np.full(16, AFTER)
    made[:4] -= short
    tries.walk = lambda starts, strides: SimpleNamespace(made=made)
    assert tries.recovered(0.3, 16, 0)[0] == (1.0 if short == 0 else 0.75)


def test_ground_of_the_scene_that_is_random_is_walked_at_its_word():
    scene = make_scene("lab", terrain=gpw.rough(0.004))
    found, other = (
        gpw.robustness("lab", scene, roughness=r, walkers=300, strides=20, starts=2)
        for r in (0.001, 0.01)
    )
    assert found.roughness == other.roughness == 0.004
    np.testing.assert_array_equal(found.survivors, other.survivors)
