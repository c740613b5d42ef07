"""Machine code for a wheel, so that its users need no compiler.

    python -m gym_passive_walker.apps.build FOLDER

The folder is `machine.BUILT`: objects of all equations and kernels for each of `machine.LEVELS`,
the bitcode of the kernels for all other CPUs, and the modules of web pages.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

from gym_passive_walker._tools import console
from gym_passive_walker._tools.progress import progress
from gym_passive_walker.devices.web.build import bookkeeping, modules
from gym_passive_walker.devices.web.code import BOOKKEEPING
from gym_passive_walker.engine import counter_rng, machine, run
from gym_passive_walker.engine.compiled import PHASE, compiled
from gym_passive_walker.engine.layout import NARROW, WIDE, Layout, layout_of, record_for
from gym_passive_walker.envs import constraints, ticks, transitions
from gym_passive_walker.envs.batch import system_in
from gym_passive_walker.envs.custom import is_custom
from gym_passive_walker.envs.disturbances import disturbed
from gym_passive_walker.gaits import terrain
from gym_passive_walker.gaits.find import newton
from gym_passive_walker.gaits.scenes import starts
from gym_passive_walker.gaits.scenes.scene import Scene
from gym_passive_walker.models.equations.systems import SYSTEMS

GROUPS = (*SYSTEMS, *(f"kernels of {width} records" for width in ("narrow", "wide")))
"""Parts of the package that are compiled apart from each other."""


def pieces(groups: Iterable[str] = GROUPS) -> Iterator[Callable[[], object]]:
    """Yield functions, each of which loads one module of machine code."""
    for group in groups:
        if group not in SYSTEMS:
            yield from _kernels(WIDE if "wide" in group else NARROW)
            continue
        yield partial(compiled, group)
        yield partial(compiled, group, derived=True)
        yield partial(compiled, group, derived=True, still=True)
        yield partial(constraints.hooks, group, pushed=True, watched=False)
        yield partial(constraints.hooks, group, pushed=False, watched=True)


def compile_piece(number: int) -> None:
    """Compile and cache one of `pieces`, in a process of a pool, by its number."""
    list(pieces())[number]()


def _kernels(layout: Layout) -> Iterator[Callable[[], object]]:
    records = np.zeros((0, 1), record_for(layout))
    phases, numbers = np.zeros(0, PHASE), np.zeros(0)
    lanes, table, keys = np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0, np.uint64)
    cube = np.zeros((0, 1, 1))
    given = [
        (run.integrate, records, cube, phases, run.options(1e-8), *run.workspace(layout=layout)),
        (transitions.look, np.zeros(0, transitions.note_for(layout)), 0, table),
        (ticks.draw_numbers, 0, lanes, table, keys),
        (newton.eliminate, cube, table),
        (starts.between, numbers, table, numbers, table),
        (terrain.grounds, table, numbers, keys, lanes, table),
        (counter_rng.word, 0, 0),
        (counter_rng.uniform, 0, 0, 0),
        (counter_rng.normal, 0, 0, 0),
    ]
    for kernel, *arguments in given:
        yield partial(kernel.native, *arguments)
    for switches in product((False, True), repeat=2):
        yield from _of_batches(layout, *switches)


def _of_batches(layout: Layout, pushed: bool, custom: bool) -> Iterator[Callable[[], object]]:
    """Yield the kernels of batches, those of steps last."""
    numbers, singles, truths = np.zeros(0), np.zeros(0, np.float32), np.zeros(0, bool)
    lanes, table, words = np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 1), np.int64)
    of = ticks.kernels_for(layout, pushed, custom)
    keys = np.zeros(0, np.uint64)
    yield partial(of.begin.native, 0, lanes, numbers, table, table, keys, singles)
    yield partial(of.observe.native, 0, singles)
    yield partial(of.begin_alike.native, 0, lanes, singles)
    yield partial(of.write_info.native, 0, table, words)
    if custom:
        yield partial(of.enter.native, 0, True, True, numbers, truths)
    filled = singles, numbers, truths, truths, table, words
    yield partial(ticks.post.native, 0, False, *filled)
    yield partial(of.step.native, 0, 0, 0, 0, 0)


def _of_scene(system: str, wide: bool, pushed: bool, custom: bool) -> list[Callable]:
    """Return what a scene's steps need, the longest last."""
    _, *kernels = _of_batches(WIDE if wide else NARROW, pushed, custom)
    return [partial(compiled, system)] * (not pushed and system in SYSTEMS) + kernels


def compile_for(scene: Scene) -> None:
    """Compile what environments of a scene need, in two processes at once.

    Nothing happens if most of it is there, as in a package from a wheel.
    """
    system = system_in(scene, scene.walker)
    key = system.name, layout_of(system) is WIDE, disturbed(scene), is_custom(scene)
    *_, step = _of_scene(*key)
    if all(map(machine.at_hand, machine.asked_by([step]))):
        return
    code = f"from gym_passive_walker.apps import build; build.compile_others({key})"
    with subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.DEVNULL):
        step()


def compile_others(key: tuple[str, bool, bool, bool]) -> None:
    """Compile what `compile_for` does not: it is the other process."""
    for piece in _of_scene(*key)[:-1]:
        piece()


def processes(wanted: int) -> int:
    """Return how many processes to start; Windows waits for at most 61 at once."""
    return min(wanted, 61) if os.name == "nt" else wanted


def _texts(group: str) -> dict[str, str]:
    return {name: str(write()) for name, write in machine.asked_by(pieces([group])).items()}


def _of_pages(folder: Path) -> dict[str, bytes]:
    """Write the modules of web pages into a folder; return the bitcode of what they share."""
    for name, data in modules().items():
        (folder / name).write_bytes(data)
    return {f"web-{name}": bookkeeping(name) for name in BOOKKEEPING}


def write_files(folder: Path) -> None:
    """Write the files of `machine.BUILT` into a folder."""
    for name in machine.LEVELS:
        (folder / name).mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(processes(os.cpu_count() or 1)) as pool:
        # The longest first.
        groups = {group: pool.submit(_texts, group) for group in reversed(GROUPS)}
        pages, asked, packed = pool.submit(_of_pages, folder), [], {}
        for group, found in groups.items():
            for name, text in found.result().items():
                if group not in SYSTEMS:
                    packed[name] = machine.bitcode(text)
                for level, target in machine.LEVELS.items():
                    path = folder / level / f"{name}.o"
                    asked.append((path, pool.submit(machine.object_for, target, text)))
        with progress("modules of machine code", len(asked)) as made_one:
            for path, data in asked:
                path.write_bytes(data.result())
                made_one()
        machine.pack(packed | pages.result(), folder)


if __name__ == "__main__":
    sys.exit(console.run(lambda: write_files(Path(sys.argv[1]))))
