"""Machine code by LLVM: compiled once, kept on disk, called by its addresses."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import lru_cache
from hashlib import sha256
from typing import Any

from llvmlite import binding as llvm

from gym_passive_walker._tools.progress import compiling
from gym_passive_walker.engine import cache

_ALIVE: list[Any] = []
"""LLVM engines that own native code; kept so that the code lasts as long as the process."""


THREADS = "NUMBA_NUM_THREADS"
"""Environment variable with the number of threads of large batches."""


@lru_cache
def default_threads() -> int:
    """Return the number of threads: that of the environment variable, else of free processors."""
    asked = os.environ.get(THREADS, "")
    if asked.isdecimal():
        return max(1, int(asked))
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@lru_cache
def context() -> Any:
    """Return the LLVM context for parsing; llvmlite 0.44 needs opaque pointers enabled."""
    asked: Any = llvm.context
    before = getattr(asked, "opaque_pointers_enabled", True)
    asked.opaque_pointers_enabled = True
    try:
        return llvm.create_context()
    finally:
        asked.opaque_pointers_enabled = before


@lru_cache
def _machine() -> Any:
    """Return the target machine and its description: this CPU, or that of NUMBA_CPU_NAME."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    cpu = os.environ.get("NUMBA_CPU_NAME") or llvm.get_host_cpu_name()
    features = os.environ.get("NUMBA_CPU_FEATURES")
    if features is None:
        own = cpu == llvm.get_host_cpu_name()
        # Use 512-bit vectors where the CPU has them; LLVM prefers 256 bits by default.
        features = llvm.get_host_cpu_features().flatten() + ",-prefer-256-bit" if own else ""
    target = llvm.Target.from_triple(llvm.get_process_triple())
    machine = target.create_target_machine(cpu=cpu, features=features, opt=2, jit=True)
    return machine, f"{llvm.llvm_version_info}{target.triple}{cpu}{features}"


def kept_code(name: str, write: Callable[[], Any], what: str) -> Any:
    """Load machine code from the cache, or make and cache it.

    Args:
        name: Name of the code.
        write: Returns LLVM's text, or what `str` makes it of.
        what: Name of the code in notices.
    """
    file = f"{name}-{sha256(_machine()[1].encode()).hexdigest()[:16]}.o"
    data = cache.found(file)
    if data is None:
        with compiling(what):
            data = object_code(write())
        cache.keep(file, data)
    return loaded(data)


def object_code(module: Any) -> bytes:
    """Compile LLVM's text, or what `str` makes it of, to machine code."""
    return _machine()[0].emit_object(_parsed(str(module)))


def add_symbol(name: str, address: int) -> None:
    """Tell LLVM the address of a function that machine code calls by its name."""
    llvm.add_symbol(name, address)


def loaded(data: bytes) -> Any:
    """Load machine code, which stays callable as long as the process lasts."""
    engine = llvm.create_mcjit_compiler(_parsed(""), _machine()[0])
    engine.add_object_file(llvm.ObjectFileRef.from_data(data))
    engine.finalize_object()
    _ALIVE.append(engine)
    return engine


def _parsed(text: str) -> Any:
    """Parse LLVM text as a module for the target machine."""
    module = llvm.parse_assembly(text, context())
    module.triple, module.data_layout = _machine()[0].triple, str(_machine()[0].target_data)
    module.verify()
    return module
