"""The part of a page's code that numba compiles: kernels, and elementary functions.

It is a process of `build`, in which numba writes code for a CPU without vector units.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
from numba import types

from gym_passive_walker.devices.web import code, elementary, kernels, system_kernels
from gym_passive_walker.engine import jit, lanes, one_walker
from gym_passive_walker.engine.compiler import NUMBA_OPTIONS, PRIMITIVES, linker, untargeted
from gym_passive_walker.engine.device_linker import DeviceLinker
from gym_passive_walker.envs import disturbance_kernels
from gym_passive_walker.envs import one_walker as one_episode

_FUNCTIONS = {
    "fma": elementary.fused,
    "sin": elementary.sine,
    "cos": elementary.cosine,
    "log": elementary.logarithm,
    "asin": elementary.arcsine,
    "exp": elementary.exponential,
    "tanh": elementary.hyperbolic_tangent,
}


def _jitted(function: FunctionType) -> Any:
    return numba.njit(**NUMBA_OPTIONS)(function)


_LINKER = DeviceLinker(PRIMITIVES, _jitted)


def _compiled(function: FunctionType, *kinds: Any) -> tuple[str, str]:
    """Compile a function by numba; return its LLVM text and its name there."""
    dispatcher = _jitted(function)
    dispatcher.compile(types.void(*kinds) if kinds[0] != types.float64 else kinds)
    (result,) = dispatcher.overloads.values()
    text = re.sub(
        r"= linkonce_odr (local_unnamed_addr |hidden )*constant", "= internal constant",
        untargeted(result.library.get_llvm_str()),
    )  # fmt: skip
    return code.with_own_functions(text), result.fndesc.llvm_func_name


def texts(name: str) -> list[str]:
    """Return LLVM's texts of one of `code.BOOKKEEPING`."""
    layout = code.BOOKKEEPING[name]
    run = kernels.run if layout is None else system_kernels.run_for(layout)
    bound = _LINKER.instead({
        lanes.integrate_phase: one_walker.integrate_phase,
        jit.entry: one_walker.entry,
        disturbance_kernels.integrate_past_events: one_episode.integrate_past_events,
    })  # fmt: skip
    text, called = _compiled(bound.rebound(run), types.int64, types.int64)
    call = (
        "define void @run(i32 %what, i32 %base) {\n"
        "%result = alloca ptr\n%error = alloca ptr\n"
        "%a = zext i32 %what to i64\n%b = zext i32 %base to i64\n"
        f'call i32 @"{called}"(ptr %result, ptr %error, i64 %a, i64 %b)\nret void\n}}\n'
    )
    found = [f"{text}\n{call}"]
    for symbol in code.OWN_FUNCTIONS:
        function = _FUNCTIONS[symbol]
        count = function.__code__.co_argcount
        text, called = _compiled(linker().rebound(function), *[types.float64] * count)
        given = ", ".join(f"double %x{i}" for i in range(count))
        found.append(
            f"{text}\ndefine double @own_{symbol}({given}) noinline {{\n"
            "%result = alloca double\n%error = alloca ptr\n"
            f'call i32 @"{called}"(ptr %result, ptr %error, {given})\n'
            "%value = load double, ptr %result\nret double %value\n}\n"
        )
    return found


def main(file: Path, name: str) -> None:
    """Write the bitcode of one of `code.BOOKKEEPING` into a file."""
    file.write_bytes(code.one_module(texts(name)).as_bitcode())


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
