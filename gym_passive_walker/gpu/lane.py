"""One walker on one thread of a device: what carries it there, in the engine's own words."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.engine import jit, lanes
from gym_passive_walker.engine.compiled import phases_of, written
from gym_passive_walker.engine.layout import HISTORY, PAIR, history_for, layout_of, tile_for
from gym_passive_walker.engine.one_walker import entry, integrate_phase
from gym_passive_walker.envs.constraints import equipped, look_code, push_code
from gym_passive_walker.envs.custom import Rule
from gym_passive_walker.gpu import primitives
from gym_passive_walker.gpu.bookkeeping import DeviceLinker
from gym_passive_walker.gpu.device import kind
from gym_passive_walker.gpu.source import Source
from gym_passive_walker.math import where
from gym_passive_walker.physics.hybrid import System
from gym_passive_walker.physics.systems import SYSTEMS

TILE, RUN = kind(tile_for(PAIR, width=1)), kind(HISTORY)
"""A tile for one walker, and how guards run over its step."""


def rooms(system: System) -> dict[str, np.dtype]:
    """`TILE` and `RUN` of a system, which has more coordinates than the package's if a user's."""
    layout = layout_of(system)
    tile = tile_for(PAIR, width=1, layout=layout)
    return {"TILE": kind(tile), "RUN": kind(history_for(layout))}


class Machinery:
    """A system's traced code and the engine's bookkeeping, for a device.

    Args:
        system: Its name.
        pushed: Whether walkers are pushed.
        watched: Whether feasibility constraints are checked.
        rules: Users' own functions.

    Attributes:
        phases: What the engine knows of the system's phases, with numbers for addresses.
        hooks: Addresses of what else is done to walkers.
        bound: Makes a device's function of one of the engine's.
        rules: The numbers by which users' functions are called, by their names.
    """

    phases: NDArray
    hooks: NDArray

    def __init__(
        self,
        system: str,
        *,
        pushed: bool = False,
        watched: bool = False,
        rules: Sequence[Rule] = (),
    ) -> None:
        of, pushes, looks = SYSTEMS[system], None, None
        source = Source()
        written(of, module=source, width=1)
        phases = phases_of(of, source)
        if pushed:
            pushes = source = Source(source, "pushed_")
            push_code(of, source)
        if watched:
            looks = source = Source(source, "watched_")
            look_code(of, source)
        self.rules = {}
        for rule in rules:
            source = Source(source, f"{rule.name}_", fuses=False)
            rule.write(source)
            self.rules[rule.name] = source.get_function_address("rule")
        self.phases, self.hooks = equipped(of, phases, pushes, looks)
        call = _compiled(source, f"<the equations {system}>")
        own = {getattr(jit, name): primitives.BY_NAME[name] for name in ("address", "fma")}
        own |= {jit.call: call, where: primitives.BY_NAME["select"]}
        self.bound = DeviceLinker(own).instead(
            {lanes.integrate_phase: integrate_phase, jit.entry: entry}
        )


def _compiled(source: Source, name: str) -> Any:
    """The device's function that calls each of a source's functions by its number."""
    names = dict(primitives.BY_NAME)
    names |= {"fabs": abs, "inf": np.inf, "nan": np.nan}
    exec(compile(str(source), name, "exec"), names)
    for part in source.parts:
        names[part] = primitives.inlined(names[part])
    for function in (*source.names, "call"):
        names[function] = primitives.jitted(names[function])
    return names["call"]


@lru_cache
def machinery(
    system: str, *, pushed: bool = False, watched: bool = False, rules: tuple[Rule, ...] = ()
) -> Machinery:
    """The machinery of a system; see `Machinery`."""
    return Machinery(system, pushed=pushed, watched=watched, rules=rules)
