"""Quantities that strides and gaits report: each with one name, one unit and one definition.

Results are in the walker's own units; those of environments (`Transition`, `Walks`, `Robustness`,
rollouts) are dimensionless, as are `dimensionless` views of the others.
"""

from __future__ import annotations

from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple

from gym_passive_walker.models.units import KINDS, UNITS, Units

SHARES = {"absolute": (1.0, 0.0), "positive": (0.5, 0.5), "net": (0.0, 1.0)}
"""Shares of absolute and of net work in each kind of work of a torque."""


def motor_cost(strides: Any, energy: str = "absolute", channels: str = "hip ankle push_off") -> Any:
    """Work of some actuators over weight and distance.

    Args:
        strides: A `Stride`, a `Gait` or another object with works, weight and step length.
        energy: "absolute", "positive" or "net" work of torques; a push-off does its work at once.
        channels: Names of the actuators.
    """
    absolute, net = SHARES[energy]
    cost, distance = 0.0, strides.weight * strides.step_length
    for channel in channels.split():
        work = getattr(strides, f"{channel}_work")
        if channel != "push_off":
            work = absolute * getattr(strides, f"{channel}_work_absolute") + net * work
        cost = cost + work / distance
    return cost


def cost_of_transport(strides: Any, energy: str = "absolute") -> Any:
    """Energy spent over weight and distance: work of gravity and of all actuators.

    It is sin(slope) on a passive gait, where it equals the energy lost, as in Garcia (1999),
    Eq. 4.3. The arguments are those of `motor_cost`.
    """
    return strides.gravity_cost + motor_cost(strides, energy)


def collision_cost(strides: Any) -> Any:
    """Energy lost at kneestrike and heelstrike over weight and distance."""
    return strides.collision_loss / (strides.weight * strides.step_length)


class Measure(NamedTuple):
    """A quantity that strides report.

    Attributes:
        name: Name of the attribute.
        unit: Kind of its unit in `models.units.UNITS`; empty for a number.
        of: Field of an engine's record; such a field and an index, to be multiplied by the work of
            a unit; or a function of an object with the other quantities.
        about: Definition.
    """

    name: str
    unit: str
    of: Any
    about: str


MEASURES = tuple(
    Measure(*row)
    for row in (
        ("duration", "time", "time", "Time of the motion, to its end."),
        ("kneestrike_time", "time", "knee_time", "Time at which the knee locked, of the stride."),
        ("step_length", "length", "step_length", "Distance from one contact point to the next."),
        ("hip_work", "energy", ("moved", 0), "Net work of the hip torque."),
        ("hip_work_absolute", "energy", ("turned", 0), "Integral of the absolute hip power."),
        ("kneestrike_loss", "energy", "knee_loss", "Energy lost at kneestrike."),
        ("heelstrike_loss", "energy", "heel_loss", "Energy lost at heelstrike."),
        ("gravity_work", "energy", "gravity_work", "Work of gravity."),
        ("spring_work", "energy", "spring_work", "Net work of the springs."),
        ("friction_loss", "energy", "friction_loss", "Energy lost to friction at the hip."),
        ("ankle_work", "energy", ("moved", 1), "Net work of the ankle torque."),
        ("ankle_work_absolute", "energy", ("turned", 1), "Integral of the absolute ankle power."),
        ("push_off_work", "energy", "push_work", "Work of the push-off, just before heelstrike."),
        ("collision_loss", "energy", lambda s: s.kneestrike_loss + s.heelstrike_loss,
         "Energy lost at kneestrike and heelstrike."),
        ("hip_work_positive", "energy", lambda s: 0.5 * (s.hip_work_absolute + s.hip_work),
         "Positive work of the hip torque."),
        ("step_period", "time", lambda s: s.duration, "Time of a stride."),
        ("speed", "speed", lambda s: s.step_length / s.step_period, "Speed along the slope."),
        ("froude_speed", "", lambda s: s.speed / s.units.speed,
         "Speed over sqrt(g l), the square root of the Froude number (Eq. 4.6)."),
        ("gravity_cost", "", lambda s: s.gravity_work / (s.weight * s.step_length),
         "Work of gravity over weight and distance."),
        *(
            (f"{kind}_{channel}_cost".removeprefix("absolute_"), "",
             partial(motor_cost, energy=kind, channels=channel),
             f"{kind.capitalize()} work of the {channel} torque over weight and distance.")
            for channel in ("hip", "ankle")
            for kind in SHARES
        ),
        ("push_off_cost", "", partial(motor_cost, channels="push_off"),
         "Work of the push-off over weight and distance."),
        ("motor_cost", "", motor_cost, "Absolute work of all actuators over weight and distance."),
        ("cost_of_transport", "", cost_of_transport,
         "Energy spent over weight and distance: gravity's and the actuators' absolute work."),
        ("collision_cost", "", collision_cost, "Energy lost at impacts over weight and distance."),
        ("friction_cost", "", lambda s: s.friction_loss / (s.weight * s.step_length),
         "Energy lost to friction over weight and distance."),
    )
)  # fmt: skip
"""The quantities of strides. Those of a gait are means over the strides of its period."""

RECORDED = tuple(each for each in MEASURES if isinstance(each.of, str))
"""Those that are fields of an engine's record."""

_OTHERS = {
    "": "walker kind period multipliers multipliers_error violation stable beyond_fold "
    "outcome outcomes controller parameter folds period_doublings neimark_sackers "
    "halts ends stride_map knee_locked settled gaits walks strides friction stance_friction "
    "holds passed readings stride_index phases terrain terrain_seed struck ending needed_friction "
    "charged_cost on_edge optimality stubs control_steps reward reward_per_control_step held point "
    "cycle stride mean taken strikes",
    "angle": "slope stance_angle thigh_angle shank_angle tilt tilts knee_flexion",
    "time": "time times",
    "length": "clearance foot_clearance release_depth contact_x contact_y distance centre_of_mass "
    "com_x com_y",
    "speed": "release_velocity tangential normal centre_of_mass_velocity com_velocity_x "
    "com_velocity_y",
    "rate": "stance_rate thigh_rate shank_rate forward backward",
    "torque": "stance_knee_torque swing_knee_torque hip_joint_torque",
    "force": "weight normal_force tangential_force least_normal_force greatest_normal_force",
    "impulse": "kneestrike_impulse heelstrike_impulse push_off_impulse normal_impulse "
    "tangential_impulse",
    "twist": "stance_knee_at_kneestrike stance_knee_at_heelstrike stance_knee_at_push_off "
    "stance_knee_impulse",
    "energy": "loss kinetic_energy potential_energy spring_energy mechanical_energy",
    "power": "powers hip_power ankle_power friction_power",
    "state": "state states",
    "controls": "torques",
}
UNIT_OF = KINDS | {name: kind for kind, names in _OTHERS.items() for name in names.split()}
UNIT_OF |= {each.name: each.unit for each in MEASURES}
"""Kind of the unit of each attribute of a result; empty for numbers and for what is none."""

SI = {
    "angle": "rad", "length": "m", "time": "s", "mass": "kg", "speed": "m/s", "rate": "rad/s",
    "gravity": "m/s²", "force": "N", "impulse": "N s", "torque": "N m", "energy": "J",
    "power": "W", "friction": "N m s", "twist": "N m s", "state": "rad, rad/s",
}  # fmt: skip
"""Units of quantities of the named walkers; a walker of one's own is taken to use them."""

SYMBOLS = {kind: each[1:-1] if each[0] == "(" else each for kind, (each, _) in UNITS.items()}
"""Symbol of each kind of unit."""


class InUnits:
    """A result in its walker's own units, with a dimensionless view."""

    __slots__ = ()
    walker: Any

    @property
    def units(self) -> Units:
        """Dimensionless units, in the walker's own."""
        return self.walker.units

    @property
    def weight(self) -> float:
        """Weight of the walker: total mass times gravity."""
        return self.walker.weight

    @property
    def dimensionless(self) -> Any:
        """The same attributes over the walker's mass m, leg length l and time sqrt(l/g)."""
        return Dimensionless(self)

    def column_units(self) -> dict[str, str]:
        """Units of the columns that have one, by name.

        They are those of the named walkers. A walker that is stated in other units has its own in
        their place, and a `System` has no names of units.
        """
        if "units" not in self.walker.supports:
            return {}
        kinds = UNIT_OF | {"ankle_torque": "torque"}
        return {name: SI[kind] for name, kind in kinds.items() if kind in SI}


class Dimensionless:
    """A result with dimensionless attributes."""

    def __init__(self, result: Any) -> None:
        self._result = result

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        value = getattr(self._result, name)
        if name not in UNIT_OF:
            raise AttributeError(f"{name} of {type(self._result).__name__} has no known unit")
        return _over(value, UNIT_OF[name], self._result)

    def __dir__(self) -> list[str]:
        return [name for name in dir(self._result) if name in UNIT_OF]


def _over(value: Any, kind: str, result: Any) -> Any:
    """A value of a result without its unit; of several numbers, each without its own."""
    if isinstance(value, InUnits):
        return value.dimensionless
    if hasattr(value, "_fields"):
        kinds = ((name, UNIT_OF.get(name, kind)) for name in value._fields)
        return value._replace(
            **{name: _over(getattr(value, name), own, result) for name, own in kinds}
        )
    if isinstance(value, tuple):
        return tuple(_over(each, kind, result) for each in value)
    if kind == "state":
        return result.units.to_dimensionless(value)
    if kind == "controls":
        return value / result.walker.control_units
    return value / UNITS[kind][1](result.walker, result.units) if kind else value


def in_words(result: Any, name: str) -> str:
    """A quantity of a result, dimensionless, with its unit."""
    return f"{getattr(result.dimensionless, name):.6g} {SYMBOLS.get(UNIT_OF[name], '')}".strip()


class StrideQuantities:
    """Quantities that follow from works, losses, times and lengths of strides."""

    __slots__ = ()
    if TYPE_CHECKING:
        speed: Any
        froude_speed: Any

        def __getattr__(self, name: str) -> Any: ...


class Measured(InUnits):
    """A gait, with the MEASURES of its strides as attributes: means over its period.

    Attributes:
        mean: A `Stride` of these means.
        multipliers: Floquet multipliers, largest modulus first, (m,).
    """

    mean: Any
    multipliers: Any
    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...

    @property
    def stable(self) -> bool:
        """Whether small disturbances die out: all multipliers inside the unit circle."""
        return bool(abs(self.multipliers[0]) < 1.0)


for _each in MEASURES:
    if callable(_each.of):
        setattr(StrideQuantities, _each.name, property(_each.of, doc=_each.about))
    if _each.name != "duration":  # of one stride: that of a gait is its `step_period`
        _mean = attrgetter(f"mean.{_each.name}")
        setattr(Measured, _each.name, property(_mean, doc=_each.about))
