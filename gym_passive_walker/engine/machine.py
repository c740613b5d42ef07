"""Machine code by LLVM: from a wheel, or compiled once and kept on disk."""

from __future__ import annotations

import ctypes
import io
import os
import warnings
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

from llvmlite import binding as llvm

from gym_passive_walker._tools.arguments import whole
from gym_passive_walker._tools.progress import compiling
from gym_passive_walker.engine import cache
from gym_passive_walker.engine.native import GROUP


class Level(NamedTuple):
    """A target of the machine code in a wheel."""

    triple: str
    cpu: str
    features: str
    needs: tuple[str, ...]


_V3 = ("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave")
_V4 = (*_V3, "avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl")
LEVELS = {
    "x86-64-v3": Level("x86_64-unknown-linux-gnu", "x86-64-v3", "", _V3),
    # Use 512-bit vectors; LLVM prefers 256 bits by default.
    "x86-64-v4": Level("x86_64-unknown-linux-gnu", "x86-64-v4", "-prefer-256-bit", _V4),
}
"""Machine code in a wheel, the better ones last."""

BUILT = Path(__file__).parents[1] / "built"
"""What a wheel has and a checkout has not: a folder of objects for each level, the modules of web
pages, and PACKED: bitcode of kernels, for all other CPUs, on which equations are traced again."""

PACKED = "bitcode.tar.xz"

_ALIVE: list[Any] = []
"""LLVM engines that own native code; kept so that the code lasts as long as the process."""


_MATHEMATICS = ("cos", "exp", "fma", "log", "sin", "tanh")
"""Functions of the C library that machine code may call. A process of Windows may have several
C libraries with other bits, so these are named to LLVM from the one that Python uses."""

THREADS = "NUMBA_NUM_THREADS"
"""Environment variable with the number of threads of large batches."""


@lru_cache
def default_threads() -> int:
    """Return the number of threads: that of the environment variable, else of free CPUs.

    Raises:
        ValueError: if the variable is not a whole number from 1 on.
    """
    if asked := os.environ.get(THREADS):
        return whole(int(asked) if asked.isdecimal() else asked, THREADS, least=1)
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
    if os.name == "nt":
        runtime = ctypes.CDLL("ucrtbase")
        for name in _MATHEMATICS:
            add_symbol(name, ctypes.cast(getattr(runtime, name), ctypes.c_void_p).value or 0)
    cpu = os.environ.get("NUMBA_CPU_NAME") or llvm.get_host_cpu_name()
    features = os.environ.get("NUMBA_CPU_FEATURES")
    if features is None:
        own = cpu == llvm.get_host_cpu_name()
        # Use 512-bit vectors where the CPU has them; LLVM prefers 256 bits by default.
        has = llvm.get_host_cpu_features()
        on_x86 = llvm.get_process_triple().startswith("x86_64")  # elsewhere LLVM would complain
        features = has.flatten() + ",-prefer-256-bit" * on_x86 if own else ""
        if own and on_x86 and not has.get("fma"):
            warnings.warn(
                "this CPU, or the virtual machine that it seems to be, has no fused multiply-add: "
                "walks have the same bits, and take 50 to 1,000 times as long",
                RuntimeWarning,
                stacklevel=2,
            )
    target = llvm.Target.from_triple(llvm.get_process_triple())
    machine = target.create_target_machine(cpu=cpu, features=features, opt=2, jit=True)
    return machine, f"{llvm.llvm_version_info}{target.triple}{cpu}{features}"


@lru_cache
def group() -> int:
    """Return the lanes of a vector in code for this CPU. Bits do not depend on it.

    Vectors of 128 bits have no registers for more: with eight lanes, a third of the instructions of
    a kneed walker's sweep on ARM would store registers and load them again.
    """
    return GROUP if llvm.get_process_triple().startswith("x86_64") else 2


@lru_cache
def _level() -> str | None:
    """Return the best of LEVELS that this CPU has; None if there is none."""
    if "NUMBA_CPU_NAME" in os.environ or "NUMBA_CPU_FEATURES" in os.environ:
        return None
    triple, has = llvm.get_process_triple(), llvm.get_host_cpu_features()
    for name, level in reversed(LEVELS.items()):
        alike = triple.split("-")[0] == level.triple.split("-")[0] and "linux" in triple
        if alike and all(has.get(feature) for feature in level.needs):
            return name
    return None


def is_built() -> bool:
    """Return whether the package has machine code for this CPU."""
    return (BUILT / f"{_level()}").is_dir()


def kept_code(name: str, write: Callable[[], Any], what: str) -> Any:
    """Load machine code from the package or the cache, or make and cache it.

    Args:
        name: Name of the code.
        write: Returns LLVM's text, or what `str` makes it of.
        what: Name of the code in notices.
    """
    if _asked:
        _asked[-1][name] = write
        raise _Asked
    data = at_hand(name)
    if data is None:
        with compiling(what):
            data = object_code(packed(name) or write())
        cache.keep(_file(name), data)
    return loaded(data)


def at_hand(name: str) -> bytes | None:
    """Return machine code from the package or the cache, by its name; None if there is none."""
    built = BUILT / f"{_level()}" / f"{name}.o"
    return built.read_bytes() if built.exists() else cache.found(_file(name))


def _file(name: str) -> str:
    return f"{name}-{sha256(_machine()[1].encode()).hexdigest()[:16]}.o"


class _Asked(Exception):
    """The name of code was asked for, and not the code."""


_asked: list[dict[str, Callable[[], Any]]] = []


def asked_by(pieces: Iterable[Callable[[], object]]) -> dict[str, Callable[[], Any]]:
    """Return what writes LLVM's text, by name, for the first code that each function would load."""
    _asked.append({})
    for piece in pieces:
        with suppress(_Asked):
            piece()
    return _asked.pop()


def object_code(module: Any) -> bytes:
    """Compile bitcode, LLVM's text, or what `str` makes it of, for this CPU."""
    machine, _ = _machine()
    if not isinstance(module, bytes):
        return machine.emit_object(_parsed(str(module)))
    return machine.emit_object(_for(llvm.parse_bitcode(module, context()), machine))


def packed(name: str) -> bytes | None:
    """Return bitcode of the package; None if it has none of this name."""
    return _packed().get(f"{name}.bc")


@lru_cache
def _packed() -> dict[str, bytes]:
    """Return all bitcode of the package; modules share most of it, so it is compressed at once."""
    if not (BUILT / PACKED).exists():
        return {}
    import tarfile  # seldom needed, and its import takes as long as a kernel's

    with tarfile.open(BUILT / PACKED) as files:
        return {file.name: files.extractfile(file).read() for file in files}  # type: ignore[union-attr]


def pack(modules: Mapping[str, bytes], folder: Path) -> None:
    """Write bitcode, by its names, for `packed`."""
    import tarfile

    with tarfile.open(folder / PACKED, "w:xz", preset=9) as files:
        for name, data in sorted(modules.items()):
            file = tarfile.TarInfo(f"{name}.bc")
            file.size = len(data)
            files.addfile(file, io.BytesIO(data))


def bitcode(text: str) -> bytes:
    """Return the bitcode of LLVM's text."""
    return llvm.parse_assembly(text, context()).as_bitcode()


def object_for(level: Level, text: str) -> bytes:
    """Compile LLVM's text for a level of CPUs."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    target = llvm.Target.from_triple(level.triple)
    machine = target.create_target_machine(level.cpu, level.features, opt=2, jit=True)
    return machine.emit_object(_for(llvm.parse_assembly(text, context()), machine))


def add_symbol(name: str, address: int) -> None:
    """Name a function of this process, with its address, for machine code that calls it."""
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
    return _for(llvm.parse_assembly(text, context()), _machine()[0])


def _for(module: Any, machine: Any) -> Any:
    """Return a module for a target machine, after a check."""
    module.triple, module.data_layout = machine.triple, str(machine.target_data)
    module.verify()
    return module
