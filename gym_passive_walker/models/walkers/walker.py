"""The walker: McGeer's parameters and their validation."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from importlib import import_module
from os import PathLike
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import shown, unknown
from gym_passive_walker._tools.loading import WALKER_READERS
from gym_passive_walker._tools.shown import Shown
from gym_passive_walker.models.chart import Mirrored
from gym_passive_walker.models.equations.bodies import body_from
from gym_passive_walker.models.equations.hybrid import System
from gym_passive_walker.models.equations.systems import EXTRAS, FITTINGS, UNEVEN, system_of
from gym_passive_walker.models.model import FEATURES, Actuator, Model, check_row, constants_from
from gym_passive_walker.models.units import Units, mass_of, varied

_PLACES = ("thigh_com", "thigh_offset", "thigh_gyration")
_PLACES += ("shank_com", "shank_offset", "shank_gyration")
_NOT_NEGATIVE = ("thigh_mass", "shank_mass", "hip_mass", "thigh_gyration", "shank_gyration")
_NOT_NEGATIVE += ("hip_stiffness", "hip_friction", "knee_stiffness")
_ANGLES = "stance leg", "swing thigh", "swing shank"
_ENDINGS = {
    "fell_forward": "the stance leg lies on the ground, ahead",
    "fell_backward": "the stance leg lies on the ground, behind",
    "swing_overrotation": "the swing leg has turned beyond upright",
}


STATE_NAMES = (
    "stance_angle",
    "thigh_angle",
    "shank_angle",
    "stance_rate",
    "thigh_rate",
    "shank_rate",
)
"""Column names of the six numbers of a state in tables."""


class WalkerError(ValueError):
    """A parameter of a walker is invalid; the message names it and its range."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Walker(Shown, Model):
    """A planar walker with two equal legs; masses are per leg.

    A walker with legs without mass (``thigh_mass = shank_mass = 0`` and ``hip_mass > 0``) is the
    simplest walker: the limit of a vanishing point mass at each foot. `passive-walker figures 4.1`
    draws a walker with the name of each parameter; so does the page on theory.

    Attributes:
        thigh_length: l_t, hip to knee.
        thigh_offset: w_t, centre of mass of the thigh, backwards from the hip-knee line.
        thigh_mass: m_t, mass of one thigh.
        thigh_gyration: r_t, radius of gyration of the thigh about its centre of mass.
        thigh_com: c_t, centre of mass of the thigh, down from the hip.
        shank_length: l_s, knee to the bottom of the foot, through the foot's centre.
        shank_offset: w_s, centre of mass of the shank, backwards from the line knee-foot centre.
        shank_mass: m_s, mass of one shank.
        shank_gyration: r_s, radius of gyration of the shank about its centre of mass.
        shank_com: c_s, centre of mass of the shank, down from the knee.
        foot_radius: R, of the circular foot: from 0 (a point foot) to below the shank's length.
        foot_angle: epsilon_T, with the knee locked, from the thigh's line forward to the line
            hip-foot centre.
        hip_mass: a point mass at the hip, once for both legs.
        hip_stiffness: of a torsional spring between the legs, relaxed where they are parallel; per
            unit of foot mass where legs have none.
        hip_friction: viscous, torque per rate at which the legs open; per
            unit of foot mass where legs have none.
        knee_stiffness: of a torsional spring at the knee, relaxed where the leg is straight; of no
            effect on locked knees.
        knees: whether the swing knee is free until it strikes its stop; False locks both knees.
            "held" keeps the trailing knee locked during the heelstrike and frees it afterwards, as
            many other programs do; True frees it before, as McGeer and Garcia do.
        gravity: g, acceleration of gravity.

    Raises:
        WalkerError: if a parameter is unknown, not finite, out of its range, or leaves a joint with
            nothing to turn.
    """

    thigh_length: float
    thigh_offset: float = 0.0
    thigh_mass: float
    thigh_gyration: float = 0.0
    thigh_com: float = 0.0
    shank_length: float
    shank_offset: float = 0.0
    shank_mass: float
    shank_gyration: float = 0.0
    shank_com: float = 0.0
    foot_radius: float = 0.0
    foot_angle: float = 0.0
    hip_mass: float = 0.0
    hip_stiffness: float = 0.0
    hip_friction: float = 0.0
    knee_stiffness: float = 0.0
    knees: bool | Literal["held"] = True
    gravity: float = 9.81
    title = ""
    """Name in pictures and messages; walkers that differ in it alone are equal."""
    coordinates, size = 3, 6
    state_names = STATE_NAMES
    inputs = ("hip_torque", "ankle_torque", "push_off")
    controls = inputs[:2]
    observed = (
        *((f"{angle} angle", "rad") for angle in _ANGLES),
        *((f"{angle} angular velocity", "sqrt(g/l)") for angle in _ANGLES),
        ("knee locked", "1 or 0"),
        ("slope, positive downhill", "rad"),
    )
    endings = _ENDINGS
    start = None
    supports = frozenset(FEATURES)

    def __new__(cls, **parameters: Any) -> Walker:
        """Check the names of the parameters; `__init__` would raise Python's own error."""
        known = cls.__dataclass_fields__
        if not parameters.keys() <= known.keys():  # seldom, and walkers are made by the thousand
            raise WalkerError(unknown(parameters, tuple(known), "a walker"))
        return super().__new__(cls)

    def __post_init__(self) -> None:
        """Check the values of the parameters."""
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name == "knees":
                if not isinstance(value, bool) and not (isinstance(value, str) and value == "held"):
                    raise WalkerError(f"knees must be True, False or 'held', not {shown(value)}")
                continue
            try:
                if isinstance(value, str | bytes | bool | np.bool_):
                    raise TypeError
                value = float(value)
            except (TypeError, ValueError, OverflowError):
                raise WalkerError(f"{field.name} must be a number, not {shown(value)}") from None
            if not math.isfinite(value):
                raise WalkerError(f"{field.name} must be finite, not {value}")
            object.__setattr__(self, field.name, value)
        for name in ("thigh_length", "shank_length", "gravity"):
            if getattr(self, name) <= 0.0:
                raise WalkerError(f"{name} must be positive, not {getattr(self, name)}")
        for name in _NOT_NEGATIVE:
            if getattr(self, name) < 0.0:
                raise WalkerError(f"{name} must not be negative, but is {getattr(self, name)}")
        if not 0.0 <= self.foot_radius < self.shank_length:
            raise WalkerError(
                f"foot_radius must lie from 0 to below the shank's length {self.shank_length}, "
                f"so that the foot's centre is below the knee; it is {self.foot_radius}"
            )
        reach = (self.shank_length - self.foot_radius) / self.thigh_length
        if not (abs(self.foot_angle) < 0.5 * math.pi and abs(math.sin(self.foot_angle)) < reach):
            limit = math.asin(min(1.0, reach))
            raise WalkerError(
                f"foot_angle {self.foot_angle} rad cannot be reached by this shank: its size must "
                f"be below {limit:.6g} rad (sin of it below (l_s - R)/l_t)"
            )
        self._check_places()
        self._check_masses()

    def _check_places(self) -> None:
        """Check positions: a centre of mass far from its leg is a wrong decimal point or unit."""
        farthest = 2.0 * self.leg_length
        for name in _PLACES:
            if abs(getattr(self, name)) > farthest:
                raise WalkerError(
                    f"{name} must be at most two leg lengths, {farthest:g}, for the mass to "
                    f"belong to a leg; it is {getattr(self, name)}"
                )

    def _check_masses(self) -> None:
        """Check that each joint moves some inertia."""
        if self.thigh_mass == 0.0 and self.shank_mass == 0.0:
            if self.hip_mass == 0.0:
                raise WalkerError("a walker needs mass: thigh_mass, shank_mass and hip_mass are 0")
            if self.knees or self.foot_radius != 0.0:
                raise WalkerError(
                    "legs without mass are the simplest walker, which has point feet and no "
                    "knees: set foot_radius=0 and knees=False, or give the legs some mass"
                )
            return
        thigh_spread = math.hypot(self.thigh_gyration, self.thigh_com, self.thigh_offset)
        shank_spread = math.hypot(self.shank_gyration, self.shank_com, self.shank_offset)
        if self.knees and self.shank_mass * shank_spread == 0.0:
            raise WalkerError(
                "a free shank needs a moment of inertia about the knee: give it shank_mass and "
                "one of shank_com, shank_offset, shank_gyration, or set knees=False"
            )
        if self.shank_mass == 0.0 and self.thigh_mass * thigh_spread == 0.0:
            raise WalkerError(
                "a swing leg needs a moment of inertia about the hip: move some of its mass away "
                "from the hip, or set both leg masses to 0 for the simplest walker"
            )

    @classmethod
    def from_mjcf(cls, path: str | PathLike[str]) -> Walker:
        """Return the walker in an MJCF file: a planar body with two equal legs.

        Bodies that are welded together are summed. Each leg has one link, or two with a knee that
        stops at angle 0; its last link has a foot, a sphere or a cylinder across the plane. A
        body between the hips is a point mass; springs and friction of two hinges there act in
        series, as one. Units are those of the file. Contacts, actuators, stops of the hips and what
        lies across the plane are ignored.

        Args:
            path: The file. MuJoCo reads it.

        Raises:
            WalkerError: if it is no such file; the message names the element that does not fit.
            ImportError: if mujoco is not installed.
        """
        return import_module(WALKER_READERS[0]).read_mjcf(path)

    @classmethod
    def from_urdf(cls, path: str | PathLike[str], gravity: float = 9.81) -> Walker:
        """Return the walker in a URDF file; see `from_mjcf`.

        Args:
            path: The file.
            gravity: Acceleration of gravity in m/s^2, which the format has not.

        Raises:
            WalkerError: if it is no such file; the message names the element that does not fit.
        """
        return import_module(WALKER_READERS[0]).read_urdf(path, gravity)

    def titled(self, title: str) -> Walker:
        """Return a walker of equal parameters with a title; see `name_of`."""
        walker = copy(self)
        object.__setattr__(walker, "title", title)
        return walker

    def facts(self) -> dict[str, str]:
        """The walker's parameters, in its own units."""
        numbers = {name: f"{value:.6g}" for name, value in self.parameters.items()}
        return numbers | {"knees": str(self.knees)}

    def __repr__(self) -> str:
        """The expression that makes the walker, without parameters that have their default."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        given = (f.name for f in fields(self) if values[f.name] != f.default)
        return f"Walker({', '.join(f'{name}={values[name]!r}' for name in given)})"

    @property
    def leg_length(self) -> float:
        """Leg length l = l_t + l_s, the unit of length of all dimensionless numbers."""
        return self.thigh_length + self.shank_length

    @property
    def total_mass(self) -> float:
        """Mass of both legs and the hip."""
        return mass_of(self)

    def mass_with(self, **values: Any) -> Any:
        """Return the mass of walkers that differ in some parameters."""
        return mass_of(varied(self, values))

    @property
    def units(self) -> Units:
        """Units in which the walker is dimensionless."""
        return _units(self)

    def units_with(self, **values: ArrayLike) -> Units:
        """Return the units of walkers that differ in some parameters: numbers, or arrays (n,)."""
        return varied(self, values).units

    @property
    def chart(self) -> Mirrored:
        """Coordinates of its states just after heelstrike."""
        return Mirrored(bool(self.knees))

    @property
    def toe_stubs(self) -> bool:
        """Whether a locked swing leg below the ground can end its strides."""
        return bool(self.knees)

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of its coordinates in pictures."""
        return _ANGLES if self.knees else ("stance leg", "swing leg")

    @property
    def weight(self) -> float:
        """Weight m g."""
        return self.units.force

    @property
    def parameters(self) -> dict[str, float]:
        """Parameters that may vary, by name."""
        return {name: getattr(self, name) for name in PARAMETERS}

    def with_parameters(self, **values: float) -> Walker:
        """Return a walker with other values of some parameters.

        Raises:
            WalkerError: if it cannot have these values.
        """
        return replace(self, **values)

    def with_body(self, values: Mapping[str, float]) -> Walker:
        """Return a walker with other values, as `with_parameters` does."""
        return replace(self, **values)

    @property
    def actuators(self) -> tuple[Actuator, ...]:
        """What actions of environments may move."""
        unit = "g l a foot mass" if self.massless_legs else "m g l"
        hip = "hip torque, positive swings the free leg forward"
        ankle = "ankle torque, positive tips the walker forward"
        push = "push-off impulse at the next heelstrike"
        return (
            Actuator("hip", "max_hip_torque", hip, unit),
            Actuator("ankle", "max_ankle_torque", ankle, "m g l", usual=False),
            Actuator("push_off", "max_push_off", push, "m sqrt(g l)", 0.0, usual=False),
        )

    def check_values(self, names: Sequence[str], values: NDArray) -> None:
        """Check that walkers may have each row of values (n, k) of parameters.

        Raises:
            WalkerError: if one may not.
        """
        for row in set(map(tuple, values.tolist())):
            check_row(self, tuple(names), row)

    def checked_state(
        self, state: Sequence[float], name: str = "options['state']"
    ) -> tuple[float, ...]:
        """Return a user's state with angular velocities in units of 1/sqrt(l/g), after a check.

        Args:
            state: [stance, thigh, shank] angles in rad and their angular velocities, (6,). The
                shank of a straight-legged walker is ignored.
            name: Name of the argument, for messages.

        Raises:
            ValueError: if it is no state of an upright walker.
        """
        given = np.asarray(state, dtype=float)
        if given.shape != (6,) or not np.all(np.isfinite(given)):
            raise ValueError(
                f"{name} must be 6 finite numbers, [stance, thigh, shank] angles and their "
                f"rates, not {state!r}"
            )
        stance, thigh, shank, *rates = given.tolist()
        if not self.knees:
            shank, rates[2] = thigh, rates[1]
        if abs(stance) >= 0.5 * math.pi or abs(thigh) >= math.pi or abs(shank) >= math.pi:
            raise ValueError(f"{name} is of a walker that has fallen: {given.tolist()}")
        if shank > thigh:
            raise ValueError(
                f"{name} bends the knee backwards: the shank must not be ahead of the thigh: "
                f"{given.tolist()}"
            )
        return (stance, thigh, shank, *(self.time_unit * rate for rate in rates))

    @property
    def control_units(self) -> NDArray[np.float64]:
        """Units of the controls."""
        return np.array([self.units.torque, self.units.energy])

    @property
    def kind(self) -> str:
        """Kind of the legs: "kneed", "held" (see `knees`), "straight" or "simplest"."""
        if self.massless_legs or not self.knees:
            return "simplest" if self.massless_legs else "straight"
        return "kneed" if self.knees is True else "held"

    def equations(self, using: Collection[str] = ()) -> System:
        """Return the equations of motion.

        Args:
            using: Further features in use, of `EXTRAS` and `UNEVEN`: controls, parameters that
                vary, and changes of the ground.
        """
        if not set(UNEVEN).isdisjoint(using):
            return system_of(f"{self.kind}-uneven")
        fitted = any(getattr(self, name) for name in FITTINGS) or not set(EXTRAS).isdisjoint(using)
        return system_of(f"{self.kind}-fitted" if fitted else self.kind)

    @property
    def body(self) -> Any:
        """Constants in the equations of motion."""
        return body_from(self, system_of(self.kind).Body)

    def constants(self, **values: ArrayLike) -> NDArray[Any]:
        """Return the constants of walkers that differ from this one in some parameters.

        Args:
            **values: Values of parameters, one for all or (n,); complex ones carry derivatives.

        Returns:
            Shape (1 or n, constants).
        """
        return constants_from(body_from(varied(self, values), system_of(self.kind).Body))

    @property
    def massless_legs(self) -> bool:
        """Whether this is the simplest walker, the limit of vanishing foot mass."""
        return self.thigh_mass == 0.0 and self.shank_mass == 0.0

    @property
    def time_unit(self) -> float:
        """The pendulum time sqrt(l/g), the unit of time of all dimensionless numbers."""
        return math.sqrt(self.leg_length / self.gravity)

    @property
    def shank_angle(self) -> float:
        """Angle in rad from the line foot centre-hip to the shank's line, forward (epsilon_F)."""
        reach = (self.shank_length - self.foot_radius) / self.thigh_length
        return math.asin(math.sin(self.foot_angle) / reach)


PARAMETERS = tuple(field.name for field in fields(Walker) if field.name != "knees")
"""Names of the numerical parameters of a walker."""


_units = lru_cache(maxsize=4096)(Units.of)
