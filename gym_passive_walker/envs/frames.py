"""Drawings and captions of an environment's pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.envs.batch import Batch
from gym_passive_walker.envs.disturbance_kernels import PASSED
from gym_passive_walker.envs.interface import OUTCOMES
from gym_passive_walker.models.walkers import name_of


def frame(batch: Batch, lane: int, screen: Any) -> Any:
    """Draw a walker of a batch on a `render.Screen`; returns the result of its `draw`."""
    row, record = batch.ledger[lane], batch.records[lane, 0]
    largest = batch.scene.max_hip_torque if "legs" in batch.walkers[lane].supports else 0.0
    ended, contact = OUTCOMES[row["ending"]], batch.contact(lane)
    return screen.draw(
        batch.states[lane],
        float(row["slope"]) - contact.tilt,
        contact.x,
        int(row["strides"]),
        contact_y=contact.y,
        tilt=contact.tilt,
        profile=_ground(batch, lane, contact.x, screen),
        push=batch.disturbances.pushed(lane) if batch.disturbances else 0.0,
        torque=float(record["control"][0]) / largest if largest else 0.0,
        notes=_notes(batch, lane),
        warning=ended.replace("_", " ") if ended else "",
    )


def _ground(batch: Batch, lane: int, x: float, screen: Any) -> NDArray[np.float64] | None:
    """Return the surface of the ground in the picture; None for smooth ground."""
    terrain = batch.scene.terrain
    if terrain is None or batch.disturbances is None:
        return None
    from gym_passive_walker.pictures.ground import profile

    disturbance, walker = batch.disturbances.states[lane], batch.walkers[lane]
    stride, length = int(batch.ledger["strides"][lane]), walker.leg_length
    before = disturbance["passed"][: min(stride, PASSED)][::-1]
    known = length * np.vstack([before, [[disturbance["x"], disturbance["y"]]]])
    usual = 2.0 * length * abs(float(batch.records["start"][lane, 0, 0]))
    reach = x - screen.seen, x + screen.seen + length
    return profile(walker, terrain, disturbance["key"], stride - len(before), known, reach, usual)


def _notes(batch: Batch, lane: int) -> tuple[Sequence[str], Sequence[str]]:
    """Return dimensionless captions, left and right; speed and cost are means of the episode."""
    row, record = batch.ledger[lane], batch.records[lane, 0]
    walker, distance = batch.walkers[lane], float(row["episode_distance"])
    time = float(row["clock"] + record["time"])
    # Work of gravity: height lost in completed strides, and by the slope in the present one.
    paid = float(row["descent"]) + math.sin(row["slope"]) * float(row["progress"])
    speed = f"{distance / time:.3f}" if time > 0.0 else "–"
    cost = f"{(paid + row['episode_energy']) / distance:.4f}" if distance > 0.0 else "–"
    number = f"{lane + 1}: " if batch.count > 1 else ""
    left = (
        f"{number}walker {name_of(walker)}",
        f"slope {row['slope']:.3f} rad",
        f"stride {row['strides'] + 1}",
        f"time {time:.1f} √(l/g)",
    )
    held = zip(walker.actuators, walker.controls, record["control"].tolist(), strict=False)
    right = f"speed {speed} √(g l)", f"cost of transport {cost}"
    right += tuple(
        f"{name.replace('_', ' ')} {value:+.3f} {each.unit}".rstrip()
        for each, name, value in held
        if each.name in batch.scene.actions
    )
    return left, (*right, f"leg length l = {walker.leg_length:.3g}")
