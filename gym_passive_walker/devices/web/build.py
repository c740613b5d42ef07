"""The files of a page: a WebAssembly module for each kind of walker, and what they share."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path

import llvmlite

from gym_passive_walker._tools.arguments import shown
from gym_passive_walker._tools.files import replacing
from gym_passive_walker._tools.progress import compiling
from gym_passive_walker.devices.web import code, container, page_data
from gym_passive_walker.engine import cache, machine
from gym_passive_walker.engine.layout import NARROW, layout_of
from gym_passive_walker.engine.own import system as own
from gym_passive_walker.envs.policies import TENSORS, policy_folder, shipped_policies
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.models.model import check_supports

_ROOT = Path(__file__).parent
PACKAGE = _ROOT / "package"
"""The folder of the JavaScript package, without what is built."""

MODULES = ("kneed", "straight", "simplest")
DATA = "data.json"
_SOURCES = _ROOT.parents[1]
_OF_CODE = (
    "devices/web/*.py",
    "pictures/*.py",
    "models/walkers/*.py",
    "gaits/scenes/*.py",
    "envs/*.py",
)
"""Sources of compiled code, besides those that name the cache folder."""
_OF_DATA = ("**/*.py", "**/*.json")
"""Sources of the data: gaits are searched for, and the version is that of the package."""
_GIVEN = ("__linear_memory", "__stack_pointer", "__indirect_function_table")

# Numba then writes code for a CPU without vector units, which becomes the smallest module.
_PLAIN = {
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
    "NUMBA_LOOP_VECTORIZE": "0",
    "NUMBA_SLP_VECTORIZE": "0",
}


class WebError(RuntimeError):
    """The WebAssembly modules cannot be built; the message says why."""


def _name(sources: Collection[str]) -> str:
    """Return a hash of the package's files of these patterns; it names what is made of them."""
    digest = hashlib.sha256(f"{sys.version} {llvmlite.__version__}".encode())
    for source in sorted(path for pattern in sources for path in _SOURCES.glob(pattern)):
        digest.update(source.relative_to(_SOURCES).as_posix().encode() + source.read_bytes())
    return digest.hexdigest()[:16]


def bookkeeping(name: str) -> bytes:
    """Return the bitcode of one of `code.BOOKKEEPING`: from the package, or compiled and cached.

    Raises:
        WebError: if it cannot be compiled here.
    """
    packed = machine.packed(f"web-{name}")
    if packed is not None:
        return packed
    return _kept(f"{name}.bc", "what web pages share", lambda: _compile(name))


def _kept(name: str, what: str, compile: Callable[[], bytes]) -> bytes:
    """Return code of this name from the cache, or compile and cache it."""
    name = f"web-{_name(_OF_CODE)}-{name}"
    found = cache.found(name)
    if found is None:
        with compiling(what):
            found = compile()
        cache.keep(name, found)
    return found


def _object(texts: Sequence[str], exported: Collection[str], name: str) -> bytes:
    made = code.wasm_object(texts, exported, bookkeeping(name))
    if strange := set(container.imports(made)) - set(_GIVEN):
        raise WebError(f"a module for web pages would need {', '.join(sorted(strange))}")
    return made


def modules() -> dict[str, bytes]:
    """Return the WebAssembly modules, by file name: from the package, or compiled and cached.

    Raises:
        WebError: if they cannot be compiled here.
    """
    return {f"{kind}.wasm": _module(kind) for kind in MODULES}


def _module(kind: str) -> bytes:
    built = machine.BUILT / f"{kind}.wasm"
    if built.exists():
        return built.read_bytes()
    made = _kept(
        f"{kind}.o", f"the {kind} walkers for web pages",
        lambda: _object(code.of_kind(kind), code.EXPORTED, "walkers"),
    )  # fmt: skip
    notes = page_data.of_module(code.SYSTEMS_OF[kind], code.VARIANTS, container.data_end(made))
    return container.module(made, code.EXPORTED, {page_data.SECTION: notes})


def data() -> bytes:
    """Return the data that the modules share, as JSON; cached."""
    name = f"web-{_name(_OF_DATA)}-{DATA}"
    found = cache.found(name)
    if found is None:
        found = json.dumps(page_data.of_all(), separators=(",", ":"), allow_nan=False).encode()
        cache.keep(name, found)
    return found


def system_module(system: own.System, gait: Gait | None = None) -> bytes:
    """Return the WebAssembly module of a user's system; cached by its equations.

    Args:
        system: The system.
        gait: A gait of it, in which a page begins; None is the system's `start`.

    Raises:
        WebError: if the module cannot be compiled here.
    """
    check_supports(system, "pages")
    texts = code.code_of_system(system)
    digest = hashlib.sha256("".join(texts).encode()).hexdigest()[:16]
    name = "narrow" if layout_of(system.hybrid) == NARROW else "wide"
    made = _kept(
        f"{digest}.o", "a system for web pages",
        lambda: _object(texts, code.EXPORTED_OF_SYSTEM, name),
    )  # fmt: skip
    section = page_data.of_system(system, container.data_end(made), code.variants(system), gait)
    return container.module(made, code.EXPORTED_OF_SYSTEM, {page_data.SECTION: section})


def _compile(name: str) -> bytes:
    path = os.pathsep.join([str(_ROOT.parents[2]), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, **_PLAIN, "PYTHONPATH": path.rstrip(os.pathsep)}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "shared.bc"
        module = "gym_passive_walker.devices.web.bookkeeping"
        command = [sys.executable, "-m", module, str(file), name]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        if done.returncode:
            last = (done.stderr.strip() or "no message").splitlines()[-1]
            raise WebError(f"the WebAssembly modules cannot be compiled: {last}")
        return file.read_bytes()


def files() -> dict[str, bytes]:
    """Return all files of the JavaScript package, by their paths in it.

    Raises:
        WebError: if the modules cannot be compiled here.
    """
    found = {
        path.relative_to(PACKAGE).as_posix(): path.read_bytes()
        for path in sorted(PACKAGE.rglob("*"))
        if path.is_file()
    }
    found |= modules() | {DATA: data()}
    for name in shipped_policies():
        found[f"policies/{name}.safetensors"] = (policy_folder(name) / TENSORS).read_bytes()
    return found


def build(folder: str | Path, systems: Mapping[str, own.System | Gait] | None = None) -> Path:
    """Write the JavaScript package into a folder, ready for a page or for npm.

    Args:
        folder: The folder; it is made if it does not exist.
        systems: Systems of one's own, by the names of their modules: "torso" is written to
            "systems/torso.wasm". A gait of a system gives the page its slope and its start too.

    Raises:
        ValueError: if a name is not that of a file, or a value is not a system or a passive gait of
            one on smooth ground.
        WebError: if the modules cannot be compiled here.
    """
    if systems is not None and not isinstance(systems, Mapping):
        raise ValueError(
            'systems must map names to systems, as {"torso": system}, not ' + shown(systems)
        )
    made = {}
    for name, given in ({} if systems is None else systems).items():
        if not isinstance(name, str) or not re.fullmatch(r"[\w-]+", name):
            raise ValueError(f"systems: {name!r} must be letters, digits, '-' and '_'")
        gait = given if isinstance(given, Gait) else None
        system = given if gait is None else gait.walker
        if not isinstance(system, own.System):
            raise ValueError(
                f"systems[{name!r}] must be a gpw.System or a gait of one, not {shown(given)}"
            )
        if gait is not None and (
            gait.controller is not None or gait.stride_map.terrain is not None
        ):
            raise ValueError(
                f"systems[{name!r}] must be a passive gait on smooth ground, as a page begins with "
                "controls of 0: give a gait of a stride map without controller and terrain"
            )
        made[f"systems/{name}.wasm"] = system_module(system, gait)
    folder = Path(folder)
    for name, content in (files() | made).items():
        with replacing(folder / name) as aside:
            aside.write_bytes(content)
    return folder
