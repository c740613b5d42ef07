"""Systems of the examples: their geometry, forces and printed tables, by plain NumPy."""

import math
from dataclasses import replace

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples import driven_torso, five_links, rimless_wheel, torso
from examples.five_links import FIVE_LINKS
from examples.rimless_wheel import RIMLESS_WHEEL, Wheel, closed_form
from examples.torso import TORSO

ALL = [FIVE_LINKS, TORSO, RIMLESS_WHEEL, driven_torso.DRIVEN_TORSO]
IDS = [system.name for system in ALL]


def states(system, count=5, spread=0.5):
    """Random states."""
    rng = np.random.default_rng(3)
    return [system.State(*row) for row in
            rng.uniform(-spread, spread, (count, 2 * system.coordinates)).tolist()]  # fmt: skip


def place(angle, length):
    """A vector of a length along the normal, turned backwards by an angle, as a complex number."""
    return 1j * length * np.exp(1j * angle)


def points(pairs):
    return np.array([complex(float(x), float(y)) for x, y in pairs])


def five_by_numpy(state):
    """Stance knee, hip, swing knee, swing foot and the top of the torso."""
    knee = place(state.shin, 0.5)
    hip = knee + place(state.thigh, 0.5)
    swing_knee = hip - place(state.swing_thigh, 0.5)
    foot = swing_knee - place(state.swing_shin, 0.5)
    return knee, hip, swing_knee, foot, hip + place(state.torso, 0.63 / 0.8)


def test_rabbit_s_segments_hang_together_with_their_masses_where_they_belong():
    for state in states(FIVE_LINKS):
        knee, hip, swing_knee, foot, top = five_by_numpy(state)
        np.testing.assert_allclose(points(five_links.joints(state)), [knee, hip, swing_knee, foot])
        links = five_links.links(five_links.Body(), state)
        shin, thigh = 0.24 / 0.8, 0.11 / 0.8
        expected = [
            (3.2, knee - place(state.shin, shin), 0.20, state.shin),
            (6.8, hip - place(state.thigh, thigh), 0.47, state.thigh),
            (12.0, hip + place(state.torso, 0.24 / 0.8), 1.33, state.torso),
            (6.8, hip - place(state.swing_thigh, thigh), 0.47, state.swing_thigh),
            (3.2, swing_knee - place(state.swing_shin, shin), 0.20, state.swing_shin),
        ]
        for link, (mass, at, inertia, turn) in zip(links, expected, strict=True):
            assert link[0] == pytest.approx(mass / 32.0)
            np.testing.assert_allclose(points([link[1:3]]), [at])
            assert link[3] == pytest.approx(inertia / (32.0 * 0.8**2)) and link[4] == turn
        assert sum(link[0] for link in links) == pytest.approx(1.0)
        swing, stance, trunk = (points(part) for part in five_links.pose(None, state))
        np.testing.assert_allclose(swing, [hip, swing_knee, foot])
        np.testing.assert_allclose(stance, [0.0, knee, hip])
        np.testing.assert_allclose(trunk, [hip, top])


def test_a_torso_s_segments_hang_together_with_their_masses_where_they_belong():
    body = torso.Body(0.6, 0.15, 0.2, 0.4)
    for state in states(TORSO):
        hip = place(state.stance, 1.0)
        foot, top = hip - place(state.swing, 1.0), hip + place(state.torso, 0.4)
        expected = [(0.6, hip), (0.15, hip / 2), (0.15, (hip + foot) / 2), (0.2, top)]
        for link, (mass, at) in zip(torso.links(body, state), expected, strict=True):
            assert link[0] == mass
            np.testing.assert_allclose(points([link[1:3]]), [at])
        np.testing.assert_allclose(points([torso.landing(body, state)]), [foot])
        swing, stance, trunk = (points(part) for part in torso.pose(body, state))
        np.testing.assert_allclose(swing, [hip, foot])
        np.testing.assert_allclose(stance, [0.0, hip])
        np.testing.assert_allclose(trunk, [hip, top])


@pytest.mark.parametrize("system", ALL, ids=IDS)
def test_names_change_and_the_body_stays_where_it_is(system):
    """Seen from the foot that lands, the renamed body has the same masses in the same places."""
    for state in states(system):
        foot = points([system.landing(system.body, state)])[0]
        renamed = system.relabel(system.body, state)
        after = system.State(*renamed, *renamed)
        before, then = (
            sorted(
                (round(complex(float(x) - at.real, float(y) - at.imag).real, 9),
                 round(float(y) - at.imag, 9), float(m))
                for m, x, y, *_ in system.links(system.body, each)
            )
            for each, at in ((state, foot), (after, 0.0j))
        )  # fmt: skip
        np.testing.assert_allclose(before, then, atol=1e-8)
        back = points([system.landing(system.body, after)])[0]
        if system is not RIMLESS_WHEEL:  # a wheel turns on, legs change places
            assert back == pytest.approx(-foot)


@pytest.mark.parametrize("system", [FIVE_LINKS, TORSO], ids=["five links", "torso"])
def test_springs_do_not_distinguish_the_legs_and_rest_where_they_are_said_to(system):
    body, count = system.body, system.coordinates
    for state in states(system):
        renamed = system.relabel(body, state)
        rates = system.relabel(body, system.State(*state[count:], *state[count:]))
        after = system.State(*renamed, *rates)
        assert system.potential(body, after) == pytest.approx(system.potential(body, state))
        assert system.dissipation(body, after) == pytest.approx(system.dissipation(body, state))
        assert system.dissipation(body, state) > 0.0 and system.potential(body, state) > 0.0
    lean = 0.1
    if system is FIVE_LINKS:
        rest = (lean - body.bend, lean, 0.2, 0.3, 0.3 - body.bend)
        stiff = {0: body.knee, 2: body.torso}
    else:
        rest, stiff = (0.3, -0.1, lean), {2: body.stiffness, 0: body.stiffness / 4.0}
    zero = system.State(*rest, *rest)
    assert system.potential(body, zero) == pytest.approx(0.0, abs=1e-15)
    for place_, stiffness in stiff.items():
        moved = list(rest)
        moved[place_] += 0.01
        found = system.potential(body, system.State(*moved, *rest))
        assert found == pytest.approx(0.5 * stiffness * 0.01**2)
        rates = np.zeros(count)
        rates[place_] = 0.01
        share = stiffness / (body.knee if system is FIVE_LINKS else body.stiffness)
        lost = system.dissipation(body, system.State(*rest, *rates))
        assert lost == pytest.approx(0.5 * body.damping * share * 0.01**2)


def test_four_motors_turn_what_their_names_say_and_change_places_with_the_legs():
    for state in states(FIVE_LINKS):
        travel = FIVE_LINKS.travel(state)
        assert travel == (
            state.thigh - state.shin, state.thigh - state.torso,
            state.swing_thigh - state.torso, state.swing_thigh - state.swing_shin,
        )  # fmt: skip
        renamed = FIVE_LINKS.relabel(FIVE_LINKS.body, state)
        assert FIVE_LINKS.travel(FIVE_LINKS.State(*renamed, *renamed)) == tuple(reversed(travel))


@pytest.mark.parametrize("half", [math.pi / 8.0, 0.3])
@pytest.mark.parametrize("inertia", [0.0, 0.2, 0.7])
def test_a_wheel_rolls_as_its_balances_of_energy_and_of_angular_momentum_say(half, inertia):
    slope, wheel = 0.12, Wheel(half, inertia)
    rate, multiplier = closed_form(wheel, slope)
    # From one impact to the next, the hub goes from behind the spoke to before it.
    drop = math.cos(half - slope) - math.cos(half + slope)
    before = -math.sqrt(rate**2 + 2.0 * drop / (1.0 + inertia))
    arm = complex(math.sin(half), math.cos(half))  # from the new foot to the hub
    motion = complex(math.cos(half), -math.sin(half))  # of the hub, about the old foot
    about_the_new = inertia + arm.imag * motion.real + arm.real * motion.imag
    kept = about_the_new / (1.0 + inertia)
    assert before * kept == pytest.approx(rate, rel=1e-12)
    assert multiplier == pytest.approx(kept**2, rel=1e-12)
    system = replace(RIMLESS_WHEEL, body=wheel, start=(half, -0.5))
    gait = gpw.find_gait(system, slope)
    np.testing.assert_allclose(gait.state, [half, rate], rtol=1e-12)
    assert gait.multipliers[0] == pytest.approx(multiplier, rel=1e-12)


def test_the_wheel_s_table_has_equal_columns_at_three_slopes(capsys):
    rimless_wheel.main()
    head, *rows = capsys.readouterr().out.splitlines()
    assert head == "slope   rate after an impact   closed form   multiplier   closed form"
    for row, slope in zip(rows, (0.06, 0.08, 0.1), strict=True):
        at, *numbers = map(float, row.split())
        rate, multiplier = closed_form(RIMLESS_WHEEL.body, slope)
        assert at == slope
        np.testing.assert_allclose(numbers, [rate, rate, multiplier, multiplier], rtol=1e-7)
    assert math.pi / 8.0 == RIMLESS_WHEEL.start[0] == RIMLESS_WHEEL.body.half


def _moduli(gait):
    moduli = sorted(map(abs, gait.multipliers), reverse=True)
    return " ".join(["multipliers", *(f"{modulus:.4f}" for modulus in moduli)])


@pytest.mark.parametrize(("module", "slope"), [(five_links, 0.05), (torso, 0.03)])
def test_an_example_prints_its_gait_and_the_moduli_of_its_multipliers(module, slope, capsys):
    module.main()
    said = capsys.readouterr().out.splitlines()
    gait = gpw.find_gait(FIVE_LINKS if module is five_links else TORSO, slope)
    if module is torso:
        family = gpw.parameter_family(TORSO, "torso", 0.02, 0.3, slope=0.03)
        assert said.pop() == str(family) and family.period_doublings
        assert gait.stable
        gaits = [gait]
    else:
        task = {"system": FIVE_LINKS, "slope": slope, "control": "stride"}
        feedback = five_links.LinearFeedback(task)
        gaits = [gait, gpw.find_gait(gpw.stride_map(FIVE_LINKS, slope, controller=feedback))]
        assert gaits[1].stable and gaits[1].state == pytest.approx(gait.state, abs=1e-6)
    assert said == [line for each in gaits for line in (str(each), _moduli(each))]
    np.testing.assert_allclose(gait.state, [*gait.walker.start], atol=0.02)


@pytest.mark.parametrize("system", ALL, ids=IDS)
def test_a_system_that_lies_has_fallen_and_one_that_stands_has_not(system):
    upright = system.State(*system.start)
    assert all(rule(system.body, upright) > 0.0 for rule in system.falls.values())
    for name, sign in (("fell_forward", -1.0), ("fell_backward", 1.0)):
        if name in system.falls:
            lying = upright._replace(**{upright._fields[0]: sign * 1.6})
            assert {each for each, rule in system.falls.items()
                    if rule(system.body, lying) < 0.0} == {name}  # fmt: skip
