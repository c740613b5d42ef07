"""Native code called from a test, for any CPU, and expressions evaluated in plain Python."""

from __future__ import annotations

import ctypes
import operator
import platform
import struct
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from llvmlite import binding as llvm

from gym_passive_walker.engine.layout import WIDTH, aligned
from gym_passive_walker.engine.machine import context
from gym_passive_walker.engine.native import GROUP, Function, Module
from gym_passive_walker.models.expressions import Expression, read

llvm.initialize_native_target()
llvm.initialize_native_asmprinter()

_SIGNATURE = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 4, *[ctypes.c_double] * 2)

CPUS = {"this": (llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten())}
"""CPUs and their features, for which this machine has all instructions."""

if platform.machine() in ("x86_64", "AMD64"):
    CPUS["without fused instructions"] = ("x86-64", "")
    if llvm.get_host_cpu_features().get("fma") and llvm.get_host_cpu_features().get("avx2"):
        CPUS["with vectors of 256 bits"] = ("haswell", "")


def call(
    address: int, first: np.ndarray, second: Any = 0, lane=0, x=0.0, y=0.0, *, tangents=0
) -> None:
    """Call native code with one array, and another or the address of a table."""
    there = second.ctypes.data if isinstance(second, np.ndarray) else int(second)
    _SIGNATURE(int(address))(first.ctypes.data, there, lane, tangents, x, y)


class Native:
    """A native function of one code.

    Args:
        code: Reads and writes memories.
        layouts: What stands there; for one over lanes, the first alone, a tile.
        lanes: Whether it is made for vectors.
        lane: Whether it is made for one lane of a tile.
        over_rows: Whether it is made for the entries of two arrays; `lane` is then their number.
        cpu: One of `CPUS`.
        **options: Further arguments of `Function`.
    """

    def __init__(
        self,
        code: Callable[..., None],
        *layouts: np.dtype,
        lanes: bool = False,
        lane: bool = False,
        over_rows: bool = False,
        cpu: str = "this",
        **options: Any,
    ) -> None:
        module = Module()
        function = Function(module, "code", layouts, **options)
        if lanes:
            function.over_lanes(code)
        elif over_rows:
            function.over_rows(code)
        else:
            function.once(code, lane=lane)
        function.end()
        model, features = CPUS[cpu]
        machine = llvm.Target.from_default_triple().create_target_machine(
            cpu=model, features=features, opt=2, jit=True
        )
        parsed = llvm.parse_assembly(str(module), context())
        parsed.triple, parsed.data_layout = machine.triple, str(machine.target_data)
        parsed.verify()
        self.engine = llvm.create_mcjit_compiler(parsed, machine)
        self.engine.finalize_object()
        self.address = self.engine.get_function_address("code")
        self.table = self.engine.get_global_value_address("table")

    def __call__(self, first: np.ndarray, second: Any = None, lane=0, **options: Any) -> None:
        """Call it; over lanes, with the table of its constants."""
        call(self.address, first, self.table if second is None else second, lane, **options)


def rows(**fields: int) -> np.dtype:
    """The layout of a tile with some rows in each field."""
    return np.dtype([(name, "f8", (count, WIDTH)) for name, count in fields.items()])


def in_lanes(function: Callable[..., Any], *inputs: np.ndarray, cpu: str = "this") -> np.ndarray:
    """A function's results, (results, n), computed over lanes from inputs of shape (n,)."""

    def code(tile) -> None:
        results = function(*(tile["given", i] for i in range(len(inputs))))
        for i, result in enumerate(results):
            tile["found", i] = result

    count, layout = len(inputs[0]), rows(given=len(inputs), found=8)
    native, found = Native(code, layout, lanes=True, cpu=cpu), []
    for first in range(0, count, GROUP):
        tile = aligned(layout, 1)
        part = np.array([x[first : first + GROUP] for x in inputs])
        tile["given"][0, :, : part.shape[1]] = part
        native(tile)
        found.append(tile["found"][0, :, : part.shape[1]].copy())
    return np.concatenate(found, axis=1)


def _bits(x: Any) -> int:
    return int.from_bytes(struct.pack("<d", x), "little")


def _of_bits(whole: int) -> float:
    return struct.unpack("<d", whole.to_bytes(8, "little"))[0]


_PLAIN: dict[str, Callable[..., Any]] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": operator.truediv,
    "neg": operator.neg,
    "abs": lambda a: -a if np.real(a) < 0.0 else a,
    "sqrt": np.sqrt,
    "inverse root": lambda a, start, places: _of_bits(start - sum(_bits(a) >> k for k in places)),
    "<": lambda a, b: np.real(a) < np.real(b),
    "<=": lambda a, b: np.real(a) <= np.real(b),
    ">": lambda a, b: np.real(a) > np.real(b),
    ">=": lambda a, b: np.real(a) >= np.real(b),
    "and": lambda a, b: a and b,
    "or": lambda a, b: a or b,
    "not": lambda a: not a,
    "choose": lambda condition, yes, no: yes if condition else no,
}


def entries(*names: str) -> tuple[Expression, ...]:
    """Places in memory that are read."""
    known: dict = {}
    return tuple(read(known, name) for name in names)


def evaluate(x: Expression, entries: Mapping[Expression, Any]) -> Any:
    """The value of an expression where entries have some values, real or complex."""
    done: dict[Expression, Any] = dict(entries)

    def value(x: Expression) -> Any:
        if x not in done:
            if x.op == "constant":
                done[x] = np.float64(x.args[0])
            elif x.op == "near":
                done[x] = value(x.args[0])
            elif x.op in ("sin", "cos"):
                done[x] = getattr(np, x.op)(value(x.args[0]))
            else:
                given = [value(a) if isinstance(a, Expression) else a for a in x.args]
                done[x] = _PLAIN[x.op](*given)
        return done[x]

    return value(x)
