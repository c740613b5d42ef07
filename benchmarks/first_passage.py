"""Mean first-passage times by weighted ensembles over a mesh, beside those of walkers that fall.

    python -m benchmarks.first_passage

Prints a row for each controller and roughness and writes the table into docs/robustness.md, in some
minutes.
"""

from __future__ import annotations

from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import gym_passive_walker as gpw
from benchmarks.report import command, machine, table
from benchmarks.tables import DOCS, keep
from gym_passive_walker._tools import console
from gym_passive_walker.gaits.robust.first_passage import SETTLING, FirstPassage
from gym_passive_walker.gaits.robust.first_passage_mesh import mesh_passage
from gym_passive_walker.gaits.stride_map import StrideMap


class Case(NamedTuple):
    """A controller, and the ground that it is tried on.

    Attributes:
        strides: Arguments of `gpw.stride_map`.
        heights: Standard deviations of heights, in leg lengths; the last is not sampled.
        walkers: How many walk over each other ground, to sample it.
        count: How many strides they may make.
        settling: How many of these are not counted, after which the start is forgotten.
    """

    strides: dict
    heights: tuple[float, ...]
    walkers: int
    count: int
    settling: int = SETTLING


CASES = {
    "passive, lab, 0.036 rad": Case(
        dict(walker="lab", slope=0.036), (0.002, 0.00125, 0.0007), 16000, 400
    ),
    "held torque, lab, 0.02 rad": Case(
        dict(walker="lab", slope=0.02, controller=gpw.Actuation(hip_torque=0.001)),
        (0.00015, 0.0001, 0.00007), 16000, 400, settling=50,
    ),
    "lqr on steep": Case(dict(controller="lqr", scene="steep"), (0.003, 0.002, 0.001), 8000, 200),
    "push-off-ppo": Case(dict(controller="push-off-ppo"), (0.0003, 0.0002, 0.00015), 16000, 150),
    "rough-ppo": Case(dict(controller="rough-ppo"), (0.005, 0.004, 0.002), 4000, 100),
}  # fmt: skip


def sampled(strides: StrideMap, state: NDArray, ground: gpw.Terrain, case: Case) -> NDArray:
    """Count walkers left after each stride, each on random ground of its own, (1 + count,)."""
    keys = np.random.default_rng(0).integers(2**64, size=case.walkers, dtype=np.uint64)
    states, left = np.repeat(state[None], case.walkers, axis=0), [case.walkers]
    ahead = range(strides.terrain_lookahead)
    for place in range(case.count):
        rises = ground.ground(keys, place)[:, 1] * strides.units.length
        seen = [ground.ground(keys, place + further)[:, 1:] for further in ahead]
        seen = np.concatenate([np.empty((len(keys), 0)), *seen], axis=1)
        walked = strides.stride(states, height_change=rises, slope_change=0.0, ahead=seen)
        struck = walked.outcome == gpw.Outcome.HEELSTRIKE
        states, keys = walked.state[struck], keys[struck]
        left.append(len(keys))
        if not len(keys):
            break
    return np.array(left + [0] * (1 + case.count - len(left)))


def main() -> None:
    """Compute and sample them all."""
    command(__doc__)
    rows = []
    for name, case in CASES.items():
        strides = gpw.stride_map(**case.strides).with_tolerance(1e-8)
        state = np.asarray(gpw.find_gait(strides).state)
        for height in case.heights:
            ground, began = gpw.rough(height), perf_counter()
            found = mesh_passage(strides, state, ground)
            took, beside = perf_counter() - began, "not sampled"
            if height != case.heights[-1]:
                falls = FirstPassage.of(sampled(strides, state, ground, case), case.settling)
                low, high = falls.interval
                beside = f"{falls.mean:.4g} ({low:.4g} to {high:.4g})"
            low, high = found.interval
            mean, count = f"{found.mean:.4g} ({low:.4g} to {high:.4g})", f"{found.strides:.2g}"
            rows.append((name, f"{height:g}", mean, beside, count, f"{took:.0f} s"))
            print(*rows[-1], sep=" | ", flush=True)
    titles = ["controller", "heights, σ in l", "by a mesh, strides", "sampled, strides"]
    text = table([*titles, "strides computed by the mesh", "run time"], rows)
    text += "\n\nMeans have 95 % intervals."
    keep("first passage", f"{text}\n\n{machine()}.", DOCS / "robustness.md")


if __name__ == "__main__":
    raise SystemExit(console.run(main))
