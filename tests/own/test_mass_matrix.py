"""Systems by mass matrix and forces: the package's walkers without their special equations."""

from dataclasses import replace

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.five_links import FIVE_LINKS
from examples.rimless_wheel import RIMLESS_WHEEL, closed_form
from gym_passive_walker.engine.own.mechanics import Derived
from gym_passive_walker.modeling import (
    Free,
    Ground,
    Guard,
    HybridSystem,
    Outcome,
    Phase,
    Reset,
    Stage,
    StatementError,
    Watch,
    accelerations_of,
    heelstrike_of,
    kinetic_energy_of,
    stop_of,
)
from gym_passive_walker.models.equations import kneed, straight
from gym_passive_walker.models.equations.hybrid import measured
from gym_passive_walker.models.equations.systems import SYSTEMS
from gym_passive_walker.models.math import cos, sin
from tests.own.statements import COMPASS
from tests.own.test_equations import dimensionless, hip, stated

KNEED = SYSTEMS["kneed"]


def closed(body, state):
    """How far the shank is behind the thigh."""
    return state.thigh - state.shank


def foot(body, state):
    """The swing foot of a straight leg: its centre, less how far it has rolled."""
    x, y = (body.leg * (f(state.thigh) - f(state.stance)) for f in (sin, cos))
    return x + body.foot_radius * (state.thigh - state.stance), -y


def swapped(body, state):
    """The legs exchange their roles."""
    return state.thigh, state.stance, state.stance


def by_matrix():
    """The kneed walker by one mass matrix and one set of forces; its kneestrike is derived."""
    free, locked = KNEED.phases
    strike = free.resets[Outcome.KNEESTRIKE]._replace(strike=stop_of(kneed.mass_matrix, closed))
    forces = kneed.mass_matrix, kneed.forces
    return KNEED._replace(
        kinetic_energy=kinetic_energy_of(kneed.mass_matrix),
        phases=(
            free._replace(
                accelerations=accelerations_of(*forces),
                resets={Outcome.KNEESTRIKE: strike},
                push=None,
            ),
            locked._replace(accelerations=accelerations_of(*forces, links=2), push=None),
        ),
    )


@pytest.fixture(scope="module", name="system")
def a_kneed_walker_by_its_mass_matrix():
    gait = gpw.find_gait("lab", 0.036)
    body = gpw.WALKERS["lab"].body
    return gpw.System.of(by_matrix(), body, centre=hip, start=dimensionless("kneed", gait.state))


def random_state(system, seed, links=3):
    state = np.random.default_rng(seed).uniform(-0.5, 0.5, 6)
    if links == 2:
        state[2], state[5] = state[1], state[4]
    return system.State(*state)


@pytest.mark.parametrize("links", [3, 2])
def test_a_mass_matrix_and_forces_give_the_accelerations_of_each_phase(system, links):
    ground, control = Ground(0.1, 0.99), KNEED.Control(0.03, 0.0)
    own, package = system.hybrid.phases[3 - links], KNEED.phases[3 - links]
    for seed in range(5):
        state = random_state(system, seed, links)
        found = own.accelerations(system.body, state, control, ground)
        expected = package.accelerations(system.body, state, control, ground)
        np.testing.assert_allclose(found, expected, rtol=1e-11)


def compass_without(**left_out):
    """The compass of its masses as given equations, some of them left to be derived."""
    given = COMPASS.hybrid
    phases = (given.phases[0]._replace(push=None),)
    return gpw.System.of(
        given._replace(phases=phases, **left_out), COMPASS.body, start=COMPASS.start,
        centre=lambda body, state: COMPASS._centre(body, state)[1:],
    )  # fmt: skip


def test_a_push_follows_from_the_mass_matrix_and_gravity():
    system = compass_without()
    for seed in range(5):
        state = system.State(*np.random.default_rng(seed).uniform(-0.5, 0.5, 4))
        for impulse in ((0.1, 0.0), (0.0, 0.2)):
            pushes = (each.hybrid.phases[0].push for each in (system, COMPASS))
            found, expected = (
                push(system.body, state, *impulse) for push in pushes if push is not None
            )
            np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-15)


def test_a_stride_is_measured_by_the_centre_of_mass_where_no_measure_is_given():
    own, usual = (
        gpw.stride(each, 0.03, COMPASS.start)
        for each in (compass_without(measure=measured), COMPASS)
    )
    assert own.step_length == pytest.approx(usual.step_length, rel=1e-13)
    assert own.gravity_work == pytest.approx(usual.gravity_work, rel=1e-13)
    assert own.state.tobytes() == usual.state.tobytes()


def test_a_stop_is_the_kneestrike_of_the_package(system):
    for seed in range(5):
        state = random_state(system, seed)
        state = state._replace(shank=state.thigh)
        own, package = (
            each.phases[0].resets[Outcome.KNEESTRIKE].strike(system.body, state, 0.0, Ground(0, 1))
            for each in (system.hybrid, KNEED)
        )
        np.testing.assert_allclose(own.after, package.after, rtol=1e-11, atol=1e-14)
        assert own.lost == pytest.approx(package.lost, rel=1e-10) and own.lost > 0.0


def straight_with(relabel):
    """The straight-legged walker by its mass matrix, with a derived heelstrike."""
    given = SYSTEMS["straight"]
    matrix, gain = straight.mass_matrix, given.potential_gain
    heel = heelstrike_of(matrix, gain, foot, relabel, links=2)
    reset = given.phases[0].resets[Outcome.HEELSTRIKE]._replace(strike=heel)
    phase = given.phases[0]._replace(resets={Outcome.HEELSTRIKE: reset})
    return given._replace(phases=(phase,))


def test_a_heelstrike_is_that_of_the_package():
    usual = stated("straight")
    own = gpw.System.of(straight_with(swapped), usual.body, centre=hip)
    for seed in range(5):
        state = random_state(own, seed, links=2)
        state = state._replace(thigh=-state.stance, shank=-state.stance)
        found, expected = (
            each.hybrid.phases[0].resets[Outcome.HEELSTRIKE].strike(
                own.body, state, 0.0, Ground(0.0, 1.0)
            )
            for each in (own, usual)
        )  # fmt: skip
        np.testing.assert_allclose(found.after, expected.after, rtol=1e-10, atol=1e-13)
        assert found.lost == pytest.approx(expected.lost, rel=1e-10) and found.lost > 0.0
    gait = dimensionless("straight", gpw.find_gait("A", 0.01).state)
    strides = [gpw.stride(each, 0.01, gait, tolerance=1e-12) for each in (own, usual)]
    np.testing.assert_allclose(strides[0].state, strides[1].state, atol=1e-10)


@pytest.mark.parametrize("given", [COMPASS, FIVE_LINKS], ids=["compass", "five links"])
def test_a_heelstrike_is_that_of_the_positions_of_masses(given):
    """In five coordinates and any posture; the mass need not be one."""
    equations = given.hybrid

    def doubled(function):
        return lambda *arguments: tuple(2.0 * x for x in function(*arguments))

    def gain(*arguments):
        return 2.0 * equations.potential_gain(*arguments)

    own = heelstrike_of(
        doubled(equations.mass_matrix), gain, given.landing, given.relabel,
        mass=lambda body: 2.0 * given.total_mass,
    )  # fmt: skip
    usual = equations.phases[0].resets[Outcome.HEELSTRIKE].strike
    for seed in range(5):
        numbers = np.random.default_rng(seed).uniform(-0.5, 0.5, 2 * given.coordinates)
        state = given.State(*numbers.tolist())
        found = own(given.body, state, 0.0, Ground(0.0, 1.0))
        expected = Derived(usual)(given.body, state, 0.0, Ground(0.0, 1.0))
        np.testing.assert_allclose(found.after, expected.after, rtol=1e-10, atol=1e-13)
        assert found.lost == pytest.approx(2.0 * expected.lost, rel=1e-10)


def test_a_heelstrike_that_turns_a_leg_is_refused_by_name():
    wrong = straight_with(lambda body, state: (state.thigh, state.thigh, state.thigh))
    with pytest.raises(StatementError, match="reset HEELSTRIKE of phase LOCKED") as raised:
        gpw.System.of(wrong, stated("straight").body, centre=hip)
    assert "\n" not in str(raised.value)


def test_its_strides_are_the_packages(system):
    package = stated("kneed", start=system.start)
    states = np.array(system.start) * (1.0 + 0.02 * np.random.default_rng(0).normal(size=(16, 6)))
    states[:, 2] = states[:, 1]
    own, usual = (gpw.stride(each, 0.036, states, tolerance=1e-12) for each in (system, package))
    np.testing.assert_array_equal(own.outcome, usual.outcome)
    walked = own.outcome == gpw.Outcome.HEELSTRIKE
    assert walked.sum() > 4
    np.testing.assert_allclose(own.state[walked], usual.state[walked], atol=1e-10)
    lost = own.kneestrike_loss[walked]
    np.testing.assert_allclose(lost, usual.kneestrike_loss[walked], atol=1e-11)


def gain(body, start, end, ground):
    """The energy that a rimless wheel gains in gravity's field."""
    return ground.cosine * (cos(end.spoke) - cos(start.spoke)) + ground.sine * (
        sin(end.spoke) - sin(start.spoke)
    )


def wheel_by_matrix():
    """The rimless wheel by its mass matrix: one link, one phase, and no leg to exchange."""
    wheel = RIMLESS_WHEEL

    def matrix(body, state):
        return (1.0 + body.inertia,)

    def forces(body, state, control, ground):
        return (ground.cosine * sin(state.spoke) - ground.sine * cos(state.spoke),)

    phase = Phase(
        stage=Stage.LOCKED,
        links=1,
        accelerations=accelerations_of(matrix, forces),
        guards=(
            Guard(lambda b, s, g: wheel.landing(b, s)[1], Outcome.HEELSTRIKE, Watch.STRIKE),
            Guard(lambda b, s, g: wheel.falls["fell_backward"](b, s), Outcome.FELL_BACKWARD),
        ),
        resets={
            Outcome.HEELSTRIKE: Reset(heelstrike_of(matrix, gain, wheel.landing, wheel.relabel))
        },
    )
    equations = HybridSystem(
        name="wheel", Body=type(wheel.body), phases=(phase,),
        place=lambda body, state: -sin(state.spoke),
        kinetic_energy=kinetic_energy_of(matrix), potential_gain=gain,
        foot_clearance=lambda body, state: wheel.landing(body, state)[1],
        mass_matrix=matrix, travel=lambda state: Free(), works=Free(),
        absent=("height_change", "slope_change", "push_off"),
        State=wheel.State, Control=Free,
    )  # fmt: skip
    return gpw.System.of(
        equations, wheel.body, centre=lambda b, s: (-sin(s.spoke), cos(s.spoke)), start=wheel.start
    )


def test_a_wheel_of_one_link_and_one_phase_has_the_gait_of_the_closed_form():
    system = wheel_by_matrix()
    gait = gpw.find_gait(system, 0.08)
    rate, multiplier = closed_form(system.body, 0.08)
    assert gait.state[1] == pytest.approx(rate, rel=1e-12)
    assert gait.multipliers[0].real == pytest.approx(multiplier, rel=1e-10)
    assert gpw.gait_family(system, 0.06, 0.1).stable.all()


def test_given_equations_are_replaced_like_other_systems():
    system = wheel_by_matrix()
    assert system.given is not None
    other = replace(
        system, name="heavier", start=(0.39, -0.6), body=system.body._replace(inertia=0.5)
    )
    assert other.hybrid.name == system.hybrid.name  # the equations are compiled once
    found = gpw.find_gait(other, 0.08)
    assert found.state[1] == pytest.approx(closed_form(other.body, 0.08)[0], rel=1e-12)
    renamed = replace(system, given=system.given._replace(spring_gain=None))
    assert renamed.falls.keys() == system.falls.keys()


REPLACED = {
    "links": ({"links": RIMLESS_WHEEL.links}, "links .*must be left out"),
    "State": ({"State": tuple}, "State .*must be that of its equations"),
    "travel": ({"travel": lambda state: Free()}, "travel .*must be that of its equations"),
    "mass": ({"mass": -1.0}, "mass .*must be positive"),
    "centre": ({"centre": None}, "centre .*is missing"),
}


@pytest.mark.parametrize("name", REPLACED)
def test_what_follows_from_given_equations_is_not_replaced(name):
    changes, said = REPLACED[name]
    with pytest.raises(StatementError, match=said) as raised:
        replace(wheel_by_matrix(), **changes)
    assert "\n" not in str(raised.value)
    with pytest.raises(StatementError, match=r"centre and mass .*follow from its links"):
        replace(RIMLESS_WHEEL, mass=2.0)


GIVEN = {
    "kinetic_energy": (lambda b, s: np.nan, "finite"),
    "potential_gain": (lambda *given: np.nan, "finite"),
    "spring_gain": (lambda *given: np.inf, "finite"),
    "friction_power": (lambda b, s: "x", "numbers"),
    "place": (lambda b, s: np.nan, "finite"),
    "foot_clearance": (lambda b, s: (0.0,), "numbers"),
    "measure": (lambda *given: (0.0, 0.0), "4 numbers"),
    "mass_matrix": (lambda b, s: (-1.0,), "positive"),
    "phases": ((), "one phase"),
}


@pytest.mark.parametrize("name", GIVEN)
def test_given_equations_that_are_wrong_are_refused_by_the_name_of_their_function(name):
    system, (function, said) = wheel_by_matrix(), GIVEN[name]
    assert system.given is not None
    wrong = system.given._replace(**{name: function})
    with pytest.raises(StatementError, match=said) as raised:
        gpw.System.of(wrong, system.body, centre=system.centre)
    assert str(raised.value).startswith(name) and "\n" not in str(raised.value)


def test_even_equations_are_refused_on_footholds_of_different_heights():
    system = stated("straight")
    with pytest.raises(StatementError, match="equations of system 'straight' are for even ground"):
        gpw.stride(system, 0.03, np.zeros(6), height_change=0.01)


def test_a_stop_that_leaves_the_knee_bending_is_refused_by_name():
    wrong = stop_of(kneed.mass_matrix, lambda body, state: state.thigh - state.stance)
    equations = by_matrix()
    free, locked = equations.phases
    strike = free.resets[Outcome.KNEESTRIKE]._replace(strike=wrong)
    phases = free._replace(resets={Outcome.KNEESTRIKE: strike}), locked
    with pytest.raises(StatementError, match="reset KNEESTRIKE of phase FREE") as raised:
        gpw.System.of(equations._replace(phases=phases), gpw.WALKERS["lab"].body, centre=hip)
    assert "\n" not in str(raised.value)
