"""What a walker is for computation: a hybrid system.

A system has *phases*, in which it moves by differential equations. A phase ends where one of its
*guards*, a function of the state, falls through zero; a *reset* then says with what state the next
phase, or the next stride, begins, and what energy that costs. `kneed`, `straight` and `simplest`
state one system each, in plain functions of the tuples below; nothing else knows their equations.

Everything is dimensionless: the leg length l is the unit of length, the walker's total mass the
unit of mass, and sqrt(l/g) the unit of time. So a leg of a millimetre and one of a kilometre run
through the same numbers. Vectors have the parts (back, up): against the walking direction and away
from the ground.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import Any, NamedTuple

Number = Any
"""A float, an array, a symbol, an expression: see `numbers`."""


class State(NamedTuple):
    """Absolute angles in rad, and their rates; with a straight swing leg, shank is thigh."""

    stance: Number
    thigh: Number
    shank: Number
    stance_rate: Number
    thigh_rate: Number
    shank_rate: Number


class Control(NamedTuple):
    """What motors do, held constant while the engine runs.

    Attributes:
        hip: Torque between stance leg and swing thigh, positive when it opens the legs.
        ankle: Torque between ground and stance leg, positive when it tips the walker forward.
    """

    hip: Number
    ankle: Number = 0.0


class Ground(NamedTuple):
    """What the stance foot stands on, and the foothold that comes next.

    Attributes:
        sine: Of the slope: gravity's part along it, downhill.
        cosine: Gravity's part into it.
        height_change: Height of the next foothold over this one, along this one's normal.
        slope_change: By how much the next one slopes more steeply downhill; it touches the foot
            that lands.
    """

    sine: Number
    cosine: Number
    height_change: Number = 0.0
    slope_change: Number = 0.0


SMOOTH = Ground(0.0, 1.0)
"""Level, and goes on as it is."""


class Outcome(IntEnum):
    """Result of a stride or of a control step."""

    RUNNING = 0
    """The time asked for is over and the stride goes on."""
    HEELSTRIKE = 1
    """The swing foot came down in front: the next stride begins."""
    KNEESTRIKE = 2
    """The swing knee locked (inside a stride only)."""
    FELL_FORWARD = 3
    """The stance leg lies on the ground ahead."""
    FELL_BACKWARD = 4
    """The stance leg lies on the ground behind."""
    SWING_OVERROTATION = 5
    """The swing leg went round beyond the upright."""
    STUBBED_TOE = 6
    """The locked swing leg of a kneed walker was below the ground (only where this is a rule)."""
    KNEE_NOT_LOCKED = 7
    """The foot came down in front before the knee had locked."""
    STALLED = 8
    """No heelstrike within the time or the integration steps allowed: rocking, standing, hanging,
    or whirling too fast to be followed."""
    DIVERGED = 9
    """The motion left the range of floating-point numbers."""


class Stage(IntEnum):
    """What the swing leg is doing: which equations a walker obeys in a phase."""

    FREE = 0
    """Knee free: three links."""
    LOCKED = 1
    """Straight swing leg: two links."""
    SIMPLEST = 2
    """Straight swing leg without mass."""


class Watch(IntEnum):
    """How closely a guard is watched."""

    STRIKE = 0
    """It may be zero where its phase starts; even two passages within one step are found."""
    BOUND = 1
    """It is positive while the phase lasts: a phase that would begin beyond it ends at once."""
    SCUFF = 2
    """It counts only where scuffing is a rule; checked from one step's end to the next."""


class Guard(NamedTuple):
    """What ends a phase.

    Attributes:
        falls: Function of body, state and ground that ends the phase as it falls through zero.
        outcome: How the phase has ended then.
        watch: How closely to look.
        where: Functions of the same that are all positive where falling through zero counts.
        between: At how many places within an integration step a strike's guard is checked too:
            it may fall and rise again within a step, the sooner the less linear in the angles.
    """

    falls: Callable[[Any, State, Ground], Number]
    outcome: Outcome
    watch: Watch = Watch.BOUND
    where: tuple[Callable[[Any, State, Ground], Number], ...] = ()
    between: int = 0


class Refusal(NamedTuple):
    """A state in which no phase can begin.

    Attributes:
        if_: Condition, of body, state after a reset, and ground.
        outcome: How the stride has ended if it holds.
        scuff: Whether it counts only where scuffing is a rule.
    """

    if_: Callable[[Any, State, Ground], Number]
    outcome: Outcome
    scuff: bool = False


class Strike(NamedTuple):
    """What has come of a strike.

    Attributes:
        after: The state after it.
        lost: The energy lost.
        work: That of the push-off just before it.
    """

    after: State
    lost: Number
    work: Number = 0.0


class Reset(NamedTuple):
    """What a strike does.

    Attributes:
        strike: Function of body, state before, push-off and ground; the state after is over the
            next foothold.
        into: Index of the phase that begins; None if the stride is over and the legs have changed
            roles.
        refuses: After which states no phase begins.
    """

    strike: Callable[[Any, State, Number, Ground], Strike]
    into: int | None = None
    refuses: tuple[Refusal, ...] = ()


class Phase(NamedTuple):
    """A way of moving.

    Attributes:
        stage: What the swing leg is doing.
        links: Angles that move by themselves: 3, or 2 where the shank goes with the thigh.
        accelerations: Function of body, state, control and ground: one for each link.
        guards: What ends it; of several that fall at one instant, the first counts.
        resets: By the outcome that they answer; other outcomes are falls.
        push: Function of body, state and an impulse on the hip, by its parts back and up: by how
            much the rate of each link jumps while the stance foot stays where it is.
    """

    stage: Stage
    links: int
    accelerations: Callable[[Any, State, Control, Ground], tuple[Number, ...]]
    guards: tuple[Guard, ...]
    resets: dict[Outcome, Reset]
    push: Callable[[Any, State, Number, Number], tuple[Number, ...]] | None = None

    @property
    def strike(self) -> int | None:
        """Which of the guards is the strike that the phase leads to; None if there is none."""
        strikes = (i for i, guard in enumerate(self.guards) if guard.watch == Watch.STRIKE)
        return next(strikes, None)


def travel(state: State) -> Control:
    """For each control the coordinate that it moves."""
    return Control(hip=state.thigh - state.stance, ankle=-state.stance)


class Step(NamedTuple):
    """What a heelstrike ends: measures of the stride.

    Attributes:
        length: From contact to contact.
        passed: How far the hip is then ahead of where its old foot stands at stance angle 0.
        gravity_work: Work of gravity in the stride.
        spring_work: Work of springs in it.
    """

    length: Number
    passed: Number
    gravity_work: Number
    spring_work: Number = 0.0


def measured(system: Any, body: Any, start: Any, before: Any, after: Any, ground: Ground) -> Step:
    """The stride that a heelstrike has ended, by its `place` over the old foot and over the new."""
    began = before._make([*start, *before[len(start) :]])
    passed = system.place(body, before)
    return Step(
        passed - system.place(body, after),
        passed,
        -system.potential_gain(body, began, before, ground),
        -system.spring_gain(body, began, before) if system.spring_gain else 0.0,
    )


class System(NamedTuple):
    """A kind of walker.

    Attributes:
        name: What it is called.
        Body: Named tuple of what its equations need to know of a walker.
        phases: Its phases; a stride begins in the first.
        place: Function of body and state: how far the hip is ahead of where its foot stands at
            stance angle 0.
        kinetic_energy: Function of body and state.
        potential_gain: Function of body, two states over the same contact, and ground: what the
            energy in gravity's field gains from the first to the second, without loss of digits
            where they are close.
        foot_clearance: Function of body and state: height of the swing foot over the ground, which
            is a whole circle here.
        measure: Function of system, body, angles where the stride began, states just before and
            after a heelstrike, and ground: the `Step` that has ended.
        mass_matrix: Function of body and state: its upper triangle, row by row; of legs that have
            mass.
        travel: Function of a state: for each control the coordinate that it moves, so that the work
            of a constant control is it times the change of that coordinate.
        works: Whether each control works, 1 or 0: a hip's not on legs without mass.
        spring_gain: Function of body and two states: what the energy of springs gains;
            None where it counts for nothing.
        friction_power: Function of body and state: what friction takes; None without friction.
        absent: Constants of its body, controls, impulses and parts of the ground that are zero for
            certain. Code is made without them, so that a walker does not pay for what it has not.
        State: Named tuple of its coordinates, and behind them of their rates in the same order.
        Control: Named tuple of its controls.
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
    absent: tuple[str, ...] = ()
    State: type = State
    Control: type = Control

    @property
    def coordinates(self) -> int:
        """How many numbers say where it is; as many say how it moves."""
        return len(self.State._fields) // 2  # type: ignore[attr-defined]
