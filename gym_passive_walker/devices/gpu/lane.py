"""Code of a GPU thread: traced equations, and functions of the engine compiled for the GPU."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from gym_passive_walker.devices.gpu import primitives
from gym_passive_walker.devices.gpu.device import kind
from gym_passive_walker.devices.gpu.source import Source
from gym_passive_walker.engine import jit, lanes
from gym_passive_walker.engine.compiled import phases_of, written
from gym_passive_walker.engine.device_linker import DeviceLinker
from gym_passive_walker.engine.layout import PAIR, history_for, layout_of, tile_for
from gym_passive_walker.engine.one_walker import entry, integrate_phase
from gym_passive_walker.envs.constraints import equipped, look_code, push_code
from gym_passive_walker.envs.rule import Rule
from gym_passive_walker.models.equations.systems import SYSTEMS
from gym_passive_walker.models.math import where

ONE_TILE: Any = None
ONE_HISTORY: Any = None
"""Types of the tile and of the guard history of one walker, which kernels have of their system."""


class DeviceCode:
    """Traced code of a system, and the functions of the engine, compiled for a GPU.

    Args:
        system: Name of the system.
        pushed: Whether walkers are pushed.
        watched: Whether feasibility constraints are checked.
        rules: Users' own functions.

    Attributes:
        phases: Phases of the system, (phases,) of `compiled.PHASE`; function numbers replace
            addresses.
        hooks: Functions for pushes and checks, (phases,) of `constraints.HOOK`.
        bound: Compiles functions of the package for the GPU.
        scratch: ONE_TILE and ONE_HISTORY of the system, by name.
        rules: Numbers by which users' functions are called, by name.
    """

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
        layout = layout_of(of)
        tile, history = tile_for(PAIR, width=1, layout=layout), history_for(layout)
        self.scratch = {"ONE_TILE": kind(tile), "ONE_HISTORY": kind(history)}
        call = _compiled(source, f"<equations of {system}>")
        own = {getattr(jit, name): primitives.BY_NAME[name] for name in ("address", "copy", "fma")}
        own |= {jit.call: call, where: primitives.BY_NAME["select"]}
        self.bound = DeviceLinker(own, primitives.jitted).instead(
            {lanes.integrate_phase: integrate_phase, jit.entry: entry}
        )


def _compiled(source: Source, name: str) -> Any:
    """Return the function for the GPU that calls the functions of a source by number."""
    names = dict(primitives.BY_NAME)
    names |= {"fabs": abs, "inf": np.inf, "nan": np.nan}
    exec(compile(str(source), name, "exec"), names)
    for part in source.parts:
        names[part] = primitives.inlined(names[part])
    for function in (*source.names, "dispatch"):
        names[function] = primitives.jitted(names[function])
    names["call"] = primitives.inlined(names["call"])
    return names["call"]


device_code = lru_cache(DeviceCode)
"""Returns the code of a system, compiled once for equal arguments."""
