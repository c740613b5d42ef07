"""Where walkers are stable: slope against foot radius, and slope against the mass of the hip.

    python -m examples.stable_regions stable-regions.png

Every fold, period doubling and Neimark-Sacker point of a walker's gaits over the slope is followed
in a second parameter. A gait that is stable stays so as parameters vary, until one of these curves
or an end of its branch is reached.
"""

from __future__ import annotations

import argparse
import sys

import gym_passive_walker as gpw
from gym_passive_walker import console

WALKERS = ("lab", "A", "B", "C", "E", "F")
LOW, HIGH = 0.003, 0.2
"""Range of slopes in rad."""

LABELS = {
    "foot_radius": "foot radius / shank length",
    "hip_mass": "hip mass / mass of a leg",
}
HIGHEST = {"foot_radius": 0.55, "hip_mass": 5.0}
"""Highest values, over the shank's length or the mass of a leg."""


def unit(walker: gpw.Walker, parameter: str) -> float:
    """Return the walker's shank length or the mass of its leg."""
    own = walker.thigh_mass + walker.shank_mass
    return walker.shank_length if parameter == "foot_radius" else own


def loci(name: str, parameter: str) -> list[gpw.BifurcationLocus]:
    """Return the loci of all bifurcations of a walker's gaits over the slope."""
    walker = gpw.WALKERS[name]
    family = gpw.gait_family(walker, LOW, HIGH)
    high = HIGHEST[parameter] * unit(walker, parameter)
    return [
        gpw.bifurcation_locus(family, at, parameter, 0.0, high)
        for at in (*family.folds, *family.period_doublings, *family.neimark_sackers)
    ]


def main() -> None:
    """Print the loci, and draw those in each second parameter, to the file that is named."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("picture", help="file to draw to, such as stable-regions.png")
    path = parser.parse_args().picture
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(1, 2, figsize=(8.0, 3.6), sharex=True, layout="constrained")
    for ax, parameter in zip(panels, LABELS, strict=True):
        for i, name in enumerate(WALKERS):
            label = name
            for locus in loci(name, parameter):
                print(f"{name}: {locus}")
                slope, value = locus.values[:, 0], locus.values[:, 1]
                style = {"linestyle": "-" if locus.bifurcation == "fold" else "--", "label": label}
                ax.plot(slope, value / unit(gpw.WALKERS[name], parameter), color=f"C{i}", **style)
                label = ""  # each walker once
        ax.set(xlabel="slope γ (rad)", ylabel=LABELS[parameter])
    panels[1].legend(title="folds: solid,\ndoublings: dashed")
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    sys.exit(console.run(main))
