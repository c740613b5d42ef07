"""Cost and robustness of the shipped policies and of controllers without training.

    python -m benchmarks.gauntlet

Prints a row for each controller, and writes the table and docs/images/controllers.png for
docs/robustness.md, in ten minutes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import gym_passive_walker as gpw
from benchmarks.first_passage import Case, sampled
from benchmarks.report import command, machine, table
from benchmarks.tables import DOCS, keep
from gym_passive_walker._tools import console
from gym_passive_walker.envs.policies import shipped_policies
from gym_passive_walker.gaits.control import optimal
from gym_passive_walker.gaits.control.controlled import ControlledMap
from gym_passive_walker.gaits.control.maps import calm
from gym_passive_walker.gaits.robust.first_passage import FirstPassage
from gym_passive_walker.gaits.scenes.scene import Scene

WALKERS = 128
"""Walks in each test."""

BESIDE = (
    ("constant", "level"), ("lqr", "level"), ("deadbeat", "level"), ("optimal", "level"),
    ("passive", "steep"), ("lqr", "steep"), ("deadbeat", "steep"), ("optimal", "steep"),
    ("passive", "lab"), ("constant", "lab"), ("lqr", "lab"), ("deadbeat", "lab"),
    ("optimal", "lab"),
    ("passive", "rough"), ("constant", "rough"), ("lqr", "rough"), ("deadbeat", "rough"),
)  # fmt: skip
"""Controllers without training, and scenes in which they have a gait."""

ROUGHNESS = 0.004
"""Standard deviation of footholds' heights in leg lengths, for the first passage."""

FALLING = Case({}, (ROUGHNESS,), walkers=500, count=100)
"""Numbers of walkers and of strides on this ground."""

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

KINDS = {"trained": "o", "feedback": "s", "optimal gait with feedback": "^", "no feedback": "D"}
"""Kinds of controllers, and their markers."""


class Scores(NamedTuple):
    """Cost and robustness of a controller in its scene.

    Attributes:
        name: Name of the controller, with its scene where that is not its own.
        kind: One of `KINDS`.
        card: Score card of the gauntlet.
        gait: Periodic gait on smooth ground.
        least: Least cost of transport at the speed of this gait; NaN if none is found.
        left: Walkers that are left on rough ground after each stride, (1 + strides,).
    """

    name: str
    kind: str
    card: gpw.Gauntlet
    gait: gpw.Gait
    least: float
    left: NDArray

    @property
    def above(self) -> float:
        """Share of the gait's cost above the least cost."""
        return self.gait.cost_of_transport / self.least - 1.0

    @property
    def score(self) -> str:
        """Score of the gauntlet with its interval, as text."""
        low, high = self.card.score_interval
        return f"{self.card.score:.3f} ({low:.3f} to {high:.3f})"

    @property
    def reach(self) -> float:
        """Mean strides until a fall: after the first 10, or of all walkers if all fall by then."""
        mean = FirstPassage.of(self.left).mean
        return float(self.left[1:].sum() / self.left[0]) if np.isnan(mean) else mean

    @property
    def lasts(self) -> str:
        """Mean first passage with its interval, as text."""
        found = FirstPassage.of(self.left)
        if np.isnan(found.mean):
            return f"{self.reach:.2g}, all fall within 10"
        low, high = found.interval
        return f"{found.mean:.3g} ({low:.3g} to {high:.3g})"


def scores_of(controller: str, scene: str | None = None) -> Scores:
    """Measure a controller in its scene."""
    strides = gpw.stride_map(controller=controller, scene=scene)
    assert isinstance(strides, ControlledMap)
    gait = gpw.find_gait(strides)
    walked = strides.with_tolerance(1e-8)
    kind = {"passive": "no feedback", "constant": "no feedback", "lqr": "feedback"}
    kind |= {"deadbeat": "feedback", "optimal": "optimal gait with feedback"}
    return Scores(
        name=controller if scene is None else f"{controller} on {scene}",
        kind=kind.get(controller, "trained"),
        card=gpw.gauntlet(controller, scene, walkers=WALKERS),
        gait=gait,
        least=least_cost(strides.scene, gait.froude_speed),
        left=sampled(walked, np.asarray(gait.state), gpw.rough(ROUGHNESS), FALLING),
    )


def least_cost(scene: Scene, speed: float) -> float:
    """Least cost of transport in a scene without disturbances at a speed over √(g l)."""
    there = calm(scene)
    try:
        return optimal.least_cost(optimal.stored_name(there), speed)
    except ValueError:  # none are stored
        pass
    try:
        return gpw.optimal_gait(there, speed).cost_of_transport
    except gpw.GaitNotFound:  # as at the passive gait's speed, where torques have nothing to do
        return math.nan


def draw(found: list[Scores]) -> None:
    """Draw the cost of transport over both measures of robustness, numbered as in the table."""
    from gym_passive_walker.pictures.axes import legend, panels, save, series

    figure, axes = panels(1, 2, (11.0, 5.6), sharey=True)
    axes[0].set(xlabel="score of the gauntlet", ylabel="cost of transport", yscale="log")
    axes[1].set(xlabel=f"mean strides to a fall, heights with σ = {ROUGHNESS:g} l", xscale="log")
    axes[0].set(xlim=(-0.05, 1.05), ylim=(1.4e-3, 0.2))
    axes[1].set_xlim(0.7, 2.0 * max(each.reach for each in found))
    for ax, across in zip(axes, ("score", "reach"), strict=True):
        labels: dict[tuple[float, float], str] = {}
        for index, (kind, marker) in enumerate(KINDS.items()):
            style = {**series(index), "marker": marker, "linestyle": "", "markersize": 5.0}
            these = [(n, each) for n, each in enumerate(found, 1) if each.kind == kind]
            points = [(each.card.score, each.reach)[across == "reach"] for _, each in these]
            costs = [each.gait.cost_of_transport for _, each in these]
            ax.plot(points, costs, label=kind, **style)
            for (n, _), point in zip(these, zip(points, costs, strict=True), strict=True):
                at = ax.transAxes.inverted().transform(ax.transData.transform(point))
                near = [x for x in labels if max(abs(x[0] - at[0]), abs(x[1] - at[1])) < 0.03]
                place = near[0] if near else (float(at[0]), float(at[1]))
                labels[place] = f"{labels[place]}, {n}" if near else str(n)
        for place, text in labels.items():
            ax.annotate(
                text, place, (0, 5), xycoords="axes fraction", textcoords="offset points",
                fontsize=7, ha="center",
            )  # fmt: skip
    names = "\n".join(f"{n}  {each.name}" for n, each in enumerate(found, 1))
    axes[1].text(1.04, 1.0, names, transform=axes[1].transAxes, va="top", fontsize=8)
    legend(axes[0], columns=2)
    save(figure, DOCS / "images" / "controllers.png")


def main() -> None:
    """Measure all controllers."""
    command(__doc__)
    found = []
    for controller, scene in [*((name, None) for name in shipped_policies()), *BESIDE]:
        found.append(scores_of(controller, scene))
        print(found[-1].name, found[-1].score, found[-1].lasts, sep=" | ", flush=True)
    found.sort(key=lambda each: each.card.score, reverse=True)
    rows = []
    for number, each in enumerate(found, 1):
        shares = dict(zip(each.card.episodes, each.card.survival, strict=True))
        cost = f"{each.gait.cost_of_transport:.4f}"
        above = "–" if math.isnan(each.above) else f"{max(each.above, 0.0):.1%}"
        columns = (number, each.name, each.score, each.lasts, cost, above)
        rows.append((*columns, *(f"{shares[test]:.0%}" for test in SHOWN)))
    titles = [
        "no.",
        "controller",
        "score, 95 % interval",
        f"first passage at {ROUGHNESS:g} l, strides",
    ]
    titles += ["cost of transport", "above the optimum"]
    text = table([*titles, *SHOWN.values()], rows)
    draw(found)
    keep(
        "gauntlet",
        f"{text}\n\n{WALKERS} walks of 100 √(l/g) in each of 14 tests; a column after the costs is "
        "the share that reaches the time limit. The cost of transport is that of the periodic gait "
        "on smooth ground, and the optimum has its speed, slope and actuators. The first passage "
        f"is sampled with {FALLING.walkers} walkers and at most {FALLING.count} strides each. "
        f"{machine()}.",
        DOCS / "robustness.md",
    )


if __name__ == "__main__":
    raise SystemExit(console.run(main))
