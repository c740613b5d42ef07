"""The files of a page: a WebAssembly module for each kind of walker, and what they share."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from gym_passive_walker._tools.arguments import shown
from gym_passive_walker._tools.extras import need
from gym_passive_walker._tools.progress import compiling
from gym_passive_walker.devices.web import page_data
from gym_passive_walker.engine import cache
from gym_passive_walker.engine.layout import NARROW, layout_of
from gym_passive_walker.envs.policies import TENSORS, policy_folder, shipped_policies
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.models.walkers import Mechanism

_ROOT = Path(__file__).parent
PACKAGE = _ROOT / "package"
"""The folder of the JavaScript package, without what is built."""

MODULES = ("kneed", "straight", "simplest")
DATA = "data.json"

# Numba then writes code for a CPU without vector units, which becomes the smallest module.
_PLAIN = {
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
    "NUMBA_LOOP_VECTORIZE": "0",
    "NUMBA_SLP_VECTORIZE": "0",
}


class WebError(RuntimeError):
    """The WebAssembly modules cannot be built; the message says why."""


def _name() -> str:
    """Return the name under which modules are cached: a hash of what they are made of."""
    digest = hashlib.sha256(sys.version.encode())
    for folder in (
        "devices/web", "pictures", "models/walkers", "gaits/scenes", "envs", "envs/policies",
    ):  # fmt: skip
        sources = (_ROOT.parents[1] / folder).glob
        for source in sorted([*sources("*.py"), *sources("*/*.json")]):  # also the policies'
            digest.update(source.name.encode() + source.read_bytes())
    return digest.hexdigest()[:16]


def modules() -> dict[str, bytes]:
    """Return the WebAssembly modules, by file name.

    They are compiled in a process of their own in about twenty seconds, and cached.

    Raises:
        WebError: if they cannot be compiled here.
    """
    names = [f"{kind}.wasm" for kind in MODULES]
    made = {name: cache.found(f"web-{_name()}-{name}") for name in names}
    if any(content is None for content in made.values()):
        with compiling("the walkers for web pages"), tempfile.TemporaryDirectory() as folder:
            _compile(Path(folder))
            made = {name: (Path(folder) / name).read_bytes() for name in names}
        for name, content in made.items():
            cache.keep(f"web-{_name()}-{name}", content)  # type: ignore[arg-type]
    return made  # type: ignore[return-value]


def data() -> bytes:
    """Return the data that the modules share, as JSON; cached."""
    name = f"web-{_name()}-{DATA}"
    found = cache.found(name)
    if found is None:
        found = json.dumps(page_data.of_all(), separators=(",", ":"), allow_nan=False).encode()
        cache.keep(name, found)
    return found


def system_module(system: Mechanism, gait: Gait | None = None) -> bytes:
    """Return the WebAssembly module of a user's system; cached by its equations.

    Args:
        system: The system.
        gait: A gait of it, in which a page begins; None is the system's `start`.

    Raises:
        WebError: if the module cannot be compiled here.
    """
    from gym_passive_walker.devices.web import (  # numba is imported where it is needed
        code,
        container,
    )

    name = "narrow" if layout_of(system.hybrid) == NARROW else "wide"
    texts = code.code_of_system(system)
    digest = hashlib.sha256("".join(texts).encode()).hexdigest()[:16]
    made = cache.found(f"web-{_name()}-{digest}.o")
    if made is None:
        with compiling("a system for web pages"), tempfile.TemporaryDirectory() as folder:
            for i, text in enumerate(texts):
                (Path(folder) / f"{name}-{i}.ll").write_text(text, encoding="utf-8")
            _compile(Path(folder), name)
            made = (Path(folder) / f"{name}.o").read_bytes()
        cache.keep(f"web-{_name()}-{digest}.o", made)
    section = page_data.of_system(system, container.data_end(made), code.variants(system), gait)
    return container.module(made, code.EXPORTED_OF_SYSTEM, {page_data.SECTION: section})


def _compile(folder: Path, *names: str) -> None:
    need("numba", "notebook")
    command = [sys.executable, "-m", "gym_passive_walker.devices.web.compile", str(folder), *names]
    path = os.pathsep.join([str(_ROOT.parents[2]), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, **_PLAIN, "PYTHONPATH": path.rstrip(os.pathsep)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        last = (done.stderr.strip() or "no message").splitlines()[-1]
        raise WebError(f"the WebAssembly modules cannot be compiled: {last}")


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


def build(folder: str | Path, systems: Mapping[str, Mechanism | Gait] | None = None) -> Path:
    """Write the JavaScript package into a folder, ready for a page or for npm.

    Args:
        folder: The folder; it is made if it does not exist.
        systems: Systems of one's own, by the names of their modules: "torso" is written to
            "systems/torso.wasm". A gait of a system gives the page its slope and its start too.

    Raises:
        ValueError: if a name is not that of a file, or a value is not a system.
        WebError: if the modules cannot be compiled here.
    """
    own = {}
    for name, given in ({} if systems is None else systems).items():
        if not re.fullmatch(r"[\w-]+", name):
            raise ValueError(f"systems: {name!r} must be letters, digits, '-' and '_'")
        gait = given if isinstance(given, Gait) else None
        system = given if gait is None else gait.walker
        if not isinstance(system, Mechanism):
            raise ValueError(
                f"systems[{name!r}] must be a gpw.System or a gait of one, not {shown(given)}"
            )
        own[f"systems/{name}.wasm"] = system_module(system, gait)
    folder = Path(folder)
    for name, content in (files() | own).items():
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(content)
    return folder
