"""The models are plain functions of any kind of number, and are consistent with each other.

Motion, energies, collisions and the work of controls are defined separately; mechanics connects
them. SymPy differentiates here, with forty digits.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp

from gym_passive_walker import WALKERS, Outcome
from gym_passive_walker.models.equations import kneed, legs, straight
from gym_passive_walker.models.equations.bodies import body_from
from gym_passive_walker.models.equations.hybrid import Control, Ground, State, System
from gym_passive_walker.models.equations.systems import SYSTEMS, UNEVEN
from gym_passive_walker.models.model import bodies
from tests.equations.examples import KNEED, MASSIVE, fitted, random_walker
from tests.equations.statements import KINDS, ground

DIGITS = 40

EXAMPLES = {"kneed": WALKERS["lab"], "straight": WALKERS["A"], "simplest": WALKERS["D"]}
EXAMPLES |= {
    f"{name}-{more}": fitted(walker)
    for more in ("fitted", "uneven")
    for name, walker in EXAMPLES.items()
}
"""A walker of each system."""

PHASES = [
    pytest.param(system, index, id=f"{name}-{phase.stage.name}")
    for name, system in KINDS.items()
    for index, phase in enumerate(system.phases)
]


MASSIVE_PHASES = [phase for phase in PHASES if phase.values[0].mass_matrix]


def some_walker(rng: np.random.Generator, system: System):
    """A random walker with the equations of a system, except legs without mass."""
    kind, *fittings = system.name.split("-")
    if kind == "simplest":
        walker = replace(WALKERS["D"], thigh_length=rng.uniform(0.2, 2.0))
    else:
        walker = random_walker(rng, knees=kind == "kneed")
    if fittings:
        walker = fitted(walker, *rng.uniform(0.001, [0.2, 0.02, 0.02]))
    assert walker.equations(UNEVEN if "uneven" in fittings else ()) is system
    return walker


def energy_gain(system: System, body, start: State, end: State, slope: Ground):
    """Gain of potential energy of gravity and springs between two states over the same contact."""
    springs = system.spring_gain(body, start, end) if system.spring_gain else 0.0
    return system.potential_gain(body, start, end, slope) + springs


def some_state(rng: np.random.Generator, links: int, count: int | None = None) -> State:
    """A state, or arrays of them; the shank of a straight leg goes with the thigh."""
    shape = () if count is None else (count,)
    angles, rates = rng.uniform(-1.5, 1.5, (3, *shape)), rng.normal(size=(3, *shape))
    if links == 2:
        angles[2], rates[2] = angles[1], rates[1]
    return State(*angles, *rates)


def exactly(numbers):
    """A tuple of floats as SymPy's numbers with many digits."""
    return type(numbers)(*(sp.Float(x, DIGITS) for x in numbers))


def parts_of(system: System, index: int):
    """Mass matrix, forces and accelerations of a phase."""
    return kneed if system.phases[index].links == 3 else straight


def square(upper, links: int) -> np.ndarray:
    """A symmetric matrix from its upper triangle, row by row; of arrays, (links, links, n)."""
    matrix = np.empty((links, links, *np.shape(upper[0])), dtype=np.result_type(*upper))
    for entry, i, j in zip(upper, *np.triu_indices(links), strict=True):
        matrix[i, j] = matrix[j, i] = entry
    return matrix


@pytest.mark.parametrize(("system", "index"), PHASES)
def test_a_statement_says_the_same_of_one_walker_and_of_many(system, index):
    rng = np.random.default_rng(2)
    phase = system.phases[index]
    body, many = some_walker(rng, system).body, some_state(rng, phase.links, 5)
    slope = ground(0.1)
    together = phase.accelerations(body, many, Control(0.3), slope)
    for i in range(5):
        one = State(*(float(x[i]) for x in many))
        alone = phase.accelerations(body, one, Control(0.3), slope)
        np.testing.assert_allclose(alone, [x[i] for x in together], rtol=1e-14)


@pytest.mark.parametrize(("system", "index"), PHASES)
def test_a_statement_means_the_same_to_many_digits(system, index):
    rng = np.random.default_rng(3)
    phase, body = system.phases[index], some_walker(rng, system).body
    state, slope = some_state(rng, phase.links), ground(0.1)
    floats = phase.accelerations(body, state, Control(0.3), slope)
    exact = phase.accelerations(
        exactly(body), exactly(state), exactly(Control(0.3)), exactly(slope)
    )
    scale = max(abs(float(x)) for x in exact)
    np.testing.assert_allclose(floats, [float(x) for x in exact], rtol=0.0, atol=1e-13 * scale)


def lagrange(system: System, body, links: int, state: State, control: Control, slope: Ground):
    """Residual of Lagrange's equations in the motion of a phase, link by link."""
    angles, rates = sp.symbols("a:3", real=True), sp.symbols("b:3", real=True)
    if links == 2:
        angles, rates = (*angles[:2], angles[1]), (*rates[:2], rates[1])
    moving = State(*angles, *rates)
    here = exactly(State(*state[:3], 0.0, 0.0, 0.0))
    kinetic = system.kinetic_energy(body, moving)
    energy = kinetic - energy_gain(system, body, here, moving, slope)
    friction = system.friction_power(body, moving) if system.friction_power else 0
    work = sum(c * x for c, x in zip(control, system.travel(moving), strict=True))
    values = dict(zip((*angles, *rates), state, strict=True))
    index = 0 if links == system.phases[0].links else 1
    found = system.phases[index].accelerations(body, exactly(state), control, slope)
    left, scale = [], 0
    for i in range(links):
        momentum = energy.diff(rates[i])
        terms = [
            *(momentum.diff(angles[j]) * rates[j] for j in range(links)),
            *(momentum.diff(rates[j]) * found[j] for j in range(links)),
            -energy.diff(angles[i]),
            -sp.sympify(work).diff(angles[i]),
            sp.sympify(friction).diff(rates[i]) / 2,  # Rayleigh's dissipation function
        ]
        terms = [sp.N(sp.sympify(term).subs(values), DIGITS) for term in terms]
        scale = max(scale, *(abs(term) for term in terms))
        left.append(sum(terms))
    return max(abs(x) for x in left) / scale


@pytest.mark.parametrize(("system", "index"), MASSIVE_PHASES)
def test_energies_and_the_travel_of_controls_give_the_motion(system, index):
    """Lagrange's equations of the second kind, to thirty digits: signs and factors of everything.

    A locked leg of a kneed walker has the energy of the kneed one: thigh and shank go together.
    """
    rng, links = np.random.default_rng(4), system.phases[index].links
    for _ in range(3):
        walker = some_walker(rng, system)
        # To all digits: what a body's constants have in common must not be lost to rounding.
        numbers = {k: sp.Float(v, DIGITS) for k, v in vars(walker).items() if type(v) is float}
        body = exact_body(changed(walker, numbers), system)
        state = State(*(sp.Float(x, DIGITS) for x in some_state(rng, links)))
        sine = sp.Float(rng.uniform(-0.5, 0.5), DIGITS)
        slope = Ground(sine, sp.sqrt(1 - sine**2))
        control = Control(sp.Float(rng.normal(), DIGITS))
        assert lagrange(system, body, links, state, control, slope) < 1e-30


def changed(walker, numbers) -> SimpleNamespace:
    """A walker with some parameters changed."""
    return SimpleNamespace(**(vars(walker) | numbers))


def exact_body(walker, system: System):
    """A walker's constants to many digits: its sines are SymPy's here."""
    with pytest.MonkeyPatch.context() as patch:
        for name, function in (("sin", sp.sin), ("cos", sp.cos), ("arcsin", sp.asin)):
            patch.setattr(np, name, function)
        return body_from(walker, system.Body)


@pytest.mark.parametrize("name", WALKERS)
def test_a_walkers_constants_are_those_of_its_exact_parameters(name):
    walker = WALKERS[name]
    numbers = {k: sp.Float(v, DIGITS) for k, v in vars(walker).items() if type(v) is float}
    exact = exact_body(changed(walker, numbers), walker.equations())
    np.testing.assert_allclose(walker.body, [float(x) for x in exact], rtol=1e-14, atol=1e-17)


def test_the_simplest_hips_energy_gives_its_motion():
    """Feet without mass have no energy; the hip falls as an inverted pendulum's."""
    rng, system = np.random.default_rng(5), SYSTEMS["simplest"]
    body, slope = system.Body(0.0, 1.0, 0.0, 0.0), ground(0.2)
    for _ in range(20):
        state = some_state(rng, 2)
        stance, _ = system.phases[0].accelerations(body, state, Control(0.0), slope)
        moved = state._replace(
            stance=state.stance + 1e-100j * state.stance_rate,
            stance_rate=state.stance_rate + 1e-100j * stance,
        )
        kinetic = system.kinetic_energy(body, moved)
        gain = system.potential_gain(body, state, moved, slope)
        assert kinetic.imag == pytest.approx(-gain.imag, rel=1e-13)


@pytest.mark.parametrize(("system", "index"), PHASES)
def test_power_is_the_control_times_what_it_moves(system, index):
    """Energy changes by actuators and friction alone; for the simplest walker, not at all."""
    rng, phase = np.random.default_rng(6), system.phases[index]
    tiny = 1e-100
    for _ in range(50):
        body, state = some_walker(rng, system).body, some_state(rng, phase.links)
        control, slope = Control(*rng.normal(size=2)), ground(rng.uniform(-0.5, 0.5))
        bends = phase.accelerations(body, state, control, slope)
        bends = (*bends, bends[-1])[:3]
        moved = State(
            *(x + 1j * tiny * v for x, v in zip(state, (*state[3:], *bends), strict=True))
        )
        kinetic = system.kinetic_energy(body, moved).imag / tiny
        potential = np.imag(energy_gain(system, body, state, moved, slope)) / tiny
        travel = np.imag(system.travel(moved)) / tiny
        power = float(np.dot(np.multiply(control, system.works), travel))
        if system.friction_power:
            power -= system.friction_power(body, state)
        scale = 1.0 + abs(kinetic) + abs(potential)
        assert kinetic + potential == pytest.approx(power, rel=0.0, abs=1e-12 * scale)


@pytest.mark.parametrize("name", MASSIVE)
def test_kinetic_energy_is_the_quadratic_form_of_the_mass_matrix(name):
    rng, walker = np.random.default_rng(7), WALKERS[name]
    system = walker.equations()
    links = system.phases[0].links
    for _ in range(20):
        state = some_state(rng, links)
        matrix = square(system.mass_matrix(walker.body, state), links)
        assert np.all(np.linalg.eigvalsh(matrix) > 0.0)
        rates = np.array(state[3 : 3 + links])
        assert system.kinetic_energy(walker.body, state) == pytest.approx(
            0.5 * rates @ matrix @ rates, rel=1e-13
        )


@pytest.mark.parametrize("system", KINDS.values(), ids=KINDS)
def test_a_small_gain_of_height_keeps_its_digits(system):
    """A billionth of a radian apart, the difference of two energies has no digit left."""
    rng, links = np.random.default_rng(8), system.phases[0].links
    for gap in (1e-3, 1e-9, 1e-15):
        body = some_walker(rng, system).body
        # Steps that are exact, so that what remains is the statement's own rounding.
        start = State(*(round(x * 1024.0) / 1024.0 for x in some_state(rng, links)))
        step = gap * np.array([1.0, -0.5, 0.7 if links == 3 else -0.5, 0.0, 0.0, 0.0])
        end = State(*(np.array(start) + step))
        slope = ground(0.3)
        exact = system.potential_gain(exactly(body), exactly(start), exactly(end), exactly(slope))
        found = system.potential_gain(body, start, end, slope)
        assert found == pytest.approx(float(exact), rel=1e-12)
        back = system.potential_gain(body, end, start, slope)
        assert back == pytest.approx(-found, rel=1e-14)


@pytest.mark.parametrize("system", KINDS.values(), ids=KINDS)
def test_a_rise_and_another_are_one_rise(system):
    rng, links = np.random.default_rng(9), system.phases[0].links
    body, slope = some_walker(rng, system).body, ground(0.3)
    a, b, c = (some_state(rng, links) for _ in range(3))
    there = system.potential_gain(body, a, b, slope) + system.potential_gain(body, b, c, slope)
    assert system.potential_gain(body, a, c, slope) == pytest.approx(there, rel=0.0, abs=1e-14)
    assert system.potential_gain(body, a, a, slope) == 0.0


@pytest.mark.parametrize("name", KNEED)
def test_a_kneed_walker_with_a_straight_leg_is_a_straight_legged_one(name):
    rng, walker = np.random.default_rng(10), WALKERS[name]
    body, plain = walker.body, replace(walker, knees=False).body
    assert isinstance(plain, straight.SYSTEM.Body)
    np.testing.assert_allclose([getattr(body, x) for x in plain._fields], plain, rtol=1e-15)
    slope = ground(0.1)
    for _ in range(20):
        one, other = some_state(rng, 2), some_state(rng, 2)
        m11, m12, m13, m22, m23, m33 = kneed.mass_matrix(body, one)
        both = m11, m12 + m13, m22 + 2.0 * m23 + m33
        assert straight.mass_matrix(plain, one) == pytest.approx(both, rel=1e-13, abs=1e-15)
        first, second, third = kneed.forces(body, one, Control(0.2), slope)
        assert straight.forces(plain, one, Control(0.2), slope) == pytest.approx(
            (first, second + third), rel=1e-12, abs=1e-15
        )
        for ours, theirs in (
            (kneed.kinetic_energy(body, one), straight.kinetic_energy(plain, one)),
            (kneed.foot_clearance(body, one), straight.foot_clearance(plain, one)),
            (
                kneed.potential_gain(body, one, other, slope),
                straight.potential_gain(plain, one, other, slope),
            ),
        ):
            assert ours == pytest.approx(theirs, rel=1e-12, abs=1e-15)


def momenta(system: System, body, state: State):
    """Generalized momenta of the stance leg and the swing leg's links."""
    links = system.phases[0].links
    matrix = square(system.mass_matrix(body, state), links)
    return matrix @ np.array(state[3 : 3 + links])


@pytest.mark.parametrize("name", KNEED)
def test_momentum_about_contact_and_hip_passes_through_kneestrike(name):
    """A stop between thigh and shank is inside the swing leg, and pulls at nothing outside it."""
    rng, walker = np.random.default_rng(11), WALKERS[name]
    body = walker.body
    strike = kneed.SYSTEM.phases[0].resets[Outcome.KNEESTRIKE].strike
    for _ in range(20):
        before = some_state(rng, 2)._replace(shank_rate=rng.normal())
        after, loss, _ = strike(body, before)
        assert after.thigh_rate == after.shank_rate
        one, other = (momenta(kneed.SYSTEM, body, state) for state in (before, after))
        np.testing.assert_allclose(
            [other[0], other[1] + other[2]], [one[0], one[1] + one[2]], rtol=0.0, atol=1e-14
        )
        lost = kneed.kinetic_energy(body, before) - kneed.kinetic_energy(body, after)
        assert loss == pytest.approx(lost, rel=1e-11, abs=1e-15)


@pytest.mark.parametrize("system", KINDS.values(), ids=KINDS)
def test_a_heelstrike_costs_the_kinetic_energy_that_is_gone(system):
    rng = np.random.default_rng(12)
    strike = system.phases[-1].resets[Outcome.HEELSTRIKE].strike
    for _ in range(50):
        body, angle = some_walker(rng, system).body, rng.uniform(0.05, 0.7)
        before = legs.straight(-angle, angle, *rng.normal(size=2))
        after, loss, _ = strike(body, before)
        assert after[:3] == pytest.approx((angle, -angle, -angle), rel=1e-15)
        energies = [system.kinetic_energy(body, state) for state in (before, after)]
        assert loss == pytest.approx(energies[0] - energies[1], rel=0.0, abs=1e-13 * energies[0])
        assert loss > 0.0


@pytest.mark.parametrize("system", KINDS.values(), ids=KINDS)
def test_a_heelstrike_mirrors_legs_that_all_but_mirror_each_other(system):
    """Landing leaves a rounding between the legs' angles; the next stride begins without it."""
    body = EXAMPLES[system.name].body
    after, *_ = (
        system.phases[-1]
        .resets[Outcome.HEELSTRIKE]
        .strike(body, State(-0.2, 0.2 + 1e-13, 0.2 + 1e-13, -1.0, -0.5, -0.5))
    )
    assert after.stance == -after.thigh == -after.shank
    assert after.stance == pytest.approx(0.2, rel=1e-12)


@pytest.mark.parametrize("name", WALKERS)
def test_a_body_moves_with_its_walkers_parameters(name):
    """Complex parameters carry derivatives into a body's constants."""
    walker, system = WALKERS[name], WALKERS[name].equations()
    for parameter in ("shank_length", "foot_radius", "shank_com", "hip_mass", "gravity"):
        value = getattr(walker, parameter)
        moved = changed(walker, {parameter: value + 1e-100j})
        found = np.imag(np.array(body_from(moved, system.Body), complex)) / 1e-100
        near = [
            np.array(body_from(changed(walker, {parameter: value + step}), system.Body), float)
            for step in (1e-5, -1e-5)
        ]
        expected = (near[0] - near[1]) / 2e-5
        scale = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8 * scale)


def test_bodies_stand_behind_each_other_as_the_engine_reads_them():
    two = bodies(WALKERS["lab"], WALKERS["C"])
    assert two.shape == (2, 1, len(kneed.SYSTEM.Body._fields))
    np.testing.assert_array_equal(two[1, 0], WALKERS["C"].body)
