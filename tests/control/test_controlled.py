"""The stride map under a controller: as the environment walks, with the controller's derivative."""

import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.envs.evaluation.steps import steps
from gym_passive_walker.envs.policies import shipped_policies
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.gaits.control import ticks
from gym_passive_walker.gaits.control.baselines import LinearFeedback
from gym_passive_walker.gaits.control.controllers import with_changes
from gym_passive_walker.gaits.control.maps import acting_as, map_in
from gym_passive_walker.gaits.scenes.scene import make_scene
from tests.control.in_environment import walked
from tests.own.statements import DRIVEN

MEASURES = ("ends", "durations", "lengths", "lost", "supplied")
SINGLE = 2e-6  # what single precision of observations and actions comes to in a stride


def point_of(strides):
    """Where the walk under a controller has settled, (1, m)."""
    return strides.apply(strides.beginning(strides.slope), strides=100).ends


@pytest.fixture(scope="module", params=shipped_policies())
def strides(request):
    return gpw.stride_map(controller=request.param)


def test_a_stride_of_the_map_is_one_of_the_environment(strides):
    beside = point_of(strides) * (1.0 + 0.01 * np.random.default_rng(0).uniform(-1, 1, (5, 1)))
    seen = walked(strides, beside)
    passage = strides.apply(beside)
    assert passage.alive.any()
    np.testing.assert_allclose(passage.ends, seen.ends, atol=SINGLE)
    alive = passage.alive
    np.testing.assert_allclose(passage.lengths[alive], seen.length[alive], atol=SINGLE)
    np.testing.assert_allclose(passage.durations[alive], seen.duration[alive], atol=SINGLE)


def test_derivatives_are_those_of_the_network(strides):
    """By the start, the slope and a parameter, of ends and works; over two strides."""
    assert strides.exact
    point, slope, m = point_of(strides), strides.slope, strides.dimension
    by = ("state", "slope", "foot_radius")
    passage, change = strides.linearize(point, strides=2, by=by)
    radius = strides.walker.foot_radius

    def reported(shift):
        own = strides.with_parameter("foot_radius", np.array([radius + shift[-1]]))
        taken = own.apply(point + shift[:m], slope + shift[m], strides=2)
        rows = (taken.durations, taken.lengths, taken.lost, taken.supplied, taken.braked)
        return np.concatenate([taken.ends[0], *rows])

    widths = np.full(m + 2, 1e-7)
    widths[m] = 1e-8  # a network that has seen one slope alone turns sharply with it
    rows = (change.durations, change.lengths, change.lost, change.supplied, change.braked)
    exact = np.concatenate([change.ends[0], *rows])
    assert passage.alive.all()
    for j, way in enumerate(np.diag(widths)):
        difference = (reported(way) - reported(-way)) / (2.0 * widths[j])
        scale = 1.0 + np.abs(exact[:, j]).max()
        np.testing.assert_allclose(exact[:, j], difference, atol=1e-6 * scale, err_msg=str(j))


def test_the_energy_balance_closes_under_a_policy(strides):
    """What gravity and motors give, collisions take: on a gait both are the same."""
    point = strides.points_at(gpw.closed_loop_gait(strides.controller).state)
    passage = strides.apply(point)
    np.testing.assert_allclose(passage.ends, point, atol=1e-11)
    assert abs(passage.imbalance[0]) < 1e-10


def test_a_function_of_what_is_observed_is_a_controller():
    """Ten lines lead from a controller to its gait's multipliers, and these from the gait's own."""
    scene = {"walker": "lab", "slope": 0.036, "control": "stride", "max_hip_torque": 0.02}
    gait = gpw.find_gait("lab", 0.036)

    def brake(observation):
        return 40.0 * (observation[:, :1] - gait.stance_angle)

    free, held = (
        gpw.stride_map(controller=controller, scene=scene)
        for controller in (lambda seen: np.zeros((len(seen), 1)), brake)
    )
    point = free.points_at(gait.state)
    for strides in (free, held):
        np.testing.assert_allclose(strides.apply(point).ends, point, atol=1e-10)
    passive = gpw.stride_map("lab", 0.036).linearize(point)[1].ends
    np.testing.assert_allclose(free.linearize(point)[1].ends, passive, atol=1e-7)
    by_torque = gpw.stride_map("lab", 0.036).linearize(point, by=("hip_torque",))[1].ends[0]
    fed_back = passive[0] + 0.02 * 40.0 * by_torque * np.eye(4)[:1]
    np.testing.assert_allclose(held.linearize(point)[1].ends[0], fed_back, atol=1e-7)


class Observing:
    """A policy that is known by its actions alone."""

    def __init__(self, policy, scene):
        self.policy, self.scene = policy, scene

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """As the policy."""
        return self.policy.predict(observation, state, episode_start, deterministic)


def test_a_policy_without_a_derivative_is_differentiated_by_differences():
    policy = LinearFeedback("steep")
    exact = gpw.stride_map(controller=policy)
    strides = gpw.stride_map(controller=Observing(policy, "steep"))
    assert exact.exact and not strides.exact
    point, by = point_of(exact), ("shank_com", "state", "slope", "foot_radius")
    for count in (1, 2):
        _, change = strides.linearize(point, by=by, strides=count)
        _, expected = exact.linearize(point, by=by, strides=count)
        for name in ("ends", "durations", "lengths", "lost", "supplied"):
            scale = 1.0 + np.abs(getattr(expected, name)).max()
            np.testing.assert_allclose(
                getattr(change, name), getattr(expected, name), atol=5e-3 * scale, err_msg=name
            )
    np.testing.assert_allclose(exact.linearize(point)[1].ends[0], policy.closed_loop, atol=1e-8)
    with pytest.raises(ValueError, match="has no push_off"):
        exact.linearize(point, by=("push_off",))


def rounded(observation):
    return (0.1 * np.asarray(observation)[:, :1]).astype(np.float32), None


def test_differences_are_those_of_a_walker_a_thousand_times_smaller():
    """Lengths, masses and gravity: angles and torques over m g l are the same at all times."""
    walker, by = gpw.WALKERS["C"], ("thigh_mass", "shank_com", "gravity")
    names = {name for name in walker.parameters if name not in ("foot_angle", "knees")}
    small = replace(walker, **{name: 1e-3 * walker.parameters[name] for name in names})
    found = []
    for each in (walker, small):
        policy = SimpleNamespace(scene=None, predict=lambda seen, *_, **__: rounded(seen))
        strides = gpw.stride_map(each, 0.02, controller=policy)
        assert not strides.exact
        _, change = strides.linearize(strides.beginning(0.02), by=by)
        found.append(change.ends[0] * [each.parameters[name] for name in by])
    np.testing.assert_allclose(found[1], found[0], rtol=1e-4, atol=1e-7)
    assert np.abs(found[0][0, :2]).min() > 0.01


def test_walkers_of_a_batch_are_each_alone_and_falls_are_none():
    strides = gpw.stride_map(controller="steep-ppo")
    points = np.repeat(point_of(strides), 4, axis=0)
    points[1, 1] = -0.01  # too slow for the top
    points[2] *= 1.01
    points[3] = np.nan
    slopes = strides.slope + np.array([0.0, 0.0, -0.002, 0.0])
    passage, change = strides.linearize(points, slopes, strides=3)
    assert passage.alive.tolist() == [True, False, True, False]
    assert passage.outcomes[1] > gpw.Outcome.HEELSTRIKE
    assert np.isnan(passage.ends[[1, 3]]).all() and np.isnan(change.ends[[1, 3]]).all()
    for i in (0, 2):
        alone, by = strides.linearize(points[i : i + 1], slopes[i], strides=3)
        # But for the network's products of matrices, which round by the size of a batch.
        np.testing.assert_allclose(passage.ends[i], alone.ends[0], rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(change.ends[i], by.ends[0], rtol=1e-9, atol=1e-11)


class Fading:
    """A torque that fades with the control steps that its memory has counted, of each walker."""

    scene, double = "level", True

    def __init__(self):
        self.asked = []

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """A quarter of the torque's limit, less in each control step."""
        counted = np.zeros(len(observation)) if state is None else state
        self.asked.append(len(observation))
        return 0.25 * 0.9 ** counted[:, None], counted + 1.0


def beside(strides, count):
    """Points from which strides last for different times, (count, m)."""
    points = np.repeat(point_of(strides), count, axis=0)
    points[:, 1] *= np.linspace(0.95, 1.1, count)
    return points


def test_a_memory_is_kept_for_all_walkers_of_a_batch_until_the_last_stride_ends():
    policy = Fading()
    points = beside(gpw.stride_map(controller="level-ppo"), 4)
    strides = gpw.stride_map(controller=policy)
    together = strides.apply(points)
    durations = np.ceil(together.durations / strides.hold)
    assert together.alive.all() and len(np.unique(durations)) > 1
    assert set(policy.asked) == {4} and len(policy.asked) == durations.max()
    alone = [strides.apply(point[None]) for point in points]
    np.testing.assert_allclose(together.ends, [one.ends[0] for one in alone], rtol=1e-12)


def test_a_memory_is_of_the_walkers_that_are_followed_together(monkeypatch):
    strides = gpw.stride_map(controller=Fading())
    points = beside(gpw.stride_map(controller="level-ppo"), 4)
    expected = strides.apply(points).ends
    monkeypatch.setattr(ticks, "_TOGETHER", (3, 3))
    np.testing.assert_allclose(strides.apply(points).ends, expected, rtol=1e-12)


def test_no_walkers_make_no_strides():
    strides = gpw.stride_map(controller="level-ppo")
    assert strides.apply(np.empty((0, strides.dimension))).ends.shape == (0, strides.dimension)
    assert strides.stride(np.empty((0, 6)), strides.slope).state.shape == (0, 6)


def test_a_network_is_asked_only_for_walkers_that_are_still_in_their_stride(monkeypatch):
    points, asked = beside(gpw.stride_map(controller="level-ppo"), 5), []
    means = gpw.TrainedPolicy.mean_actions
    monkeypatch.setattr(
        gpw.TrainedPolicy, "mean_actions",
        lambda policy, seen: asked.append(len(seen)) or means(policy, seen),
    )  # fmt: skip
    strides = gpw.stride_map(controller="level-ppo")
    walks = strides.apply(points)
    steps_taken = np.ceil(walks.durations / strides.hold - 1e-9)
    number = np.arange(len(asked))
    np.testing.assert_array_equal(asked, (steps_taken[:, None] > number).sum(axis=0))
    assert asked[0] == 5 and asked[-1] < 5


def test_a_map_can_be_pickled_and_has_a_slope_of_its_own():
    strides = gpw.stride_map(controller="steep-ppo")
    again = pickle.loads(pickle.dumps(strides))
    point = point_of(strides)
    np.testing.assert_array_equal(again.apply(point).ends, strides.apply(point, 0.11).ends)
    assert strides.slope == 0.11 and gpw.stride_map(scene="lab").slope == 0.036
    with pytest.raises(ValueError, match="needs a walker, a scene, or a policy"):
        gpw.stride_map(slope=0.1)
    with pytest.raises(ValueError, match="no slope of its own"):
        gpw.stride_map("lab").apply(point)
    with pytest.raises(ValueError, match="a policy acts by predict"):
        gpw.stride_map(controller=3)


def test_walks_under_a_policy_have_a_bifurcation_diagram_and_exponents():
    """On a stable gait every stride is the same, and the exponent is that of its multiplier."""
    strides = gpw.stride_map(controller="steep-ppo")
    slopes = strides.slope + np.array([-0.002, 0.0])
    diagram = gpw.bifurcation_diagram(
        strides, slopes, n_transient=40, n_recorded=8, longest_period=4
    )
    assert diagram.period.tolist() == [1, 1]
    for i, slope in enumerate(slopes):
        gait = gpw.closed_loop_gait(strides.controller, slope=float(slope))
        assert diagram.stance_angle[i, -1] == pytest.approx(gait.stance_angle, abs=1e-6)
    exponent = gpw.lyapunov_exponents(strides, slopes[1:], strides=60, n_transient=40)
    expected = gpw.closed_loop_gait(strides.controller).multipliers
    assert exponent[0, 0] == pytest.approx(np.log(abs(expected[0])), abs=0.05)


def test_a_crisis_is_found_from_level_ground_on():
    strides = gpw.stride_map("D", 0.0, controller=Actuation(push_off=0.05))
    found = gpw.crisis(strides, 0.0, 0.1, strides=50, walkers=2, accuracy=1e-3)
    assert 0.0 < found < 0.1


@pytest.mark.parametrize("controller", [None, "lqr"])
def test_no_walkers_and_no_instants_have_no_samples(controller):
    strides = gpw.stride_map("lab", 0.036, controller=controller)
    point = strides.points_at(gpw.find_gait("lab", 0.036).state)
    for points, instants in ((point[:0], 3), (point, 0)):
        seen = strides.sample(points, 0.036, np.zeros((len(points), instants)))
        assert seen.states.shape == (len(points), instants, 6)
        assert seen.controls.shape == (len(points), instants, 3)


@pytest.mark.parametrize("name", ["level-ppo", "rolling-ppo", "push-off-ppo"])
def test_samples_and_ledgers_are_of_the_stride_that_the_map_takes(name):
    """Inside a stride and at its end, alone and in a batch."""
    strides = gpw.stride_map(controller=name)
    points = point_of(strides) * np.array([[1.0], [1.003]])
    passage, walk = strides.apply(points), strides.stride(strides.states_at(points))
    np.testing.assert_allclose(walk.state, strides.states_at(passage.ends), rtol=1e-12)
    units = strides.units
    np.testing.assert_allclose(walk.duration, passage.durations * units.time, rtol=1e-12)
    lost = (walk.collision_loss + walk.friction_loss) / units.energy
    np.testing.assert_allclose(lost, passage.lost, rtol=1e-12)
    given = walk.gravity_work + walk.hip_work + walk.ankle_work + walk.push_off_work
    states = strides.states_at(np.concatenate([points, passage.ends]))
    alone = strides.stride(states[0])
    assert alone.hip_work_absolute == pytest.approx(walk.hip_work_absolute[0], rel=1e-12)
    assert np.all(np.abs(given - walk.collision_loss) < 0.1 * walk.collision_loss)
    times = np.array([[0.0, 0.7, 1.3, 1.3000001, 99.0]]) * np.ones((2, 1))
    seen = strides.sample(points, strides.slope, times)
    np.testing.assert_array_equal(seen.states[:, 0], strides.state(points))
    np.testing.assert_allclose(seen.states[:, 4], strides.state(passage.ends), rtol=1e-12)
    rates = (seen.states[:, 3, :3] - seen.states[:, 2, :3]) / 1e-7
    np.testing.assert_allclose(rates, seen.states[:, 2, 3:], atol=1e-5)
    verge = strides.before_strike(points[0], strides.slope, float(passage.durations[0]))
    assert verge[0] + verge[1] == pytest.approx(0.0, abs=1e-9)  # feet side by side on the ground


def test_a_stride_of_a_map_on_other_ground_is_that_of_the_walker():
    held = gpw.Actuation(hip_torque=0.1)
    scene = {"walker": "lab", "slope": 0.036, "control": "stride"}
    gait = gpw.find_gait(gpw.stride_map("lab", 0.036, controller=held))
    torque = 0.1 / gait.stride_map.units.torque

    def push(seen):
        return np.full((len(seen), 1), torque / 0.03)

    controlled = gpw.stride_map(controller=push, scene=scene)
    foothold = {"height_change": -0.004, "slope_change": 0.01}
    known = gpw.stride(gait, **foothold, tolerance=1e-12)
    walk = gpw.stride(controlled, state=gait.state, **foothold, tolerance=1e-12)
    for name in ("state", "duration", "step_length", "hip_work", "heelstrike_loss"):
        np.testing.assert_allclose(getattr(walk, name), getattr(known, name), rtol=1e-11)
    ground = gpw.rough(height_std=0.002, slope_std=0.005)
    walks = [
        gpw.simulate(form, state=gait.state, strides=4, terrain=ground, terrain_seed=5)
        for form in (gait, controlled)
    ]
    np.testing.assert_allclose(walks[0].states, walks[1].states, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(walks[0].torques, walks[1].torques, rtol=1e-12)
    with pytest.raises(ValueError, match="push works these motors"):
        gpw.stride(controlled, state=gait.state, hip_torque=0.1)


STAIRS = {
    "stairs down": ("lab", 0.02, gpw.stairs(-0.004)),
    "stairs up": ("C", 0.05, gpw.stairs(0.002)),
    "waves": ("lab", 0.036, gpw.waves(0.002, 3)),
    "slopes by turns": ("A", 0.03, gpw.Terrain(rises=(0.001, -0.001), slopes=(0.0, 0.004))),
}


@pytest.mark.parametrize("name", STAIRS)
@pytest.mark.parametrize("controller", [None, Actuation(hip_torque=0.02)])
def test_a_gait_on_steps_repeats_as_its_ground_does_and_its_energy_balance_closes(name, controller):
    """Stride by stride on each foothold, as `gpw.stride` takes them."""
    walker, slope, ground = STAIRS[name]
    strides = gpw.stride_map(walker, slope, controller=controller, terrain=ground)
    gait = gpw.find_gait(strides)
    assert gait.violation < 1e-12
    units, state = gait.stride_map.units, gait.state
    held = controller or Actuation()
    for tilt, rise, turn in ground.ground(0, np.arange(len(ground.rises))).tolist():
        foothold = {"height_change": rise * units.length, "slope_change": turn}
        walk = gpw.stride(
            walker, slope + tilt, state, **foothold, **held._asdict(), tolerance=1e-13
        )
        state = walk.state
    np.testing.assert_allclose(state, gait.state, rtol=1e-10, atol=1e-12)
    spent = gait.cycle.gravity_work + gait.cycle.hip_work
    assert sum(spent) == pytest.approx(sum(gait.cycle.collision_loss), rel=1e-10)
    passage = strides.apply(strides.points_at(gait.state), strides=2)
    assert abs(passage.imbalance[0]) < 1e-10
    assert gpw.simulate(gait, strides=3 * len(ground.rises)).ending == "heelstrike"


@pytest.mark.parametrize("name", STAIRS)
@pytest.mark.parametrize("controller", ["nothing", "policy"])
def test_derivatives_on_steps_are_those_of_differences(name, controller):
    """By the point, with the rear leg on the previous foothold; by the slope; and by a length."""
    walker, slope, ground = STAIRS[name]
    scene = {"walker": walker, "slope": slope, "control": "stride", "max_hip_torque": 0.01}
    controlled = {"controller": lambda seen: np.zeros((len(seen), 1)), "scene": scene}
    strides = gpw.stride_map(walker, slope, terrain=ground)
    if controller == "policy":
        feedback = LinearFeedback(scene)
        strides = gpw.stride_map(controller=feedback, scene=scene, terrain=ground)
        zero = gpw.stride_map(**controlled, terrain=ground)
        assert not zero.exact and strides.exact
    point = strides.points_at(gpw.find_gait(gpw.stride_map(walker, slope, terrain=ground)).state)
    by, m = ("foot_radius", "state", "slope"), strides.dimension
    _, change = strides.linearize(point, by=by, strides=2)
    radius = strides.walker.foot_radius

    def reported(shift):
        own = strides.with_parameter("foot_radius", np.array([radius + shift[0]]))
        taken = own.apply(point + shift[1 : m + 1], slope + shift[m + 1], strides=2)
        return np.concatenate([taken.ends[0], taken.durations, taken.lost, taken.supplied])

    exact = np.concatenate([change.ends[0], change.durations, change.lost, change.supplied])
    for j, way in enumerate(1e-6 * np.eye(m + 2)):
        difference = (reported(way) - reported(-way)) / 2e-6
        scale = 1.0 + np.abs(exact[:, j]).max()
        np.testing.assert_allclose(exact[:, j], difference, atol=2e-6 * scale, err_msg=str(j))


def test_ground_that_does_not_repeat_has_no_stride_map():
    for ground in (gpw.rough(0.001), gpw.footholds([0.0, 0.01], [0.0, 0.0])):
        with pytest.raises(ValueError, match="ground that repeats"):
            gpw.stride_map("lab", 0.03, terrain=ground)
    strides = gpw.stride_map("lab", 0.03, terrain=gpw.stairs(-0.001))
    with pytest.raises(ValueError, match="smooth ground"):
        gpw.reality_check(gpw.find_gait(strides))
    with pytest.raises(ValueError, match="smooth ground"):
        gpw.robustness(strides)


def test_stairs_down_carry_a_passive_walker_over_the_level():
    """A step down of h each L is a slope of h / L, but for the feet that stand at two heights."""
    ground = gpw.stairs(-0.01)
    gait = gpw.find_gait(gpw.stride_map("C", 0.0, terrain=ground))
    alike = gpw.find_gait("C", 0.01 * gait.stride_map.units.length / gait.step_length)
    assert gait.stance_angle == pytest.approx(alike.stance_angle, rel=0.2)
    family = gpw.gait_family(gpw.stride_map("C", terrain=ground), -0.005, 0.005)
    assert family.slope.min() == -0.005 and family.slope.max() == 0.005


def test_a_policy_s_gaits_come_in_pieces_that_do_not_depend_on_where_they_were_begun():
    """Where the knee locks as a control step ends, what the policy observes jumps."""
    strides = gpw.stride_map(controller="rolling-ppo")
    families = [
        gpw.gait_family(
            strides, 0.028, 0.036, start=gpw.find_gait(strides, slope), resolution=resolution
        )
        for slope, resolution in ((0.029, 0.02), (0.030, 0.011))
    ]
    edge = families[0].ends[1]
    assert edge.reason == "a strike comes as a control step ends"
    assert families[1].ends[1].value == pytest.approx(edge.value, abs=1e-7)
    last = strides.stride(families[0].state[-1], edge.value)
    steps = float(last.kneestrike_time) / strides.units.time / strides.hold
    assert steps == pytest.approx(round(steps), abs=1e-3)


@pytest.mark.parametrize(("action", "least"), [("push_off", 0.0), ("hip", -1.0), ("ankle", -1.0)])
def test_actions_beyond_their_bounds_are_clipped_as_in_the_environment(action, least):
    scene = make_scene(walker="E", slope=0.009, actions=(action,))
    state = gpw.find_gait("E", 0.009).state

    def walked(value):
        strides = gpw.stride_map(
            controller=lambda seen: np.full((len(seen), 1), value), scene=scene
        )
        return strides.stride(state).state

    for value in (-3.0, -0.1, 2.0):
        np.testing.assert_array_equal(walked(value), walked(np.clip(value, least, 1.0)))
    assert np.abs(walked(0.1) - walked(0.0)).max() > 1e-6


def test_a_controller_sees_its_command_and_the_footholds_ahead_each_in_its_place():
    scene, ground = make_scene("rough", command=0.2, terrain_lookahead=2), gpw.waves(0.002, 3)
    reported = []

    def watch(seen):
        reported.append(seen[0].copy())
        return np.zeros((len(seen), 1))

    strides = gpw.stride_map(controller=watch, scene=scene, terrain=ground)
    strides.stride(gpw.find_gait(scene.walker, scene.slope).state)
    env = PassiveWalkerVectorEnv(1, make_scene(scene, terrain=ground))
    expected, _ = env.reset(seed=0)
    assert reported[0].shape == expected[0].shape == (13,)
    for seen in reported:
        np.testing.assert_allclose(seen[8:], expected[0, 8:], rtol=1e-6)


def in_environment(policy, scene, state, count):
    """States after each stride of one walker in the environment, (count, 6)."""
    envs, ends = PassiveWalkerVectorEnv(1, scene, max_episode_steps=-1), []
    seen, _ = envs.reset(seed=0, options={"state": state[None], "slope": scene.slope})
    for step in steps(policy, envs, seen):
        assert not step.terminated[0]
        if step.struck[0]:
            ends.append(envs.states[0].copy())
            if len(ends) == count:
                return np.array(ends)
    raise AssertionError("steps ended by themselves")


@pytest.mark.parametrize("drive", [(-0.001, 0.0, 0.0), (0.002, -0.001, 0.01), (0.0, 0.002, 0.02)])
def test_motors_that_do_the_same_in_each_stride_act_alike_as_a_policy(drive):
    """As `robustness` has them act; also those that brake."""
    units = gpw.WALKERS["E"].units
    held = np.multiply(drive, [units.torque, units.energy, units.impulse])
    strides = gpw.stride_map("E", 0.009, controller=gpw.Actuation(*held))
    state = gpw.find_gait("E", 0.009).state
    policy, scene = acting_as(strides, 0.009)
    walk = [stride.state for stride in strides.walk(state, 0.009, count=2)]
    found = in_environment(policy, make_scene(scene, tolerance=1e-10), state, 2)
    np.testing.assert_allclose(found, walk, atol=1e-6)
    acted = gpw.stride_map(controller=policy, scene=scene)
    points = strides.points_at(state) * [[1.0], [1.01]]
    expected, passage = (each.apply(points, 0.009) for each in (strides, acted))
    for name in (*MEASURES, "braked", "imbalance"):
        seen, own = getattr(passage, name), getattr(expected, name)
        np.testing.assert_allclose(seen, own, rtol=1e-6, atol=1e-8, err_msg=name)


@pytest.fixture(scope="module")
def seeing():
    """A policy that sees the footholds ahead, and a state to start from."""
    policy = gpw.load_policy("rough-ppo")
    return policy, gpw.find_gait(policy.scene.walker, policy.scene.slope).state


def test_a_policy_that_sees_the_ground_ahead_is_shown_it(seeing):
    """On a list of footholds and over stairs, as in the environment."""
    policy, state = seeing
    scene = policy.scene
    rough = gpw.footholds(0.003 * np.random.default_rng(3).normal(size=8))
    strides = gpw.stride_map(controller=policy)
    walk = gpw.simulate(strides, state=state, strides=7, samples=20, terrain=rough)
    expected = in_environment(policy, make_scene(scene, terrain=rough), state, 7)
    np.testing.assert_allclose(walk.states[20::20], expected[:-1], atol=1e-6)
    blind = strides.stride(state, height_change=0.003, ahead=np.zeros(4)).state
    assert (
        np.abs(strides.stride(state, height_change=0.003, ahead=np.ones(4)).state - blind).max()
        > 1e-3
    )

    stairs = gpw.stairs(0.002)
    climbing = gpw.stride_map(controller=policy, terrain=stairs)
    begun = strides.stride(state).state  # such as stands on a step is not known before
    ends = in_environment(policy, make_scene(scene, terrain=stairs), begun, 3)
    np.testing.assert_allclose(
        [stride.state for stride in climbing.walk(begun, scene.slope, count=3)], ends, atol=1e-6
    )


@pytest.mark.parametrize("terrain", [gpw.stairs(0.002), gpw.waves(0.002, 3)])
def test_on_ground_that_repeats_a_policy_sees_what_lies_ahead_of_each_foothold(terrain, seeing):
    """Also of the last ones, ahead of which the first come again."""
    policy, state = seeing
    scene = policy.scene
    strides = gpw.stride_map(controller=policy, terrain=terrain)
    point = strides.points_at(state)
    begun = strides.states_at(point)[0]
    walk = [stride.state for stride in strides.walk(begun, scene.slope, count=2)]
    ends = in_environment(policy, make_scene(scene, terrain=terrain), begun, len(walk))
    np.testing.assert_allclose(walk, ends, atol=1e-6)
    end = strides.apply(point, strides=2).ends
    np.testing.assert_allclose(strides.states_at(end)[0], walk[-1], atol=1e-6)


@pytest.mark.parametrize("controller", [None, "rough-ppo"])
def test_a_stride_of_a_map_with_terrain_is_over_its_footholds(controller, seeing):
    """Given or not, the foothold is where the terrain has it, and so does the strike come."""
    policy, state = seeing
    scene, rise = policy.scene, 0.002
    walker = scene.walker
    strides = gpw.stride_map(walker, scene.slope, controller=controller, terrain=gpw.stairs(rise))
    tilt, own, turn = strides.ground[0]
    over = {"height_change": own * walker.leg_length, "slope_change": turn}
    first = strides.walk(state, scene.slope, count=1)[0]
    for other in (
        strides.stride(state),
        gpw.stride(strides, None, state),
        strides.stride(state, scene.slope + tilt, **over),
    ):
        np.testing.assert_allclose(other.state, first.state, atol=1e-9)
    assert np.abs(strides.stride(state, slope_change=0.0).state - first.state).max() > 1e-4
    point, strike = strides.points_at(state), first.duration / walker.units.time
    before = strides.before_strike(point[0], scene.slope, strike)
    late = strides.sample(point, scene.slope, np.array([[strike * (1.0 - 1e-9)]]))
    np.testing.assert_allclose(before, late.states[0, 0], atol=1e-6)


def test_a_level_step_that_is_given_replaces_that_of_a_map_s_terrain():
    state = gpw.find_gait("lab", 0.036).state
    stairs = gpw.stride_map("lab", 0.036, terrain=gpw.stairs(-0.01))
    level = gpw.stride("lab", 0.036, state)
    for given in ({"height_change": 0.0}, {"slope_change": 0.0}):
        assert gpw.stride(stairs, state=state, **given).duration == level.duration
    assert gpw.stride(stairs, state=state).duration > level.duration


def test_controllers_of_walkers_that_differ_observe_each_one_s_own_body():
    strides = gpw.stride_map(controller="anywhere-ppo")
    walker, point = strides.walker, strides.beginning(strides.slope)[:1]
    assert "shank_mass" in strides.scene.observe_body
    masses = walker.shank_mass * (1.0 + np.array([-1e-6, 0.0, 1e-6]))
    each = strides.with_parameter("shank_mass", masses)
    points, asked = np.repeat(point, 3, axis=0), {"by": ("state", "shank_mass")}
    found, change = each.linearize(points, **asked)
    for i, mass in enumerate(masses):
        alone = strides.with_walker(walker.with_parameters(shank_mass=mass))
        np.testing.assert_allclose(found.ends[i], alone.apply(point).ends[0], rtol=1e-10)
    by_mass = (found.ends[2] - found.ends[0]) / (masses[2] - masses[0])
    np.testing.assert_allclose(change.ends[1, :, -1], by_mass, rtol=1e-5, atol=1e-7)


def test_a_map_keeps_its_own_rules(seeing):
    strides = gpw.stride_map(controller=seeing[0])
    for given in ({"max_stride_time": 3.0}, {"end_on_toe_stub": True}):
        with pytest.raises(ValueError, match="leave max_stride_time, end_on_toe_stub"):
            gpw.stride(strides, None, seeing[1], **given)


def test_a_controller_that_never_acts_is_the_passive_walker():
    """Also from where the shank is faster than the thigh, which bends the knee backwards."""
    passive = gpw.stride_map("C", 0.03)
    idle = gpw.stride_map("C", 0.03, controller=lambda seen: np.zeros((len(seen), 1)))
    points = np.repeat(passive.points_at(gpw.find_gait(passive).state), 4, axis=0)
    points[:, 3] = points[:, 2] * [1.1, 1.0, 0.98, 0.9]
    expected, passage = passive.apply(points), idle.apply(points)
    assert expected.alive.all()
    np.testing.assert_array_equal(passage.outcomes, expected.outcomes)
    for name in (*MEASURES, "imbalance"):
        np.testing.assert_allclose(getattr(passage, name), getattr(expected, name), atol=1e-9)


def test_a_search_for_a_gait_begins_on_both_sides_of_the_start_of_walks():
    strides = gpw.stride_map(controller="lqr", scene="level")
    begun = strides.beginning(0.0)[0]
    beside = strides.likely(0.0)[-15:] / begun - 1.0
    assert np.all(beside.min(axis=0) < -0.02) and np.all(beside.max(axis=0) > 0.02)
    assert np.abs(beside).max() <= 0.1
    held = strides.controller.point
    assert (strides.likely(0.0) == held).all(axis=1).any() and not np.allclose(held, begun)


@pytest.mark.parametrize("point", [np.full(4, 0.25), ["a"] * 4, None])
def test_what_a_user_s_controller_calls_a_point_is_not_taken_for_a_gait(point):
    given = gpw.load_policy("level-ppo")
    mine = SimpleNamespace(predict=given.predict, point=point)
    usual, found = (gpw.stride_map(controller=x, scene="level").likely(0.0)
                    for x in (SimpleNamespace(predict=given.predict), mine))  # fmt: skip
    np.testing.assert_array_equal(found, usual)


@pytest.mark.parametrize("knees", [True, "held"])
def test_a_passive_map_of_a_scene_has_its_rule_of_toe_stubs(knees):
    walker = replace(gpw.WALKERS["lab"], knees=knees)
    for rule in (True, False):
        scene = make_scene(walker=walker, slope=0.036, end_on_toe_stub=rule)
        assert map_in(scene, None).walkers.end_on_toe_stub is rule


def test_another_walker_has_its_own_rule_of_toe_stubs_unless_one_is_given():
    level = make_scene("level")
    assert level.end_on_toe_stub
    for other in ({"walker": "A"}, {"system": DRIVEN}):
        assert not with_changes(level, other).end_on_toe_stub
    changes = {"walker": "lab", "end_on_toe_stub": False}
    assert not with_changes(level, changes).end_on_toe_stub
