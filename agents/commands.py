"""What `train.py` does besides training."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from agents import optimal

GRIDS = {"level": (0.05, 0.20, 0.01), "lab": (0.15, 0.23, 0.01), "steep": (0.31, 0.34, 0.005)}
"""Speeds of the stored optimal gaits of each scene: the first, the last and their distance."""


def find_optimal(arguments: Sequence[str]) -> int:
    """Find and store the optimal gaits of a scene, or print the stored ones."""
    parser = argparse.ArgumentParser(
        prog="train.py optimal",
        description="Gaits of least cost of transport: prints those of a scene. With --again they "
        "are found anew and stored, which takes minutes.",
    )
    parser.add_argument("--scene", choices=tuple(GRIDS), default="level", help="(%(default)s)")
    parser.add_argument("--again", action="store_true", help="find them anew, and store them")
    args = parser.parse_args(arguments)
    if args.again:
        first, last, apart = GRIDS[args.scene]
        speeds = np.linspace(first, last, round((last - first) / apart) + 1).round(6).tolist()
        gaits = optimal.optimal_gaits(args.scene, speeds)
        optimal.save(optimal.STORE / f"{args.scene}.json", gaits)
    print(optimal_table(optimal.load(args.scene)))
    return 0


def optimal_table(gaits: Sequence[optimal.OptimalGait]) -> str:
    """Optimal gaits as a table."""
    lines = [
        "speed/√(gl)  cost of transport  of it motor's  period  largest multiplier  optimality"
    ]
    for gait in gaits:
        lines.append(
            f"{gait.speed:11.3f}  {gait.cost_of_transport:17.5f}  {gait.hip_cost:13.5f}  "
            f"{gait.step_period:6.3f}  {gait.multipliers[0]:18.3f}  {gait.optimality:10.1e}"
        )
    return "\n".join(lines)
