"""Robustness of the shipped policies and the feedback controllers in the fixed tests.

    python -m benchmarks.gauntlet

Prints a row for each controller and writes the table into docs/robustness.md, in two minutes.
"""

from __future__ import annotations

import gym_passive_walker as gpw
from benchmarks.report import command, machine, table
from benchmarks.tables import DOCS, keep
from gym_passive_walker import console
from gym_passive_walker.policies import shipped_policies

WALKERS = 128
"""Walks in each test."""

BESIDE = (("lqr", "steep"), ("deadbeat", "steep"), ("optimal", "level"), ("passive", "lab"))
"""Controllers without training, and their scenes."""

SHOWN = {
    "rough, 0.002 l": "rough 0.002",
    "rough, 0.004 l": "rough 0.004",
    "pushes, 0.05": "pushes 0.05",
    "observation noise, 0.03": "observation noise 0.03",
    "action noise, 0.2": "action noise 0.2",
    "action delay, 1": "delay 1",
    "bodies, 20 %": "bodies 20 %",
    "starts, 20 %": "starts 20 %",
}
"""Tests that have a column."""


def main() -> None:
    """Test them all."""
    command(__doc__)
    rows = []
    for controller, scene in [*((name, None) for name in shipped_policies()), *BESIDE]:
        found = gpw.gauntlet(controller, scene, walkers=WALKERS)
        shares = dict(zip(found.walks, found.survival, strict=True))
        low, high = found.score_interval
        name = controller if scene is None else f"{controller} on {scene}"
        score = f"{found.score:.3f} ({low:.3f} to {high:.3f})"
        rows.append((name, score, *(f"{shares[test]:.0%}" for test in SHOWN)))
    rows.sort(key=lambda row: row[1], reverse=True)
    text = table(["controller", "score, 95 % interval", *SHOWN.values()], rows)
    keep(
        "gauntlet",
        f"{text}\n\n{WALKERS} walks of 100 √(l/g) in each of 14 tests; a column is the share that "
        f"reaches the time limit. {machine()}.",
        DOCS / "robustness.md",
    )


if __name__ == "__main__":
    raise SystemExit(console.run(main))
