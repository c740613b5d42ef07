"""A system's links as a tree of bodies, found from their positions alone.

A point of a linkage of hinges is a sum of vectors, each of which turns with an angle that is a sum
or a difference of coordinates. In the plane of complex numbers x + i y it is a Fourier polynomial
of the coordinates. Its coefficients are these vectors, so they are found exactly from a grid.
Where the stance foot rolls, all points move besides in proportion to a coordinate.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.bridge.rigid import Body, Foot, Motor, Tree, TreePose
from gym_passive_walker.engine.own.mechanics import Derived, Link, rates_by

_GRID = 4  # values of each coordinate; turns by more than one coordinate's angle are refused
_SMALL = 1e-10  # of a vector, in units of the system

Turn = tuple[int, ...]  # by how much each coordinate turns a body
Arm = dict[Turn, complex]  # a point: the vectors that add to it, by how they turn


class Linkage:
    """A system as a tree of bodies, in its own units.

    Args:
        system: The system, stated by its links.

    Raises:
        ValueError: if it has no links, or they are no tree of hinges.
    """

    def __init__(self, system: Any) -> None:
        self.system, self.size = system, system.coordinates
        if getattr(system, "given", None) is not None or system.links is None:
            raise ValueError(
                f"the system {system.title!r} is given by equations, which say nothing of its "
                "bodies: state it by links to export it"
            )
        self._sample = np.random.default_rng(0).uniform(-1.0, 1.0, (3, self.size))
        links = [Link(*link) for link in self._links(self._sample[0])]
        self._slopes = self._rolling(lambda q: self._point(0, q))
        points = [self._arm(lambda q, i=i: self._point(i, q)) for i in range(len(links))]
        foot = self._arm(self._landing, self._rolling(self._landing))
        ground = (0,) * self.size
        self.radius = points[0].get(ground, 0j).imag
        for point in points:
            if abs(point.pop(ground, 0j) - 1j * self.radius) > _SMALL:
                raise self._refuse("a part of it is fixed to the ground")
        landed = foot.pop(ground, 0j)
        self._order = self._sorted([*points, foot])
        self.bodies: dict[Turn, list[tuple[Link, complex]]] = {turn: [] for turn in self._order}
        self.joints: dict[Turn, Arm] = {}
        for i, (link, point) in enumerate(zip(links, points, strict=True)):
            turn = self._own_turn(point) if point else self._order[0]  # a mass at the foot
            self._attach(turn, point)
            if link.inertia and not self._turns(i, turn):
                raise self._refuse(
                    f"the moment of inertia of link {i} of `links` turns otherwise than "
                    f"{self.name(turn)}, on which its mass lies"
                )
            self.bodies[turn].append((link, point.get(turn, 0j)))
        self.landing = self._own_turn(foot), foot
        self._attach(*self.landing)
        self.swing_radius = self.radius - landed.imag
        self._check_rolling("stance", -self._slopes, self.radius, self._order[0])
        rolled = self._rolling(self._landing) - self._slopes
        self._check_rolling("swing", rolled, self.swing_radius, self.landing[0])

    def _refuse(self, reason: str) -> ValueError:
        return ValueError(
            f"the links of the system {self.system.title!r} are no tree of bodies with hinges "
            f"({reason}), which is what files of simulators describe"
        )

    def _state(self, q: NDArray) -> Any:
        """A state of coordinates (..., m) at rest."""
        columns = [q[..., i] for i in range(self.size)]
        return self.system.State(*columns, *[0.0 * columns[0]] * self.size)

    def _links(self, q: NDArray) -> Sequence[Any]:
        return self.system.links(self.system.body, self._state(q))

    def _point(self, i: int, q: NDArray) -> NDArray:
        link = Link(*self._links(q)[i])
        return np.asarray(link.x + 1j * np.asarray(link.y))

    def _landing(self, q: NDArray) -> NDArray:
        x, y = self.system.landing(self.system.body, self._state(q))
        return np.asarray(x + 1j * np.asarray(y))

    def _rolling(self, point: Callable[[NDArray], NDArray]) -> NDArray:
        """How far a point moves per angle of each coordinate beyond its circles, (m,)."""
        q, whole = self._sample[0], 2.0 * np.pi
        turned = q + whole * np.eye(self.size)
        return np.array([complex(point(each) - point(q)) / whole for each in turned])

    def _arm(self, point: Callable[[NDArray], NDArray], slopes: NDArray | None = None) -> Arm:
        """The vectors of a point."""
        slopes = self._slopes if slopes is None else slopes
        grid = 2.0 * np.pi / _GRID * np.moveaxis(np.indices((_GRID,) * self.size), 0, -1)
        values = np.broadcast_to(point(grid), grid.shape[:-1]) - grid @ slopes
        found = np.fft.fftn(values) / values.size
        arm: Arm = {}
        for place in np.argwhere(np.abs(found) > _SMALL):
            turn = tuple(int(k) - _GRID * (k > _GRID // 2) for k in place)
            arm[turn] = complex(found[tuple(place)])
        for q in self._sample:
            again = sum(a * np.exp(1j * np.dot(turn, q)) for turn, a in arm.items())
            if abs(again + q @ slopes - complex(point(q))) > 1e3 * _SMALL:
                raise self._refuse("a position is no sum of links that turn")
        return arm

    def _sorted(self, points: Sequence[Arm]) -> list[Turn]:
        """All turns, parents first."""
        turns = {turn for point in points for turn in point}
        depth = {t: min(len(point) for point in points if t in point) for t in turns}
        return sorted(turns, key=lambda turn: (depth[turn], turn[::-1]))

    def _own_turn(self, point: Arm) -> Turn:
        return max(point, key=self._order.index)

    def _check_rolling(self, foot: str, rolled: NDArray, radius: float, turn: Turn) -> None:
        """Refuse a foot unless it rolls (per angle of each coordinate, (m,)) as a circle does."""
        if radius < -_SMALL or np.abs(rolled - radius * np.array(turn)).max() > _SMALL:
            raise self._refuse(f"the {foot} foot does not roll as a circle of radius {radius:.6g}")

    def _turns(self, i: int, turn: Turn) -> bool:
        """Whether the angle of a link changes with the coordinates as a body turns."""

        def rates(body: Any, state: Any) -> tuple:
            angle = Link(*self.system.links(body, state)[i]).angle
            return tuple(rates_by(angle, state[: self.size]))

        found = [Derived(rates)(self.system.body, self._state(q)) for q in self._sample]
        return any(np.allclose(found, way * np.array(turn), atol=_SMALL) for way in (1.0, -1.0))

    def _attach(self, turn: Turn, point: Arm) -> None:
        """Note the joint at which a body hangs, from a point on it."""
        joint = {t: a for t, a in point.items() if t != turn}
        known = self.joints.setdefault(turn, joint)
        if known.keys() != joint.keys() or any(abs(known[t] - joint[t]) > _SMALL for t in joint):
            raise self._refuse("a body hangs from two places")

    def name(self, turn: Turn) -> str:
        """Name of a body: that of its coordinate, if it turns with one."""
        places = [i for i, share in enumerate(turn) if share]
        if len(places) == 1:
            return self.system.state_names[places[0]]
        return f"body_{self._order.index(turn) + 1}"

    def parent(self, turn: Turn) -> Turn | None:
        """The body from which one hangs."""
        joint = self.joints[turn]
        return self._own_turn(joint) if joint else None

    def tree(self, length: float, mass: float) -> Tree:
        """Return the tree in SI units.

        Args:
            length: Unit of length in m.
            mass: Unit of mass in kg.
        """
        bodies = []
        for turn in self._order:
            parent = self.parent(turn)
            parts = [(link.mass, at, link.inertia) for link, at in self.bodies[turn]]
            total = float(sum(m for m, _, _ in parts))
            if total <= 0.0:
                raise self._refuse(f"{self.name(turn)} has no mass")
            com = complex(sum(m * at for m, at, _ in parts)) / total
            spin = float(sum(i + m * abs(at - com) ** 2 for m, at, i in parts))
            feet = [(0j, self.radius)] * (parent is None)
            if self.landing[0] == turn:
                feet.append((self.landing[1][turn], self.swing_radius))
            name = self.name(turn)
            bodies.append(
                Body(
                    name=name,
                    parent=None if parent is None else self.name(parent),
                    joint="pitch" if parent is None else f"{name}_joint",
                    place=_pair((0j if parent is None else self.joints[turn][parent]) * length),
                    mass=total * mass,
                    com=_pair(com * length),
                    inertia=spin * mass * length**2,
                    feet=tuple(Foot(_pair(at * length), max(0.0, r) * length) for at, r in feet),
                    end=_pair((feet[-1][0] if feet and feet[-1][0] else com) * length),
                )
            )  # fmt: skip
        return Tree(
            name=self.system.title, bodies=tuple(bodies), gravity=9.81, knees=False,
            motors=self._motors(),
        )  # fmt: skip

    def _motors(self) -> tuple[Motor, ...]:
        """Actuators with a torque at a hinge."""
        q, step = self._sample[0], np.eye(self.size)
        found = []
        for name in self.system.controls:
            ways = [
                float(getattr(self.system.travel(self._state(q + e)), name))
                - float(getattr(self.system.travel(self._state(q)), name))
                for e in step
            ]
            for turn in self._order:
                parent = self.parent(turn)
                if parent is None:
                    continue
                hinge = np.subtract(turn, parent)
                for gear in (1.0, -1.0):
                    if np.allclose(np.multiply(gear, hinge), ways):
                        found.append(Motor(name, f"{self.name(turn)}_joint", gear))
        return tuple(found)

    def coordinates(
        self, slope: float, state: Sequence[float], length: float, rate: float
    ) -> TreePose:
        """Return coordinates and velocities of the tree, with the stance foot on the ground.

        Args:
            slope: Slope in rad, positive downhill.
            state: Coordinates and their rates, in the system's units, (2 m,).
            length: Unit of length in m.
            rate: Unit of rates in 1/s.
        """
        q, v = np.split(np.asarray(state, float), 2)
        v = v * rate
        angles = {turn: float(np.dot(turn, q)) for turn in self._order}
        rates = {turn: float(np.dot(turn, v)) for turn in self._order}
        positions, velocities = [], []
        for turn in self._order:
            parent = self.parent(turn)
            before = (-slope, 0.0) if parent is None else (-angles[parent], -rates[parent])
            positions.append(angles[turn] + before[0])
            velocities.append(rates[turn] + before[1])
        along = complex(self._slopes @ q) + 1j * self.radius
        moving = complex(self._slopes @ v)
        tilt = np.exp(-1j * slope)
        centre, speed = along * tilt * length, moving * tilt * length
        return (
            np.array([centre.real, centre.imag, *positions]),
            np.array([speed.real, speed.imag, *velocities]),
        )


def _pair(at: complex) -> tuple[float, float]:
    return at.real, at.imag
