"""Definition of a walker as a hybrid system.

A system has *phases*, each with differential equations. A phase ends where one of its *guards*, a
function of the state, falls through zero. A *reset* then returns the state in which the next phase
or the next stride begins, and the energy lost. `kneed`, `straight` and `simplest` define one system
each, as plain functions of the tuples below. No other module contains their equations.

Everything is dimensionless: the unit of length is the leg length l, that of mass the walker's total
mass m, and that of time sqrt(l/g). Numbers therefore do not depend on the size of a leg. Vectors
have the components (back, up): against the walking direction and away from the ground.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import Any, NamedTuple

Number = Any
"""A float, an array, a symbol or an expression: see `numbers`."""


class State(NamedTuple):
    """Absolute angles in rad, and angular velocities; a straight swing leg has shank = thigh."""

    stance: Number
    thigh: Number
    shank: Number
    stance_rate: Number
    thigh_rate: Number
    shank_rate: Number


class Control(NamedTuple):
    """Torques and other controls of the actuators, constant while the engine runs.

    Attributes:
        hip: Torque between stance leg and swing thigh, positive when it opens the legs.
        ankle: Torque between ground and stance leg, positive when it tips the walker forward.
    """

    hip: Number
    ankle: Number = 0.0


class Ground(NamedTuple):
    """The foothold of the stance foot, and the next foothold.

    Attributes:
        sine: Sine of the slope: component of gravity along the ground, downhill.
        cosine: Cosine of the slope: component of gravity into the ground.
        height_change: Height of the next foothold over this one, along the normal of this one.
        slope_change: Slope of the next foothold minus that of this one, in rad, positive downhill.
            It affects only the foot that lands.
    """

    sine: Number
    cosine: Number
    height_change: Number = 0.0
    slope_change: Number = 0.0


SMOOTH = Ground(0.0, 1.0)
"""Level ground without steps."""


class Outcome(IntEnum):
    """Result of a stride or of a control step."""

    RUNNING = 0
    """The time limit was reached during the stride."""
    HEELSTRIKE = 1
    """The swing foot came down in front: the next stride begins."""
    KNEESTRIKE = 2
    """The swing knee locked (inside a stride only)."""
    FELL_FORWARD = 3
    """The stance leg lies on the ground ahead."""
    FELL_BACKWARD = 4
    """The stance leg lies on the ground behind."""
    SWING_OVERROTATION = 5
    """The swing leg rotated beyond upright."""
    STUBBED_TOE = 6
    """The locked swing leg of a kneed walker was below the ground (only with `end_on_toe_stub`)."""
    KNEE_NOT_LOCKED = 7
    """The foot came down in front before the knee had locked."""
    STALLED = 8
    """No heelstrike within the time or the number of integration steps: the walker rocks, stands,
    hangs, or rotates too fast to integrate."""
    DIVERGED = 9
    """The state left the range of floating-point numbers."""

    def __str__(self) -> str:
        """Return the name in words, such as "fell forward"."""
        return self.name.lower().replace("_", " ")

    def __format__(self, spec: str) -> str:
        """Format the name in words."""
        return format(str(self), spec)


class Stage(IntEnum):
    """Kind of motion of the swing leg, which determines the equations of a phase."""

    FREE = 0
    """Knee free: three links."""
    LOCKED = 1
    """Straight swing leg: two links."""
    SIMPLEST = 2
    """Straight swing leg without mass."""


class Watch(IntEnum):
    """Kinds of checks of a guard within an integration step."""

    STRIKE = 0
    """An impact: may be zero at the start of its phase; two crossings in one step are found too."""
    BOUND = 1
    """A bound: positive during the phase. A phase that begins beyond it ends at once."""
    SCUFF = 2
    """Applies only with `end_on_toe_stub`; within a step it is checked only if it bends."""


class Guard(NamedTuple):
    """An event that ends a phase.

    Attributes:
        falls: Function of body, state and ground; the event is where it falls through zero.
        outcome: Outcome of the phase.
        watch: How the guard is checked.
        where: Functions of the same arguments. The event counts only where all are positive.
        bends: Whether the guard is far from linear in the angles, so that it may fall and rise
            within an integration step; it is then searched for such crossings.
    """

    falls: Callable[[Any, State, Ground], Number]
    outcome: Outcome
    watch: Watch = Watch.BOUND
    where: tuple[Callable[[Any, State, Ground], Number], ...] = ()
    bends: bool = False


class Refusal(NamedTuple):
    """A state after a reset in which no phase can begin.

    Attributes:
        if_: Condition, a function of body, state after the reset, and ground.
        outcome: Outcome of the stride if the condition holds.
        scuff: Whether the condition applies only with `end_on_toe_stub`.
    """

    if_: Callable[[Any, State, Ground], Number]
    outcome: Outcome
    scuff: bool = False


class Strike(NamedTuple):
    """Result of an impact.

    Attributes:
        after: State after the impact.
        lost: Energy lost.
        work: Work of the push-off just before the impact.
    """

    after: State
    lost: Number
    work: Number = 0.0


class Reset(NamedTuple):
    """Change of the state at an impact.

    Attributes:
        strike: Function of body, state before, push-off and ground. The state after is relative to
            the next foothold.
        into: Index of the phase that begins, a later one: so it is of a kneestrike. None if the
            stride has ended and the legs have exchanged roles: so it is of a heelstrike.
        refuses: Conditions under which no phase can begin after the impact.
    """

    strike: Callable[[Any, State, Number, Ground], Strike]
    into: int | None = None
    refuses: tuple[Refusal, ...] = ()


class Phase(NamedTuple):
    """A part of a stride with its own equations of motion.

    Attributes:
        stage: Kind of motion of the swing leg.
        links: Number of independent angles: 3, or 2 if shank and thigh move together.
        accelerations: Function of body, state, control and ground; one acceleration for each link.
        guards: Events that end the phase. Of several at the same instant, the first one counts.
        resets: Resets by outcome; outcomes without a reset are falls.
        push: Function of body, state and the components (back, up) of an impulse on the hip.
            Returns the change of each link's angular velocity, with the stance foot at rest.
    """

    stage: Stage
    links: int
    accelerations: Callable[[Any, State, Control, Ground], tuple[Number, ...]]
    guards: tuple[Guard, ...]
    resets: dict[Outcome, Reset]
    push: Callable[[Any, State, Number, Number], tuple[Number, ...]] | None = None

    @property
    def knee_locked(self) -> bool:
        """Whether the swing leg is straight."""
        return self.stage != Stage.FREE

    @property
    def strike(self) -> int | None:
        """Index of the guard of the impact that ends the phase; None if there is none."""
        strikes = (i for i, guard in enumerate(self.guards) if guard.watch == Watch.STRIKE)
        return next(strikes, None)


def travel(state: State) -> Control:
    """For each control, the coordinate along which it does work."""
    return Control(hip=state.thigh - state.stance, ankle=-state.stance)


class Step(NamedTuple):
    """Measures of a stride that a heelstrike has ended.

    Attributes:
        length: Distance from contact to contact.
        passed: Distance of the hip from its place over the old foot at stance angle 0.
        gravity_work: Work of gravity in the stride.
        spring_work: Work of springs in the stride.
    """

    length: Number
    passed: Number
    gravity_work: Number
    spring_work: Number = 0.0


def measured(
    system: Any, body: Any, start: Any, before: Any, after: Any, ground: Ground, then: Any = None
) -> Step:
    """Measures of a stride, from the hip's `place` over the old foot and over the new one.

    The body of the next stride is `then`; None for legs that are alike.
    """
    began = before._make([*start, *before[len(start) :]])
    passed = system.place(body, before)
    return Step(
        passed - system.place(body if then is None else then, after),
        passed,
        -system.potential_gain(body, began, before, ground),
        -system.spring_gain(body, began, before) if system.spring_gain else 0.0,
    )


class System(NamedTuple):
    """A kind of walker.

    Attributes:
        name: Name of the kind.
        Body: Named tuple of the constants in its equations.
        phases: Phases; a stride begins in the first one.
        place: Function of body and state: distance of the hip from its place over the stance foot
            at stance angle 0.
        kinetic_energy: Function of body and state.
        potential_gain: Function of body, two states over the same contact, and ground: gain of
            potential energy from the first state to the second. It keeps its digits where the
            states are close.
        foot_clearance: Function of body and state: height over the ground of the swing foot, taken
            as a full circle.
        measure: Function of system, body, angles at the start of the stride, states just before and
            after a heelstrike, and ground: the `Step` that has ended. If the legs exchange
            parameters, the body is that before it.
        mass_matrix: Function of body and state: upper triangle of the mass matrix, row by row; None
            for legs without mass.
        travel: Function of a state: for each control, the coordinate along which it does work. The
            work of a constant control is the control times the change of that coordinate.
        works: For each control, 1 if it does work, else 0, as for a hip torque on legs without
            mass.
        spring_gain: Function of body and two states: gain of the springs' energy; None without.
        friction_power: Function of body and state: power dissipated by friction; None without.
        ground_force: Function of body, state, accelerations of its coordinates and ground: force of
            the ground on the walker, along it (downhill) and up from it; None if it is not known.
        momentum: Function of body and state: momentum along the ground and up from it; None if it
            is not known.
        absent: Names of constants, controls, impulses and ground data that are always zero. They
            are omitted from the compiled code, and a `System` has no such parameter or action.
        State: Named tuple of the coordinates, followed by their rates in the same order.
        Control: Named tuple of the controls.
    """

    name: str
    Body: type
    phases: tuple[Phase, ...]
    place: Callable[[Any, State], Number]
    kinetic_energy: Callable[[Any, State], Number]
    potential_gain: Callable[[Any, State, State, Ground], Number]
    foot_clearance: Callable[[Any, State], Number]
    measure: Callable[[Any, Any, Any, Any, Any, Ground], Step] = measured
    mass_matrix: Callable[[Any, State], tuple[Number, ...]] | None = None
    travel: Callable[[State], Control] = travel
    works: Control = Control(1.0, 1.0)
    spring_gain: Callable[[Any, State, State], Number] | None = None
    friction_power: Callable[[Any, State], Number] | None = None
    ground_force: Callable[[Any, State, Any, Ground], tuple[Number, Number]] | None = None
    momentum: Callable[[Any, State], tuple[Number, Number]] | None = None
    absent: tuple[str, ...] = ()
    State: type = State
    Control: type = Control

    @property
    def coordinates(self) -> int:
        """Number of coordinates; the state has as many rates."""
        return len(self.State._fields) // 2  # type: ignore[attr-defined]
