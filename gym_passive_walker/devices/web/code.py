"""Code of a module for wasm32: the equations of a walker, linked with `bookkeeping`."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from functools import lru_cache, partial
from types import FunctionType, SimpleNamespace
from typing import Any

import numpy as np
from llvmlite import binding as llvm
from numpy.typing import NDArray

from gym_passive_walker.devices.web import kernels
from gym_passive_walker.engine.compiled import OF_LANE, OF_LANES, body_layout, phases_of, written
from gym_passive_walker.engine.layout import NARROW, WIDE, Layout
from gym_passive_walker.engine.machine import context
from gym_passive_walker.engine.native import Code, Emitter, Function, Memory, Module
from gym_passive_walker.engine.own import system as own
from gym_passive_walker.engine.own.stated import StatementError
from gym_passive_walker.envs.constraints import HOOK, equipped, push_code
from gym_passive_walker.models.equations import bodies, kneed, simplest, straight
from gym_passive_walker.models.equations.hybrid import System
from gym_passive_walker.models.equations.systems import SYSTEMS
from gym_passive_walker.models.expressions import Expression
from gym_passive_walker.models.walkers.walker import PARAMETERS
from gym_passive_walker.pictures.pose import hip_over, joints

SYSTEMS_OF = {kind.name: kind for kind in (kneed.SYSTEM, straight.SYSTEM, simplest.SYSTEM)}
VARIANTS = ("", "-fitted", "-uneven")
"""Endings of the names of a kind's systems: bare, with springs and all actuators, on any ground."""

EXPORTED = ("run", "phases", "hooks", "body", "joints")
EXPORTED_OF_SYSTEM = ("run", "phases", "hooks", "pose")

TRIPLE = "wasm32-unknown-unknown"
_FEATURES = "+bulk-memory,+nontrapping-fptoint,+sign-ext,+mutable-globals"
OWN_FUNCTIONS = ("fma", "sin", "cos", "log", "asin", "exp", "tanh")
"""Elementary functions of the package, by the names that LLVM's text has for them."""

BOOKKEEPING: dict[str, Layout | None] = {"walkers": None, "narrow": NARROW, "wide": WIDE}
"""What `bookkeeping` is compiled for: the package's walkers, and layouts of a user's systems."""


def with_own_functions(text: str) -> str:
    """Return text that calls this package's elementary functions instead of a library's."""
    for name in OWN_FUNCTIONS:
        text = re.sub(rf"@(llvm\.)?{name}(\.f64)?\(", f"@own_{name}(", text)
    text = re.sub(r"^declare [^\n]*@llvm\.x86[^\n]*\n", "", text, flags=re.M)
    return text.replace("@sqrt(", "@llvm.sqrt.f64(")


class _Addresses:
    """Stands for native code: numbers functions in the order in which they are asked for."""

    def __init__(self, prefix: str, names: list[str]) -> None:
        self._prefix, self._names = prefix, names

    def get_function_address(self, name: str) -> int:
        """Return the number of a function, from 1 on."""
        self._names.append(self._prefix + name)
        return len(self._names)

    def get_global_value_address(self, name: str) -> int:
        """Return 0: constants are literals."""
        return 0


_ADDRESSES = (*OF_LANE, *OF_LANES, "open", "begin", "place", "resets")


def _constant(name: str, array: NDArray, fields: tuple[str, ...], names: list[str]) -> str:
    """Return the definition of an array of words, in which numbers of functions are addresses."""
    words = []
    layout = array.dtype
    for row in array:
        for field in layout.names or ():
            for value in np.atleast_1d(row[field]).tolist():
                if field in fields and value:
                    words += [f"ptr @{names[value - 1]}", "i32 0"]
                else:
                    words.append(f"i64 {value}")
    kinds = ", ".join(word.split()[0] for word in words)
    return f"@{name} = internal constant <{{ {kinds} }}> <{{ {', '.join(words)} }}>, align 8"


def equations(systems: Sequence[System], *, pushed: bool = True) -> list[str]:
    """Return the texts of systems' equations, and of the tables of their addresses.

    Args:
        systems: Variants of one walker.
        pushed: Whether there is code that pushes them.
    """
    texts, tables = [], []
    for number, system in enumerate(systems):
        names: list[str] = []
        own, prefix = f"v{number}_", f"p{number}_"
        phases = phases_of(system, _Addresses(own, names))
        phases["move"] = 0  # one walker needs no other lane
        phases, hooks = equipped(
            system, phases, _Addresses(prefix, names) if pushed else None, None
        )
        texts.append(_prefixed(written(system, module=Module(group=1), width=1), own))
        if pushed:
            texts.append(_prefixed(push_code(system, Module(group=1)), prefix))
        tables.append(_constant(f"phases{number}", phases, _ADDRESSES, names))
        tables.append(_constant(f"hooks{number}", hooks, tuple(HOOK.names or ()), names))
        tables += [
            f"declare void @{name}(i64, i64, i64, i64, double, double)"
            for name in dict.fromkeys(names)
            if not name.endswith(tuple(f"_move{i}" for i in range(9)))
        ]
    for name in ("phases", "hooks"):
        rows = ", ".join(f"ptr @{name}{number}" for number in range(len(systems)))
        tables.append(
            f"@all_{name} = internal constant [{len(systems)} x ptr] [{rows}]\n"
            f"define i32 @{name}(i32 %variant) {{\n"
            f"%place = getelementptr ptr, ptr @all_{name}, i32 %variant\n"
            "%found = load ptr, ptr %place\n%address = ptrtoint ptr %found to i32\n"
            "ret i32 %address\n}"
        )
    return [*texts, "\n".join(tables)]


def _prefixed(module: Module, prefix: str) -> str:
    """Return a module's text with a prefix to the names of its functions."""
    text = _without_table(module)
    text = re.sub(r"^define void @(?!\w*move\d)", f"define void @{prefix}", text, flags=re.M)
    text = re.sub(r"^define void @move", f"define internal void @{prefix}move", text, flags=re.M)
    return with_own_functions(text)


def _without_table(module: Module) -> str:
    """Return a module's text; code over single numbers uses no table of constants."""
    return re.sub(r"^@table = [^\n]*\n?", "", str(module), flags=re.M)


class _GeometryFunction(Function):
    """A function with expressions that may use functions of a library."""

    def _emitter(self, uses: Any, *, group: int, lane: bool) -> Emitter:
        return _GeometryEmitter(self, uses, group=group, lane=lane)


class _GeometryEmitter(Emitter):
    def _of(self, x: Expression) -> str:
        if x.op.startswith("library "):
            name = x.op.partition(" ")[2]
            self.owner.module.declared.add(f"declare double @own_{name}(double)")
            return self.owner.new(f"call double @own_{name}(double {self(x.args[0])})")
        return super()._of(x)


def _of_library(name: str) -> Any:
    return lambda x: x._with(f"library {name}", x)


_SIN, _COS, _ARCSIN = map(_of_library, ("sin", "cos", "asin"))
_LIBRARY = SimpleNamespace(sin=_SIN, cos=_COS, asin=_ARCSIN)


def _with(function: Any, **names: Any) -> Any:
    """Return a function with other values of some global names."""
    return FunctionType(function.__code__, {**function.__globals__, **names})


def geometry(kind: System) -> str:
    """Return the text of two functions of a walker's parameters: its constants, and its joints."""
    return _called(
        body=(kernels.SHAPE, body_layout(kind), partial(_body, kind)),
        joints=(kernels.SHAPE, _points(len(kernels.POINTS)), partial(_joints, kind)),
    )


def _points(count: int) -> np.dtype:
    return np.dtype([("points", "f8", (2 * count,))])


def _called(**traced: tuple[np.dtype, np.dtype, Code]) -> str:
    """Return the text of functions that a page calls, from their two memories and their code."""
    module = Module(fuses=False, group=1)
    for name, (first, second, code) in traced.items():
        function = _GeometryFunction(module, f"traced_{name}", (first, second))
        function.once(code)
        function.end()
    text = _without_table(module).replace("define void @traced", "define internal void @traced")
    for name in traced:
        text += (
            f"\ndefine void @{name}(i32 %first, i32 %second) {{\n"
            "%a = zext i32 %first to i64\n%b = zext i32 %second to i64\n"
            f"call void @traced_{name}(i64 %a, i64 %b, i64 0, i64 0, double 0.0, double 0.0)\n"
            "ret void\n}\n"
        )
    return text


def code_of_system(system: own.System) -> list[str]:
    """Return the texts of a user's system: its equations, and the lines that show it."""
    size = 2 * system.coordinates
    given = np.dtype([("body", "f8", (len(system.body),)), ("state", "f8", (size,))])
    points = _points(sum(map(len, system.drawn(np.zeros(size)))))
    pose = _called(pose=(given, points, partial(_pose, system)))
    return [*equations(variants(system), pushed="pushes" in system.supports), pose]


def variants(system: own.System) -> list[System]:
    """Return a user's system, and its form for uneven ground if it has one."""
    try:
        return [system.hybrid, system.uneven]
    except StatementError:
        return [system.hybrid]


def _pose(system: own.System, given: Memory, points: Memory) -> None:
    """Write the points of a system's lines."""
    body = type(system.body)(*given.entries("body"))
    found = system.lines(body, system.State(*given.entries("state")))
    numbers = [number for line in found for point in line for number in point]
    for i, value in enumerate(numbers):
        points["points", i] = value


def _given(shape: Memory) -> SimpleNamespace:
    """Return a walker's parameters by name, and its derived angle."""
    given = SimpleNamespace(**dict(zip(PARAMETERS, shape.entries("parameters"), strict=True)))
    reach = (given.shank_length - given.foot_radius) / given.thigh_length
    given.shank_angle = _ARCSIN(_SIN(given.foot_angle) / reach)
    return given


def _body(kind: System, shape: Memory, body: Memory) -> None:
    """Write a walker's constants."""
    constants = _with(bodies.body_from, np=_LIBRARY, inverse_sine=_ARCSIN)(_given(shape), kind.Body)
    for i, value in enumerate(constants):
        body["body", i] = value


def _joints(kind: System, shape: Memory, points: Memory) -> None:
    """Write the positions of a walker's joints, from its angles; see `pictures.pose`."""
    given, tilt = _given(shape), shape["tilt"]
    stance, thigh, shank = shape.entries("angles")
    reach = given.shank_length - given.foot_radius
    line = given.thigh_length * _COS(given.foot_angle) + reach * _COS(given.shank_angle)
    hip = _with(hip_over, leg_line=lambda _: line)(given, np.zeros(2), stance, tilt)
    below = _with(joints, math=_LIBRARY)
    found = hip, *below(given, hip, stance, stance), *below(given, hip, thigh, shank)
    for i, value in enumerate(np.concatenate(found)):
        points["points", i] = value


@lru_cache
def machine() -> Any:
    """Return LLVM's machine for wasm32."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    target = llvm.Target.from_triple(TRIPLE)
    return target.create_target_machine(opt=2, features=_FEATURES, reloc="static")


def of_kind(kind: str) -> list[str]:
    """Return the texts of a kind of walker: its equations, its constants and its joints."""
    return [
        *equations([SYSTEMS[kind + variant] for variant in VARIANTS]),
        geometry(SYSTEMS_OF[kind]),
    ]


def one_module(parts: Iterable[str | bytes]) -> Any:
    """Return a module of LLVM for wasm32, from texts and bitcode."""
    whole = None
    for part in parts:
        parse = llvm.parse_assembly if isinstance(part, str) else llvm.parse_bitcode
        found = parse(part, context())
        found.triple, found.data_layout = TRIPLE, str(machine().target_data)
        if whole is None:
            whole = found
        else:
            whole.link_in(found)
    return whole


def wasm_object(texts: Iterable[str], exported: Collection[str], bookkeeping: bytes) -> bytes:
    """Return the object file of a walker's texts, with all other code that it needs.

    Args:
        texts: LLVM's texts of its equations.
        exported: Names of the functions that a page calls.
        bookkeeping: Bitcode of one of BOOKKEEPING.
    """
    whole = one_module([*texts, bookkeeping])
    for function in whole.functions:
        if not function.is_declaration and function.name not in exported:
            function.linkage = "internal"
    whole.verify()
    tuning = llvm.create_pipeline_tuning_options(speed_level=2)
    tuning.loop_vectorization = tuning.slp_vectorization = tuning.loop_unrolling = False
    builder = llvm.create_pass_builder(machine(), tuning)
    builder.getModulePassManager().run(whole, builder)
    return machine().emit_object(whole)
