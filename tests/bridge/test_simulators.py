"""Files of walkers in Pinocchio and Drake; `nox -s simulators` installs them."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.rimless_wheel import RIMLESS_WHEEL, closed_form
from tests.bridge.models import (
    LENGTH,
    MASS,
    MODELS,
    joints_of,
    motions,
    options,
    own_kinetic_energy,
    own_mass_matrix,
    pose_of,
    random_state,
)

SLOPE = 0.05
CLOSE = {"rtol": 0.0, "atol": 1e-12}


@pytest.fixture(params=MODELS)
def model(request):
    """Each walker and system that has a file."""
    return MODELS[request.param]


def written(model, folder, ending):
    """The path of a model's file."""
    path = folder / f"walker.{ending}"
    gpw.export(model, path, **options(model))
    return str(path)


def random_motions(model, count=5):
    """Random coordinates and velocities of a file, and the states of the model."""
    rng = np.random.default_rng(0)
    for _ in range(count):
        state = random_state(model, rng)
        yield (state, *pose_of(model, SLOPE, state))


def check_mass_matrix(model, state, full):
    """Check a mass matrix of the file's coordinates against the model's own."""
    own, ways = own_mass_matrix(model, state), motions(model, SLOPE, state)
    if not isinstance(model, gpw.Walker):
        ways = ways / (9.81 / LENGTH) ** 0.5
    np.testing.assert_allclose(
        ways.T @ full @ ways / np.abs(own).max(), own / np.abs(own).max(), **CLOSE
    )


def bias_of_mujoco(path):
    """A function of coordinates and velocities: velocity-dependent forces and weights."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(path)
    data = mujoco.MjData(model)

    def bias(positions, velocities):
        data.qpos[:], data.qvel[:] = positions, velocities
        mujoco.mj_forward(model, data)
        return data.qfrc_bias.copy()

    return bias


def test_pinocchio_has_the_mass_matrix_energy_and_bias(model, tmp_path):
    pinocchio = pytest.importorskip("pinocchio")
    path = written(model, tmp_path, "xml")
    made = pinocchio.buildModelFromMJCF(path)
    data, bias = made.createData(), bias_of_mujoco(path)
    unit = (model.total_mass if isinstance(model, gpw.Walker) else MASS) * 9.81
    for state, positions, velocities in random_motions(model):
        full = np.array(pinocchio.crba(made, data, positions))
        full = np.triu(full) + np.triu(full, 1).T
        check_mass_matrix(model, state, full)
        energy = pinocchio.computeKineticEnergy(made, data, positions, velocities)
        assert energy == pytest.approx(own_kinetic_energy(model, state), rel=1e-12)
        found = pinocchio.nonLinearEffects(made, data, positions, velocities)
        scale = max(unit, np.abs(found).max())
        np.testing.assert_allclose(found / scale, bias(positions, velocities) / scale, **CLOSE)


def test_pinocchio_reads_the_urdf_with_the_same_energy(model, tmp_path):
    pinocchio = pytest.importorskip("pinocchio")
    made = pinocchio.buildModelFromUrdf(written(model, tmp_path, "urdf"))
    data, order = made.createData(), [*joints_of(model)[3:]]
    places = [order.index(name) for name in [*made.names][2:]]  # it sorts joints by their names
    for state, positions, velocities in random_motions(model):
        (x, z, pitch, *hinges), (vx, vz, *rates) = positions, velocities
        sine, cosine = math.sin(pitch), math.cos(pitch)  # velocities are those of the body's frame
        base = [cosine * vx + sine * vz, cosine * vz - sine * vx, rates[0]]
        moved = [*base, *(rates[1 + place] for place in places)]
        energy = pinocchio.computeKineticEnergy(
            made,
            data,
            np.array([x, z, cosine, sine, *(hinges[place] for place in places)]),
            np.array(moved),
        )
        assert energy == pytest.approx(own_kinetic_energy(model, state), rel=1e-12)


def test_pinocchio_knows_no_slope_that_is_tilted_gravity(tmp_path):
    """The trap that files avoid: they tilt the ground, which readers keep or leave to the user."""
    pinocchio, mujoco = map(pytest.importorskip, ("pinocchio", "mujoco"))
    path = tmp_path / "lab.xml"
    gpw.export("lab", path)
    weight = f"{9.81 * math.sin(SLOPE)!r} 0 {-9.81 * math.cos(SLOPE)!r}"
    text = path.read_text("utf-8")
    tilted = re.sub('gravity="[^"]*"', f'gravity="{weight}"', text)
    assert tilted != text
    path.write_text(tilted, "utf-8")
    for found, tilt in (
        (mujoco.MjModel.from_xml_path(str(path)).opt.gravity, SLOPE),
        (pinocchio.buildModelFromMJCF(str(path)).gravity.linear, 0.0),
    ):
        assert math.atan2(found[0], -found[2]) == pytest.approx(tilt, abs=1e-12)


def plant_of(path):
    """Drake's plant of a file, with a context."""
    parsing = pytest.importorskip("pydrake.multibody.parsing")
    from pydrake.multibody.plant import MultibodyPlant

    plant = MultibodyPlant(0.0)
    parsing.Parser(plant).AddModels(path)
    plant.Finalize()
    return plant, plant.CreateDefaultContext()


def test_drake_has_the_mass_matrix_and_the_bias(model, tmp_path):
    plant, context = plant_of(written(model, tmp_path, "sdf"))
    bias = bias_of_mujoco(written(model, tmp_path, "xml"))
    unit = (model.total_mass if isinstance(model, gpw.Walker) else MASS) * 9.81
    for state, positions, velocities in random_motions(model):
        plant.SetPositionsAndVelocities(context, np.concatenate([positions, velocities]))
        check_mass_matrix(model, state, plant.CalcMassMatrix(context))
        gravity = plant.CalcGravityGeneralizedForces(context)
        found = plant.CalcBiasTerm(context) - gravity
        scale = max(unit, np.abs(found).max())
        np.testing.assert_allclose(found / scale, bias(positions, velocities) / scale, **CLOSE)


@pytest.mark.parametrize("ending", ["xml", "urdf"])
def test_drake_reads_the_other_formats_with_the_same_energy(model, ending, tmp_path):
    plant, context = plant_of(written(model, tmp_path, ending))
    for state, positions, velocities in random_motions(model, 2):
        plant.SetPositionsAndVelocities(context, np.concatenate([positions, velocities]))
        energy = plant.CalcKineticEnergy(context)
        assert energy == pytest.approx(own_kinetic_energy(model, state), rel=1e-12)


def simulated(system, state, end):
    """States of one of Drake's examples: before the first impact and after it, and its time."""
    from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator

    def started():
        context = system.CreateDefaultContext()
        context.get_mutable_continuous_state_vector().SetFromVector(state)
        context.SetAccuracy(1e-12)
        simulator = Simulator(system, context)
        integrator = ResetIntegratorFromFlags(simulator, "runge_kutta5", 0.01)
        integrator.set_target_accuracy(1e-12)
        simulator.Initialize()
        return simulator, context

    simulator, context = started()
    seen = []
    simulator.set_monitor(
        lambda here: seen.append(
            (here.get_time(), here.get_continuous_state_vector().CopyToVector())
        )
    )
    simulator.AdvanceTo(end)
    k = next(i for i in range(1, len(seen)) if abs(seen[i][1][0] - seen[i - 1][1][0]) > 0.2)
    time, before = seen[k - 1]
    simulator, context = started()
    simulator.AdvanceTo(time)
    simulator.AdvancePendingEvents()
    return time, before, context.get_continuous_state_vector().CopyToVector()


def test_drake_s_compass_walker_has_the_same_stride():
    examples = pytest.importorskip("pydrake.examples")
    system = examples.CompassGait()
    own = system.CreateDefaultContext().get_numeric_parameter(0)
    length = own.length_leg()
    walker = gpw.Walker(
        thigh_length=0.5 * length, thigh_mass=own.mass_leg(), thigh_com=own.center_of_mass_leg(),
        shank_length=0.5 * length, shank_mass=0.0, hip_mass=own.mass_hip(), knees=False,
        gravity=own.gravity(),
    )  # fmt: skip
    slope = own.slope()
    gait = gpw.find_gait(walker, slope)
    stance, swing, _, stance_rate, swing_rate, _ = gait.state.tolist()
    start = np.array([slope - stance, slope - swing, -stance_rate, -swing_rate])
    time, before, after = simulated(system, start, 1.02 * gait.step_period)
    assert time == pytest.approx(gait.step_period, abs=1e-12)
    assert before[:2] == pytest.approx([slope - swing, slope - stance], abs=1e-10)
    assert after == pytest.approx(start, abs=1e-9)


def test_drake_s_rimless_wheel_has_the_same_stride():
    examples = pytest.importorskip("pydrake.examples")
    system = examples.RimlessWheel()
    own = system.CreateDefaultContext().get_numeric_parameter(0)
    wheel = RIMLESS_WHEEL.vary(half=math.pi / own.number_of_spokes(), inertia=0.0)
    gait = gpw.find_gait(wheel, own.slope())
    rate, _ = closed_form(wheel.body, own.slope())
    unit = math.sqrt(own.length() / own.gravity())
    angle, found = gait.state
    assert found == pytest.approx(rate, abs=1e-9)
    start = np.array([own.slope() - angle, -found / unit])
    time, _, after = simulated(system, start, 1.05 * gait.step_period * unit)
    assert time == pytest.approx(gait.step_period * unit, abs=1e-11)
    assert after == pytest.approx(start, abs=1e-8)
