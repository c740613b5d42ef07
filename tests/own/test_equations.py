"""Systems of given equations: the package's own walkers by public means, and contradictions."""

import math
from collections import namedtuple
from dataclasses import replace
from typing import NamedTuple

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.models.equations import hybrid, kneed, simplest, straight
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.equations.systems import SYSTEMS
from gym_passive_walker.models.math import cos, sin
from tests.own.statements import DRIVEN, TORSO, Legs, Motor

KINDS = {"kneed": ("lab", 0.036), "straight": ("A", 0.01), "simplest": ("D", 0.009)}


def hip(body, state):
    """Position of the hip; its height over a foot is that of the centre of mass within a shift."""
    return -body.leg * sin(state.stance) - body.foot_radius * state.stance, (
        body.foot_radius + body.leg * cos(state.stance)
    )


def stated(kind, **rest):
    """A kind of walker of the package as a system of a user's own."""
    walker = gpw.WALKERS[KINDS[kind][0]]
    return gpw.System.of(SYSTEMS[kind], walker.body, centre=hip, **rest)


def dimensionless(kind, states):
    unit = gpw.WALKERS[KINDS[kind][0]].time_unit
    return np.asarray(states) * np.array([1.0, 1.0, 1.0, unit, unit, unit])


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_of_the_package_is_a_statement_like_any_other(kind):
    """By public means alone its strides have the same bits, near the gait and far from it."""
    name, slope = KINDS[kind]
    walker, gait = gpw.WALKERS[name], gpw.find_gait(name, slope)
    rng = np.random.default_rng(2)
    starts = gait.state * (1.0 + 0.5 * rng.uniform(-1.0, 1.0, (64, 6)))
    if not walker.knees:
        starts[:, 2], starts[:, 5] = starts[:, 1], starts[:, 4]
    states = dimensionless(kind, starts)
    alone = gpw.WALKERS[name] if walker.time_unit == 1.0 else replace_gravity(walker)
    found = gpw.stride(stated(kind), slope, states)
    expected = gpw.stride(alone, slope, states)
    assert len(set(found.outcome)) > 1
    np.testing.assert_array_equal(found.outcome, expected.outcome)
    np.testing.assert_array_equal(found.state, expected.state)
    np.testing.assert_array_equal(found.duration, expected.duration)


def replace_gravity(walker):
    """The walker with a gravity that makes its unit of time 1."""
    return replace(walker, gravity=walker.leg_length)


@pytest.mark.parametrize("kind", KINDS)
def test_its_gaits_and_multipliers_are_the_package_s(kind):
    name, slope = KINDS[kind]
    gait = gpw.find_gait(name, slope)
    system = stated(kind, start=dimensionless(kind, gait.state))
    found = gpw.find_gait(system, slope)
    np.testing.assert_allclose(found.state, dimensionless(kind, gait.state), atol=1e-9)
    largest = np.abs(gait.multipliers[0])
    assert np.abs(found.multipliers[0]) == pytest.approx(largest, rel=1e-7)
    assert found.cost_of_transport == pytest.approx(math.sin(slope), rel=1e-9)


def straight_legs(step):
    return 1.0 * step.knee_locked


def test_a_walker_with_knees_is_an_environment_by_the_same_means():
    """Its knee locks within a stride, so a system may have several phases."""
    gait = gpw.find_gait("lab", 0.036)
    start = dimensionless("kneed", gait.state)
    system = stated("kneed", start=start)
    scene = {"slope": 0.036, "actions": ("hip",), "reward": straight_legs}
    env = gym.make("PassiveWalker-v0", system=system, **scene).unwrapped
    own = gym.make("PassiveWalker-v0", scene="lab", reward=straight_legs).unwrapped
    env.reset(seed=0, options={"state": start, "slope": 0.036})
    own.reset(seed=0, options={"state": gait.state, "slope": 0.036})
    locked = set()
    for _ in range(60):
        found, expected = env.step(np.zeros(1)), own.step(np.zeros(1))
        np.testing.assert_allclose(found[0][:6], expected[0][:6], rtol=1e-5, atol=1e-6)
        assert found[1:4] == expected[1:4] and found[2:4] == (False, False)
        locked.add(found[1])
    assert locked == {0.0, 1.0}
    assert found[4]["strides"] == expected[4]["strides"] >= 2


def test_legs_without_knees_are_straight():
    env = gym.make("PassiveWalker-v0", system=TORSO, slope=0.01, reward=straight_legs).unwrapped
    env.reset(seed=0)
    assert env.step(np.zeros(env.action_space.shape))[1] == 1.0


@pytest.mark.parametrize(("asked", "outcome"), [(None, "stubbed_toe"), (False, "fell_backward")])
def test_a_guard_of_stubbed_toes_ends_episodes_as_those_of_the_package(asked, outcome):
    start = dimensionless("kneed", gpw.find_gait("lab", 0.036).state) * [1, 1, 1, 0.8, 1, 1]
    system, scene = stated("kneed"), {"slope": 0.036, "control": "stride", "actions": ("hip",)}
    env = gym.make("PassiveWalker-v0", system=system, end_on_toe_stub=asked, **scene).unwrapped
    env.reset(seed=0, options={"state": start, "slope": 0.036})
    assert env.step(np.zeros(1))[4]["outcome"] == outcome
    with pytest.raises(ValueError, match="guard of it"):
        make_scene(scene, system=stated("straight"), end_on_toe_stub=True)


def changed(kind, phase=-1, **parts):
    """The equations of a kind with other functions."""
    equations = SYSTEMS[kind]
    phases = list(equations.phases)
    of_phase = {name: parts.pop(name) for name in list(parts) if name in hybrid.Phase._fields}
    phases[phase] = phases[phase]._replace(**of_phase)
    return equations._replace(phases=tuple(phases), **parts)


def heavier(body, state):
    """A mass matrix of twice the inertia."""
    return tuple(2.0 * x for x in straight.mass_matrix(body, state))


def negative(body, state):
    first, *rest = straight.mass_matrix(body, state)
    return -first, *rest


def too_light(body, state, control, ground):
    first, second = straight.accelerations(body, state, control, ground)
    return first, 1.01 * second


def not_a_number(body, state, control, ground):
    return math.nan, 0.0


def one_of_two(body, state, control, ground):
    return straight.accelerations(body, state, control, ground)[:1]


def springs_back(body, before, push_off=0.0, ground=hybrid.SMOOTH):
    """A collision that returns energy."""
    strike = straight.heelstrike(body, before, push_off, ground)
    after = strike.after
    faster = after._replace(stance_rate=9.0 * after.stance_rate)
    return strike._replace(after=faster)


def understates(body, before, push_off=0.0, ground=hybrid.SMOOTH):
    strike = straight.heelstrike(body, before, push_off, ground)
    return strike._replace(lost=0.5 * strike.lost)


def jumps(body, before, push_off=0.0, ground=hybrid.SMOOTH):
    """A collision that moves the new stance leg."""
    strike = straight.heelstrike(body, before, push_off, ground)
    return strike._replace(after=strike.after._replace(stance=strike.after.stance + 0.3))


def level(body, state, ground):
    """A guard that no motion changes."""
    return 1.0 + 0.0 * body.leg


def never():
    guard = SYSTEMS["straight"].phases[0].guards[0]
    return (guard._replace(falls=level), *SYSTEMS["straight"].phases[0].guards[1:])


def resets(strike, outcome=Outcome.HEELSTRIKE, into=None):
    """A heelstrike, and perhaps a reset of another outcome."""
    plain = {Outcome.HEELSTRIKE: hybrid.Reset(straight.heelstrike)}
    return plain | {outcome: hybrid.Reset(strike, into)}


def guards(count=1, **changes):
    """The guards of a straight-legged walker, the last one changed and repeated."""
    *others, last = SYSTEMS["straight"].phases[0].guards
    return (*others, *[last._replace(**changes)] * count)


STRIKE = hybrid.Watch.STRIKE
Nine = namedtuple("Nine", [f"torque_{i}" for i in range(9)])

WRONG = {
    "a mass matrix of another energy": (
        changed("straight", mass_matrix=heavier), "mass_matrix .* kinetic energy",
    ),
    "negative mass": (changed("straight", mass_matrix=negative), "mass_matrix .* positive"),
    "forces from nowhere": (
        changed("straight", accelerations=too_light), "accelerations of phase LOCKED .* power",
    ),
    "NaN": (changed("straight", accelerations=not_a_number), "accelerations .* finite"),
    "wrong shapes": (changed("straight", accelerations=one_of_two), "accelerations .* 2 numbers"),
    "a guard that never falls": (
        changed("straight", guards=never()), "guard HEELSTRIKE of phase LOCKED .* never falls",
    ),
    "a reset that gains energy": (
        changed("straight", resets=resets(springs_back)), "reset HEELSTRIKE .* gains energy",
    ),
    "a loss that is another": (
        changed("straight", resets=resets(understates)), "reset HEELSTRIKE .* states an energy",
    ),
    "a reset that moves the walker": (
        changed("straight", resets=resets(jumps)), "reset HEELSTRIKE",
    ),
    "no heelstrike": (changed("straight", resets={}), "phases .* end with a heelstrike"),
    "a reset into its own phase": (
        changed("straight", resets=resets(straight.heelstrike, Outcome.KNEESTRIKE, 0)),
        "reset KNEESTRIKE of phase LOCKED .* into phase 0: a kneestrike leads to a later one",
    ),
    "a reset into a phase that is missing": (
        changed("straight", resets=resets(straight.heelstrike, Outcome.KNEESTRIKE, 5)),
        "reset KNEESTRIKE of phase LOCKED .* into phase 5",
    ),
    "a heelstrike within a stride": (
        changed("straight", resets=resets(straight.heelstrike, into=0)),
        "reset HEELSTRIKE .* a heelstrike ends the stride",
    ),
    "a reset of a fall": (
        changed("straight", resets=resets(straight.heelstrike, Outcome.FELL_FORWARD)),
        "reset FELL_FORWARD .* cannot act",
    ),
    "an impact without a reset": (
        changed("straight", guards=guards(outcome=Outcome.KNEESTRIKE, watch=STRIKE)),
        "guard KNEESTRIKE of phase LOCKED .* has no reset",
    ),
    "an event without an outcome": (
        changed("straight", guards=guards(outcome=Outcome.RUNNING, watch=STRIKE)),
        "guards of phase LOCKED .* RUNNING",
    ),
    "too many guards": (
        changed("straight", guards=guards(10)), "phase LOCKED .* too large: .* 16 controls, guards",
    ),
    "too many controls": (
        changed("straight", Control=Nine, travel=lambda s: Nine(*[s.stance] * 9)),
        "phase LOCKED .* too large: at most 8 controls",
    ),
    "no links": (changed("straight", links=0), "phase LOCKED .* 1 to 3 links, not 0"),
}  # fmt: skip


@pytest.mark.parametrize("wrong", WRONG)
def test_equations_that_contradict_each_other_are_refused_by_name(wrong):
    equations, said = WRONG[wrong]
    body = gpw.WALKERS["A"].body
    with pytest.raises(gpw.StatementError, match=said) as raised:
        gpw.System.of(equations, body, centre=hip)
    assert "\n" not in str(raised.value) and "system 'straight'" in str(raised.value)


def given(body=DRIVEN.body, mass=1.0, **changes):
    """The compass with a motor as a system with given equations, and changes of them."""
    return gpw.System.of(
        DRIVEN.hybrid._replace(**changes), body, name="given", start=DRIVEN.start, mass=mass,
        centre=lambda body, state: DRIVEN._centre(body, state)[1:],
    )  # fmt: skip


def test_the_mass_of_given_equations_may_be_a_function_of_the_body():
    """The weight is then that of the body that walks, as that of a system of links is."""
    system = given(mass=lambda body: body.hip + 2.0 * body.leg)
    assert system.vary(hip=2.0).weight == pytest.approx(DRIVEN.vary(hip=2.0).weight)
    assert system.mass_with(hip=np.array([1.0, 2.0])) == pytest.approx(4.0 / 3.0 + np.array([0, 1]))
    with pytest.raises(gpw.StatementError, match=r"its mass is 1$"):
        given().vary(hip=2.0)
    with pytest.raises(gpw.StatementError, match="mass of system 'given' must be positive"):
        given(mass=lambda body: -body.hip)


def test_equations_use_as_many_constants_as_a_phase_has_room_for():
    (phase,) = DRIVEN.hybrid.phases

    def of(count):
        """A fall by the sum of so many constants."""
        kind = namedtuple("Long", ["hip", "leg", *(f"more_{i}" for i in range(count - 2))])
        fall = phase.guards[1]._replace(falls=lambda b, s, ground: s.stance + sum(b))
        phases = (phase._replace(guards=(phase.guards[0], fall)),)
        return given(kind(*Legs(), *[0.05] * (count - 2)), Body=kind, phases=phases)

    assert len(of(24).parameters) == 24
    with pytest.raises(gpw.StatementError, match=r"phase LOCKED .* at most 24 parameters"):
        of(25)


def braked(at):
    """A phase of the compass that ends where the swing leg passes an angle, and is slowed there."""
    (phase,) = DRIVEN.hybrid.phases

    def slowed(body, before, push_off, ground):
        after = before._make([*before[:2], *(0.98 * rate for rate in before[2:])])
        energy = DRIVEN.hybrid.kinetic_energy(body, before)
        return hybrid.Strike(after, energy * (1.0 - 0.98**2))

    strike = hybrid.Guard(lambda body, state, ground: at - state.swing, Outcome.KNEESTRIKE, STRIKE)
    return phase._replace(guards=(strike, *phase.guards[1:])), slowed


@pytest.mark.parametrize("places", [(0.0,), (-0.1, 0.0, 0.1)])
def test_the_impacts_within_a_stride_lose_their_energies_together(places):
    """Gravity supplies what they, the heelstrike and the gain of speed take."""
    phases = []
    for number, at in enumerate(places):
        phase, slowed = braked(at)
        reset = hybrid.Reset(slowed, number + 1)
        phases.append(phase._replace(resets={Outcome.KNEESTRIKE: reset}))
    system = given(phases=(*phases, *DRIVEN.hybrid.phases))
    stride = gpw.stride(system, 0.06, DRIVEN.start)
    assert stride.outcome == Outcome.HEELSTRIKE
    energies = [
        float(system.hybrid.kinetic_energy(system.body, system.State(*state)))
        for state in (DRIVEN.start, stride.state)
    ]
    lost = stride.kneestrike_loss + stride.heelstrike_loss
    assert stride.gravity_work - lost == pytest.approx(energies[1] - energies[0], abs=1e-9)
    assert stride.kneestrike_loss > 1e-4


def test_losses_of_control_steps_add_up_to_that_of_the_stride_over_weight():
    phase, slowed = braked(0.0)
    struck = phase._replace(resets={Outcome.KNEESTRIKE: hybrid.Reset(slowed, 1)})
    heavy = Legs(*(3.0 * mass for mass in Legs()))
    system = given(heavy, 3.0, phases=(struck, *DRIVEN.hybrid.phases))
    stride = gpw.stride(system, 0.06, DRIVEN.start)
    env = gym.make(
        "PassiveWalker-v0", system=system, slope=0.06, reward=lambda step: step.collision_loss
    )  # fmt: skip
    env.reset(options={"state": DRIVEN.start})
    lost, strides = 0.0, 0
    while strides == 0:
        _, reward, *_, info = env.step(np.zeros(env.action_space.shape, np.float32))
        lost, strides = lost + reward, info["strides"]
    expected = (stride.kneestrike_loss + stride.heelstrike_loss) / system.weight
    assert lost == pytest.approx(expected, rel=1e-6) and stride.kneestrike_loss > 1e-4


def test_what_is_absent_from_equations_cannot_be_set():
    system = given(
        Control=Motor, travel=lambda s: Motor(s.swing - s.stance),
        absent=("motor", *DRIVEN.hybrid.absent),
    )  # fmt: skip
    assert make_scene(system=system, slope=0.03).actions == ()
    refused = {
        "action": lambda: make_scene(system=system, slope=0.03, actions=("motor",)),
        "limit": lambda: replace(system, limits={"motor": 1.0}),
        "held torque": lambda: gpw.stride_map(system, 0.03, controller={"motor": 0.01}),
        "gradient": lambda: gpw_torch().stride(system, 0.03, DRIVEN.start, controls={"motor": 0.1}),
    }
    for ask in refused.values():
        with pytest.raises(ValueError, match="motor"):
            ask()


class Sprung(NamedTuple):
    """Masses, and a spring that is absent."""

    hip: float = 2.0 / 3.0
    leg: float = 1.0 / 6.0
    spring: float = 0.0


def test_a_constant_that_is_absent_from_equations_is_zero_and_no_parameter():
    absent = ("spring", *DRIVEN.hybrid.absent)
    system = given(Sprung(), Body=Sprung, absent=absent)
    assert list(system.parameters) == ["hip", "leg"]
    with pytest.raises(gpw.StatementError, match="has no spring: it has hip, leg"):
        system.vary(spring=1.0)
    with pytest.raises(gpw.StatementError, match=r"spring = 1\.0, which is absent"):
        given(Sprung(spring=1.0), Body=Sprung, absent=absent)


def gpw_torch():
    return pytest.importorskip("gym_passive_walker.torch")


PUSHES = {
    "a scene": lambda system: make_scene(
        system=system, slope=0.03, pushes={"rate": 0.1, "impulse": 0.01}
    ),
    "robustness": lambda system: gpw.robustness(system, slope=0.03, walkers=4),
    "a control step": lambda system: gpw_torch().tick(
        system, 0.03, DRIVEN.start, duration=0.1, push=0.01
    ),
    "a rollout": lambda system: gpw_torch().rollout(
        lambda seen: seen[:, :1], {"system": system, "slope": 0.03}, 2, count=2, pushes=0.01
    ),
}


def test_pushes_need_a_mass_matrix_or_functions_of_their_own():
    phases = tuple(phase._replace(push=None) for phase in DRIVEN.hybrid.phases)
    assert "pushes" in given(phases=phases).supports
    system = given(phases=phases, mass_matrix=None)
    for ask in PUSHES.values():
        with pytest.raises(
            ValueError, match=r"a push needs the inertia .*`mass_matrix`, or `push`"
        ):
            ask(system)


def test_a_body_and_a_centre_must_fit_the_equations():
    body = gpw.WALKERS["A"].body
    with pytest.raises(gpw.StatementError, match=r"body .* StraightBody"):
        gpw.System.of(SYSTEMS["straight"], gpw.WALKERS["lab"].body, centre=hip)
    with pytest.raises(gpw.StatementError, match=r"centre .* 2 numbers"):
        gpw.System.of(SYSTEMS["straight"], body, centre=lambda body, state: (0.0,))
    with pytest.raises(TypeError, match=r"System.of has no argument links"):
        gpw.System.of(SYSTEMS["straight"], body, centre=hip, links=hip)


def test_the_kinds_of_the_package_are_the_statements_of_their_modules():
    """Nothing is added to them but what smooth ground and bare walkers leave out."""
    for module in (kneed, straight, simplest):
        bare, full = SYSTEMS[module.SYSTEM.name], module.SYSTEM
        assert bare.kinetic_energy is full.kinetic_energy and bare.measure is full.measure
        for one, other in zip(bare.phases, full.phases, strict=True):
            assert one.accelerations is other.accelerations and one.resets is other.resets
