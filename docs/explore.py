"""Write what the page of figures to explore shows: data for its scripts, and still pictures.

    python docs/explore.py             docs/images/explore-*.png, for readers without JavaScript
    python docs/explore.py --data DIR  explore.json; `make docs` does this

Angles are in rad, angular velocities in sqrt(g/l).
"""

from __future__ import annotations

import argparse
import json
from base64 import b64encode
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import gym_passive_walker as gpw

IMAGES = Path(__file__).resolve().parent / "images"
FINEST = 2**16 - 1
LONGEST = 31
"""Strides before a fall are counted up to here."""

BASIN_SLOPE = 0.01
BASIN_ANGLES, BASIN_RATES = (0.15, 0.36), (-0.36, -0.15)
SLOPES = (0.0145, 0.018, 0.0191)
"""Least slope of the bifurcation diagram, slope from which its grid is finer, largest slope."""


def family() -> gpw.GaitFamily:
    """The branch of gaits of the laboratory's walker."""
    return gpw.gait_family("lab", 0.005, 0.1)


def basin(resolution: int = 400) -> gpw.Basin:
    """The basin of the simplest walker's gait, where it is wide enough to be seen."""
    angles, rates = (np.linspace(*ends, resolution) for ends in (BASIN_ANGLES, BASIN_RATES))
    own = rates / gpw.WALKERS["D"].units.time
    return gpw.basin_of_attraction("D", BASIN_SLOPE, stance_angles=angles, stance_rates=own)


def bifurcation(columns: int = 960, n_recorded: int = 64) -> gpw.BifurcationDiagram:
    """The simplest walker's settled walks; most slopes are above 0.018 rad.

    The page starts at the states, so the recorded strides are those that follow.
    """
    first, middle, last = SLOPES
    wide = np.linspace(first, middle, columns // 4, endpoint=False)
    slopes = np.concatenate([wide, np.linspace(middle, last, columns - len(wide))])
    settled = gpw.bifurcation_diagram("D", slopes, n_recorded=n_recorded)
    walks = settled.walks
    after = gpw.bifurcation_diagram(
        "D", slopes[walks], start=settled.state[walks], n_transient=0, n_recorded=n_recorded
    )
    return replace(after, state=settled.state[walks])


def _text(values: np.ndarray) -> str:
    return b64encode(np.ascontiguousarray(values).tobytes()).decode()


def of_family(found: gpw.GaitFamily) -> dict[str, Any]:
    """Entries of the figure of a branch."""
    turns = np.flatnonzero(np.diff(np.sign(np.diff(found.slope)))) + 1
    beyond = np.sum((found.multipliers.imag == 0.0) & (found.multipliers.real < -1.0), axis=1)
    marks = [["fold", int(i)] for i in turns]
    marks += [["period doubling", int(i)] for i in np.flatnonzero(np.diff(beyond))]
    return {
        "walker": "lab",
        "slope": found.slope.tolist(),
        "stance_angle": found.stance_angle.tolist(),
        "speed": found.froude_speed.tolist(),
        "multiplier": np.abs(found.multipliers[:, 0]).tolist(),
        "stable": found.stable.tolist(),
        "state": found.walker.units.to_dimensionless(found.state).tolist(),
        "marks": marks
        + [[end.reason, place] for end, place in zip(found.ends, (0, -1), strict=True)],
    }


def of_basin(found: gpw.Basin) -> dict[str, Any]:
    """Entries of the figure of a basin; a code is 32 times the kind of the end, plus strides."""
    kinds = [gpw.Outcome.HEELSTRIKE, gpw.Outcome.FELL_FORWARD, gpw.Outcome.FELL_BACKWARD]
    kind = np.select([found.outcome == each for each in kinds], range(len(kinds)), len(kinds))
    units, (gait,) = found.walker.units, found.gaits
    return {
        "walker": "D",
        "slope": found.slope,
        "angles": found.stance_angle.tolist(),
        "rates": (found.stance_rate * units.time).tolist(),
        # The heelstrike of the simplest walker leaves this swing angular velocity over that of the
        # stance leg (Garcia et al. 1998).
        "ratios": np.cos(2.0 * found.stance_angle).tolist(),
        "kinds": ["converges to the gait", "falls forward", "falls backward", "ends otherwise"],
        "codes": _text((32 * kind + np.minimum(found.strides, LONGEST)).astype(np.uint8)),
        "gait": units.to_dimensionless(gait.state).tolist(),
    }


def of_bifurcation(found: gpw.BifurcationDiagram) -> dict[str, Any]:
    """Entries of the figure of a bifurcation diagram; its states are those before the strides."""
    walks = found.walks
    angles = found.stance_angle[walks]
    low, high = float(angles.min()), float(angles.max())
    return {
        "walker": "D",
        "slope": found.slope[walks].tolist(),
        "range": [low, high],
        "count": angles.shape[1],
        "angles": _text(np.rint((angles - low) / (high - low) * FINEST).astype("<u2")),
        "period": found.period[walks].tolist(),
        "state": found.walker.units.to_dimensionless(found.state[walks]).tolist(),
    }


FIGURES = {
    "family": (family, of_family),
    "basin": (basin, of_basin),
    "bifurcation": (bifurcation, of_bifurcation),
}
"""The figures of the page: what computes each, and what its entries are."""


def write(folder: Path) -> None:
    """Write the data of all figures into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    figures = {name: entries(compute()) for name, (compute, entries) in FIGURES.items()}
    text = json.dumps(figures, separators=(",", ":"), allow_nan=False)
    (folder / "explore.json").write_text(text, encoding="utf-8")


def draw() -> None:
    """Draw the still pictures."""
    import matplotlib.pyplot as plt

    for name, (compute, _) in FIGURES.items():
        plt.figure(figsize=(7.2, 4.6))
        compute().plot()
        plt.savefig(IMAGES / f"explore-{name}.png", dpi=110, bbox_inches="tight")
        plt.close("all")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--data", type=Path, help="folder to write explore.json to")
    folder = parser.parse_args().data
    draw() if folder is None else write(folder)
