"""Systems as native code: compiled once and called by address."""

from __future__ import annotations

from functools import lru_cache, partial
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.engine.equations import Equations, places_of, state_of, without_absent
from gym_passive_walker.engine.layout import (
    MOST_GUARDS,
    PAIR,
    WIDTH,
    history_for,
    layout_of,
    record_for,
    tile_for,
)
from gym_passive_walker.engine.machine import group, kept_code
from gym_passive_walker.engine.native import FEW, Code, Function, Memory, Module, uses
from gym_passive_walker.engine.one_lane import OneLane, first_where
from gym_passive_walker.engine.runge_kutta import Pair
from gym_passive_walker.engine.step import StepCode
from gym_passive_walker.models.equations import legs
from gym_passive_walker.models.equations.hybrid import Ground, Outcome, Phase, State, System
from gym_passive_walker.models.equations.numbers import sine_cosine
from gym_passive_walker.models.equations.systems import SYSTEMS
from gym_passive_walker.models.expressions import Expression, choose, read

OF_LANE = ("load_constants", "load", "move", "unload", "look", "accept", "predict_strike")
OF_LANES = ("first", "sweep")

PHASE = np.dtype(
    [
        # Addresses of native functions.
        *((name, "i8") for name in (*OF_LANE, *OF_LANES, "open", "begin", "place")),
        ("sweep_few", "i8"),
        ("table", "i8"),
        ("group", "i8"),  # lanes of a vector
        ("few", "i8"),  # lanes of a vector of `sweep_few`, which is for fewer than a group
        ("resets", "i8", (len(Outcome),)),  # addresses by outcome; 0 for a fall
        ("knee_locked", "i8"),
        ("guards", "i8"),
        ("strike", "i8"),  # number of the guard of the impact, from 1 on; 0 if there is none
        ("outcomes", "i8", (MOST_GUARDS,)),
        ("watch", "i8", (MOST_GUARDS,)),
        ("bends", "i8", (MOST_GUARDS,)),  # whether guards may fall and rise within a step
        # Rows of a `HISTORY` with the conditions under which each guard counts: first row, number.
        ("first_where", "i8", (MOST_GUARDS,)),
        ("wheres", "i8", (MOST_GUARDS,)),
    ]
)
"""Data of a phase for the engine: addresses of native functions, and properties of guards."""

_STATES = (
    "angle",
    "rate",
    "new_angle",
    "new_rate",
    "stage",
    "stage_rate",
    "moved",
    "turned",
    "lost",
    "power",
    "ground",
    "control",
    "body",
)
_TIMES = ("time", "end")
_HISTORY = ("before", "rate_before", "bend_before", "after", "rate_after", "bend_after")
_RECORDS = ("state", "start", "ground", "control", "time", "knee_time", "knee_loss", "heel_loss")
_RECORDS += ("step_length", "gravity_work", "spring_work", "friction_loss", "moved", "turned")
_RECORDS += ("push_off", "push_work", "passed", "body")


def constants_used(system: System, phase: Phase) -> tuple[str, ...]:
    """Return the names of the constants that a phase's equations and guards read, in order."""
    known: dict = {}
    names: tuple[str, ...] = system.Body._fields  # type: ignore[attr-defined]
    body = without_absent(system, system.Body(*(read(known, name) for name in names)))
    equations, count = Equations(system, phase, ()), system.coordinates
    state = equations.as_state(*([read(known, kind, i) for i in range(count)] for kind in "ab"))
    names_of_controls = system.Control._fields  # type: ignore[attr-defined]
    control = system.Control(*(read(known, "c", i) for i in range(len(names_of_controls))))
    ground = Ground(*(read(known, "g", i) for i in range(len(Ground._fields))))
    ground = without_absent(system, ground)
    results = [*phase.accelerations(body, state, control, ground)]
    if system.friction_power:
        results.append(system.friction_power(body, state))
    for guard in phase.guards:
        results.append(guard.falls(body, state, ground))
        results += [where(body, state, ground) for where in guard.where]
    reached = uses(results)
    return tuple(name for name, x in zip(names, body, strict=True) if x in reached)


def body_layout(system: System) -> np.dtype:
    """Return the layout of a body's constants: one field "body" with all of them."""
    return np.dtype([("body", "f8", (len(system.Body._fields),))])  # type: ignore[attr-defined]


WRITTEN: dict[str, Module] = {}
"""Native functions of systems that were generated for their names and are not yet compiled."""


@lru_cache
def compiled(system: str, *, derived: bool = False, still: bool = False) -> NDArray:
    """Compile a system, or load it from the cache.

    Args:
        system: Name of the system.
        derived: Whether to integrate derivatives too, as tangents behind the values.
        still: Whether derivatives of all constants are zero, which saves a sixth of the operations.

    Returns:
        The phases, shape (phases,) of PHASE.
    """
    of, known = SYSTEMS[system], None if derived else WRITTEN.pop(system, None)
    module = Module(still=("body",) if still else (), group=group())
    name = system + "-derived" * derived + "-still" * still
    write = lambda: known or written(of, derived=derived, module=module)  # noqa: E731
    code = kept_code(name, write, f"the equations {name}")
    return phases_of(of, code, group())


def phases_of(system: System, code: Any, lanes: int = 1) -> NDArray:
    """Return the PHASE data of a system's phases, (phases,).

    Args:
        system: The system.
        code: Its native code.
        lanes: Lanes of a vector in it.
    """
    phases = np.zeros(len(system.phases), PHASE)
    for i, (entry, phase) in enumerate(zip(phases, system.phases, strict=True)):
        for function in (*OF_LANE, *OF_LANES, "open"):
            entry[function] = code.get_function_address(f"{function}{i}")
        for function in ("begin", "place"):
            entry[function] = code.get_function_address(function)
        entry["table"] = code.get_global_value_address("table")
        for outcome in phase.resets:
            entry["resets"][outcome] = code.get_function_address(f"reset{i}_{outcome.name}")
        entry["group"], entry["few"] = lanes, min(lanes, FEW)
        if lanes > FEW:
            entry["sweep_few"] = code.get_function_address(f"sweep_few{i}")
        entry["knee_locked"], entry["guards"] = phase.knee_locked, len(phase.guards)
        entry["strike"] = 0 if phase.strike is None else phase.strike + 1
        entry["outcomes"][: len(phase.guards)] = [guard.outcome for guard in phase.guards]
        entry["watch"][: len(phase.guards)] = [guard.watch for guard in phase.guards]
        entry["bends"][: len(phase.guards)] = [guard.bends for guard in phase.guards]
        for number, guard in enumerate(phase.guards):
            entry["first_where"][number] = first_where(system, phase, number)
            entry["wheres"][number] = len(guard.where)
    return phases


def written(
    system: System,
    *,
    derived: bool = False,
    pair: Pair = PAIR,
    module: Module | None = None,
    width: int = WIDTH,
) -> Module:
    """Generate all native functions of a system.

    Args:
        system: The system.
        derived: Whether to generate derivatives too.
        pair: The Runge-Kutta pair.
        module: Module to write into, for another target language; a new one if None.
        width: Number of lanes of a tile.
    """
    layout = layout_of(system)
    record, history, tile = record_for(layout), history_for(layout), tile_for(pair, width, layout)
    module, body = module or Module(), body_layout(system)

    def function(name: str, *layouts: np.dtype, active: tuple[str, ...]) -> Function:
        return module.function(name, layouts, active=active if derived else ())

    def once(name: str, code: Code, *layouts: np.dtype, active: tuple[str, ...] = ()) -> None:
        made = function(name, *layouts, active=active)
        made.once(code, lane=layouts[0] == tile)
        made.end()

    for i, phase in enumerate(system.phases):
        about = system, phase, constants_used(system, phase), pair
        one_lane, step = OneLane(*about), StepCode(*about)
        others = (body, record, tile, record, history, history, history)
        for name, other in zip(OF_LANE, others, strict=True):
            # The predicted time of an impact only decides where steps end: no derivative needed.
            active = () if name == "predict_strike" else (*_STATES, *_TIMES, *_RECORDS, *_HISTORY)
            once(f"{name}{i}", getattr(one_lane, name), tile, other, active=active)
        first = function(f"first{i}", tile, active=_STATES)
        first.over_lanes(step.first)
        first.end()
        sweeps = {f"sweep{i}": module.group}
        if module.group > FEW:
            sweeps[f"sweep_few{i}"] = FEW
        for name, lanes in sweeps.items():
            sweep = function(name, tile, active=_STATES)
            for code in step.sweep():
                sweep.over_lanes(code, lanes)
            sweep.end()
        once(f"open{i}", partial(_open, system, phase), record, body)
        for outcome in phase.resets:
            code = partial(reset, system, phase, outcome)
            once(f"reset{i}_{outcome.name}", code, record, body, active=_RECORDS)
    once("begin", partial(_begin, system), record, body, active=_RECORDS)
    once("place", partial(_place, system), record, body)
    return module


def written_readings(system: System) -> Module:
    """Generate a function with the values of what only pushes and checks call of a system.

    Its text names a user's system together with that of `written`, since all code of a system is
    kept under its name.
    """
    kinds: list[Any] = [system.Body, system.State, Ground]
    sizes = [len(kind._fields) for kind in kinds]
    layouts = [
        np.dtype([("numbers", "f8", (count,))])
        for count in (sum(sizes) + 2 + system.coordinates, 6 + sum(p.links for p in system.phases))
    ]

    def write(given: Memory, found: Memory) -> None:
        numbers = iter(given.entries("numbers"))
        body, state, ground = (
            without_absent(system, kind(*islice(numbers, size)))
            for kind, size in zip(kinds, sizes, strict=True)
        )
        impulse, accelerations = (next(numbers), next(numbers)), tuple(numbers)
        results = [system.foot_clearance(body, state), system.kinetic_energy(body, state)]
        for phase in system.phases:
            if phase.push is not None:
                results += phase.push(body, state, *impulse)[: phase.links]
        if system.momentum is not None:
            results += system.momentum(body, state)
        if system.ground_force is not None:
            results += system.ground_force(body, state, accelerations, ground)
        for place, result in enumerate(results):
            found["numbers", place] = result

    module = Module()
    function = module.function("readings", (layouts[0], layouts[1]))
    function.once(write)
    function.end()
    return module


def _begin(system: System, record: Memory, body: Memory) -> None:
    """Begin a stride, just after heelstrike."""
    for i in range(system.coordinates):
        record["start", i] = record["state", i]
    record["phase"] = 0.0
    _open(system, system.phases[0], record, body)


def constants_of(system: System, body: Memory) -> Any:
    """Return a walker's constants as expressions."""
    return without_absent(system, system.Body(*body.entries("body")))


def recorded_ground(system: System, record: Memory) -> Ground:
    """Return a walker's ground data as expressions."""
    return without_absent(system, Ground(*record.entries("ground")))


def _open(system: System, phase: Phase, record: Memory, body: Memory) -> None:
    """Begin a stride or a tick within the bounds of its phase, or not at all."""
    state, constants = state_of(system, record), constants_of(system, body)
    ground = recorded_ground(system, record)
    outcome: Expression | float = float(Outcome.RUNNING)
    for guard in reversed(phase.guards):
        if guard.watch == guard.watch.BOUND:
            beyond = guard.falls(constants, state, ground) <= 0.0
            outcome = choose(beyond, float(guard.outcome), outcome)
    record["outcome"] = outcome


def reset(system: System, phase: Phase, outcome: Outcome, record: Memory, body: Memory) -> None:
    """Apply an impact: write the state after it, the energy lost, and the next phase or outcome."""
    constants, reset = constants_of(system, body), phase.resets[outcome]
    ground = recorded_ground(system, record)
    push_off = 0.0 if "push_off" in system.absent else record["push_off"]
    before = state_of(system, record)
    after, loss, work = reset.strike(constants, before, push_off, ground)
    for i, value in zip(places_of(system, record), after, strict=True):
        record["state", i] = value
    if reset.into is None:
        record["heel_loss"], record["push_work"] = loss, work
        _measure(system, constants, before, after, ground, record)
        record["phase"] = 0.0
        return
    record["phase"], record["knee_loss"] = float(reset.into), record["knee_loss"] + loss
    record["knee_time"] = record["time"]
    follows: Expression | float = float(Outcome.RUNNING)
    for refusal in reversed(reset.refuses):
        met = refusal.if_(constants, after, ground)
        if refusal.scuff:
            met &= record.argument(1) > 0.0
        follows = choose(met, float(refusal.outcome), follows)
    record["outcome"] = follows


def _measure(
    system: System, body: Any, before: State, after: State, ground: Ground, record: Memory
) -> None:
    """The step that a heelstrike has ended, and the work done in it; the next one starts here."""
    start = record.entries("start")[: system.coordinates]
    step = system.measure(system, body, start, before, after, ground)
    record["step_length"], record["passed"] = step.length, step.passed
    record["gravity_work"] = step.gravity_work
    if system.spring_gain:
        record["spring_work"] = step.spring_work
    for i in range(system.coordinates):
        record["start", i] = after[i]
    if "slope_change" not in system.absent:
        back, up = legs.turned(ground.cosine, ground.sine, *sine_cosine(ground.slope_change))
        for i, value in enumerate(Ground(back, up)):
            record["ground", i] = value


def _place(system: System, record: Memory, body: Memory) -> None:
    """Write the position of the hip, from which the distance of a step is measured."""
    record["place"] = system.place(constants_of(system, body), state_of(system, record))
