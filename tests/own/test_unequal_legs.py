"""Walkers with unequal legs: two strides are one application of their map.

Numbers are those of an independent program, by Lagrange's equations and in maximal coordinates.
"""

import math
import pickle
from dataclasses import replace
from functools import cache

import gymnasium as gym
import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp

import gym_passive_walker as gpw
import gym_passive_walker.torch as walks
from examples.unequal_legs import PROSTHESIS, UNEQUAL_LEGS
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.modeling import StatementError
from gym_passive_walker.models.equations import hybrid
from tests.own.oracle import Independent

SLOPE = math.radians(3.0)
CLOSE = 1e-10

STABLE = {
    "mass": (-0.0754335193690509, 0.0789546713179437),
    "length": (-0.0014136884692348, 0.0014116927754362),
}
"""Asymmetries between which the gait at 3 degrees is stable."""

FOLDS = {
    "mass": (-0.6156682514379808, 0.8271441282799249),
    "length": (-0.0138718656741131, 0.0136820698391603),
}
"""Asymmetries beyond which there is no gait at 3 degrees."""

LOWEST = 0.06854866892407
"""Slope in rad from which on there are gaits with a leg shorter by 2 %."""

DOUBLING = 0.076635631575613
SECOND = math.radians(4.914057)
"""Slopes in rad at which the period of equal legs doubles, and doubles again."""


def asymmetry(kind, value):
    """The mass of leg 2 is 5 (1 + e), or its length 1 - e."""
    return value / 5.0 - 1.0 if kind == "mass" else 1.0 - value


def family(kind, e, slope=SLOPE, **rest):
    """The gaits of a range of asymmetries."""
    ends = sorted((5.0 * (1.0 + x) if kind == "mass" else 1.0 - x) for x in e)
    return gpw.parameter_family(UNEQUAL_LEGS, f"swing_{kind}", *ends, slope=slope, **rest)


def leg_2(**parameters):
    return UNEQUAL_LEGS.vary(**{f"swing_{name}": value for name, value in parameters.items()})


def short_by(e):
    """The walker with a leg 2 that is shorter by a share, without checks, which take long."""
    return UNEQUAL_LEGS.with_body({"swing_length": 1.0 - e})


@pytest.mark.parametrize(("kind", "e"), [("mass", (-0.8, 1.0)), ("length", (-0.02, 0.02))])
def test_gaits_over_an_asymmetry_are_a_closed_curve(kind, e):
    """Long steps, a fold, short steps, a fold."""
    found = family(kind, e)
    folds = np.sort([asymmetry(kind, value) for value in found.folds])
    np.testing.assert_allclose(folds, FOLDS[kind], atol=CLOSE)
    flips = np.array([asymmetry(kind, value) for value in found.period_doublings])
    for end in STABLE[kind]:
        assert np.abs(flips - end).min() < CLOSE
    values = asymmetry(kind, found.value)
    inside = (STABLE[kind][0] < values) & (values < STABLE[kind][1])
    short = np.zeros(len(found), bool)  # the part between the folds that the start is not on
    short[slice(*sorted((np.argmin(values), np.argmax(values))))] = True
    assert found.stable[inside & ~short].all() and not found.stable[inside & short].any()
    np.testing.assert_array_equal(found.state[0], found.state[-1])
    assert "the curve is closed" in str(found) and {end.value for end in found.ends} == {
        UNEQUAL_LEGS.parameters[f"swing_{kind}"]
    }


def test_each_asymmetry_of_a_closed_curve_has_two_gaits():
    found = family("length", (-0.02, 0.02))
    for length in (0.99, 1.0, 1.01):
        long, short = sorted(found.at(length), key=lambda gait: gait.multipliers[0].real < 0.0)
        assert {len(gait.cycle.duration) for gait in (long, short)} == {2}
        assert np.abs(long.state - short.state).max() > 0.01
    reach = r"from 0\.986317930161 \(a fold\) to 1\.01387186567 \(a fold\)"
    with pytest.raises(gpw.GaitNotFound, match=reach):
        found.at(0.98)


def test_a_function_of_the_asymmetry_doubles_the_period_where_the_parameter_does():
    shorter = cache(lambda e: gpw.stride_map(short_by(e), SLOPE))
    found = gpw.parameter_family(shorter, "e", 0.0, 0.0016, resolution=0.5)
    assert found.period_doublings == pytest.approx(STABLE["length"][1:], abs=CLOSE)
    assert found.step_length[0] == pytest.approx(gpw.find_gait(UNEQUAL_LEGS, SLOPE).step_length)


def test_a_leg_too_short_for_a_slope_has_gaits_from_a_fold_on():
    short = leg_2(length=0.98)
    assert gpw.gait_family(short, 0.05, 0.12).folds == pytest.approx((LOWEST,), abs=CLOSE)
    with pytest.raises(
        gpw.GaitNotFound, match=r"the nearest slope with one is 0\.068549 rad, at a fold$"
    ):
        gpw.find_gait(short, SLOPE)
    assert gpw.nearest_gait(short, SLOPE).slope == pytest.approx(LOWEST, rel=1e-5)
    with pytest.raises(ValueError, match="McGeer's parameters"):
        gpw.nearest_gait(short, SLOPE, keep="slope")


def test_a_family_ends_where_the_foot_grazes_the_ground():
    found = family("length", (-0.1, 0.1), slope=0.15)
    assert {end.reason for end in found.ends} == {"heelstrike becomes tangential"}
    least, greatest = sorted(end.value for end in found.ends)
    assert 0.9438 < least < 0.9440 and 1.0594 < greatest < 1.0596
    assert least < min(found.folds) and max(found.folds) < greatest  # at no fold


def test_asymmetry_unfolds_the_period_doubling_of_equal_legs():
    """One branch passes it, another begins at a fold at a distance that grows as e^(2/3).

    The second doubling of equal legs becomes a flip of each branch.
    """
    distances = []
    for e in (0.0004, 0.0032):
        legs = leg_2(mass=5.0 * (1.0 + e))
        whole, apart = (
            gpw.gait_family(legs, 0.074, 0.09, start=gait, resolution=0.01)
            for gait in sorted(gpw.find_gaits(legs, 0.083), key=lambda gait: -gait.stance_angle)
            if gait.stable
        )
        assert whole.folds == () and whole.period_doublings[0] < SECOND < apart.period_doublings[0]
        (fold,) = apart.folds
        assert apart.stable.any() and not apart.stable.all()
        distances.append(fold - DOUBLING)
    assert distances[1] / distances[0] == pytest.approx(8.0 ** (2.0 / 3.0), rel=0.01)


def test_the_map_of_equal_legs_is_that_of_one_leg_twice():
    """Bit for bit, with derivatives, sums and outcomes."""
    alike = replace(UNEQUAL_LEGS, exchange={})
    gait = gpw.find_gait(UNEQUAL_LEGS, SLOPE)
    points = gait.point.values + np.random.default_rng(0).normal(0.0, 0.02, (60, 4))
    twice = gpw.stride_map(alike, SLOPE).linearize(points, strides=2)
    once = gpw.stride_map(UNEQUAL_LEGS, SLOPE).linearize(points)
    for first, second in zip(twice, once, strict=True):
        for name, values in vars(first).items():
            np.testing.assert_array_equal(values, getattr(second, name), err_msg=name)
    assert 0 < np.isfinite(twice[0].lengths).sum() < 60
    of_one = gpw.find_gait(alike, SLOPE).multipliers
    squares = np.sort_complex(of_one**2)
    np.testing.assert_allclose(np.sort_complex(gait.multipliers), squares, atol=1e-9)


def independent_stride(system, slope, state):
    """The state after the first fall of the foot's height that counts, and its time."""
    other = Independent(system, slope)

    def height(_, y):
        return other._foot(*y)[1]

    height.direction = -1.0
    walk = solve_ivp(
        lambda _, y: np.concatenate([y[2:], other.accelerations(y)]), (0.0, 4.0), state,
        method="DOP853", rtol=1e-12, atol=1e-13, events=height, max_step=0.02,
    )  # fmt: skip
    strikes = zip(walk.t_events[0], walk.y_events[0], strict=True)
    time, before = next((t, y) for t, y in strikes if y[0] < 0.0 < y[1])
    return other.strike(before)[0], time


@pytest.mark.parametrize("legs", [{"mass": 6.0}, {"length": 0.99}, {"centre": 0.45}])
def test_each_stride_is_that_of_an_independent_derivation(legs):
    """The foot passes through the ground where legs pass each other, and strikes in front."""
    system = leg_2(**legs)
    gait = gpw.find_gait(system, 0.07)
    here, times = gait.state, []
    for number in (0, 1):
        own = system.in_stride(number)
        here, time = independent_stride(own, 0.07, here)
        times.append(time)
        l1, l2 = own.body.swing_length, own.body.stance_length
        trailing = -math.acos(l1 * math.cos(here[0]) / l2)
        assert here[1] == pytest.approx(trailing, abs=1e-9)
        np.testing.assert_allclose(here, gait.cycle.state[number], atol=1e-9)
    np.testing.assert_allclose(here, gait.state, atol=1e-9)
    np.testing.assert_allclose(times, gait.cycle.duration, atol=1e-9)
    walk = gpw.simulate(gait, strides=2, samples=200)
    feet = zip(walk.stride_index.tolist(), walk.states, strict=True)
    heights = np.array([system.in_stride(k).drawn(state)[0][-1][1] for k, state in feet])
    heights = heights.reshape(2, 200)
    np.testing.assert_allclose(heights[:, [0, -1]], 0.0, atol=1e-8)
    assert heights[:, 20:-20].min() < 0.0 < heights[:, 20:-20].max()


def test_energies_and_forces_over_time_are_those_of_the_leg_that_stands():
    """Passive strides keep their energy, and the force of the ground moves the centre of mass."""
    gait = gpw.find_gait(leg_2(mass=6.0), 0.07)
    walk = gpw.simulate(gait, strides=4, samples=400, tolerance=1e-13)
    energy = walk.mechanical_energy.reshape(4, 400)
    np.testing.assert_allclose(energy - energy[:, :1], 0.0, atol=1e-11)
    loss = energy[:-1, -1] - energy[1:, 0]
    lost = walk.strikes.loss
    np.testing.assert_allclose(loss, lost[:3], rtol=1e-8)
    assert lost[0] != pytest.approx(lost[1], rel=1e-2) and lost[0] == pytest.approx(lost[2])
    velocity = walk.com_velocity_y.reshape(4, 400)
    times = walk.times.reshape(4, 400)
    force = walk.normal_force.reshape(4, 400) - 21.0 * math.cos(0.07)
    gained = np.trapezoid(force, times, axis=1)
    np.testing.assert_allclose(gained, 21.0 * (velocity[:, -1] - velocity[:, 0]), atol=1e-4)
    jumps = 21.0 * (velocity[1:, 0] - velocity[:-1, -1])
    np.testing.assert_allclose(walk.strikes.normal_impulse[:3], jumps, atol=1e-7)


def test_derivatives_by_a_parameter_of_one_leg_are_those_of_differences():
    strides = gpw.stride_map(leg_2(length=0.999), SLOPE)
    point = gpw.find_gait(strides).point.values
    names = ("swing_length", "stance_mass", "hip", "slope")
    _, by = strides.linearize(point, by=names)
    for column, name in enumerate(names):
        shift = 1e-5

        def end(sign, name=name, shift=shift):
            if name == "slope":
                return strides.apply(point, SLOPE + sign * shift).ends[0]
            value = strides.walker.parameters[name] + sign * shift
            other = strides.walker.vary(**{name: value})
            return gpw.stride_map(other, SLOPE).apply(point).ends[0]

        expected = (end(1.0) - end(-1.0)) / (2.0 * shift)
        np.testing.assert_allclose(by.ends[0, :, column], expected, rtol=1e-5, atol=1e-6)


def test_derivatives_go_on_behind_a_crossing_that_does_not_count():
    """Legs that pass each other near the normal cross the ground where the conditions change."""
    legs = leg_2(mass=9.0)
    point = gpw.find_gait(legs, SLOPE).point.values
    strides = gpw.stride_map(legs, SLOPE)
    expected = strides.with_tolerance(1e-12).linearize(point)[1].ends
    for tolerance in np.geomspace(1e-14, 1e-10, 25):
        found = strides.with_tolerance(tolerance).linearize(point)[1].ends
        np.testing.assert_allclose(found, expected, atol=1e-7)


def pull(seen):
    """A torque by the state."""
    return 0.01 * (seen[:, :1] - 0.1) - 0.01 * seen[:, 3:4]


def test_a_controller_acts_on_both_legs():
    strides = gpw.stride_map(PROSTHESIS, SLOPE, controller=pull)
    found = gpw.find_gait(strides, guess=gpw.find_gait(PROSTHESIS, SLOPE).state)
    assert found.violation < 1e-9 and len(found.cycle.duration) == 2
    assert found.cycle.step_length[0] != pytest.approx(found.cycle.step_length[1], rel=1e-3)
    env = gym.make("PassiveWalker-v0", scene=strides.scene, tolerance=1e-12).unwrapped
    seen, _ = env.reset(options={"state": found.state})
    lengths = []
    while len(lengths) < 4:
        seen, *_, info = env.step(pull(seen[None].astype(float))[0])
        lengths += [info["step_length"]] * bool(info["step_length"])
    np.testing.assert_allclose(lengths, [*found.cycle.step_length] * 2, rtol=1e-5)
    walk = gpw.simulate(found, strides=4)
    np.testing.assert_allclose(walk.taken.step_length, [*found.cycle.step_length] * 2, rtol=1e-9)


def test_a_controller_observes_the_legs_in_the_order_of_the_first_stride():
    """As agents of the environment do."""

    def by_mass(seen):
        return 0.01 * (seen[:, -1:] - 5.1) - 0.01 * seen[:, 3:4]

    scene = make_scene(system=PROSTHESIS, slope=SLOPE, observe_body=("swing_mass",))
    strides = gpw.stride_map(controller=by_mass, scene=scene)
    start = gpw.find_gait(PROSTHESIS, SLOPE).state
    env = gym.make("PassiveWalker-v0", scene=scene, tolerance=1e-12).unwrapped
    (seen, _), lengths = env.reset(options={"state": start}), []
    while len(lengths) < 4:
        seen, *_, info = env.step(by_mass(seen[None].astype(float))[0])
        lengths += [info["step_length"]] * bool(info["step_length"])
    walk = strides.walk(start, SLOPE, 2)
    np.testing.assert_allclose([each.step_length for each in walk], lengths, rtol=1e-6)
    point, masses = strides.points_at(start), [5.1, 5.3]
    found = strides.with_parameter("swing_mass", masses).apply(np.repeat(point, 2, axis=0))
    for ends, mass in zip(found.ends, masses, strict=True):
        alone = strides.with_walker(PROSTHESIS.vary(swing_mass=mass))
        np.testing.assert_allclose(ends, alone.apply(point).ends[0], rtol=1e-10)


def test_exponents_are_those_of_a_stride():
    gait = gpw.find_gait(PROSTHESIS, SLOPE)
    (found,) = gpw.lyapunov_exponents(PROSTHESIS, [SLOPE], strides=200, n_transient=50)
    assert found[0] == pytest.approx(0.5 * np.log(np.abs(gait.multipliers[0])), rel=0.02)


def rows(env):
    """The masses of both legs of each walker, of the stance leg first, and their strides."""
    return env.batch.bodies[:, 0, 1:3].copy(), env.batch.ledger["strides"].copy()


def test_legs_exchange_at_each_heelstrike_of_an_environment():
    """Each walker its own; an episode begins on the leg that the body names first."""
    envs = gym.make_vec(
        "PassiveWalker-v0", num_envs=5, system=PROSTHESIS, slope=SLOPE, reset_noise_scale=0.05
    ).unwrapped
    rng = np.random.default_rng(0)
    for seed in (0, 1):
        envs.reset(seed=seed)
        np.testing.assert_array_equal(rows(envs)[0], [[5.0, 5.2]] * 5)
        seen = set()
        for _ in range(80):
            envs.step(0.01 * rng.uniform(-1.0, 1.0, (5, 1)))
            masses, strides = rows(envs)
            np.testing.assert_array_equal(masses[:, 0], np.where(strides % 2, 5.2, 5.0))
            seen |= {*strides.tolist()}
        assert {0, 1, 2, 3} <= seen


def test_a_walker_of_a_batch_has_the_bits_that_it_has_alone():
    given = {"system": PROSTHESIS, "slope": SLOPE}
    envs = gym.make_vec("PassiveWalker-v0", num_envs=3, **given)
    alone = [gym.make("PassiveWalker-v0", **given) for _ in range(3)]
    envs.reset(seed=4)
    for lane, env in enumerate(alone):
        env.reset(seed=4 + lane)
    rng = np.random.default_rng(1)
    for _ in range(60):
        actions = 0.1 * rng.uniform(-1.0, 1.0, (3, 1))
        seen, paid, *_ = envs.step(actions)
        for lane, env in enumerate(alone):
            own = env.step(actions[lane])
            assert (own[0].tobytes(), own[1]) == (seen[lane].tobytes(), paid[lane])


def test_a_rollout_earns_what_the_environment_pays():
    """Its gradient by the mass of one leg is that of differences."""
    scene = make_scene(
        system=PROSTHESIS, slope=SLOPE, reset_noise_scale=0.0, observe_body=("swing_mass",),
        tolerance=1e-12,
    )  # fmt: skip
    envs = gym.make_vec("PassiveWalker-v0", num_envs=2, scene=scene)
    envs.reset(seed=0)
    idle = lambda seen: torch.zeros((len(seen), 1), dtype=torch.float64)  # noqa: E731
    found = walks.rollout(idle, scene, 50, count=2)
    paid = np.array([envs.step(np.zeros((2, 1)))[1] for _ in range(50)])
    np.testing.assert_allclose(found.rewards, paid, atol=1e-9)
    assert found.end.strides.tolist() == [2, 2] or found.end.strides.min() > 2
    np.testing.assert_array_equal(found.observations[..., -1], found.observations[0, 0, -1])
    mass = torch.tensor(5.2, dtype=torch.float64, requires_grad=True)

    def returns(mass):
        start = walks.initial_state(scene, 2, seed=0, parameters={"swing_mass": mass})
        return walks.rollout(idle, scene, 50, start=start).returns.sum()

    (by,) = torch.autograd.grad(returns(mass), mass)
    beside = [returns(torch.tensor(5.2 + d, dtype=torch.float64)).item() for d in (1e-4, -1e-4)]
    assert by.item() == pytest.approx((beside[0] - beside[1]) / 2e-4, rel=1e-3)


@pytest.mark.parametrize("scene", [{}, {"domain_randomization": {"swing_mass": 0.1}}])
def test_a_state_saved_on_the_other_leg_goes_on_with_it(scene):
    env, other = (
        gym.make(
            "PassiveWalker-v0", system=PROSTHESIS, slope=SLOPE, reset_noise_scale=0.01, **scene
        ).unwrapped
        for _ in range(2)
    )
    env.reset(seed=0)
    other.reset(seed=3)
    rest = np.zeros(1)
    while env.batch.ledger["strides"][0] < 3:
        env.step(rest)
    other.set_state(pickle.loads(pickle.dumps(env.get_state())))
    np.testing.assert_array_equal(rows(other)[0], rows(env)[0])
    for _ in range(60):
        assert env.step(rest)[0].tobytes() == other.step(rest)[0].tobytes()
    env.reset(seed=7)
    heavy = env.batch.walkers[0].parameters["swing_mass"]
    np.testing.assert_array_equal(rows(env)[0], [[5.0, heavy]])
    assert (heavy != 5.2) == bool(scene)


@pytest.mark.parametrize("measure", [UNEQUAL_LEGS.hybrid.measure, hybrid.measured])
def test_given_equations_exchange_parameters_too(measure):
    given = gpw.System.of(
        UNEQUAL_LEGS.hybrid._replace(measure=measure),
        leg_2(mass=5.3).body,
        exchange=UNEQUAL_LEGS.exchange,
        centre=lambda body, state: UNEQUAL_LEGS._centre(body, state)[1:],
        mass=20.3,
        start=UNEQUAL_LEGS.start,
    )
    found, expected = (gpw.find_gait(each, SLOPE) for each in (given, leg_2(mass=5.3)))
    np.testing.assert_allclose(found.state, expected.state, atol=1e-11)
    steps = [gait.cycle.step_length for gait in (found, expected)]
    np.testing.assert_allclose(*steps, rtol=1e-10)


def test_the_other_leg_first_is_the_same_walk_half_a_period_later():
    gait = gpw.find_gait(leg_2(mass=5.3, length=0.9995), SLOPE)
    later = gpw.find_gait(gait.walker.swapped, SLOPE, guess=gait.cycle.state[0])
    np.testing.assert_allclose(later.state, gait.cycle.state[0], atol=1e-11)
    np.testing.assert_allclose(later.multipliers, gait.multipliers, atol=1e-8)
    assert gait.walker.swapped.swapped is gait.walker
    check, again = (gpw.reality_check(each) for each in (gait, later))
    assert check.least_normal_force.value == pytest.approx(again.least_normal_force.value)
    assert check.heelstrike_impulse[:2] == pytest.approx(again.heelstrike_impulse[:2], rel=1e-9)


@pytest.mark.parametrize(
    ("exchange", "said"),
    [
        ({"stance_mass": "mass"}, "exchange .* has no field 'mass' of body: choose from hip, "),
        ({"stance_mass": "hip", "swing_mass": "hip"}, "exchange .* has the field hip twice"),
        (["stance_mass"], "exchange .* must be a mapping"),
        ({"stance_mass": "swing_mass"}, "relabel .* does not name the same motion"),
    ],
)
def test_an_exchange_is_of_pairs_of_fields_that_keep_the_motion(exchange, said):
    with pytest.raises(StatementError, match=said):
        replace(leg_2(length=0.9), exchange=exchange)
