"""Systems as native code: compiled once, kept on disk, called by address."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import lru_cache
from hashlib import sha256
from typing import Any

import numpy as np
from llvmlite import binding as llvm
from numpy.typing import NDArray

from gym_passive_walker.engine import cache
from gym_passive_walker.engine.expressions import Expression, choose, read
from gym_passive_walker.engine.layout import (
    COURSE,
    MOST_CONSTANTS,
    MOST_GUARDS,
    PAIR,
    RECORD,
    tile_for,
)
from gym_passive_walker.engine.native import Function, Memory, Module, uses
from gym_passive_walker.engine.runge_kutta import Pair
from gym_passive_walker.engine.step import Equations
from gym_passive_walker.physics import legs
from gym_passive_walker.physics.hybrid import Control, Ground, Outcome, Phase, State, System
from gym_passive_walker.physics.systems import SYSTEMS

PHASE = np.dtype(
    [
        # Addresses of native functions.
        ("open", "i8"),
        ("first", "i8"),
        ("sweep", "i8"),
        ("look", "i8"),
        ("place", "i8"),
        ("table", "i8"),
        ("resets", "i8", (len(Outcome),)),  # by outcome; 0 where it is a fall
        ("links", "i8"),
        ("constants", "i8"),  # how many the phase uses, and which
        ("uses", "i8", (MOST_CONSTANTS,)),
        ("guards", "i8"),
        ("outcomes", "i8", (MOST_GUARDS,)),
        ("watch", "i8", (MOST_GUARDS,)),
    ]
)
"""What the engine knows of a phase."""

_STATES = (
    "angle",
    "rate",
    "new_angle",
    "new_rate",
    "stage",
    "moved",
    "turned",
    "ground",
    "control",
)
_COURSES = ("before", "rate_before", "bend_before", "after", "rate_after", "bend_after")
_RECORDS = ("state", "start", "ground", "time", "knee_time", "knee_loss", "heel_loss")
_RECORDS += ("step_length", "gravity_work")
_LOSSES = {Outcome.KNEESTRIKE: "knee_loss", Outcome.HEELSTRIKE: "heel_loss"}


def constants_used(system: System, phase: Phase) -> tuple[str, ...]:
    """Names of the constants that a phase's equations and guards read, in the body's order."""
    known: dict = {}
    names: tuple[str, ...] = system.Body._fields  # type: ignore[attr-defined]
    body = system.Body(*(read(known, name) for name in names))
    equations = Equations(system, phase, ())
    state = equations.as_state(*([read(known, kind, i) for i in range(3)] for kind in "ab"))
    control = Control(*(read(known, "c", i) for i in range(len(Control._fields))))
    ground = Ground(*(read(known, "g", i) for i in range(len(Ground._fields))))
    results = [*phase.accelerations(body, state, control, ground)]
    for guard in phase.guards:
        results.append(guard.falls(body, state))
        if guard.when:
            results.append(guard.when(body, state))
    reached = uses(results)
    return tuple(name for name, x in zip(names, body, strict=True) if x in reached)


def body_layout(system: System) -> np.dtype:
    """A body's constants behind each other."""
    return np.dtype([("body", "f8", (len(system.Body._fields),))])  # type: ignore[attr-defined]


@lru_cache
def compiled(system: str, planes: int = 0, *, moving_body: bool = False) -> NDArray:
    """The phases of a system, shape (phases,) of PHASE.

    Args:
        system: Its name.
        planes: How many derivatives are carried along.
        moving_body: Whether they are also by the walker's constants.
    """
    of = SYSTEMS[system]
    name = f"{system}-{planes}{'b' * moving_body}"
    return phases_of(of, _kept(name, lambda: written(of, planes, moving_body=moving_body)))


def phases_of(system: System, code: Any) -> NDArray:
    """What the engine is to know of a system's phases, from their native code, (phases,)."""
    phases = np.zeros(len(system.phases), PHASE)
    for i, (entry, phase) in enumerate(zip(phases, system.phases, strict=True)):
        for function in ("open", "first", "sweep", "look"):
            entry[function] = code.get_function_address(f"{function}{i}")
        entry["place"] = code.get_function_address("place")
        entry["table"] = code.get_global_value_address("table")
        for outcome in phase.resets:
            entry["resets"][outcome] = code.get_function_address(f"reset{i}_{outcome.name}")
        used = constants_used(system, phase)
        entry["links"], entry["constants"] = phase.links, len(used)
        entry["uses"][: len(used)] = [system.Body._fields.index(n) for n in used]  # type: ignore[attr-defined]
        entry["guards"] = len(phase.guards)
        entry["outcomes"][: len(phase.guards)] = [guard.outcome for guard in phase.guards]
        entry["watch"][: len(phase.guards)] = [guard.watch for guard in phase.guards]
    return phases


def written(
    system: System, planes: int = 0, *, moving_body: bool = False, pair: Pair = PAIR
) -> Module:
    """All native functions of a system, in steps of a method."""
    module = Module()
    body = ("body",) * moving_body
    layouts, tile = (RECORD, body_layout(system)), tile_for(pair)
    for i, phase in enumerate(system.phases):
        equations = Equations(system, phase, constants_used(system, phase), pair)
        options: dict[str, Any] = {"planes": planes, "active": _STATES + body}
        first = Function(module, f"first{i}", (tile,), **options)
        first.over_lanes(equations.first)
        first.end()
        sweep = Function(module, f"sweep{i}", (tile,), **options)
        for index in range(1, pair.stages + 1):
            sweep.over_lanes(equations.stage(index))
        sweep.over_lanes(equations.estimate)
        sweep.over_lanes(equations.judge)
        sweep.end()
        options["active"] += _COURSES
        look = Function(module, f"look{i}", (tile, COURSE), **options)
        look.once(equations.look, lane=True)
        look.end()
        opening = Function(module, f"open{i}", layouts)
        opening.once(lambda record, body, phase=phase: _open(system, phase, record, body))
        opening.end()
        for outcome in phase.resets:
            function = Function(
                module, f"reset{i}_{outcome.name}", layouts, planes=planes, active=_RECORDS + body
            )
            function.once(
                lambda record, body, p=phase, o=outcome: _reset(system, p, o, record, body)
            )
            function.end()
    placing = Function(module, "place", layouts)
    placing.once(lambda record, body: _place(system, record, body))
    placing.end()
    return module


def _open(system: System, phase: Phase, record: Memory, body: Memory) -> None:
    """Begin a stride or a tick within the bounds of its phase, or not at all."""
    state, constants = State(*record.entries("state")), system.Body(*body.entries("body"))
    outcome: Expression | float = float(Outcome.RUNNING)
    for guard in reversed(phase.guards):
        if guard.watch == guard.watch.BOUND:
            beyond = guard.falls(constants, state) <= 0.0
            outcome = choose(beyond, float(guard.outcome), outcome)
    record["outcome"] = outcome


def _reset(system: System, phase: Phase, outcome: Outcome, record: Memory, body: Memory) -> None:
    """A strike: the state after it, what it cost, and what follows."""
    constants, reset = system.Body(*body.entries("body")), phase.resets[outcome]
    after, loss = reset.strike(constants, State(*record.entries("state")))
    for i, value in enumerate(after):
        record["state", i] = value
    record[_LOSSES[outcome]] = loss
    if reset.into is None:
        _measure(system, constants, after, record)
        record["phase"] = 0.0
        return
    record["phase"] = float(reset.into)
    record["knee_time"] = record["time"]
    follows: Expression | float = float(Outcome.RUNNING)
    for refusal in reversed(reset.refuses):
        met = refusal.if_(constants, after)
        if refusal.scuff:
            met &= record.argument(1) > 0.0
        follows = choose(met, float(refusal.outcome), follows)
    record["outcome"] = follows


def _measure(system: System, body: Any, after: State, record: Memory) -> None:
    """The step that a heelstrike has ended, and gravity's work in it; the next one starts here."""
    ground = Ground(*record.entries("ground"))
    start = after._replace(**dict(zip(State._fields[:3], record.entries("start"), strict=True)))
    end = after._replace(stance=-after.stance, thigh=-after.thigh, shank=-after.shank)
    record["step_length"] = legs.step_length(body, start.stance, after.stance)
    record["gravity_work"] = -system.potential_gain(body, start, end, ground)
    for i in range(3):
        record["start", i] = after[i]


def _place(system: System, record: Memory, body: Memory) -> None:
    """Where the hip is, for whoever counts the way from step to step."""
    record["place"] = legs.progress(system.Body(*body.entries("body")), record["state", 0])


_ALIVE: list[Any] = []
"""Whoever holds native code: it lives as long as the process."""


@lru_cache
def _machine() -> Any:
    """What code is made for: this processor, or the one that numba is told to make it for."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    cpu = os.environ.get("NUMBA_CPU_NAME") or llvm.get_host_cpu_name()
    features = os.environ.get("NUMBA_CPU_FEATURES")
    if features is None:
        own = cpu == llvm.get_host_cpu_name()
        # Vectors of 512 bits where there are any: LLVM prefers 256 by default.
        features = llvm.get_host_cpu_features().flatten() + ",-prefer-256-bit" if own else ""
    target = llvm.Target.from_triple(llvm.get_process_triple())
    machine = target.create_target_machine(cpu=cpu, features=features, opt=2, jit=True)
    return machine, f"{llvm.llvm_version_info}{target.triple}{cpu}{features}"


def _kept(name: str, write: Callable[[], Module]) -> Any:
    """Native code, from the cache or written anew."""
    name = f"{name}-{sha256(_machine()[1].encode()).hexdigest()[:16]}.o"
    data = cache.found(name)
    if data is None:
        data = object_code(write())
        cache.keep(name, data)
    return loaded(data)


def object_code(module: Module) -> bytes:
    """A module's native functions, in machine code."""
    return _machine()[0].emit_object(_parsed(str(module)))


def loaded(data: bytes) -> Any:
    """Machine code, ready to be called for as long as the process lives."""
    engine = llvm.create_mcjit_compiler(_parsed(""), _machine()[0])
    engine.add_object_file(llvm.ObjectFileRef.from_data(data))
    engine.finalize_object()
    _ALIVE.append(engine)
    return engine


def _parsed(text: str) -> Any:
    """A module for this machine."""
    module = llvm.parse_assembly(text)
    module.triple, module.data_layout = _machine()[0].triple, str(_machine()[0].target_data)
    module.verify()
    return module
