"""Options of analyses against plain loops over single strides."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.stats

import gym_passive_walker as gpw
from gym_passive_walker import (
    Outcome,
    basin_of_attraction,
    bifurcation_diagram,
    find_gait,
    gait_family,
    largest_push,
    lyapunov_exponents,
    parameter_family,
    reality_check,
    stride,
    stride_jacobian,
)
from gym_passive_walker.gaits.robust.basin import FELL, UNSETTLED
from gym_passive_walker.gaits.robust.first_passage import FirstPassage
from gym_passive_walker.gaits.robust.first_passage_mesh import MeshPassage
from gym_passive_walker.models.walkers import as_walker

SLOPES = {"lab": (0.036, 0.04), "E": (0.005, 0.006), "D": (0.009, 0.0188)}


def walk(name, slope, state, count):
    """States after each of some strides; NaN from a fall on."""
    states, state = [], np.asarray(state, float)
    for _ in range(count):
        end = stride(name, slope, state)
        state = end.state if end.outcome == Outcome.HEELSTRIKE else np.full(6, np.nan)
        states.append(state)
        if np.isnan(state[0]):
            states += [state] * (count - len(states))
            break
    return np.array(states)


def chart_by(walker, state):
    """Derivatives of ln(angle) and of scaled rates over angle, by the section's coordinates."""
    time = math.sqrt(walker.leg_length / walker.gravity)
    rates = state[3 : 6 if walker.knees else 5]
    by = np.zeros((1 + len(rates),) * 2)
    by[0, 0] = 1.0 / state[0]
    by[1:, 0] = -rates * time / state[0] ** 2
    by[1:, 1:] = time / state[0] * np.eye(len(rates))
    return by


def plain_exponents(name, slope, state, skipped, strides, count):
    """Benettin's method by Gram and Schmidt, with the derivative of each stride."""
    walker = as_walker(name)
    for _ in range(skipped):
        state = stride(name, slope, state).state
    m = 4 if walker.knees else 3
    frame, sums = np.eye(m)[:, :count], np.zeros(count)
    for _ in range(strides):
        change = stride_jacobian(name, slope, state)
        after = stride(name, slope, state).state
        moved = chart_by(walker, after) @ change @ np.linalg.inv(chart_by(walker, state)) @ frame
        frame = np.empty_like(moved)
        for j, column in enumerate(moved.T):
            rest = column - frame[:, :j] @ (frame[:, :j].T @ column)
            sums[j] += math.log(np.linalg.norm(rest))
            frame[:, j] = rest / np.linalg.norm(rest)
        state = after
    return sums / strides


@pytest.mark.parametrize("name", SLOPES)
@pytest.mark.parametrize(("count", "strides", "skipped"), [(1, 6, 0), (2, 5, 3)])
def test_exponents_are_those_of_products_of_derivatives(name, count, strides, skipped):
    starts = [1.003 * find_gait(name, slope).state for slope in SLOPES[name]]
    found = lyapunov_exponents(
        name, SLOPES[name], count=count, strides=strides, n_transient=skipped, start=starts
    )
    assert found.shape == (2, count)
    for row, slope, state in zip(found, SLOPES[name], starts, strict=True):
        known = plain_exponents(name, slope, state, skipped, strides, count)
        np.testing.assert_allclose(row, known, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("name", SLOPES)
@pytest.mark.parametrize(("skipped", "kept", "longest"), [(0, 3, 1), (2, 4, 3)])
def test_a_diagram_records_each_walk_from_its_own_start(name, skipped, kept, longest):
    starts = [
        share * find_gait(name, x).state
        for x, share in zip(SLOPES[name], (1.01, 0.998), strict=True)
    ]
    found = bifurcation_diagram(
        name, SLOPES[name], n_transient=skipped, n_recorded=kept, start=starts,
        longest_period=longest,
    )  # fmt: skip
    for i, slope in enumerate(SLOPES[name]):
        states = walk(name, slope, starts[i], skipped + kept)
        np.testing.assert_allclose(found.stance_angle[i], states[skipped:, 0], rtol=1e-7)
        np.testing.assert_allclose(found.state[i], states[-1], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("kind", ["long", "short"])
def test_walks_begin_just_beside_the_gait_of_the_kind_that_is_asked_for(kind):
    gait = find_gait("E", 0.01, kind)
    found = bifurcation_diagram(
        "E", [0.01], kind=kind, n_transient=0, n_recorded=2, longest_period=1
    )
    state = gait.state * np.array([1.0001, 1.0001, 1.0001, 1.0, 1.0, 1.0])
    known = walk("E", 0.01, state, 2)
    assert found.stance_angle[0] == pytest.approx(known[:, 0], abs=2e-7)
    exponent = lyapunov_exponents("E", [0.01], kind=kind, n_transient=0, strides=3, count=1)
    known = plain_exponents("E", 0.01, state, 0, 3, 1)
    np.testing.assert_allclose(exponent[0], known, atol=1e-2)


@pytest.mark.parametrize(("longest", "period"), [(1, 0), (2, 0), (3, 3), (5, 3)])
def test_a_period_is_looked_for_up_to_the_longest(longest, period):
    gait = find_gait("D", 0.0125, period=3)
    found = bifurcation_diagram(
        "D", [0.0125], start=gait.state, n_transient=50, n_recorded=6, longest_period=longest
    )
    assert found.period.tolist() == [period]


def swing(angle):
    """Ratio of rates after a heelstrike of the simplest walker."""
    return math.cos(2.0 * angle)


@pytest.mark.parametrize(("strides", "atol"), [(1, 1e-4), (4, 1e-4), (4, 0.05), (30, 0.3)])
def test_cells_of_a_basin_have_walked_so_many_strides_or_come_so_near(strides, atol):
    angles, rates = np.linspace(0.17, 0.23, 5), np.linspace(-0.65, -0.55, 4)
    basin = basin_of_attraction(
        "D", 0.009, stance_angles=angles, stance_rates=rates, strides=strides, atol=atol
    )
    (gait,) = basin.gaits
    time = math.sqrt(1.0 / 9.81)

    def chart(state):
        return np.array([math.log(state[0]), *(state[3:5] * time / state[0])])

    for (row, column), settled in np.ndenumerate(basin.settled):
        angle, rate = angles[column], rates[row]
        state = np.array([angle, -angle, -angle, rate, swing(angle) * rate, swing(angle) * rate])
        count, known = 0, UNSETTLED
        while count < strides and known == UNSETTLED:
            end = stride("D", 0.009, state, tolerance=1e-8)
            if end.outcome != Outcome.HEELSTRIKE:
                known = FELL
                break
            state, count = end.state, count + 1
            if np.abs(chart(state) - chart(gait.state)).max() < atol:
                known = 0
        assert (settled, basin.strides[row, column]) == (known, count)
        assert basin.outcome[row, column] == end.outcome
        assert basin.walks[row, column] == (known != FELL)


@pytest.mark.parametrize("name", ["lab", "E", "D"])
@pytest.mark.parametrize("resolution", [1, 5])
def test_a_slice_reaches_from_near_nothing_to_more_than_twice_the_gait(name, resolution):
    slope = {"lab": 0.036, "E": 0.01, "D": 0.009}[name]
    gait = find_gait(name, slope)
    basin = basin_of_attraction(name, slope, resolution=resolution, strides=1)
    share = 2.2 * np.arange(1, resolution + 1) / resolution
    np.testing.assert_allclose(basin.stance_angle, share * gait.state[0], rtol=1e-9)
    np.testing.assert_allclose(basin.stance_rate, share[::-1] * gait.state[3], rtol=1e-9)
    given = basin_of_attraction(
        name, slope, resolution=resolution, strides=1, stance_angles=[0.2, 0.3]
    )
    np.testing.assert_array_equal(given.stance_angle, [0.2, 0.3])
    np.testing.assert_array_equal(given.stance_rate, basin.stance_rate)
    assert given.outcome.shape == (resolution, 2)


@pytest.mark.parametrize("name", ["lab", "E"])
def test_swing_rates_of_a_slice_are_those_after_a_heelstrike_like_the_gait_s(name):
    """One stride backwards: states of the gait's own motion lie on the slice."""
    slope = {"lab": 0.036, "E": 0.01}[name]
    gait = find_gait(name, slope)
    basin = basin_of_attraction(
        name, slope, stance_angles=[gait.state[0]], stance_rates=[gait.state[3]], strides=3
    )
    assert basin.settled.tolist() == [[0 if gait.stable else UNSETTLED]] or not gait.stable
    assert basin.strides[0, 0] == (1 if gait.stable else 3)


@pytest.mark.parametrize("strides", [1, 2])
@pytest.mark.parametrize("kind", ["long", "short"])
def test_a_perturbation_is_withstood_for_the_strides_that_are_asked_for(strides, kind):
    """The largest is the least of all that fail, by a scan over changes of the stance rate."""
    gait = find_gait("E", 0.01, kind)
    found = largest_push("E", 0.01, gait=gait, strides=strides, accuracy=1e-6)
    size = abs(gait.state[3])
    for way, limit in ((-1.0, found.forward), (1.0, found.backward)):
        if math.isinf(limit):
            tried, walks = 3.0 * size * np.linspace(0.0, 1.0, 60), True
        else:
            tried, walks = limit * np.linspace(0.0, 1.0 - 1e-5, 60), True
            beyond = gait.state + (limit + 3e-6 * size) * way * np.eye(6)[3]
            assert np.isnan(walk("E", 0.01, beyond, strides)[-1, 0])
        states = gait.state + np.outer(tried, way * np.eye(6)[3])
        for state in states:
            assert np.isfinite(walk("E", 0.01, state, strides)[-1, 0]) == walks


def test_a_coarse_limit_is_below_a_fine_one_by_no_more_than_its_accuracy():
    gait = find_gait("lab", 0.036)
    fine = largest_push(gait, accuracy=1e-9)
    size = abs(gait.state[3])
    for accuracy in (0.1, 1e-3):
        coarse = largest_push(gait, accuracy=accuracy)
        for way in ("forward", "backward"):
            rough, exact = getattr(coarse, way), getattr(fine, way)
            assert exact - accuracy * size <= rough <= exact + 1e-9


def test_a_gait_of_several_strides_is_perturbed_where_it_begins():
    gait = find_gait("D", 0.016, period=2)
    found = largest_push(gait, strides=1, accuracy=1e-6)
    for way, limit in ((-1.0, found.forward), (1.0, found.backward)):
        if math.isfinite(limit):
            for share, walks in ((1.0 - 1e-4, True), (1.0 + 1e-4, False)):
                state = gait.state + way * share * limit * np.eye(6)[3]
                assert np.isfinite(walk("D", 0.016, state, 1)[0, 0]) == walks


def brute_folds(values):
    """Where a sequence turns back."""
    steps = np.sign(np.diff(values))
    return np.flatnonzero(steps[1:] * steps[:-1] < 0.0) + 1


@pytest.mark.parametrize(("name", "low", "high"), [("lab", 0.018, 0.3), ("C", 1e-4, 0.1)])
def test_folds_and_doublings_lie_where_the_gaits_of_a_family_say(name, low, high):
    family = gait_family(name, low, high)
    turns = brute_folds(family.value)
    assert len(family.folds) == len(turns)
    turned = sorted(family.value[i] for i in turns)
    np.testing.assert_allclose(sorted(family.folds), turned, rtol=2e-2)
    assert list(family.folds) == sorted(family.folds)
    below = (family.multipliers.real.min(axis=1) < -1.0) & True
    changes = np.flatnonzero(below[1:] != below[:-1])
    assert len(family.period_doublings) == len(changes)
    for at in family.period_doublings:
        ends = [sorted(family.value[[i, i + 1]]) for i in changes]
        assert any(a <= at <= b for a, b in ends)


@pytest.mark.parametrize("resolution", [0.02, 0.1])
def test_steps_along_a_family_are_no_longer_than_its_resolution(resolution):
    family = gait_family("E", 0.005, 0.05, resolution=resolution)
    time = math.sqrt(1.0 / 9.81)
    angle = family.state[:, :1]
    u = np.hstack(
        [np.log(angle), family.state[:, 3:5] * time / angle, np.log(family.slope[:, None])]
    )
    steps = np.linalg.norm(np.diff(u, axis=0), axis=1)
    assert steps.max() <= resolution * 1.1
    assert np.median(steps) > 0.3 * resolution


@pytest.mark.parametrize("kind", ["long", "short"])
def test_a_parameter_s_family_is_of_the_kind_asked_for(kind):
    family = parameter_family("E", "hip_mass", 0.0, 0.05, slope=0.01, kind=kind)
    known = find_gait("E", 0.01, kind)
    at = np.argmin(np.abs(family.value))
    assert family.value[at] == 0.0 and family.period == 1
    np.testing.assert_allclose(family.state[at], known.state, rtol=1e-9)
    assert [end.value for end in family.ends] == [family.value[0], family.value[-1]]


REFUSED = {
    "atol must be": lambda: basin_of_attraction("D", 0.009, atol=0.0),
    "resolution must be": lambda: basin_of_attraction("D", 0.009, resolution=0),
    "strides must be": lambda: basin_of_attraction("D", 0.009, strides=0),
    "ratios must be two numbers": lambda: basin_of_attraction("D", 0.009, ratios=(1.0, 2.0, 3.0)),
    "stance_rates must be one or more numbers in one row, not of shape": lambda: (
        basin_of_attraction("D", 0.009, stance_rates=[])
    ),
    "accuracy must be": lambda: largest_push("D", 0.009, accuracy=1e-16),
    "start must be one state, or one for each of 2 slopes, not of shape": lambda: (
        bifurcation_diagram("D", [0.01, 0.02], start=np.ones((3, 6)))
    ),
    "n_transient must be": lambda: bifurcation_diagram("D", [0.01], n_transient=-1),
    "sweep must be": lambda: bifurcation_diagram("D", [0.01], sweep="yes"),
    "n_recorded must be above the longest period 4, not 4": lambda: bifurcation_diagram(
        "D", [0.01], n_recorded=4, longest_period=4
    ),
    "walker falls at slope 0.03": lambda: gpw.crisis(
        "D", 0.03, 0.04, start=find_gait("D", 0.009).state, strides=50
    ),
    "walkers must be": lambda: gpw.crisis("D", 0.01, 0.02, walkers=0),
    "resolution must be .*": lambda: gait_family("D", 0.01, 0.02, resolution=1e-4),
    "high is too far from low": lambda: parameter_family("D", "gravity", 1.0, 1e9, slope=0.01),
    "does not double its period from 0.01 to 0.012": lambda: gpw.doubling_cascade("D", 0.01, 0.012),
    "friction must be": lambda: reality_check("lab", 0.036, friction=-0.1),
    "state must be \\(6,\\), not \\(2, 6\\)": lambda: reality_check(
        "lab", 0.036, np.tile(find_gait("lab", 0.036).state, (2, 1))
    ),
    "the stride from state 1 does not end .* but with FELL_BACKWARD": lambda: stride_jacobian(
        "lab", 0.036, [find_gait("lab", 0.036).state, [0.3, -0.3, -0.3, -0.1, 0.0, 0.0]]
    ),
    "this stride does not end .* but with FELL_BACKWARD": lambda: stride_jacobian(
        "lab", 0.036, [0.3, -0.3, -0.3, -0.1, 0.0, 0.0]
    ),
    "no foot_radios \\(foot_radius\\?\\)": lambda: stride_jacobian(
        "lab", 0.036, wrt=["slope", "foot_radios"]
    ),
    "reality_check needs smooth ground": lambda: reality_check(
        gpw.stride_map("lab", 0.036, terrain=gpw.stairs(0.001))
    ),
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_is_refused_is_named(message):
    with pytest.raises(Exception, match=message):
        REFUSED[message]()


def test_edges_of_what_is_allowed_are_allowed():
    assert largest_push("D", 0.009, accuracy=1.0, strides=1).forward >= 0.0
    asked = dict(n_transient=0, n_recorded=2, longest_period=1)
    assert bifurcation_diagram("D", [0.009], **asked).stance_angle.shape == (1, 2)
    assert reality_check("lab", 0.036, friction=0.0).passed["friction"] is False
    assert reality_check("lab", 0.036, friction=math.inf).passed["friction"]
    assert len(gait_family("D", 0.01, 0.011, resolution=1.0)) >= 2


def test_several_strides_of_a_check_are_each_stride_s():
    gait = find_gait("lab", 0.036)
    start = gait.state * np.array([1.02, 1.02, 1.02, 1.0, 1.0, 1.0])
    both = reality_check("lab", 0.036, start, strides=2)
    first = reality_check("lab", 0.036, start)
    middle = stride("lab", 0.036, start).state
    second = reality_check("lab", 0.036, middle)
    assert both.strides == 2
    assert both.duration == pytest.approx(first.duration + second.duration, rel=1e-9)
    least = ["clearance", "stance_knee_torque", "swing_knee_torque", "least_normal_force"]
    least += ["knee_flexion", "release_velocity", "release_depth", "stance_knee_at_heelstrike"]
    least += ["stance_knee_at_kneestrike"]
    for name, better in [*((x, min) for x in least), ("greatest_normal_force", max),
                         ("stance_friction", max)]:  # fmt: skip
        one, two, found = (getattr(x, name) for x in (first, second, both))
        later = two._replace(time=two.time + first.duration)
        known = better((one, later), key=lambda extreme: extreme.value)
        np.testing.assert_allclose(found, known, rtol=1e-6, atol=1e-9, err_msg=name)
    for name in ("kneestrike_impulse", "heelstrike_impulse"):
        one, two, found = (getattr(x, name) for x in (first, second, both))
        worst = two if two.needed_friction.value > one.needed_friction.value else one
        assert found.normal_impulse == pytest.approx(worst.normal_impulse, rel=1e-6)
    assert reality_check(find_gait("D", 0.016, period=2)).strides == 2


@pytest.mark.parametrize(("falls", "strides"), [(1, 10), (4, 200), (50, 50), (300, 1000)])
def test_a_sampled_mean_has_the_error_of_a_binomial_share(falls, strides):
    found = FirstPassage(falls, strides)
    share = falls / strides
    assert found.mean == pytest.approx(1.0 / share)
    error = math.sqrt(share * (1.0 - share) / strides) / share**2  # of 1 / share
    assert found.error == pytest.approx(error)
    low, high = found.interval
    width = 1.959963984540054 * error / found.mean
    assert math.log(high / found.mean) == pytest.approx(width)
    assert math.log(found.mean / low) == pytest.approx(width)
    assert str(found) == f"{1.0 / share:.4g} strides ({low:.4g} to {high:.4g})"
    none = FirstPassage(0, strides)
    assert none.interval[0] == pytest.approx(strides / -math.log(0.05))
    assert str(none) == (
        f"none of {strides} strides ended in a fall: more than {none.interval[0]:.3g} strides"
    )


def test_a_mesh_s_result_in_words_and_survivors():
    found = MeshPassage(20.0, 0.5, 321, 4567)
    share = math.exp(scipy.stats.t.ppf(0.975, 15) * 0.5 / 20.0)  # sixteen ensembles
    assert found.interval == pytest.approx((20.0 / share, 20.0 * share))
    assert str(found) == f"20 strides ({20.0 / share:.4g} to {20.0 * share:.4g})"
    assert MeshPassage(1.2, 0.5, 1, 1).interval[0] == 1.0
    np.testing.assert_allclose(found.survivors(3), [0.95, 0.95**2, 0.95**3])
    none = MeshPassage(math.inf, math.inf, 99, 1)
    assert str(none) == "none of 99 states of the mesh is near a fall"
    np.testing.assert_array_equal(none.survivors(2), [1.0, 1.0])
