"""An attribute of results has one meaning and one unit, whatever the result."""

import dataclasses
import inspect
from pathlib import Path

import numpy as np
import pytest
import torch

import gym_passive_walker as gpw
from gym_passive_walker.envs.evaluation.walks import Walks
from gym_passive_walker.gaits.measures import (
    MEASURES,
    SHARES,
    SYMBOLS,
    UNIT_OF,
    InUnits,
    collision_cost,
    cost_of_transport,
)
from gym_passive_walker.gaits.stride import _Fields
from gym_passive_walker.models.units import UNITS
from gym_passive_walker.torch import initial_state, rollout
from gym_passive_walker.torch import stride as torch_stride
from gym_passive_walker.torch.walks import Stride as TorchStride


@pytest.fixture(scope="module", params=[("C", 0.06, (-0.001, 0.0, 0.01)),
                                        ("E", 0.004, (-0.0003, 0.001, 0.01))])  # fmt: skip
def gait(request):
    """Gaits of a walker with knees, and of one with every actuator; the hip brakes."""
    walker, slope, held = request.param
    held = gpw.Actuation.dimensionless(*held)
    return gpw.find_gait(gpw.stride_map(walker, slope, controller=held))


def attributes(of):
    """Names of the fields and properties of a class."""
    names = {*getattr(of, "_fields", ()), *getattr(of, "__dataclass_fields__", ())}
    names |= {name for name, _ in inspect.getmembers(of, inspect.isdatadescriptor)}
    return {name for name in names if not name.startswith("_")} - {"units", "dimensionless"}


RESULTS = [of for name in gpw.__all__ if inspect.isclass(of := getattr(gpw, name))
           if issubclass(of, InUnits)]  # fmt: skip
PARAMETER = {"value", "axis"}
"""The quantity that a family varies has the unit of its own parameter."""


@pytest.mark.parametrize("of", RESULTS, ids=lambda of: of.__name__)
def test_each_attribute_of_a_result_has_its_unit_in_the_table(of):
    assert not attributes(of) - UNIT_OF.keys() - PARAMETER
    assert {UNIT_OF[x] for x in attributes(of) - PARAMETER} <= {*UNITS, "", "state", "controls"}


def test_the_results_in_a_walker_s_units_are_those_that_report_walks():
    named = "Basin BifurcationDiagram Gait GaitFamily OptimalGait RealityCheck Stride Trajectory"
    assert {of.__name__ for of in RESULTS} == {*named.split(), "VelocityPerturbations"}
    recorded = {each.name for each in MEASURES if not callable(each.of)}
    assert recorded == {*_Fields._fields} - {"state", "outcome", "walker"}
    assert recorded <= {*TorchStride._fields}


def views(gait):
    """Dimensionless quantities of one stride of a walk, by each type that reports it."""
    walker, slope, units = gait.walker, gait.slope, gait.units
    most = {channel: abs(held) for channel, held in zip(("hip_torque", "ankle_torque", "push_off"),
            gait.dimensionless.controller, strict=True) if held}  # fmt: skip
    scene = {"walker": walker, "slope": slope, "tick": 10.0, "tolerance": 1e-10,
             "actions": [x.removesuffix("_torque") for x in most], "end_on_toe_stub": False,
             **{f"max_{channel}": held for channel, held in most.items()}}  # fmt: skip
    held = gait.controller._asdict()
    found = torch_stride(walker, slope, torch.tensor(gait.state), tolerance=1e-12, **held)
    own = {name: x.item() / UNITS[UNIT_OF[name]][1](gait.walker, units)
           for name, x in found._asdict().items() if UNIT_OF.get(name) in UNITS}  # fmt: skip
    first = initial_state(scene, 1, seed=0)
    states = torch.tensor(gait.dimensionless.state)[None]
    steps = []
    scene["reward"] = lambda step: steps.append(step) or step.distance
    rollout(lambda seen: torch.tensor([[-1.0, *[1.0] * (len(most) - 1)]]).double(), scene, 1,
            start=first._replace(states=states, starts=states[:, :1]))  # fmt: skip
    step = {name: x.item() for name, x in steps[-1]._asdict().items()
            if isinstance(x, torch.Tensor) and x.numel() == 1}  # fmt: skip
    made, table = gait.dimensionless.stride, gpw.measures(gait).dimensionless
    lasting = {"length": made.step_length, "gravity_work": made.gravity_work}
    lasting |= {"motor_work": gait.motor_cost * made.step_length, "duration": made.duration}
    lasting["net_work"] = lasting["motor_work"]
    episode = Walks(**{each.name: np.array([lasting.get(each.name, 1.0)])
                       for each in dataclasses.fields(Walks)} | {"endings": [""]})  # fmt: skip
    costs = ("gravity_cost", "motor_cost", "cost_of_transport", "speed")
    family = gpw.gait_family(gait.stride_map, 0.95 * slope, slope, start=gait).dimensionless
    at = int(np.argmin(np.abs(family.slope - slope)))
    names = ("step_period", "step_length", "speed", "froude_speed", "stance_angle")
    return {
        "Stride": {each.name: getattr(made, each.name) for each in MEASURES},
        "measures": {each.name: getattr(table, each.name) for each in MEASURES},
        "torch.stride": own,
        "Transition": {name: step[name] for name in step.keys() & {each.name for each in MEASURES}},
        "Walks": {name: getattr(episode, name)[0] for name in costs},
        "GaitFamily": {name: getattr(family, name)[at] for name in names},
    }


def test_one_walk_has_the_same_quantities_by_every_type(gait):
    known, compared = gait.dimensionless, 0
    for of, found in views(gait).items():
        for name, value in found.items():
            if name in {each.name for each in MEASURES} - {"duration"}:
                expected = np.nan_to_num(getattr(known, name))  # 0 in torch without kneestrike
                value = np.nan_to_num(value)
                assert value == pytest.approx(expected, rel=2e-5, abs=1e-9), (of, name)
                compared += 1
    assert compared > 60


@pytest.mark.parametrize("energy", SHARES)
def test_costs_have_one_definition(energy, gait):
    """What is spent net on a gait is what impacts and friction lose."""
    distance = gait.walker.total_mass * gait.walker.gravity * gait.step_length
    absolute = np.array([gait.hip_work_absolute, gait.ankle_work_absolute])
    net = np.array([gait.hip_work, gait.ankle_work])
    work = {"absolute": absolute, "net": net, "positive": 0.5 * (absolute + net)}[energy]
    spent = gait.gravity_work + sum(work) + gait.push_off_work
    for walk in (gait, gait.stride):
        assert cost_of_transport(walk, energy) == pytest.approx(spent / distance, rel=1e-12)
    names = [f"{energy}_{channel}_cost".removeprefix("absolute_") for channel in ("hip", "ankle")]
    np.testing.assert_allclose([getattr(gait, name) for name in names], work / distance)
    assert gait.push_off_cost == gait.push_off_work / distance > 0.0
    assert gait.motor_cost == pytest.approx((sum(absolute) + gait.push_off_work) / distance)
    assert gait.cost_of_transport == cost_of_transport(gait)
    assert collision_cost(gait) == gait.collision_cost == gait.collision_loss / distance
    lost = gait.collision_cost + gait.friction_cost
    assert cost_of_transport(gait, "net") == pytest.approx(lost, rel=1e-9)
    assert gait.cost_of_transport > lost


def test_the_glossary_has_each_quantity_with_its_unit():
    text = (Path(__file__).parents[1] / "docs" / "glossary.md").read_text(encoding="utf-8")
    for each in MEASURES:
        assert f"| `{each.name}` | {SYMBOLS.get(each.unit, 1)} | {each.about} |" in text


def test_a_dimensionless_actuation_drives_walkers_of_any_size_alike():
    held = gpw.Actuation.dimensionless(hip_torque=-0.001, push_off=0.01)
    for walker in (gpw.WALKERS["C"], dataclasses.replace(gpw.WALKERS["C"], gravity=1.62)):
        found = gpw.find_gait(gpw.stride_map(walker, 0.06, controller=held))
        assert found.froude_speed == pytest.approx(0.286117, abs=1e-6)
        assert found.controller.push_off == pytest.approx(0.01 * walker.units.impulse)
        assert found.dimensionless.controller == pytest.approx(held, rel=1e-12)
    for part in ({"push_off": -0.1}, {"ankle_torque": 0.1}, {"hip_torque": np.nan}):
        with pytest.raises(ValueError, match=next(iter(part))):
            gpw.stride_map("C", 0.0, controller=gpw.Actuation.dimensionless(**part))


def test_what_has_no_unit_has_no_dimensionless_value(gait):
    with pytest.raises(AttributeError, match="facts of Gait has no known unit"):
        _ = gait.dimensionless.facts
