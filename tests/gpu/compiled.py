"""Kernels without a device: as PTX for one, and their functions as code for this CPU.

Tests run this in processes of their own, since no device is simulated here. Numba's compiler for
devices gets the kind of device as an argument.
"""

from __future__ import annotations

import os
import sys
from types import ModuleType

import numpy as np


def on_cpu(name: str) -> float:
    """By how much strides by the device's functions, compiled for this CPU, are off."""
    os.environ["NUMBA_OPT"] = "0"  # compilation takes longer than the strides

    import numba
    import numba.cuda.extending
    import numba.extending

    numba.cuda.extending.intrinsic = numba.extending.intrinsic
    sys.modules.setdefault("numba_cuda", ModuleType("numba_cuda"))  # which a device would need
    from gym_passive_walker.devices.gpu import lane, primitives
    from gym_passive_walker.engine import run
    from gym_passive_walker.engine.layout import HISTORY, PAIR, tile_for
    from gym_passive_walker.models.equations.systems import SYSTEMS

    def jitted(function):
        return numba.njit(error_model="numpy")(function)

    primitives.jitted = primitives.inlined = jitted
    from tests.gpu.thrown import thrown

    here, (own, records) = lane.device_code(name), thrown(name, 200)
    integrate, reported = here.bound(run.integrate), run.options(1e-8, from_section=True)
    usual, working = records.copy(), (np.zeros(1, tile_for(PAIR, 1)), np.zeros(1, HISTORY))
    run.advance(SYSTEMS[name], own, usual, tolerance=1e-8)
    for i in range(len(records)):
        integrate(records[i : i + 1], own, here.phases, reported, *working)
    return 0.0 if usual.tobytes() == records.tobytes() else np.inf


def on_device(name: str) -> tuple[bool, float]:
    """Whether outcomes on a GPU are the CPU's, and how far states after strides differ."""
    from gym_passive_walker.devices.gpu import strides
    from gym_passive_walker.engine.run import advance
    from gym_passive_walker.models.equations.systems import SYSTEMS
    from tests.gpu.thrown import thrown

    own, records = thrown(name, 2000, wild=0.05)
    usual = advance(SYSTEMS[name], own, records.copy(), tolerance=1e-10)
    there = strides.advance(SYSTEMS[name], own, records, tolerance=1e-10)
    near = usual["outcome"] == 1
    alike = np.array_equal(usual["outcome"], there["outcome"])
    off = np.abs(usual["state"] - there["state"]) / (1.0 + np.abs(usual["state"]))
    return alike, float(off[near].max())


def in_silence() -> None:
    """Steps of an environment on a device, during which torch lets nobody wait."""
    import torch

    from gym_passive_walker.devices.gpu.environment import PassiveWalkerGpuEnv

    there = PassiveWalkerGpuEnv(256, "level")
    there.reset()
    actions = torch.zeros(256, 1, device=there.device)
    there.step(actions)
    torch.cuda.set_sync_debug_mode("error")
    for _ in range(3):
        there.step(actions)


if __name__ == "__main__":
    what, *reported = sys.argv[1:]
    if what == "cpu":
        print(on_cpu(reported[0]))
    elif what == "device":
        print(*on_device(reported[0]))
    elif what == "silence":
        in_silence()
    else:
        from benchmarks.gpu_code import parameters, ptx

        for name, text in ptx(eval(reported[0]), int(what))[0].items():
            counts = text.count(f".target sm_{what}0"), text.count(".entry"), parameters(text)
            print(name, *counts, "malloc" in text)
