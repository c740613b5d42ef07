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
                ET.SubElement(ET.SubElement(shape, "geometry"), "cylinder", _sizes(foot))
        root.append(_joint(body, tree))
    for motor in tree.motors:
        transmission = ET.SubElement(root, "transmission", name=motor.name)
        ET.SubElement(transmission, "type").text = "transmission_interface/SimpleTransmission"
        ET.SubElement(transmission, "joint", name=motor.joint)
        ET.SubElement(transmission, "actuator", name=f"{motor.name}_motor")
    return xml_text(root)


def _sizes(foot: Foot) -> dict[str, str]:
    """Sizes of a foot, which is a cylinder about the axis across the plane."""
    return {"radius": spelled(foot.radius or POINT), "length": spelled(_WIDTH)}


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
    _add(world, "gravity", spelled(0.0, 0.0, -tree.gravity))
    ground = ET.SubElement(world, "model", name="ground")
    _add(ground, "static", "true")
    _add(ground, "pose", spelled(0.0, 0.0, 0.0, 0.0, slope, 0.0))
    link = ET.SubElement(ground, "link", name="ground")
    shape = ET.SubElement(link, "collision", name="ground")
    _add(shape, "geometry/plane/normal", "0 0 1")
    _surface(shape)
    model = ET.SubElement(world, "model", name=tree.name)
    before = "world"
    for name, axis in (("x", "1 0 0"), ("z", "0 0 1")):
        slider = f"slider_{name}"
        _inertial(ET.SubElement(model, "link", name=slider), "0", "0")
        _axis(model, name, "prismatic", before, slider, axis)
        before = slider
    for body in tree.bodies:
        link = ET.SubElement(model, "link", name=body.name)
        where: dict[str, Any] = {"relative_to": body.parent} if body.parent else {}
        ET.SubElement(link, "pose", **where).text = f"{at(body.place)} 0 0 0"
        moment = spelled(max(body.inertia, LIGHTEST))
        _inertial(link, spelled(body.mass), moment, f"{at(body.com)} 0 0 0")
        for name, foot in foot_names(body):
            for kind in ("visual", "collision"):
                shape = ET.SubElement(link, kind, name=name)
                _add(shape, "pose", f"{at(foot.centre)} {_QUARTER}")
                cylinder = _add(shape, "geometry/cylinder")
                for size, value in _sizes(foot).items():
                    _add(cylinder, size, value)
            _surface(shape)
        parent = body.parent or before
        axis = _axis(model, body.joint, "revolute", parent, body.name, "0 -1 0")
        if body.stop:
            limit = _add(axis, "limit")
            _add(limit, "lower", spelled(-math.pi))
            _add(limit, "upper", spelled(0.0))
        dynamics = _add(axis, "dynamics")
        _add(dynamics, "damping", spelled(tree.friction.get(body.joint, 0.0)))
        _add(dynamics, "spring_stiffness", spelled(tree.stiffness.get(body.joint, 0.0)))
        _add(dynamics, "spring_reference", "0")
    return xml_text(root)


def _add(parent: Any, path: str, text: str | None = None) -> Any:
    """Add elements, each in the one before, with a text in the last, which is returned."""
    for tag in path.split("/"):
        parent = ET.SubElement(parent, tag)
    parent.text = text
    return parent


def _inertial(link: Any, mass: str, moment: str, pose: str | None = None) -> None:
    """Add the mass of a link, which would be 1 kg without."""
    inertial = _add(link, "inertial")
    if pose is not None:
        _add(inertial, "pose", pose)
    _add(inertial, "mass", mass)
    inertia = _add(inertial, "inertia")
    for name in ("ixx", "iyy", "izz"):
        _add(inertia, name, moment)


def _axis(model: Any, name: str, kind: str, parent: str, child: str, along: str) -> Any:
    """Add a joint, and return its axis."""
    joint = ET.SubElement(model, "joint", name=name, type=kind)
    _add(joint, "parent", parent)
    _add(joint, "child", child)
    axis = _add(joint, "axis")
    _add(axis, "xyz", along)
    return axis


def _surface(shape: Any) -> None:
    """Write the friction of a collision shape."""
    ode = _add(shape, "surface/friction/ode")
    for each in ("mu", "mu2"):
        _add(ode, each, spelled(FRICTION))
