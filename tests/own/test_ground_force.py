"""The force of the ground on a system: from its momentum, and by other ways."""

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.driven_torso import DRIVEN_TORSO
from examples.five_links import FIVE_LINKS
from examples.rimless_wheel import RIMLESS_WHEEL
from examples.torso import TORSO
from gym_passive_walker.engine.own.system import _registered
from gym_passive_walker.gaits.look.dense_stride import dense_phases
from gym_passive_walker.gaits.look.forces import borne as loads
from gym_passive_walker.gaits.look.forces import forces, struck
from gym_passive_walker.models.equations.hybrid import Outcome, Stage, Watch
from gym_passive_walker.models.equations.systems import SYSTEMS as EQUATIONS
from tests.own.oracle import Independent
from tests.own.statements import COMPASS, DRIVEN, STRAIGHT
from tests.own.test_equations import dimensionless, hip

SYSTEMS = {DRIVEN_TORSO: 0.03, FIVE_LINKS: 0.05, RIMLESS_WHEEL: 0.08, TORSO: 0.03}


def names(system):
    return getattr(system, "name", system)


def test_the_reality_check_of_a_compass_is_that_of_the_package_s_own():
    """The package derives its forces by Newton's and Euler's laws for each leg."""
    own, package = (gpw.reality_check(gpw.find_gait(x, 0.05)) for x in (COMPASS, STRAIGHT))
    scaled = {each.quantity: each.extreme.value / each.unit for each in package.readings}
    assert len(own.readings) == 8
    for each in own.readings:
        found = each.extreme.value / each.unit
        assert found == pytest.approx(scaled[each.quantity], rel=1e-8, abs=1e-9)
    assert own.passed == {name: package.passed[name] for name in own.passed}


def test_a_walk_of_a_compass_has_the_forces_and_energies_of_the_package_s_own():
    own, package = (gpw.simulate(gpw.find_gait(x, 0.05), strides=2, tolerance=1e-12).dimensionless
                    for x in (COMPASS, STRAIGHT))  # fmt: skip
    for name in ("normal_force", "tangential_force", "centre_of_mass", "centre_of_mass_velocity",
                 "kinetic_energy", "potential_energy", "foot_clearance"):  # fmt: skip
        found, expected = getattr(own, name), getattr(package, name)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9, err_msg=name)
    for name in ("times", "normal_impulse", "tangential_impulse", "loss"):
        found, expected = getattr(own.strikes, name), getattr(package.strikes, name)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9, err_msg=name)


@pytest.fixture(scope="module", params=SYSTEMS, ids=names)
def step(request):
    """A gait of a system, its motion, and the impulse of its heelstrike along the ground and up."""
    gait = gpw.find_gait(request.param, SYSTEMS[request.param])
    walk = gpw.stride(request.param, gait.slope, gait.state, tolerance=1e-13)
    (phase,) = dense_phases(gait.stride_map, gait.slope, gait.state, walk, offset=0.0)
    impulse = gpw.reality_check(gait).heelstrike_impulse
    return gait, phase, (impulse.tangential_impulse, impulse.normal_impulse)


def test_forces_and_impulses_of_a_period_hold_the_weight(step):
    """A walker has the same momentum after a period, so its weight is borne in the mean."""
    gait, phase, (along, up) = step
    weight = gait.walker.weight * phase.end
    for force, jump, borne in (
        (phase.normal, up, weight * np.cos(gait.slope)),
        (phase.tangential, along, -weight * np.sin(gait.slope)),
    ):
        whole = force.integ()
        total = whole(phase.end) - whole(0.0) + jump
        assert total == pytest.approx(borne, abs=1e-9 * weight)


def test_the_impulse_of_a_heelstrike_is_the_contact_s_multiplier(step):
    gait, phase, impulse = step
    independent = Independent(gait.walker, gait.slope)
    assert impulse == pytest.approx(independent.impulse(phase.state_at(phase.end)), rel=1e-9)


def test_controls_press_on_the_ground():
    """A torque between the legs changes the force by what it accelerates."""
    gait = gpw.find_gait(DRIVEN, 0.05)
    rest, driven = (
        forces(DRIVEN, 0.05, gait.state[None], [Stage.LOCKED], [torque]) for torque in (0.0, 0.1)
    )
    stance, swing = (driven.accelerations - rest.accelerations)[0]
    angle, other = gait.state[:2]
    legs, hip = DRIVEN.body.leg, DRIVEN.body.hip
    # The stance leg turns hip and both legs' centres; the swing leg turns its own.
    by_stance = hip + 0.5 * legs + legs
    up = -by_stance * np.sin(angle) * stance + 0.5 * legs * np.sin(other) * swing
    assert driven.normal - rest.normal == pytest.approx(up, rel=1e-9)


def of(**changes):
    """The compass as a system with given equations, and changes of them."""
    return gpw.System.of(
        COMPASS.hybrid._replace(**changes), COMPASS.body, name="given", start=COMPASS.start,
        centre=lambda body, state: COMPASS._centre(body, state)[1:],
    )  # fmt: skip


def test_a_check_reads_the_height_of_the_foot_that_its_system_has():
    """Two systems may have one motion, and different functions of it."""
    usual, found = COMPASS.hybrid.foot_clearance, []
    for height in (0.0, 10.0):
        system = of(foot_clearance=lambda body, state, h=height: usual(body, state) + h)
        env = gym.make("PassiveWalker-v0", system=system, constraints={"scuffing": "report"})
        env.reset(seed=0)
        found.append(env.step(np.zeros(0, np.float32))[4]["clearance"] - height)
    assert found[0] == pytest.approx(found[1], abs=1e-12)


def twice(function):
    """A function with twice the values."""
    return lambda *given: tuple(2.0 * each for each in function(*given))


def scuffing(outcome):
    """The phase of the compass with a guard that ends it only with `end_on_toe_stub`."""
    strike, fall, *others = PHASE.guards
    return PHASE._replace(
        guards=(strike, fall._replace(watch=Watch.SCUFF, outcome=outcome), *others)
    )


PHASE = COMPASS.hybrid.phases[0]


@pytest.mark.parametrize(
    ("name", "one", "other"),
    [
        *((name, getattr(COMPASS.hybrid, name), twice(getattr(COMPASS.hybrid, name)))
          for name in ("ground_force", "momentum")),
        ("phases", (PHASE,), (PHASE._replace(push=twice(PHASE.push)),)),
        ("phases", *((scuffing(each),) for each in (Outcome.STUBBED_TOE, Outcome.STALLED))),
    ],
)  # fmt: skip
def test_code_of_a_system_is_kept_under_the_text_of_all_its_functions(name, one, other):
    """Other code with one name would be taken from the cache, in later processes too."""
    names = {_registered(COMPASS.hybrid._replace(**{name: each})).name for each in (one, other)}
    assert len(names) == 2


def test_given_equations_need_the_force_and_the_momentum():
    without = of(ground_force=None, momentum=None)
    with pytest.raises(ValueError, match="must have `ground_force` and `momentum`"):
        gpw.reality_check(without, 0.05, COMPASS.start)
    with pytest.raises(ValueError, match="must have `ground_force` and `momentum`"):
        gym.make("PassiveWalker-v0", system=without, constraints={"contact": "end"})
    walk = gpw.simulate(without, 0.05, COMPASS.start, 2, samples=5)
    for name in ("normal_force", "strikes"):
        with pytest.raises(ValueError, match=r"the force on the stance foot needs .* system"):
            getattr(walk, name)
    assert "normal_force" not in walk.columns() and walk.kinetic_energy.min() > 0.0
    own, other = (gpw.reality_check(gpw.find_gait(x, 0.05)) for x in (COMPASS, of()))
    assert own.least_normal_force == pytest.approx(other.least_normal_force, rel=1e-9)
    with pytest.raises(gpw.StatementError, match=r"momentum of .* is missing"):
        of(momentum=None)
    with pytest.raises(gpw.StatementError, match=r"weight change the momentum"):
        of(ground_force=lambda body, state, accelerations, ground: (0.0, 1.0))


def test_the_collision_matrix_of_a_compass_is_that_of_the_package_s_own():
    gait = gpw.find_gait(COMPASS, 0.05)
    own = gpw.collision_matrix(COMPASS, gait.state)
    np.testing.assert_array_equal(own, gpw.collision_matrix(gait))
    known = gpw.collision_matrix(STRAIGHT, gait.state[0]) / STRAIGHT.total_mass
    np.testing.assert_allclose(own, known, atol=1e-12)


def test_the_collision_matrix_times_the_velocity_is_the_impulse_of_a_heelstrike(step):
    """Half their product with the velocity is the energy lost."""
    gait, _, impulse = step
    velocity = -np.linalg.solve(gpw.collision_matrix(gait.walker, gait.state), impulse)
    assert -0.5 * velocity @ impulse == pytest.approx(float(gait.mean.heelstrike_loss), rel=1e-8)


def test_a_collision_matrix_needs_a_state_just_after_heelstrike():
    with pytest.raises(ValueError, match="the state must be 4 finite numbers, coordinates"):
        gpw.collision_matrix(COMPASS, 0.2)


def test_the_reality_check_of_knees_that_a_system_states_is_that_of_the_package_s_own():
    """A motion that jumps as the knee locks; here forces are Newton's and Euler's, as there."""
    kneed = EQUATIONS["kneed"]

    def momentum(body, state):
        back, up, *_ = struck(body, state[:3], state[3:], (0.0, 0.0))
        return -back, up

    def ground_force(body, state, turns, ground):
        back, up, *_ = loads(body, state, turns, kneed.Control(0.0, 0.0), ground)
        return -back, up

    gait = gpw.find_gait("lab", 0.036)
    given = kneed._replace(momentum=momentum, ground_force=ground_force)
    start = dimensionless("kneed", gait.state)
    system = gpw.System.of(given, gait.walker.body, centre=hip, start=start)
    own, package = gpw.reality_check(system, 0.036, start), gpw.reality_check(gait)
    scaled = {each.quantity: each.extreme.value / each.unit for each in package.readings}
    for each in own.readings:
        found = each.extreme.value / each.unit
        assert found == pytest.approx(scaled[each.quantity], rel=1e-8, abs=1e-9)
