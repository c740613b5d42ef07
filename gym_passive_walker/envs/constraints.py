"""Feasibility constraints on contact, friction, knees and clearance during control steps.

The checks are those of `reality_check`. The engine does not depend on them. Native code evaluates
them and writes the worst readings behind the constants of each walker. The function `look` checks
the present state. Resets check the state before and after an impact, and the impulses between.
"""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.engine import compiled
from gym_passive_walker.engine.equations import places_of, state_of
from gym_passive_walker.engine.layout import layout_of, record_for
from gym_passive_walker.engine.machine import kept_code
from gym_passive_walker.engine.native import Memory, Module
from gym_passive_walker.engine.own.mechanics import Derived
from gym_passive_walker.gaits.look.forces import borne, landing, pushed_off, struck
from gym_passive_walker.models.equations import legs
from gym_passive_walker.models.equations.hybrid import Outcome, Phase, State, System
from gym_passive_walker.models.equations.systems import SYSTEMS
from gym_passive_walker.models.expressions import choose, larger

READINGS = {
    "contact": ("normal_force", "normal_impulse"),
    "friction": ("friction",),
    "knee lock": ("stance_knee_torque", "stance_knee_impulse"),
    "scuffing": ("clearance",),
}
"""Readings of each check: the smallest value in a step; of friction, the largest."""

NOTES = (*(name for names in READINGS.values() for name in names), "push_work")
"""Names of the readings behind the constants of a walker."""

BLANK = np.array([0.0 if name in ("friction", "push_work") else np.inf for name in NOTES])
"""Readings before any check; the minimum of no values is infinite."""

_BEFORE = 5  # angular velocities and velocity of the landing foot, before an impact
ROOM = len(NOTES) + _BEFORE
"""Number of entries behind the constants of a walker."""

HOOK = np.dtype([("push", "i8"), ("look", "i8")])
"""Addresses of native functions that a phase calls for pushes and checks; 0 if not used."""


def page(system: System) -> np.dtype:
    """Return the data type of a walker's constants, followed by the readings of the checks."""
    layout = compiled.body_layout(system).descr
    return np.dtype([*layout, ("notes", "f8", (len(NOTES),)), ("before", "f8", (_BEFORE,))])


@lru_cache
def hooks(name: str, *, pushed: bool, watched: bool) -> tuple[NDArray, NDArray]:
    """Return the phases of a system with resets that check constraints, and its hooks.

    Args:
        name: Name of the system.
        pushed: Whether walkers are pushed.
        watched: Whether constraints are checked.

    Returns:
        Arrays (phases,) of `compiled.PHASE` and of HOOK.
    """
    system, pushes, looks, what = SYSTEMS[name], None, None, f"the checks of {name}"
    if pushed:
        pushes = kept_code(f"{name}-pushed", lambda: push_code(system, Module()), what)
    if watched:
        looks = kept_code(f"{name}-watched", lambda: look_code(system, Module()), what)
    return equipped(system, compiled.compiled(name), pushes, looks)


def equipped(system: System, phases: NDArray, pushes: Any, looks: Any) -> tuple[NDArray, NDArray]:
    """Return phases with resets that check constraints, and hooks, from native code.

    Args:
        system: The system.
        phases: Compiled phases, (phases,) of `compiled.PHASE`; not changed.
        pushes: Code from `push_code`; None without pushes.
        looks: Code from `look_code`; None without constraints.
    """
    phases, found = phases.copy(), np.zeros(len(phases), HOOK)
    for i, (native, phase) in enumerate(zip(found, system.phases, strict=True)):
        if pushes is not None:
            native["push"] = pushes.get_function_address(f"push{i}")
        if looks is not None:
            native["look"] = looks.get_function_address(f"look{i}")
            for outcome in phase.resets:
                address = looks.get_function_address(f"reset{i}_{outcome.name}")
                phases[i]["resets"][outcome] = address
    return phases, found


def push_code(system: System, module: Module) -> Module:
    """Add functions to a module that apply an impulse (backwards, upwards) to the hip."""
    for i, phase in enumerate(system.phases):
        function = module.function(f"push{i}", (record_for(layout_of(system)), page(system)))
        function.once(partial(_push, system, phase))
        function.end()
    return module


def look_code(system: System, module: Module) -> Module:
    """Add functions to a module that check a record, and resets that check before and after."""
    layouts = record_for(layout_of(system)), page(system)
    for i, phase in enumerate(system.phases):
        function = module.function(f"look{i}", layouts)
        function.once(partial(_look, system, phase))
        function.end()
        for outcome in phase.resets:
            function = module.function(f"reset{i}_{outcome.name}", layouts)
            # Separate pieces of code: the checks do not alter the rounding of the reset.
            function.once(partial(_look, system, phase))
            function.once(partial(_before, system, outcome))
            function.once(partial(compiled.reset, system, phase, outcome))
            function.once(partial(_after, system, outcome))
            if (following := phase.resets[outcome].into) is not None:
                function.once(partial(_look, system, system.phases[following]))
            function.end()
    return module


def _push(system: System, phase: Phase, record: Memory, body: Memory) -> None:
    """Apply an impulse to the hip, or to a system's centre of mass, and add its work."""
    assert phase.push is not None
    constants, state = compiled.constants_of(system, body), state_of(system, record)
    back, up = record.argument(0), record.argument(1)
    jumps, count = phase.push(constants, state, back, up), system.coordinates
    jumps = [jumps[min(link, phase.links - 1)] for link in range(count)]
    rates = [rate + jump for rate, jump in zip(state[count:], jumps, strict=True)]
    for place, rate in zip(places_of(system, record)[count:], rates, strict=True):
        record["state", place] = rate
    if system.State is State and not isinstance(phase.push, Derived):
        moment = legs.moment_of_push(constants, state.stance, back, up)
        work = moment * (state.stance_rate + 0.5 * jumps[0])
    else:
        after = system.State(*state[:count], *rates)
        energies = [system.kinetic_energy(constants, each) for each in (state, after)]
        work = energies[1] - energies[0]
    place = "notes", NOTES.index("push_work")
    body[place] = body[place] + work


def _note(body: Memory, **found: Any) -> None:
    """Write each reading that is worse than the present one."""
    for name, value in found.items():
        place = "notes", NOTES.index(name)
        known = body[place]
        worse = larger(value, known) if name == "friction" else choose(value < known, value, known)
        body[place] = worse


def _ratio(back: Any, up: Any) -> Any:
    """Return the friction coefficient that a force requires; infinite for a pulling force."""
    return choose(up > 0.0, abs(back) / up, np.inf)


def _look(system: System, phase: Phase, record: Memory, body: Memory) -> None:
    """Write the readings for the present state of a walker."""
    constants, state = compiled.constants_of(system, body), state_of(system, record)
    ground = compiled.recorded_ground(system, record)
    control = system.Control(*(record["control", i] for i in range(len(system.works))))
    found = phase.accelerations(constants, state, control, ground)
    turns = [found[min(link, phase.links - 1)] for link in range(system.coordinates)]
    if system.ground_force is not None:
        back, up = system.ground_force(constants, state, tuple(turns), ground)
        height = system.foot_clearance(constants, state) - ground.height_change
    else:
        back, up, stance_knee, _ = borne(constants, state, turns, control, ground)
        height = system.foot_clearance(constants, state) - legs.lower(ground)
        if "knee_along" in constants._fields:
            _note(body, stance_knee_torque=stance_knee)
    _note(body, normal_force=up, friction=_ratio(back, up), clearance=height)


def _before(system: System, outcome: Outcome, record: Memory, body: Memory) -> None:
    """Store the momentum, or angular velocities and that of the landing foot, before an impact."""
    if system.momentum is not None:
        state = state_of(system, record)
        for i, part in enumerate(system.momentum(compiled.constants_of(system, body), state)):
            body["before", i] = part
        return
    state = State(*record.entries("state"))
    velocity: tuple[Any, Any] = (0.0, 0.0)
    if outcome == Outcome.HEELSTRIKE:
        constants, ground = (
            compiled.constants_of(system, body),
            compiled.recorded_ground(system, record),
        )
        push_off: Any = 0.0
        if "push_off" not in system.absent:
            push_off = record["push_off"]
            back, up, stance_knee, _ = pushed_off(constants, state, push_off, ground)
            pushes = push_off > 0.0
            _note(body, friction=_ratio(back, choose(pushes, up, 1.0)))
            if "knee_along" in constants._fields:
                _note(body, stance_knee_impulse=choose(pushes, stance_knee, np.inf))
        state, velocity = landing(constants, state, push_off, ground)
        state = state._replace(
            stance_rate=state.thigh_rate, thigh_rate=state.stance_rate, shank_rate=state.stance_rate
        )
    for i, value in enumerate((*state[3:], *velocity)):
        body["before", i] = value


def _after(system: System, outcome: Outcome, record: Memory, body: Memory) -> None:
    """Write the readings for the impulses of an impact."""
    constants, state = compiled.constants_of(system, body), state_of(system, record)
    if system.momentum is not None:
        along, up = system.momentum(constants, state)
        along, up = along - body["before", 0], up - body["before", 1]
        return _note(body, normal_impulse=up, friction=_ratio(along, up))
    *rates, back, up = body.entries("before")
    jumps = [new - old for new, old in zip(state[3:], rates, strict=True)]
    foot = (-back, -up) if outcome == Outcome.HEELSTRIKE else (0.0, 0.0)
    back, up, stance_knee, _ = struck(constants, state[:3], jumps, foot)
    _note(body, normal_impulse=up, friction=_ratio(back, up))
    if "knee_along" in constants._fields:
        _note(body, stance_knee_impulse=stance_knee)
