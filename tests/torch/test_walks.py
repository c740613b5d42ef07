"""Strides and ticks as operations of torch: values, gradients, and what falls."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import gym_passive_walker as gpw
from gym_passive_walker.gaits.measures import UNIT_OF
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.units import UNITS
from gym_passive_walker.torch import stride, tick

SLOPES = {"D": 0.009, "E": 0.009, "F": 0.009, "lab": 0.036}
LEDGERS = (
    "state", "duration", "step_length", "hip_work", "hip_work_absolute", "kneestrike_loss",
    "heelstrike_loss", "gravity_work", "spring_work", "friction_loss", "ankle_work",
    "ankle_work_absolute", "push_off_work",
)  # fmt: skip
THOROUGHLY = {
    "check_forward_ad": True,
    "check_batched_grad": True,
    "check_batched_forward_grad": True,
    "atol": 1e-5,
    "rtol": 1e-4,
}


def gait(name):
    """A slope, and starts of two strides near the gait there, in the walker's own units."""
    slope = SLOPES.get(name, 0.03)
    state = gpw.find_gait(name, slope).state
    return slope, torch.tensor(np.stack([state, 1.002 * state]), requires_grad=True)


def number(value):
    return torch.tensor(value, dtype=torch.float64, requires_grad=True)


@pytest.mark.parametrize("name", gpw.WALKERS)
def test_a_stride_is_the_stride(name):
    slope, states = gait(name)
    found = stride(name, slope, states, hip_torque=0.01, tolerance=1e-12)
    expected = gpw.stride(name, slope, states.detach(), hip_torque=0.01, tolerance=1e-12)
    for ledger in LEDGERS:
        values = getattr(found, ledger).detach()
        np.testing.assert_allclose(values, getattr(expected, ledger), rtol=1e-13, atol=1e-13)
    knees = np.nan_to_num(expected.kneestrike_time)  # 0 without knees
    np.testing.assert_allclose(found.kneestrike_time.detach(), knees, rtol=1e-13)
    assert found.walks.all() and (found.margin > 0.1).all()
    alone = stride(name, slope, states[0], hip_torque=0.01, tolerance=1e-12)
    assert torch.equal(alone.state, found.state[0]) and alone.duration.ndim == 0


@pytest.mark.parametrize("name", gpw.WALKERS)
def test_gradients_of_strides_are_those_of_differences(name):
    """By start, slope, torque and parameters that move shape, mass and units; every way round."""
    slope, states = gait(name)
    mass = "hip_mass" if gpw.WALKERS[name].massless_legs else "thigh_mass"
    varied = ("thigh_length", "gravity", mass)
    values = [number(getattr(gpw.WALKERS[name], parameter)) for parameter in varied]

    def walk(states, slope, torque, *values):
        parameters = dict(zip(varied, values, strict=True))
        walked = stride(
            name, slope, states, hip_torque=torque, parameters=parameters, tolerance=1e-13
        )
        return walked[:11]  # passive ankles and no push-off: they are zero

    inputs = (states, number(slope), number([0.01, 0.02]), *values)
    assert torch.autograd.gradcheck(walk, inputs, **THOROUGHLY)


DRIVEN = {  # every motor that feet bear, and a foothold that is lower and steeper
    "lab": {"hip_torque": 0.3, "push_off": 0.2, "height_change": -0.002, "slope_change": 0.004},
    "E": {
        "hip_torque": 0.002,
        "ankle_torque": 0.003,
        "push_off": 0.01,
        "height_change": -1e-3,
        "slope_change": 0.002,
    },
    "D": {
        "hip_torque": 0.002,
        "ankle_torque": 0.003,
        "push_off": 0.01,
        "height_change": 1e-3,
        "slope_change": -0.002,
    },
}


@pytest.mark.parametrize(("name", "held"), DRIVEN.items())
def test_a_stride_with_every_motor_over_uneven_ground_is_the_stride(name, held):
    slope, states = gait(name)
    found = stride(name, slope, states, **held, tolerance=1e-12)
    expected = gpw.stride(name, slope, states.detach(), **held, tolerance=1e-12)
    assert found.walks.all() and (expected.push_off_work > 0.0).all()
    for ledger in LEDGERS:
        values = getattr(found, ledger).detach()
        np.testing.assert_allclose(values, getattr(expected, ledger), rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize(("name", "held"), DRIVEN.items())
def test_gradients_by_every_motor_and_foothold_are_those_of_differences(name, held):
    slope, states = gait(name)
    parameters = {"gravity": number(gpw.WALKERS[name].gravity)}  # moves the units of all but turn

    def walk(*values):
        asked = dict(zip(held, values, strict=True))
        return stride(
            name, slope, states.detach(), **asked, parameters=parameters, tolerance=1e-13
        )[:14]

    inputs = tuple(number(value) for value in held.values())
    assert torch.autograd.gradcheck(walk, inputs, **THOROUGHLY)
    own = dict(held)

    def heavier(gravity):
        reported = stride(
            name, slope, states.detach(), **own, parameters={"gravity": gravity}, tolerance=1e-13
        )
        return reported[:14]

    assert torch.autograd.gradcheck(heavier, (parameters["gravity"],), atol=1e-5, rtol=1e-4)


def test_a_tick_that_ends_with_heelstrike_has_the_push_off_s_gradient():
    slope, states = gait("D")
    near = tick("D", slope, states, 0.0, duration=1.5)
    inputs = number(0.001), number(0.01), number(-1e-3), number(0.002)

    def walk(ankle, push_off, rise, turn):
        reported = tick(
            "D", slope, near.state.detach(), 0.0, duration=9.0, phase=near.phase,
            ankle_torque=ankle, push_off=push_off, height_change=rise, slope_change=turn,
            tolerance=1e-13,
        )  # fmt: skip
        assert (reported.outcome == Outcome.HEELSTRIKE).all() and (
            reported.push_off_work > 0.0
        ).all()
        return reported.state, *reported[2:11]

    assert torch.autograd.gradcheck(walk, inputs, **THOROUGHLY)


def test_ticks_and_strides_are_the_same_in_any_units():
    """Arguments and results scale with length, mass and gravity, pushes and footholds too."""
    small = gpw.WALKERS["E"]
    giant = replace(
        small, thigh_length=4.0 * small.thigh_length, shank_length=4.0 * small.shank_length,
        thigh_com=4.0 * small.thigh_com, shank_com=4.0 * small.shank_com,
        thigh_mass=3.0 * small.thigh_mass, shank_mass=3.0 * small.shank_mass,
        hip_mass=3.0 * small.hip_mass, gravity=1.6,
    )  # fmt: skip
    assert giant.thigh_offset == giant.shank_offset == giant.foot_radius == 0.0
    slope, states = gait("E")
    found = []
    for walker in (small, giant):
        units = walker.units
        begun = units.to_own(small.units.to_dimensionless(states.detach().numpy()))
        given = {
            "hip_torque": 0.01 * units.torque, "ankle_torque": 0.004 * units.energy,
            "push_off": 0.01 * units.impulse, "height_change": -0.002 * units.length,
            "slope_change": 0.003,
        }  # fmt: skip
        whole = stride(walker, slope, begun, **given, tolerance=1e-12)
        part = tick(
            walker, slope, begun, **given, duration=2.0 * units.time, push=0.02 * units.impulse,
            tolerance=1e-12,
        )  # fmt: skip
        reported = [units.to_dimensionless(each.state) for each in (whole, part)]
        for each in (whole, part):
            reported += [value / UNITS[UNIT_OF[name]][1](walker, units)
                         for name, value in each._asdict().items()
                         if UNIT_OF.get(name) in UNITS]  # fmt: skip
        found.append(reported)
    for ours, theirs in zip(*found, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", ["A", "D", "lab", "lab-straight"])
def test_a_push_has_its_gradient_and_takes_what_walkers_are_made_of_with_it(name):
    """In both phases of a stride, against differences, and by the momentum that it brings."""
    slope, states = gait(name)
    mass = "hip_mass" if gpw.WALKERS[name].massless_legs else "thigh_mass"
    inputs = states, number([0.03, -0.02]), number(getattr(gpw.WALKERS[name], mass))
    late = 0.8 * float(gpw.find_gait(name, slope).stride.duration)
    for phase in (torch.tensor([0, 0]), tick(name, slope, states, 0.0, duration=late).phase):

        def walk(states, push, value, phase=phase):
            reported = tick(
                name, slope, states, 0.0, duration=0.1, phase=phase, push=push,
                parameters={mass: value}, tolerance=1e-13,
            )  # fmt: skip
            return reported.state, *reported[2:5]

        assert torch.autograd.gradcheck(walk, inputs, **THOROUGHLY)
    still = tick(name, slope, states, 0.0, duration=1e-9)
    pushed = tick(name, slope, states, 0.0, duration=1e-9, push=0.01)
    assert (pushed.state[:, 3] < still.state[:, 3]).all()  # the stance leg goes downhill faster


def test_round_feet_bear_no_ankle_torque_in_torch_either():
    slope, states = gait("lab")
    with pytest.raises(ValueError, match="ankle_torque needs point feet"):
        stride("lab", slope, states, ankle_torque=number(0.1))
    with pytest.raises(ValueError, match="push_off must not be negative"):
        stride("lab", slope, states, push_off=number(-0.1))
    slope, states = gait("B")  # its feet count as the parameters say
    point, half = {"foot_radius": number(0.0)}, {"foot_radius": number([0.0, 0.2])}
    walked = stride("B", slope, states, ankle_torque=1e-4, parameters=point)
    assert (walked.ankle_work != 0.0).all()
    with pytest.raises(ValueError, match=r"foot_radius of this walker is 0\.2"):
        stride("E", slope, states, ankle_torque=1e-4, parameters=half)


@pytest.mark.parametrize("name", gpw.WALKERS)
def test_gradients_of_ticks_are_those_of_differences(name):
    """Tick by tick through a stride, so that both strikes fall within one."""
    slope, states = gait(name)
    phase, outcomes, knees = torch.tensor([0, 0]), [], 0
    parameters = {"foot_angle": number(gpw.WALKERS[name].foot_angle)}
    fifth = 0.22 * float(gpw.find_gait(name, slope).stride.duration)

    def walk(states, slope, torque, duration):
        reported = tick(
            name, slope, states, torque, duration=duration, phase=phase, parameters=parameters,
            tolerance=1e-13,
        )  # fmt: skip
        return reported.state, *reported[2:8]

    while not outcomes or outcomes[-1] == Outcome.RUNNING:
        inputs = (states, number(slope), number([0.01, 0.02]), number(fifth))
        assert torch.autograd.gradcheck(walk, inputs, **THOROUGHLY)
        reported = tick(name, *inputs[1::-1], inputs[2], duration=inputs[3], phase=phase)
        assert reported.walks.all()
        knees += int(reported.phase[0] > phase[0])
        states, phase = reported.state.detach().requires_grad_(), reported.phase
        outcomes.append(int(reported.outcome[0]))
    assert outcomes[-1] == Outcome.HEELSTRIKE and len(outcomes) > 3
    assert knees == gpw.WALKERS[name].knees


@pytest.mark.parametrize("ticked", [False, True], ids=["stride", "tick"])
@pytest.mark.parametrize(
    ("name", "parameter"),
    [
        (name, x)
        for name in ("lab", "lab-straight")
        for x in ("thigh_length", "gravity", "shank_mass")
    ]
    + [("D", x) for x in ("thigh_length", "gravity", "hip_mass")],
)
def test_parameters_change_what_a_plain_torque_and_duration_come_to(name, parameter, ticked):
    """Both are held in the own units of the walker that there is with these parameters."""
    slope, states = gait(name)
    start, walker = states[0].detach(), gpw.WALKERS[name]
    value = getattr(walker, parameter)

    def walk(walker, **parameters):
        options = {"parameters": parameters, "tolerance": 1e-13}
        if ticked:
            reported = tick(walker, slope, start, 0.02, duration=0.3, **options)
            return torch.cat([reported.state, torch.stack([reported.duration, *reported[3:6]])])
        reported = stride(walker, slope, start, hip_torque=0.02, **options)
        return torch.cat([reported.state, torch.stack(reported[1:7])])

    found = torch.func.jacrev(lambda value: walk(name, **{parameter: value}))(number(value))
    more, less = value * (1.0 + 1e-6), value * (1.0 - 1e-6)
    beside = (walk(replace(walker, **{parameter: x})) for x in (more, less))
    expected = torch.sub(*beside) / (more - less)
    torch.testing.assert_close(found, expected, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize(
    "parameter", ["foot_radius", "thigh_length", "gravity", "shank_mass", "hip_stiffness"]
)
def test_gradients_are_the_stride_jacobian(parameter):
    slope, states = gait("lab")
    state, wrt = states[0].detach(), ("state", "slope", "hip_torque", parameter)
    expected = gpw.stride_jacobian("lab", slope, state, hip_torque=0.01, wrt=wrt)
    coordinates = [0, 3, 4, 5]

    def end(point, slope, torque, value):
        mirrored = torch.stack([point[0], -point[0], -point[0], *point[1:]])
        walked = stride(
            "lab", slope, mirrored, hip_torque=torque, parameters={parameter: value},
            tolerance=1e-13,
        )  # fmt: skip
        return walked.state[coordinates]

    value = number(getattr(gpw.WALKERS["lab"], parameter))
    inputs = (state[coordinates], number(slope), number(0.01), value)
    for jacobian in (torch.func.jacrev, torch.func.jacfwd):
        parts = jacobian(end, argnums=(0, 1, 2, 3))(*inputs)
        found = torch.cat([parts[0], *(x[:, None] for x in parts[1:])], 1).detach()
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-10)


def test_ticks_one_after_another_make_the_stride():
    slope, states = gait("lab")
    torque = number([0.03, 0.02])
    at_once = stride("lab", slope, states, hip_torque=torque, tolerance=1e-13)
    here, phase, time, work, loss = states, torch.tensor([0, 0]), 0.0, 0.0, 0.0
    going = torch.tensor([True, True])
    while going.any():
        reported = tick("lab", slope, here, torque, duration=0.07, phase=phase, tolerance=1e-13)
        time, work = time + going * reported.duration, work + going * reported.hip_work_absolute
        loss = loss + going * reported.collision_loss
        here = torch.where(going[:, None], reported.state, here)
        phase = torch.where(going, reported.phase, phase)
        going = going & (reported.outcome == Outcome.RUNNING)
    losses = at_once.kneestrike_loss + at_once.heelstrike_loss
    pairs = (
        (here, at_once.state), (time, at_once.duration), (work, at_once.hip_work_absolute),
        (loss, losses),
    )  # fmt: skip
    for found, expected in pairs:
        torch.testing.assert_close(found, expected, rtol=1e-11, atol=1e-11)
        gradients = (
            torch.autograd.grad(x.sum(), (states, torque), retain_graph=True)
            for x in (found, expected)
        )
        for a, b in zip(*gradients, strict=True):
            torch.testing.assert_close(a, b, rtol=1e-8, atol=1e-8)


def test_ticks_of_a_gait_go_as_far_as_its_step_is_long():
    found = gpw.find_gait("lab", 0.036)
    here, phase, far, outcome = number(found.state), 0, 0.0, Outcome.RUNNING
    while outcome == Outcome.RUNNING:
        moved = tick("lab", 0.036, here, 0.0, duration=0.07, phase=phase)
        here, phase, far = moved.state, moved.phase, far + moved.distance.item()
        outcome = int(moved.outcome)
    assert far == pytest.approx(found.step_length, rel=1e-8)


def test_a_fall_has_no_gradient_and_a_warning():
    slope, states = gait("lab")
    with torch.no_grad():
        states[1, 3] *= 0.3  # too slow for the top
    torque = number([0.01, 0.01])
    walked = stride("lab", slope, states, hip_torque=torque)
    assert walked.walks.tolist() == [True, False]
    assert walked.outcome.tolist() == [Outcome.HEELSTRIKE, Outcome.FELL_BACKWARD]
    assert walked.step_length[1] == 0.0 and torch.isnan(walked.margin[1])
    sum(x.sum() for x in walked[:11]).backward()
    assert (states.grad[1] == 0.0).all() and torque.grad[1] == 0.0
    alone = states[:1].detach().requires_grad_()
    sum(x.sum() for x in stride("lab", slope, alone, hip_torque=0.01)[:11]).backward()
    torch.testing.assert_close(states.grad[:1], alone.grad)


def test_a_control_step_that_ends_in_a_fall_has_no_gradient():
    slope, states = gait("lab")
    with torch.no_grad():
        states[1, 3] *= 0.3
    moved = tick("lab", slope, states, 0.01, duration=6.0)
    assert moved.outcome.tolist() == [Outcome.HEELSTRIKE, Outcome.FELL_BACKWARD]
    for values in (moved.distance, moved.state.sum(dim=1)):
        (grad,) = torch.autograd.grad(values.sum(), states, retain_graph=True)
        assert (grad[0] != 0.0).any() and (grad[1] == 0.0).all()
    gravity = number([9.81, 9.81])  # it changes the units
    moved = tick("lab", slope, states, 0.01, duration=6.0, parameters={"gravity": gravity})
    for values in (moved.distance, moved.duration, moved.state.sum(dim=1), moved.hip_work):
        (grad,) = torch.autograd.grad(values.sum(), gravity, retain_graph=True)
        assert grad[0] != 0.0 and grad[1] == 0.0


def test_strides_that_are_given_up_or_have_no_start_have_no_gradient():
    slope, states = gait("lab")
    stalled = stride("lab", slope, states, max_stride_time=0.5)
    assert stalled.outcome.tolist() == [Outcome.STALLED] * 2
    with torch.no_grad():
        states[0, 0] = float("nan")
    walked = stride("lab", slope, states)
    assert walked.outcome.tolist() == [Outcome.DIVERGED, Outcome.HEELSTRIKE]
    (stalled.state.sum() + walked.state[1].sum()).backward()
    assert (states.grad[0] == 0.0).all()


def test_vmap_is_a_larger_batch():
    _, states = gait("lab")
    several = torch.stack([states, 0.999 * states, 1.001 * states]).detach()
    slopes = torch.tensor([0.036, 0.035, 0.037], dtype=torch.float64)

    def length(states, slope):
        return stride("lab", slope, states).step_length

    found = torch.func.vmap(length)(several, slopes)
    each = torch.stack([length(x, y) for x, y in zip(several, slopes, strict=True)])
    assert torch.equal(found, each)
    gradient = torch.func.grad(lambda states, slope: length(states, slope).sum())
    found = torch.func.vmap(gradient)(several, slopes)
    each = torch.stack([gradient(x, y) for x, y in zip(several, slopes, strict=True)])
    assert torch.equal(found, each) and (found != 0.0).any()


@pytest.mark.filterwarnings("ignore:The .grad attribute of a Tensor")  # torch itself looks there
def test_a_compiled_function_leaves_strides_out_as_the_page_says():
    slope, states = gait("lab")
    left_out = torch.compiler.disable(stride)
    net = torch.nn.Linear(6, 1, dtype=torch.float64)

    def loss(states):
        torques = 1e-3 * net(states)[:, 0]
        return (left_out("lab", slope, states, hip_torque=torques).state ** 2).sum()

    found = [torch.autograd.grad(each(states), [states, *net.parameters()])
             for each in (loss, torch.compile(loss, backend="eager"))]  # fmt: skip
    for plain, compiled in zip(*found, strict=True):
        torch.testing.assert_close(compiled, plain, rtol=1e-12, atol=0.0)


def test_the_gradient_of_a_weighted_loss_has_a_derivative_by_the_weights():
    """It is linear in them, so that no second derivative of the walk is needed."""
    slope, states = gait("A")
    state, weights = states[0].detach(), torch.tensor([2.0, -3.0], dtype=torch.float64)

    def measures(state):
        found = stride("A", slope, state)
        return torch.stack([found.step_length, found.duration])

    def gradient(weights):
        return torch.func.grad(lambda state: weights @ measures(state))(state)

    expected = torch.func.jacrev(measures)(state)
    for way in (torch.func.jacfwd, torch.func.jacrev):
        torch.testing.assert_close(way(gradient)(weights), expected.T)


def test_second_derivatives_are_refused():
    slope, states = gait("A")

    def length(state):
        return stride("A", slope, state).step_length

    first, second = torch.func.jacrev, torch.func.jacfwd
    for twice in (first(first(length)), first(second(length)), second(first(length))):
        with pytest.raises(NotImplementedError, match="first derivatives only"):
            twice(states[0].detach())
    (gradient,) = torch.autograd.grad(length(states[0]), states, create_graph=True)
    with pytest.raises(NotImplementedError, match="first derivatives only"):
        gradient.sum().backward()


def test_what_makes_no_sense_is_refused():
    slope, states = gait("lab")
    with pytest.raises(TypeError, match=r"state is torch.float32: give state.double\(\)"):
        stride("lab", slope, states.float())
    with pytest.raises(TypeError, match="hip_torque is on meta"):
        stride("lab", slope, states, hip_torque=torch.zeros(2, dtype=torch.float64, device="meta"))
    with pytest.raises(
        gpw.models.walkers.WalkerError, match=r"this walker has no knee.*; it has thigh_length"
    ):
        stride("lab", slope, states, parameters={"knee": number(0.3)})
    with pytest.raises(gpw.models.walkers.WalkerError, match="foot_radius must lie from 0"):
        stride("lab", slope, states, parameters={"foot_radius": number(3.0)})
    simplest, start = gait("D")
    with pytest.raises(ValueError, match=r"a leg has mass with shank_mass = 0\.1"):
        stride("D", simplest, start, parameters={"shank_mass": [0.0, 0.1]})
    with pytest.raises(ValueError, match="a leg has no mass with thigh_mass, shank_mass, hip_mass"):
        stride("E", slope, states, parameters={"thigh_mass": 0.0, "shank_mass": 0.0, "hip_mass": 1})
    with pytest.raises(ValueError, match=r"state must have shape \(6,\) or \(n, 6\)"):
        stride("lab", slope, states[:, :4])
    with pytest.raises(ValueError, match=r"state is \(2, 6\), and slope \(3,\)$"):
        stride("lab", number([0.03] * 3), states)
    with pytest.raises(ValueError, match="tolerance must be"):
        stride("lab", slope, states, tolerance=0.0)
    for phase, said in ((2, "0 to 1, .* 'lab' .* not 2"), (-1, "not -1"), (0.5, "whole number")):
        with pytest.raises(ValueError, match=f"phase must be .*{said}"):
            tick("lab", slope, states, duration=0.1, phase=phase)
