"""A tree of rigid bodies as URDF, the format of ROS, and as SDF, that of Gazebo and Drake."""

from __future__ import annotations

import math
from typing import Any
from xml.etree import ElementTree as ET

from gym_passive_walker.bridge.mjcf import FRICTION, LIGHTEST, POINT, at, spelled, xml_text
from gym_passive_walker.bridge.rigid import Body, Foot, Tree, foot_names

_WIDTH = 0.02  # of a foot, in m
_FREE = spelled(1e6)  # limit of an effort or a speed that has none
_QUARTER = spelled(0.5 * math.pi, 0.0, 0.0)


def _flat(place: tuple[float, float]) -> str:
    """A point (x, z) in frames that lie in the plane: x and y."""
    return spelled(place[0], place[1], 0.0)


def urdf(tree: Tree, about: str = "") -> str:
    """Return a tree as URDF.

    The frames of all links lie in the plane, y up and z across it. So the first joint is planar
    with the axis z, which all readers take alike.
    """
    root = ET.Element("robot", name=tree.name)
    if about:
        root.append(ET.Comment(about))
    ET.SubElement(root, "link", name="world")
    for body in tree.bodies:
        link = ET.SubElement(root, "link", name=body.name)
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "origin", xyz=_flat(body.com))
        ET.SubElement(inertial, "mass", value=spelled(body.mass))
        spins = dict.fromkeys(("ixx", "iyy", "izz"), spelled(max(body.inertia, LIGHTEST)))
        ET.SubElement(inertial, "inertia", **spins, ixy="0", ixz="0", iyz="0")
        for name, foot in foot_names(body):
            for kind in ("visual", "collision"):
                shape = ET.SubElement(link, kind, name=name)
                ET.SubElement(shape, "origin", xyz=_flat(foot.centre))
                ET.SubElement(ET.SubElement(shape, "geometry"), *_foot(foot))
        root.append(_joint(body, tree))
    for motor in tree.motors:
        transmission = ET.SubElement(root, "transmission", name=motor.name)
        ET.SubElement(transmission, "type").text = "transmission_interface/SimpleTransmission"
        ET.SubElement(transmission, "joint", name=motor.joint)
        ET.SubElement(transmission, "actuator", name=f"{motor.name}_motor")
    return xml_text(root)


def _foot(foot: Foot) -> tuple[str, dict[str, str]]:
    """A foot's shape: a cylinder about the axis across the plane."""
    return "cylinder", {"radius": spelled(foot.radius or POINT), "length": spelled(_WIDTH)}


def _joint(body: Body, tree: Tree) -> Any:
    """The joint of a link to its parent."""
    if body.parent is None:
        joint = ET.Element("joint", name="planar", type="planar")
        ET.SubElement(joint, "origin", rpy=_QUARTER)
    else:
        joint = ET.Element("joint", name=body.joint, type="revolute")
        ET.SubElement(joint, "origin", xyz=_flat(body.place))
        high = 0.0 if body.stop else math.pi
        ET.SubElement(
            joint, "limit", lower=spelled(-math.pi), upper=spelled(high), effort=_FREE,
            velocity=_FREE,
        )  # fmt: skip
        ET.SubElement(joint, "dynamics", damping=spelled(tree.friction.get(body.joint, 0.0)))
    ET.SubElement(joint, "parent", link=body.parent or "world")
    ET.SubElement(joint, "child", link=body.name)
    ET.SubElement(joint, "axis", xyz="0 0 1")
    return joint


def sdf(tree: Tree, slope: float, about: str = "") -> str:
    """Return a tree as SDF: a world with the tilted ground and the walker.

    Two links without mass slide along x and z, and carry the walker.
    """
    root = ET.Element("sdf", version="1.9")
    if about:
        root.append(ET.Comment(about))
    world = ET.SubElement(root, "world", name="ground and walker")
    ET.SubElement(world, "gravity").text = spelled(0.0, 0.0, -tree.gravity)
    ground = ET.SubElement(world, "model", name="ground")
    ET.SubElement(ground, "static").text = "true"
    ET.SubElement(ground, "pose").text = spelled(0.0, 0.0, 0.0, 0.0, slope, 0.0)
    link = ET.SubElement(ground, "link", name="ground")
    shape = ET.SubElement(link, "collision", name="ground")
    _add(_add(_add(shape, "geometry"), "plane"), "normal", "0 0 1")
    _surface(shape)
    model = ET.SubElement(world, "model", name=tree.name)
    before = "world"
    for name, axis in (("x", "1 0 0"), ("z", "0 0 1")):
        _massless(model, f"slider_{name}")
        joint = ET.SubElement(model, "joint", name=name, type="prismatic")
        before = _ends(joint, before, f"slider_{name}", axis)
    for body in tree.bodies:
        link = ET.SubElement(model, "link", name=body.name)
        where: dict[str, Any] = {"relative_to": body.parent} if body.parent else {}
        ET.SubElement(link, "pose", **where).text = f"{at(body.place)} 0 0 0"
        inertial = ET.SubElement(link, "inertial")
        _add(inertial, "pose", f"{at(body.com)} 0 0 0")
        _add(inertial, "mass", spelled(body.mass))
        inertia = _add(inertial, "inertia")
        for name in ("ixx", "iyy", "izz"):
            _add(inertia, name, spelled(max(body.inertia, LIGHTEST)))
        for name, foot in foot_names(body):
            for kind in ("visual", "collision"):
                shape = ET.SubElement(link, kind, name=name)
                _add(shape, "pose", f"{at(foot.centre)} {_QUARTER}")
                cylinder, sizes = _foot(foot)
                geometry = _add(_add(shape, "geometry"), cylinder)
                for size, value in sizes.items():
                    _add(geometry, size, value)
            _surface(shape)
        joint = ET.SubElement(model, "joint", name=body.joint, type="revolute")
        _ends(joint, body.parent or before, body.name, "0 -1 0", body, tree)
    return xml_text(root)


def _add(parent: Any, tag: str, text: str | None = None) -> Any:
    """Add an element with a text."""
    made = ET.SubElement(parent, tag)
    made.text = text
    return made


def _massless(model: Any, name: str) -> None:
    """Add a link without mass; one without `inertial` would have a mass of 1 kg."""
    inertial = ET.SubElement(ET.SubElement(model, "link", name=name), "inertial")
    _add(inertial, "mass", "0")
    inertia = _add(inertial, "inertia")
    for each in ("ixx", "iyy", "izz"):
        _add(inertia, each, "0")


def _ends(
    joint: Any,
    parent: str,
    child: str,
    axis: str,
    body: Body | None = None,
    tree: Tree | None = None,
) -> str:
    """Write what a joint joins, and its axis; returns the child."""
    _add(joint, "parent", parent)
    _add(joint, "child", child)
    along = _add(joint, "axis")
    _add(along, "xyz", axis)
    if body is not None and tree is not None:
        if body.stop:
            limit = _add(along, "limit")
            _add(limit, "lower", spelled(-math.pi))
            _add(limit, "upper", spelled(0.0))
        dynamics = _add(along, "dynamics")
        _add(dynamics, "damping", spelled(tree.friction.get(body.joint, 0.0)))
        _add(dynamics, "spring_stiffness", spelled(tree.stiffness.get(body.joint, 0.0)))
        _add(dynamics, "spring_reference", "0")
    return child


def _surface(shape: Any) -> None:
    """Write the friction of a collision shape."""
    ode = _add(_add(_add(shape, "surface"), "friction"), "ode")
    for each in ("mu", "mu2"):
        _add(ode, each, spelled(FRICTION))
