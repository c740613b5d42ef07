"""A tree of rigid bodies as MJCF, the format of MuJoCo."""

from __future__ import annotations

import math
from typing import Any
from xml.etree import ElementTree as ET

from gym_passive_walker.bridge.rigid import SIDES, Body, Tree, TreePose, foot_names

POINT = 1e-6
"""Radius in m of the sphere that stands for a point foot."""

TIMESTEP = 1e-3
"""Default timestep in s; `docs/simulators.md` has the error of gaits by timestep."""

SOFTNESS = 2.0
"""Time constant of contacts and latches in timesteps: the stiffest that MuJoCo allows."""

STIFF = "0.9999 0.9999 0.001"
"""Impedance of contacts and latches: nearly that of rigid ones."""

FRICTION = 0.8
"""Default coefficient of friction of foot and ground."""

LIGHTEST = 1e-14
"""Moment of inertia in kg m^2 of a point mass: about the smallest that MuJoCo takes."""

_THICKNESS = 0.015  # of a leg in pictures, in m
_COLOURS = "0.25 0.35 0.6 1", "0.85 0.45 0.2 1"  # of the first leg, and of the other one


def spelled(*values: float) -> str:
    """Numbers as text, with all their digits."""
    return " ".join(repr(float(value) + 0.0) for value in values)


def at(place: tuple[float, float]) -> str:
    """A point (x, z) as text."""
    return spelled(place[0], 0.0, place[1])


def xml_text(root: Any) -> str:
    """The text of a file."""
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def mjcf(
    tree: Tree,
    slope: float,
    timestep: float,
    pose: TreePose | None = None,
    about: str = "",
    *,
    softness: float | None = SOFTNESS,
    friction: float = FRICTION,
) -> str:
    """Return a tree as MJCF.

    Args:
        tree: The tree.
        slope: Slope of the ground in rad, positive downhill.
        timestep: Timestep in s.
        pose: Coordinates and velocities of the keyframe "gait".
        about: Text of the comment.
        softness: Time constant of contacts and latches in timesteps; None leaves MuJoCo's own.
        friction: Coefficient of friction of foot and ground.
    """
    stiff: dict[str, Any] = {}
    if softness is not None:
        stiff = {"solref": spelled(softness * timestep, 1.0), "solimp": STIFF}
    root = ET.Element("mujoco", model=tree.name)
    if about:
        root.append(ET.Comment(about))
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    ET.SubElement(
        root, "option", timestep=spelled(timestep), gravity=spelled(0.0, 0.0, -tree.gravity),
        cone="elliptic", integrator="RK4",
    )  # fmt: skip
    ET.SubElement(ET.SubElement(root, "visual"), "headlight", ambient="0.4 0.4 0.4")
    ET.SubElement(
        ET.SubElement(root, "asset"), "texture", type="skybox", builtin="flat", rgb1="1 1 1",
        width="32", height="32",
    )  # fmt: skip
    world = ET.SubElement(root, "worldbody")
    ET.SubElement(
        world, "geom", name="ground", type="plane", size="0 0 1", euler=spelled(0.0, slope, 0.0),
        contype="1", conaffinity="0", rgba="0.8 0.8 0.8 1",
    )  # fmt: skip
    sliding = {"friction": spelled(friction, 0.0, 0.0)}
    places: dict[str | None, Any] = {None: world}
    for body in tree.bodies:
        places[body.name] = _body(places[body.parent], body, tree, stiff, stiff | sliding)
    if tree.motors:
        actuators = ET.SubElement(root, "actuator")
        for motor in tree.motors:
            ET.SubElement(
                actuators, "motor", name=motor.name, joint=motor.joint, gear=spelled(motor.gear)
            )
    if knees := [body.joint for body in tree.bodies if body.stop]:
        latches = ET.SubElement(root, "equality")
        for knee in knees:
            ET.SubElement(
                latches, "joint", name=f"{knee}_latch", joint1=knee, polycoef="0 0 0 0 0",
                active="false", **stiff,
            )  # fmt: skip
    if pose is not None:
        keys = ET.SubElement(root, "keyframe")
        ET.SubElement(keys, "key", name="gait", qpos=spelled(*pose[0]), qvel=spelled(*pose[1]))
    return xml_text(root)


def _body(
    parent: Any, body: Body, tree: Tree, stiff: dict[str, Any], contact: dict[str, Any]
) -> Any:
    """Add a body to its parent."""
    here = ET.SubElement(parent, "body", name=body.name, pos=at(body.place))
    inertia = spelled(*[max(body.inertia, LIGHTEST)] * 3)
    mass = spelled(body.mass)
    ET.SubElement(here, "inertial", pos=at(body.com), mass=mass, diaginertia=inertia)
    if body.parent is None:
        for name, axis in (("x", "1 0 0"), ("z", "0 0 1")):
            ET.SubElement(here, "joint", name=name, type="slide", axis=axis)
    hinge: dict[str, Any] = {"name": body.joint, "type": "hinge", "axis": "0 -1 0"}
    if body.stop:
        limits = {f"{name}limit": value for name, value in stiff.items()}
        hinge |= {"range": spelled(-math.pi, 0.0), **limits}
    if k := tree.stiffness.get(body.joint):
        hinge["stiffness"] = spelled(k)
    if c := tree.friction.get(body.joint):
        hinge["damping"] = spelled(c)
    ET.SubElement(here, "joint", **hinge)
    unseen: dict[str, Any] = {"contype": "0", "conaffinity": "0", "mass": "0"}
    unseen["rgba"] = _COLOURS[body.name.startswith(SIDES[1])]
    if math.hypot(*body.end) > 0.0:
        ET.SubElement(
            here, "geom", type="capsule", size=spelled(_THICKNESS), **unseen,
            fromto=f"0.0 0.0 0.0 {at(body.end)}",
        )  # fmt: skip
    for name, foot in foot_names(body):
        (x, z), half = foot.centre, _THICKNESS * (1 + body.name.startswith(SIDES[1]))
        if foot.radius:  # drawn as a disc, through which the legs are seen
            disc: dict[str, Any] = unseen | {"rgba": unseen["rgba"].rpartition(" ")[0] + " 0.4"}
            ET.SubElement(
                here, "geom", type="cylinder", size=spelled(foot.radius), **disc,
                fromto=spelled(x, -half, z, x, half, z),
            )  # fmt: skip
        ET.SubElement(
            here, "geom", name=name, type="sphere", pos=at(foot.centre),
            size=spelled(foot.radius or POINT), contype="0", conaffinity="1", mass="0",
            condim="3", priority="1", group="3", **contact,
        )  # fmt: skip
    return here
