"""Searches for optimal gaits from random initial guesses, beside the stored optima.

    python -m benchmarks.optimum

A guess is the stored gait of a random speed, its torques shifted in time and with noise. If none of
the searches finds a cheaper gait, the stored one is probably the global optimum at its speed.
Prints a row for each speed and writes the table into docs/agents.md, in some ten minutes.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.report import command, machine, table
from benchmarks.tables import DOCS, keep
from gym_passive_walker import GaitNotFound, optimal_gait
from gym_passive_walker._tools import console
from gym_passive_walker._tools.progress import progress
from gym_passive_walker.gaits.control import optimal
from gym_passive_walker.gaits.scenes.scene import make_scene

SCENE, SPEEDS, SEARCHES = "level", (0.08, 0.10, 0.12, 0.15, 0.18), 30
SHIFT = 4
"""Control steps by which the torques of a guess are shifted, at most."""
ALIKE = 1e-4
"""Relative difference of costs below which two gaits count as the same."""
JOURNAL = Path("runs") / "optimum.jsonl"
"""File of the searches that are done: an interrupted command continues with the others."""


def guess(speed: float, number: int) -> optimal.OptimalGait:
    """The random initial guess of a numbered search at a speed."""
    random = np.random.default_rng([round(1000 * speed), number])
    known = optimal.load(SCENE)
    gait = known[random.integers(len(known))]
    shift = int(random.integers(-SHIFT, SHIFT + 1))
    torques = gait.dimensionless.controller.hip_torque
    torques = torques[np.clip(np.arange(len(torques)) - shift, 0, len(torques) - 1)]
    largest = make_scene(SCENE).largest("hip")
    noise = random.uniform() * largest * random.uniform(-1.0, 1.0, len(torques))
    held = gait.units.torque * np.clip(torques + noise, -largest, largest)
    return replace(gait, controller=gait.controller._replace(hip_torque=held))


def searches() -> Iterator[tuple[float, float | None]]:
    """Speed and cost of each search's gait; None if it found none."""
    JOURNAL.parent.mkdir(exist_ok=True)
    lines = JOURNAL.read_text("utf-8").splitlines() if JOURNAL.exists() else []
    done = {(speed, number): cost for speed, number, cost in map(json.loads, lines)}
    with (
        progress("searches from random guesses") as searched,
        JOURNAL.open("a", encoding="utf-8") as journal,
    ):
        for speed, number in ((v, n) for v in SPEEDS for n in range(SEARCHES)):
            searched()
            if (speed, number) not in done:
                try:
                    cost = optimal_gait(SCENE, speed, start=guess(speed, number)).charged_cost
                except GaitNotFound:
                    cost = None
                done[speed, number] = cost
                journal.write(json.dumps([speed, number, cost]) + "\n")
                journal.flush()
            yield speed, done[speed, number]


def main() -> None:
    """Search at all speeds."""
    command(__doc__)
    rows, found = [], list(searches())
    for speed in SPEEDS:
        stored = optimal.least_cost(SCENE, speed)
        above = np.array([c for v, c in found if v == speed and c is not None]) / stored - 1.0
        rows.append([
            f"{speed:.2f}", f"{stored:.5f}", int(np.sum(above < -ALIKE)),
            int(np.sum(abs(above) <= ALIKE)), int(np.sum(above > ALIKE)),
            f"{above.min():+.4%}", f"{above.max():.1%}", SEARCHES - len(above),
        ])  # fmt: skip
    titles = ["speed / √(g l)", "stored cost", "cheaper", "the stored gait", "costlier",
              "cheapest", "costliest", "none found"]  # fmt: skip
    JOURNAL.unlink()  # a later command searches again, with the code of its time
    keep("random guesses", f"{table(titles, rows)}\n\n{machine()}.", DOCS / "agents.md")


if __name__ == "__main__":
    raise SystemExit(console.run(main))
