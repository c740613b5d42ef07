"""Walkers from files of other simulators: planar bodies with two legs, in MJCF or URDF.

A file becomes links in the pose in which all joints are at 0, in world coordinates. Links that are
welded together are summed. What remains must be two equal legs of one or two links.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from os import PathLike, fsdecode
from pathlib import Path
from typing import Any, NamedTuple, NoReturn
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.console import cut
from gym_passive_walker.bridge.loop import library
from gym_passive_walker.bridge.mjcf import POINT
from gym_passive_walker.models.walkers import Walker, WalkerError

Vector = NDArray[np.float64]

_CLOSE = 1e-6  # of lengths, masses and directions that have to be equal, relative
_GRAVITY = 9.81  # of URDF, which has none


class Joint(NamedTuple):
    """A joint of a link to its parent.

    Attributes:
        name: Its name.
        kind: "hinge", "slide", or "free" for one with several freedoms.
        axis: Its axis in the world, (3,).
        anchor: A point on the axis of a hinge, (3,).
        limits: Smallest and largest angle in rad; None without limits.
        stiffness: Of its spring.
        damping: Viscous friction.
        more: Names of other properties that it has, and no joint of a `Walker` has.
    """

    name: str
    kind: str
    axis: Vector
    anchor: Vector
    limits: tuple[float, float] | None = None
    stiffness: float = 0.0
    damping: float = 0.0
    more: tuple[str, ...] = ()


class Round(NamedTuple):
    """A round shape that touches the ground.

    Attributes:
        centre: Its centre, (3,).
        radius: Its radius.
        axis: Axis of a cylinder, (3,), across which it is round; None of a sphere.
    """

    centre: Vector
    radius: float
    axis: Vector | None = None


@dataclass
class Element:
    """A body of a file.

    Attributes:
        name: Its name.
        parent: Name of its parent; None below the world.
        joints: Its joints to the parent; without any it is welded to it.
        mass: Its mass.
        com: Centre of mass, (3,).
        inertia: Moments of inertia about it, (3, 3).
        feet: Its round shapes.
    """

    name: str
    parent: str | None
    joints: list[Joint]
    mass: float = 0.0
    com: Vector = field(default_factory=lambda: np.zeros(3))
    inertia: Vector = field(default_factory=lambda: np.zeros((3, 3)))
    feet: list[Round] = field(default_factory=list)

    def add(self, other: Element) -> None:
        """Weld another part to this one."""
        total = self.mass + other.mass
        if total > 0.0:
            com = (self.mass * self.com + other.mass * other.com) / total
            self.inertia = sum(
                part.inertia + part.mass * _spread(part.com - com) for part in (self, other)
            )  # type: ignore[assignment]
            self.com = com
        self.mass = total
        self.feet = [*self.feet, *other.feet]


def _spread(r: Vector) -> Vector:
    """Inertia of a unit mass at a place, (3, 3)."""
    return np.dot(r, r) * np.eye(3) - np.outer(r, r)


def read_mjcf(path: str | PathLike[str]) -> Walker:
    """Return the walker in a file of MuJoCo; see `Walker.from_mjcf`."""
    name = cut(fsdecode(path))
    _root_of(path, name, "mujoco")
    mujoco = library()
    try:
        model = mujoco.MjModel.from_xml_path(fsdecode(path))
    except ValueError as error:
        raise WalkerError(f"{name} is no model: {' '.join(str(error).split())}") from None
    data = mujoco.MjData(model)
    # A joint's angle in the file's own pose is `ref`; stops and springs count from 0.
    data.qpos[model.jnt_qposadr[model.jnt_type >= _SLIDE]] = 0.0
    mujoco.mj_kinematics(model, data)
    weightless = model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    gravity = np.zeros(3) if weightless else model.opt.gravity
    reader = _Reader(name, _parts_of_model(model, data), float(np.linalg.norm(gravity)))
    if more := _more_of_model(model):
        reader.refuse(f"{more[0]} acts on it")
    walker = reader.walker()
    if abs(reader.axis @ gravity) > _CLOSE * walker.gravity:
        reader.refuse("gravity acts across its plane")
    return walker


def read_urdf(path: str | PathLike[str], gravity: float = _GRAVITY) -> Walker:
    """Return the walker in a file of ROS; see `Walker.from_urdf`."""
    name = cut(fsdecode(path))
    root = _root_of(path, name, "robot")
    try:
        parts = _parts_of_robot(root)
    except (KeyError, ValueError, AttributeError) as error:
        raise WalkerError(f"{name} is no model: {' '.join(str(error).split())}") from None
    return _Reader(name, parts, gravity).walker()


def _root_of(path: str | PathLike[str], name: str, tag: str) -> Any:
    """Return the root element of a file.

    Raises:
        WalkerError: if it cannot be read, or is no such file.
    """
    try:
        root = ET.parse(path).getroot()
    except OSError as error:
        raise WalkerError(f"{name} cannot be read: {error.strerror or error}") from None
    except (ET.ParseError, LookupError, ValueError) as error:  # the latter of unknown encodings
        raise WalkerError(f"{name} is no model, for it is no XML: {error}") from None
    for element in root.iter():  # names may be those of a namespace
        element.tag = element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""
    if root.tag != tag:
        raise WalkerError(f"{name} is no model: its root is <{root.tag}>, and not <{tag}>")
    return root


def _parts_of_model(model: Any, data: Any) -> list[Element]:
    """Return the bodies of MuJoCo's model."""
    kinds = {0: "free", 1: "free", _SLIDE: "slide", 3: "hinge"}
    parts = []
    for i in range(1, model.nbody):
        first = model.body_jntadr[i]
        joints = [
            Joint(
                model.joint(j).name or f"joint {j}",
                kinds[int(model.jnt_type[j])],
                data.xaxis[j].copy(),
                data.xanchor[j].copy(),
                tuple(model.jnt_range[j].tolist()) if model.jnt_limited[j] else None,
                float(model.jnt_stiffness[j]),
                float(model.dof_damping[model.jnt_dofadr[j]]),
                _more_of(model, j),
            )
            for j in range(first, first + model.body_jntnum[i])
        ]
        turn = data.ximat[i].reshape(3, 3)
        above = int(model.body_parentid[i])
        part = Element(
            model.body(i).name or f"body {i}",
            (model.body(above).name or f"body {above}") if above else None,
            joints,
            float(model.body_mass[i]),
            data.xipos[i].copy(),
            turn @ np.diag(model.body_inertia[i]) @ turn.T,
        )
        for g in range(model.body_geomadr[i], model.body_geomadr[i] + model.body_geomnum[i]):
            if model.geom_contype[g] or model.geom_conaffinity[g]:
                part.feet += _round(
                    _SHAPES.get(int(model.geom_type[g]), ""), data.geom_xpos[g].copy(),
                    data.geom_xmat[g].reshape(3, 3)[:, 2], model.geom_size[g],
                )  # fmt: skip
        parts.append(part)
    return parts


def _more_of(model: Any, j: int) -> tuple[str, ...]:
    """Return the names of properties of a joint that no joint of a `Walker` has."""
    spring, freedom = model.qpos_spring[model.jnt_qposadr[j]], model.jnt_dofadr[j]
    found = {
        "armature": model.dof_armature[freedom],
        "frictionloss": model.dof_frictionloss[freedom],
        "springref": spring * (model.jnt_stiffness[j] > 0.0),
        # The coefficients of a spring or damper that is not linear, from MuJoCo 4 on.
        "stiffness of several numbers": getattr(model, "jnt_stiffnesspoly", {j: 0.0})[j],
        "damping of several numbers": getattr(model, "dof_dampingpoly", {freedom: 0.0})[freedom],
    }
    return tuple(name for name, value in found.items() if np.any(value))


def _more_of_model(model: Any) -> list[str]:
    """Return what acts on the bodies of a model and on no `Walker`."""
    tendons = model.tendon_stiffness, model.tendon_damping, model.tendon_frictionloss
    found = {
        "an equality constraint": model.eq_active0,
        "a tendon": [*tendons, model.tendon_limited],
        "gravcomp": model.body_gravcomp,
        "a fluid": [model.opt.density, model.opt.viscosity],
    }
    return [what for what, given in found.items() if np.any(given)]


_SLIDE = 2  # of mujoco.mjtJoint; angles and lengths from it on
_SHAPES = {2: "sphere", 3: "capsule", 5: "cylinder"}  # of mujoco.mjtGeom


def _round(shape: str, centre: Vector, axis: Vector, size: Any) -> list[Round]:
    """Return the round shapes of a geometry: the ends of a capsule, as the plane is not known."""
    if shape in ("sphere", "cylinder"):
        return [Round(centre, float(size[0]), axis if shape == "cylinder" else None)]
    if shape == "capsule":
        ends = (centre + sign * float(size[1]) * axis for sign in (-1.0, 1.0))
        return [Round(end, float(size[0])) for end in ends]
    return []


def _parts_of_robot(root: Any) -> list[Element]:
    """Return the links of a URDF.

    Raises:
        KeyError, ValueError or AttributeError: if something is missing.
    """
    links = {link.attrib["name"]: link for link in root.iter("link")}
    joints = {joint.find("child").attrib["link"]: joint for joint in root.findall("joint")}
    made: dict[str, tuple[Vector, Vector]] = {}

    def frame(name: str) -> tuple[Vector, Vector]:
        """Rotation (3, 3) and place (3,) of a link."""
        if name not in made:
            if name not in joints:
                return np.eye(3), np.zeros(3)
            made[name] = np.eye(3), np.zeros(3)  # ends a circle of joints
            above = joints[name].find("parent").attrib["link"]
            links[above]
            made[name] = _moved(frame(above), joints[name].find("origin"))
        return made[name]

    parts = []
    for name, link in links.items():
        turn, place = frame(name)
        above = joints[name].find("parent").attrib["link"] if name in joints else None
        own = _joints_of(joints[name], turn, place) if name in joints else []
        part = Element(name, above, own)
        inertial = link.find("inertial")
        if inertial is not None:
            turned, part.com = _moved((turn, place), inertial.find("origin"))
            part.mass = float(inertial.find("mass").attrib["value"])
            given = inertial.find("inertia")
            x, y, z = ("ixx", "ixy", "ixz"), ("ixy", "iyy", "iyz"), ("ixz", "iyz", "izz")
            if given is not None:
                rows = [[float(given.get(each, 0.0)) for each in row] for row in (x, y, z)]
                part.inertia = turned @ np.array(rows) @ turned.T
        for collision in link.findall("collision"):
            turned, centre = _moved((turn, place), collision.find("origin"))
            geometry = collision.find("geometry")
            if geometry is None or len(geometry) != 1:
                raise ValueError(f"a collision of {part.name} needs a geometry of one shape")
            (shape,) = geometry
            radius, length = (float(shape.get(each, 0.0)) for each in ("radius", "length"))
            part.feet += _round(shape.tag, centre, turned[:, 2], (radius, 0.5 * length))
        parts.append(part)
    return parts


def _moved(frame: tuple[Vector, Vector], origin: Any) -> tuple[Vector, Vector]:
    """Return a frame after the motion of an element <origin>, or of none."""
    turn, place = frame
    if origin is None:
        return frame
    shift = np.array(origin.get("xyz", "0 0 0").split(), float)
    roll, pitch, yaw = np.array(origin.get("rpy", "0 0 0").split(), float)
    about = [_turn(angle, axis) for axis, angle in enumerate((roll, pitch, yaw))]
    return turn @ about[2] @ about[1] @ about[0], place + turn @ shift


def _turn(angle: float, axis: int) -> Vector:
    """Rotation (3, 3) about one of the axes x, y and z."""
    one, other = (axis + 1) % 3, (axis + 2) % 3
    made = np.eye(3)
    made[[one, other], [one, other]] = math.cos(angle)
    made[one, other], made[other, one] = -math.sin(angle), math.sin(angle)
    return made


def _joints_of(joint: Any, turn: Vector, place: Vector) -> list[Joint]:
    """Return the joint of a URDF as a list, which is empty for a fixed one."""
    kind = joint.attrib["type"]
    if kind == "fixed":
        return []
    axis = joint.find("axis")
    along = np.array((axis.get("xyz") if axis is not None else "1 0 0").split(), float)
    kinds = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide"}
    limit, dynamics = joint.find("limit"), joint.find("dynamics")
    limits = None
    if kind == "revolute" and limit is not None and limit.get("lower") and limit.get("upper"):
        limits = float(limit.get("lower")), float(limit.get("upper"))
    given = {} if dynamics is None else dynamics.attrib
    damping, rubbing = (float(given.get(each, 0.0)) for each in ("damping", "friction"))
    more = ("friction",) * (rubbing != 0.0) + ("mimic",) * (joint.find("mimic") is not None)
    name, along = joint.attrib["name"], turn @ along / np.linalg.norm(along)
    return [Joint(name, kinds.get(kind, "free"), along, place, limits, 0.0, damping, more)]


class _Leg(NamedTuple):
    """A leg in its own frame: x forward, z up along the line from the foot's centre to the hip.

    Attributes:
        masses: Mass, (x, z) of the centre of mass from the hip and moment of inertia of each link.
        knee: Place (x, z) of the knee from the hip; None without a knee.
        leg: Distance from the hip to the foot's centre.
        radius: Radius of the foot.
        up: Direction of z in the world.
        stiffness: Of the knee's spring.
    """

    masses: list[tuple[float, Vector, float]]
    knee: Vector | None
    leg: float
    radius: float
    up: Vector
    stiffness: float


class _Reader:
    """Makes a walker of parts.

    Args:
        name: Name of the file.
        parts: Its parts, parents first or not.
        gravity: Acceleration of gravity.
    """

    def __init__(self, name: str, parts: list[Element], gravity: float) -> None:
        self.name, self.gravity = name, gravity
        self.parts = self._welded(parts)
        self.known: dict[str | None, Element] = {part.name: part for part in self.parts}
        self.below: dict[str | None, list[Element]] = {}
        for part in self.parts:
            above = part.parent if part.parent in self.known else None
            self.below.setdefault(above, []).append(part)

    def refuse(self, reason: str) -> NoReturn:
        """Raise an error.

        Raises:
            WalkerError: always.
        """
        raise WalkerError(
            f"{self.name} is no walker with two equal legs in a plane: {reason}; state other "
            "bodies as a System"
        )

    def _welded(self, parts: list[Element]) -> list[Element]:
        """Return the parts with joints, and one without; others are welded to them."""
        known = {part.name: part for part in parts}
        kept: dict[str, Element] = {}

        def carrier(name: str) -> Element:
            passed: dict[str, None] = {}
            part = known[name]
            while not part.joints and part.parent is not None:
                if part.name in passed:
                    self.refuse(f"{', '.join(passed)} are welded in a circle")
                passed[part.name] = None
                part = known[part.parent]
            return kept.setdefault(part.name, part)

        for part in parts:
            if carrier(part.name) is not part:
                carrier(part.name).add(part)
        for part in kept.values():
            if part.parent is not None:
                part.parent = carrier(part.parent).name
        # The world and links that only slide have no mass; what they carry is a base.
        return [part for part in kept.values() if part.mass > 0.0]

    def walker(self) -> Walker:
        """Return the walker."""
        bases = self.below.get(None, [])
        if len(bases) != 1:
            self.refuse(f"it has {len(bases)} bodies with mass that hang on nothing")
        base = bases[0]
        tree = [base]
        for part in tree:
            tree += self.below.get(part.name, [])
        if circle := {part.name for part in self.parts} - {part.name for part in tree}:
            self.refuse(f"{min(circle)} hangs on itself, in a circle of joints")
        for joint in base.joints:
            if joint.stiffness or joint.damping or joint.more:
                self.refuse(
                    f"{joint.name} has a spring, friction or armature, where a Walker moves freely"
                )
        for part in self.parts:
            if part is base:
                continue
            if [joint.kind for joint in part.joints] != ["hinge"]:
                kinds = [joint.name for joint in part.joints]
                self.refuse(f"{part.name} needs one hinge, and has {', '.join(kinds)}")
            if more := part.joints[0].more:
                self.refuse(
                    f"{part.joints[0].name} has {more[0]}, which a Walker's joints have not"
                )
        self.axis = self._axis()
        for part in self.parts:
            part.feet = [foot for foot in part.feet if self._is_across(foot.axis)]
        tops = self.below.get(base.name, [])
        if len(tops) > 2 - (bool(base.feet) and len(self.parts) == 3):
            self.refuse(f"{tops[-1].name} would be a third leg")
        shapes = sorted(len(self.below.get(top.name, [])) for top in tops)
        if shapes in ([1, 1], [0, 0]):
            legs: list[tuple[Element, ...]] = [(top, *self.below.get(top.name, [])) for top in tops]
            hips, rest = [top.joints[0] for top in tops], base
        elif shapes in ([0], [0, 1]):
            swing = max(tops, key=lambda top: (len(self.below.get(top.name, [])), top is tops[-1]))
            others = [top for top in tops if top is not swing]
            legs = [(base, *others), (swing, *self.below.get(swing.name, []))]
            hips, rest = [swing.joints[0]], None
        else:
            last = max(self.parts, key=self._depth)
            self.refuse(f"{last.name} is one link too many, or one of its legs has too few")
        for *_, part in legs:
            if part.name in self.below and part is not base:
                self.refuse(f"{self.below[part.name][0].name} hangs on a foot")
        hip, sense = self._hip(hips), self._sense(legs)
        found = [self._leg(leg, hip, sense) for leg in legs]
        return self._of_legs(found, legs, rest, hips)

    def _depth(self, part: Element) -> int:
        return 1 + self._depth(self.known[part.parent]) if part.parent in self.known else 0

    def _axis(self) -> Vector:
        """The direction of all hinges."""
        hinges = [part.joints[0] for part in self.parts if part.parent in self.known]
        if not hinges:
            self.refuse("it has no hinge")
        first, *others = hinges
        for other in others:
            if np.linalg.norm(np.cross(first.axis, other.axis)) > _CLOSE:
                self.refuse(f"the hinge {other.name} is not parallel to {first.name}")
        return first.axis

    def _is_across(self, axis: Vector | None) -> bool:
        """Whether a round shape is round in the plane."""
        return axis is None or bool(np.linalg.norm(np.cross(self.axis, axis)) <= _CLOSE)

    def _flat(self, vector: Vector) -> Vector:
        """A vector without its part along the hinges."""
        return vector - self.axis * (self.axis @ vector)

    def _hip(self, hips: list[Joint]) -> Vector:
        """The place of all hinges of the hip."""
        one, other = hips[0], hips[-1]
        if np.linalg.norm(self._flat(one.anchor - other.anchor)) > _CLOSE:
            self.refuse(f"{other.name} is not on the axis of {one.name}")
        return one.anchor

    def _sense(self, legs: list[tuple[Element, ...]]) -> float:
        """The sense of turns about the axis in which knees bend; 0 if no stop shows it."""
        found: dict[float, str] = {}
        for joint in (part.joints[0] for leg in legs for part in leg[1:]):
            if joint.limits is None:
                continue
            low, high = joint.limits
            if min(abs(low), abs(high)) > _CLOSE:
                self.refuse(
                    f"the stop of {joint.name} is not at 0, where the leg has to be straight, but "
                    f"at {low:g} and {high:g} rad"
                )
            way = 1.0 if abs(high) > abs(low) else -1.0
            found[math.copysign(1.0, float(self.axis @ joint.axis) * way)] = joint.name
        if len(found) == 2:
            self.refuse(f"{' and '.join(found.values())} bend opposite ways")
        return next(iter(found), 0.0)

    def _leg(self, leg: tuple[Element, ...], hip: Vector, sense: float) -> _Leg:
        """Return a leg of parts."""
        last = leg[-1]
        if not last.feet:
            self.refuse(
                f"{last.name} has no foot: a sphere, or a cylinder across the plane, that collides"
            )
        foot = max(
            last.feet, key=lambda each: np.linalg.norm(self._flat(each.centre - hip)) + each.radius
        )
        line = self._flat(hip - foot.centre)
        length = float(np.linalg.norm(line))
        if length == 0.0:
            self.refuse(f"the foot of {last.name} is at its hip")
        up = line / length
        # A turn about the axis moves the foot against the cross product of axis and up, and a knee
        # bends backwards. Without a stop of a knee, legs walk in the direction of x.
        ahead = np.cross(self.axis, up)
        forward = math.copysign(1.0, sense or ahead[0]) * ahead

        def seen(place: Vector) -> Vector:
            flat = self._flat(place - hip)
            return np.array([flat @ forward, flat @ up])

        masses = []
        for part in leg:
            spin = float(self.axis @ part.inertia @ self.axis)
            masses.append((part.mass, seen(part.com), spin))
        knee = seen(leg[1].joints[0].anchor) if len(leg) == 2 else None
        stiffness = leg[1].joints[0].stiffness if len(leg) == 2 else 0.0
        radius = foot.radius if foot.radius > POINT else 0.0
        return _Leg(masses, knee, length, radius, up, stiffness)

    def _spring(self, hips: list[Joint], legs: list[_Leg]) -> tuple[float, float]:
        """Stiffness and damping between the legs, of one hinge, or of two in series."""
        (k, c), *others = [(joint.stiffness, joint.damping) for joint in hips]
        for stiffness, damping in others:  # the point mass between them takes no moment
            if not math.isclose(k * damping, stiffness * c, rel_tol=_CLOSE):
                self.refuse(
                    f"{hips[0].name} and {hips[1].name} have springs and friction in different "
                    "proportions, which act as no spring and friction between the legs do"
                )
            k = k * stiffness / (k + stiffness) if k else 0.0
            c = c * damping / (c + damping) if c else 0.0
        if k and np.linalg.norm(legs[0].up - legs[1].up) > _CLOSE:
            self.refuse(f"the spring of {hips[0].name} is not at rest where the legs are parallel")
        return k, c

    def _of_legs(
        self,
        legs: list[_Leg],
        parts: list[tuple[Element, ...]],
        base: Element | None,
        hips: list[Joint],
    ) -> Walker:
        """Return the walker of two legs, and of a base at the hip."""
        hip, extra_mass = hips[0].anchor, 0.0
        if base is not None:
            arm = np.linalg.norm(self._flat(base.com - hip))
            spin = float(self.axis @ base.inertia @ self.axis) + base.mass * arm**2
            if spin > _CLOSE * base.mass * legs[0].leg ** 2:
                self.refuse(
                    f"{base.name} has a moment of inertia about the hip, where a Walker has a "
                    "point mass"
                )
            extra_mass = base.mass
        else:
            extra_mass = legs[0].masses[0][0] - legs[1].masses[0][0]
            if extra_mass < 0.0:
                legs, parts, extra_mass = legs[::-1], parts[::-1], -extra_mass
        self._check_equal(legs, parts, 0.0 if base is not None else extra_mass)
        leg, swing = legs[1], parts[1]
        for (mass, _, spin), part in zip(leg.masses, swing, strict=True):
            about = hip if part is swing[0] else part.joints[0].anchor
            arm = float(np.linalg.norm(self._flat(part.com - about)))
            if mass <= 0.0 or spin + mass * arm**2 <= 0.0:
                self.refuse(f"{part.name} has a mass without inertia about its hinge")
        stiffness, damping = self._spring(hips, legs)
        common: dict[str, Any] = {
            "hip_mass": extra_mass if extra_mass > _CLOSE * leg.masses[0][0] else 0.0,
            "hip_stiffness": stiffness,
            "hip_friction": damping,
            "gravity": self.gravity,
            "foot_radius": leg.radius,
        }
        try:
            made = Walker(**_links_of(leg), **common)
        except WalkerError as error:
            self.refuse(str(error))
        return made.titled(Path(self.name).stem)

    def _check_equal(
        self, legs: list[_Leg], parts: list[tuple[Element, ...]], extra_mass: float
    ) -> None:
        """Check that the legs are equal but for a point mass at the hip of the first one."""
        one, other = legs
        length = other.leg
        for i, ((m, a, s), (n, b, t)) in enumerate(zip(one.masses, other.masses, strict=True)):
            more = extra_mass if i == 0 else 0.0
            moment = np.abs(m * a - n * b).max()
            spin = abs((s + m * (a @ a)) - (t + n * (b @ b)))
            scale = max(m, n)
            if (
                abs(m - n - more) > _CLOSE * scale
                or moment > _CLOSE * scale * length
                or spin > _CLOSE * scale * length**2
            ):
                self.refuse(f"{parts[0][i].name} and {parts[1][i].name} have different masses")
        places = [
            (leg.leg, leg.radius, *(np.zeros(2) if leg.knee is None else leg.knee)) for leg in legs
        ]
        if not np.allclose(*places, rtol=0.0, atol=_CLOSE * length):
            self.refuse(f"{parts[0][-1].name} and {parts[1][-1].name} have different lengths")
        knees = [part.joints[0] for leg in parts for part in leg[1:]]
        for knee in knees:
            if knee.damping:
                self.refuse(f"{knee.name} has damping, which a Walker's knee has not")
        if not math.isclose(one.stiffness, other.stiffness, rel_tol=_CLOSE):
            self.refuse(f"{knees[0].name} and {knees[1].name} have different springs")


def _links_of(leg: _Leg) -> dict[str, Any]:
    """McGeer's parameters of a leg."""
    if leg.knee is None:
        (mass, com, spin), length = leg.masses[0], leg.leg + leg.radius
        upper = 0.5 * leg.leg
        return {
            "thigh_length": upper, "shank_length": length - upper, "knees": False,
            "thigh_mass": mass, "shank_mass": 0.0, "thigh_com": -com[1], "thigh_offset": -com[0],
            "thigh_gyration": math.sqrt(spin / mass),
        }  # fmt: skip
    (thigh_mass, thigh, thigh_spin), (shank_mass, shank, shank_spin) = leg.masses
    upper = float(np.linalg.norm(leg.knee))
    foot = np.array([0.0, -leg.leg]) - leg.knee
    reach = float(np.linalg.norm(foot))
    down, below = leg.knee / upper, foot / reach
    ahead, shin = np.array([-down[1], down[0]]), np.array([-below[1], below[0]])
    return {
        "thigh_length": upper,
        "thigh_mass": thigh_mass,
        "thigh_com": float(thigh @ down),
        "thigh_offset": float(-thigh @ ahead),
        "thigh_gyration": math.sqrt(thigh_spin / thigh_mass),
        "foot_angle": math.asin(-leg.knee[0] / upper),
        "shank_length": reach + leg.radius,
        "shank_mass": shank_mass,
        "shank_com": float((shank - leg.knee) @ below),
        "shank_offset": float(-(shank - leg.knee) @ shin),
        "shank_gyration": math.sqrt(shank_spin / shank_mass),
        "knee_stiffness": leg.stiffness,
    }
