"""A walker's file describes the walker."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.five_links import FIVE_LINKS
from examples.torso import TORSO
from gym_passive_walker.bridge.linkage import Linkage
from gym_passive_walker.bridge.rigid import tree_of_walker
from gym_passive_walker.math import cos, sin
from tests.bridge.models import (
    LENGTH,
    MASS,
    MODELS,
    motions,
    options,
    own_kinetic_energy,
    own_mass_matrix,
    pose_of,
    random_state,
)
from tests.own.test_ground_force import of as by_equations

SLOPE = 0.05


def loaded(model, tmp_path, **more):
    """A model in MuJoCo, from its file."""
    mujoco = pytest.importorskip("mujoco")
    gpw.export(model, tmp_path / "walker.xml", **options(model) if not more else {}, **more)
    made = mujoco.MjModel.from_xml_path(str(tmp_path / "walker.xml"))
    return mujoco, made, mujoco.MjData(made)


def mass_matrix(mujoco, model, data):
    """MuJoCo's mass matrix at the present coordinates."""
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    return full


@pytest.mark.parametrize("name", MODELS)
def test_the_mass_matrix_of_the_file_is_the_model_s_own(name, tmp_path):
    model, rng = MODELS[name], np.random.default_rng(0)
    mujoco, made, data = loaded(model, tmp_path)
    for _ in range(5):
        state = random_state(model, rng)
        data.qpos[:], data.qvel[:] = pose_of(model, SLOPE, state)
        full, ours = mass_matrix(mujoco, made, data), own_mass_matrix(model, state)
        ways = motions(model, SLOPE, state)
        if not isinstance(model, gpw.Walker):
            ways = ways / (9.81 / LENGTH) ** 0.5
        theirs = ways.T @ full @ ways
        np.testing.assert_allclose(theirs, ours, rtol=0.0, atol=1e-12 * np.abs(ours).max())
        energy = 0.5 * data.qvel @ full @ data.qvel
        assert energy == pytest.approx(own_kinetic_energy(model, state), rel=1e-12)


@pytest.mark.parametrize("name", MODELS)
def test_every_format_has_the_same_masses_at_the_same_places(name, tmp_path):
    model = MODELS[name]
    for ending in ("xml", "urdf", "sdf"):
        gpw.export(model, tmp_path / f"walker.{ending}", **options(model))
    masses = {
        "xml": [float(e.get("mass")) for e in _elements(tmp_path / "walker.xml", "inertial")],
        "urdf": [float(e.get("value")) for e in _elements(tmp_path / "walker.urdf", "mass")],
        "sdf": [float(e.text) for e in _elements(tmp_path / "walker.sdf", "mass")][2:],
    }
    assert masses["xml"] == masses["urdf"] == masses["sdf"]
    unit = 1.0 if isinstance(model, gpw.Walker) else MASS
    assert sum(masses["xml"]) == pytest.approx(model.total_mass * unit, rel=1e-14)


def _elements(path, tag):
    return [*ET.parse(path).getroot().iter(tag)]


def test_the_keyframe_is_the_gait_on_its_slope(tmp_path):
    gait = gpw.find_gait("lab", 0.036)
    mujoco, made, data = loaded(gait, tmp_path, slope=None)
    mujoco.mj_resetDataKeyframe(made, data, made.key("gait").id)
    mujoco.mj_kinematics(made, data)
    normal = data.geom("ground").xmat.reshape(3, 3)[:, 2]
    assert normal == pytest.approx([np.sin(0.036), 0.0, np.cos(0.036)])
    heights = [data.geom(f"{side}_shank_foot").xpos @ normal - 0.2 for side in ("left", "right")]
    assert heights == pytest.approx([0.0, 0.0], abs=1e-12)  # both feet are on the ground
    foot = made.body("left_shank").id
    velocity, place = np.zeros(6), data.geom("left_shank_foot").xpos - 0.2 * normal
    mujoco.mj_forward(made, data)
    mujoco.mj_objectVelocity(made, data, mujoco.mjtObj.mjOBJ_XBODY, foot, velocity, 0)
    at_contact = velocity[3:] + np.cross(velocity[:3], place - data.body("left_shank").xpos)
    assert np.abs(at_contact).max() < 1e-12  # the stance foot rolls


def test_a_comment_says_what_a_user_of_a_simulator_must_do(tmp_path):
    for ending in ("xml", "urdf", "sdf"):
        path = tmp_path / f"walker.{ending}"
        gpw.export("lab", path)
        text = " ".join(path.read_text("utf-8").split())
        assert "Free the knee of the leg that leaves the ground before the impact" in text
        gpw.export(replace(gpw.WALKERS["lab"], knees="held"), path)
        text = " ".join(path.read_text("utf-8").split())
        assert "Free the knee of the leg that leaves the ground after the impact" in text
        gpw.export("A", path)
        assert "knee" not in path.read_text("utf-8").lower()


def test_contacts_are_as_stiff_as_the_timestep_allows(tmp_path):
    gpw.export("lab", tmp_path / "walker.xml", timestep=1e-4)
    feet = [e for e in _elements(tmp_path / "walker.xml", "geom") if e.get("conaffinity") == "1"]
    assert [foot.get("solref") for foot in feet] == ["0.0002 1.0"] * 2


def _stretched(body, state):
    *legs, torso = TORSO.links(body, state)
    return [*legs, torso._replace(y=torso.y + 0.1 * state.torso**2)]


def _turning(angle):
    """The links of the walker with a torso, which has a moment of inertia about this angle."""

    def links(body, state):
        *legs, torso = TORSO.links(body, state)
        return [*legs, torso._replace(inertia=0.1, angle=angle(state))]

    return links


def _weightless(place):
    """The links of the walker with a torso, and one without mass at a place."""

    def links(body, state):
        return [*TORSO.links(body, state), gpw.Link(0.0, *place(state))]

    return links


def _with(links):
    """The walker with a torso, with other links."""
    names = "body", "State", "landing", "relabel", "falls", "counts", "start"
    same = {name: getattr(TORSO, name) for name in names}
    return gpw.System(**same, name="changed", links=links)


@pytest.mark.parametrize(
    ("links", "said"),
    [
        (_stretched, "'changed' are no tree of bodies with hinges"),
        (
            _turning(lambda state: state.stance + state.swing),
            "link 3 of `links` turns otherwise than torso",
        ),
        (_turning(lambda state: 2.0 * state.torso), "link 3 of `links` turns otherwise than torso"),
        (
            _weightless(lambda state: (0.3 + 0.0 * state.stance, 0.0)),
            r"hinges \(a part of it is fixed to the ground\), which is what",
        ),
        (
            _weightless(lambda state: (-sin(state.torso), cos(state.torso))),
            r"\(a body hangs from two places\)",
        ),
        (
            _weightless(lambda state: (sin(state.stance) ** 2, 0.0)),
            r"\(a position is no sum of links that turn\)",
        ),
        (
            _weightless(
                lambda state: (-sin(state.stance + state.torso), cos(state.stance + state.torso))
            ),
            r"\(body_2 has no mass\)",
        ),
        (None, "the stance foot does not roll as a circle of radius 0.3"),
    ],
    ids=["stretched", "the legs' angle", "twice its angle", "fixed", "twice", "no turn",
         "weightless", "an ankle over a flat foot"],
)  # fmt: skip
def test_a_system_that_is_no_tree_of_hinges_has_no_file(links, said, tmp_path):
    system = _compass(rolls=0.0) if links is None else _with(links)
    with pytest.raises(ValueError, match=said):
        gpw.export(system, tmp_path / "walker.xml", unit_length=1.0, unit_mass=1.0)


class _Feet(NamedTuple):
    """Radii of the feet of a compass, and whether they roll."""

    stance_radius: float = 0.3
    swing_radius: float = 0.2
    rolls: float = 1.0


class _Legs(NamedTuple):
    """Angles of the legs of a compass, and their rates."""

    stance: float
    swing: float
    stance_rate: float
    swing_rate: float


def _joints(body, state):
    """Stance foot, hip and swing foot: centres of circles."""
    x, y = -body.rolls * body.stance_radius * state.stance, body.stance_radius
    one, other = 1.0 - body.stance_radius, 1.0 - body.swing_radius
    hip_x, hip_y = x - one * sin(state.stance), y + one * cos(state.stance)
    return (
        (x, y),
        (hip_x, hip_y),
        (hip_x + other * sin(state.swing), hip_y - other * cos(state.swing)),
    )


def _landing(body, state):
    *_, (x, y) = _joints(body, state)
    return x + body.rolls * body.swing_radius * state.swing, y - body.swing_radius


def _compass(**feet):
    """Walker E or B as a system, with feet of its own."""
    return gpw.System(
        name="compass", body=_Feet(**feet), State=_Legs, landing=_landing,
        links=lambda body, state: [
            gpw.Link(mass, *place)
            for mass, place in zip((0.1, 0.8, 0.1), _joints(body, state), strict=True)
        ],
        relabel=lambda body, state: (state.swing, state.stance),
        exchange={"stance_radius": "swing_radius"},
        falls={"fell_forward": lambda body, state: state.stance + 1.5},
        counts=(lambda body, state: -state.stance,),
    )  # fmt: skip


def test_a_foot_has_its_own_radius_and_may_bear_a_mass(tmp_path):
    feet = [foot for body in Linkage(_compass()).tree(2.0, 1.0).bodies for foot in body.feet]
    assert [foot.radius for foot in feet] == pytest.approx([0.6, 0.4])
    points = _compass(stance_radius=0.0, swing_radius=0.0)
    gpw.export(points, tmp_path / "walker.xml", unit_length=1.0, unit_mass=1.0)
    read = gpw.Walker.from_mjcf(tmp_path / "walker.xml")
    found = read.hip_mass, read.thigh_mass, read.thigh_com, read.leg_length
    assert found == pytest.approx((0.8, 0.1, 1.0, 1.0))


def test_the_angle_of_a_link_counts_in_either_sense_and_from_anywhere():
    usual, other = (
        Linkage(_with(_turning(angle))).tree(LENGTH, MASS)
        for angle in (lambda state: state.torso, lambda state: 0.1 - state.torso)
    )
    assert usual == other and usual.bodies[-1].inertia > 0.0


@pytest.mark.parametrize(
    ("given", "options", "said"),
    [
        ("D", {}, "legs without mass, which no rigid-body simulator can move: give them"),
        ("lab", {"format": "usd"}, "format must be one of mjcf, urdf, sdf, not 'usd'"),
        ("lab", {"path": "walker.txt"}, r"ends in \.xml, \.urdf, \.sdf, or has a format"),
        ("lab", {"timestep": 0.0}, "timestep must be a number above 0 up to 1, not 0.0"),
        ("lab", {"timestep": -1e-3}, "timestep must be a number above 0"),
        ("lab", {"path": "walker.urdf", "timestep": 1e-3}, "MJCF: a file of URDF has none"),
        ("lab", {"path": "walker.sdf", "timestep": 1e-3}, "MJCF: a file of SDF has none"),
        ("lab", {"unit_mass": 2.0}, "unit_mass is for a System"),
        (TORSO, {}, "'torso' has no units, and files are in m, kg and s: give unit_length"),
        (by_equations(), {}, "'given' is given by equations, which say nothing of its bodies"),
        (gpw.WALKERS["lab"].with_parameters(shank_gyration=0.0), {},
         "left_shank of .* has no moment of inertia about its centre of mass"),
    ],
)  # fmt: skip
def test_what_has_no_file_is_refused_in_a_sentence(given, options, said, tmp_path):
    options = {"path": "walker.xml"} | options
    path = tmp_path / options.pop("path")
    with pytest.raises(ValueError, match=said) as refused:
        gpw.export(given, path, **options)
    assert "\n" not in str(refused.value) and not path.exists()


def test_a_gait_on_footholds_has_no_file(tmp_path):
    gait = gpw.find_gait(gpw.stride_map("lab", 0.036, terrain=gpw.stairs(0.001)))
    with pytest.raises(ValueError, match="a file's walker is on a plane, and this gait has"):
        gpw.export(gait, tmp_path / "walker.xml")
    with pytest.raises(ValueError, match="a simulator walks on a plane, and this gait has"):
        gpw.compare(gait)


def test_a_file_that_cannot_be_written_is_an_os_error(tmp_path):
    with pytest.raises(OSError, match="Is a directory"):
        gpw.export("lab", tmp_path, "mjcf")


def test_the_hip_s_mass_is_that_of_one_leg():
    walker = gpw.WALKERS["lab"].with_parameters(hip_mass=1.5)
    left, _, right, _ = tree_of_walker(walker).bodies
    assert left.mass - right.mass == 1.5
    moment = np.subtract(np.multiply(left.mass, left.com), np.multiply(right.mass, right.com))
    assert np.abs(moment).max() < 1e-15


def test_motors_of_a_system_act_at_its_hinges(tmp_path):
    """The swing thigh hangs from the stance thigh, so its motor on the torso has no hinge."""
    motors = Linkage(FIVE_LINKS).tree(LENGTH, MASS).motors
    assert {motor.name for motor in motors} == {*FIVE_LINKS.controls} - {"swing_hip"}
    gpw.export(FIVE_LINKS, tmp_path / "walker.xml", **options(FIVE_LINKS))
    text = (tmp_path / "walker.xml").read_text("utf-8")
    assert "Motors that act at no hinge of this file: swing_hip." in " ".join(text.split())
