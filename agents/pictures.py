"""Pictures: a run's learning curve, and what an agent's gait is like."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from matplotlib.figure import Figure

from agents import worlds
from agents.evaluation import EPISODES, SEED
from agents.files import replacing
from agents.learner import learned
from gym_passive_walker.control.baselines import Passive
from gym_passive_walker.control.closed_loop import ClosedLoopGait
from gym_passive_walker.control.optimal import OptimalGait
from gym_passive_walker.control.policy import Policy
from gym_passive_walker.control.walks import evaluate
from gym_passive_walker.render import strobe, strobe_of
from gym_passive_walker.units import units_of

_QUANTITIES = (
    ("distance", "distance walked / leg length", "tab:blue"),
    ("strides", "strides", "tab:green"),
    ("speed", "speed / √(g l)", "tab:orange"),
    ("cost_of_transport", "cost of transport", "tab:red"),
)

_SETTLED, _SHOWN, _FLASHES = 20, 3, 8
"""Strides before those that are drawn, how many are drawn, and postures of each."""


def draw_run(run: Path) -> None:
    """Draw a run's learning curve and the gait of its policy."""
    config, policy = learned(run)
    with (run / "learning_curve.csv").open(newline="", encoding="utf-8") as file:
        rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
    with replacing(run / "learning_curve.png") as path:
        passive = evaluate(Passive(), worlds.arena(config, EPISODES), seed=SEED).summary()
        learning_curve(path, rows, passive, worlds.describe(config))
    with replacing(run / "gait.png") as path:
        title = f"{config.algo.upper()} on {worlds.describe(config)}"
        gait(path, policy, worlds.single(config), seed=SEED, title=title)


def learning_curve(
    path: Path, rows: Sequence[dict[str, Any]], passive: dict[str, float], title: str
) -> None:
    """Draw how evaluations went as training went on, with the passive walker as a dashed line.

    Args:
        path: The picture's file.
        rows: The curve, a dict an evaluation, with "steps", "seconds" and each quantity.
        passive: The passive walker's quantities.
        title: What is on show.
    """
    figure = Figure(figsize=(9.0, 5.6), layout="constrained")
    figure.suptitle(title)
    millions = [row["steps"] / 1e6 for row in rows]
    for ax, (name, label, colour) in zip(
        figure.subplots(2, 2, sharex=True).flat, _QUANTITIES, strict=True
    ):
        ax.plot(millions, [row[name] for row in rows], "o-", color=colour, markersize=3)
        ax.axhline(passive[name], color="grey", linestyle="--", linewidth=1.0, label="passive")
        ax.set_ylabel(label)
        ax.spines[["top", "right"]].set_visible(False)
        ax.grid(alpha=0.25)
        ax.set_ylim(bottom=0.0)
    for ax in figure.axes[2:]:
        seconds = rows[-1]["seconds"]
        ax.set_xlabel(f"million steps ({seconds:.0f} s of training in all)")
    figure.axes[0].legend(frameon=False)
    figure.savefig(path, dpi=150)


def gait(path: Path, policy: Policy, world: gymnasium.Env, *, seed: int, title: str) -> None:
    """Draw a strobe picture of an agent's gait, once it has settled."""
    walker: Any = world.unwrapped
    observation, _ = world.reset(seed=seed)
    memory, first, stride, over = None, np.ones(1, bool), 0, False
    states, contacts, strides, torques = [], [], [], []
    while not over and stride < _SETTLED + _SHOWN:
        action, memory = policy.predict(observation[None], memory, first)
        states.append(walker.state)
        contacts.append(walker.contact)
        strides.append(stride)
        torques.append(float(action[0, 0]))
        observation, _, terminated, truncated, info = world.step(action[0])
        first, stride, over = np.zeros(1, bool), info["strides"], terminated or truncated
    begun = strides.index(max(0, strides[-1] + 1 - _SHOWN))
    shown = slice(begun, None)
    if walker.scene.control == "stride":
        scale = units_of(walker.walker).torque * walker.scene.max_hip_torque
        torque = scale * np.array(torques[shown])
        figure = strobe(
            walker.walker, walker.slope, states[begun], strides=len(torque), hip_torque=torque
        )
    else:
        pace = max(1, round(strides.count(strides[begun]) / _FLASHES))
        shown = slice(begun, None, pace)
        figure = strobe_of(
            walker.walker,
            np.array(states[shown]),
            np.array(contacts[shown]),
            walker.slope,
            strides=np.array(strides[shown]),
        )
    figure.suptitle(title)
    figure.savefig(path, dpi=150)


def closed_loop(path: Path, gait: ClosedLoopGait, optimum: OptimalGait | None) -> None:
    """Draw a gait under a policy: phase portrait, torque over the stride, multipliers and basin.

    Args:
        path: The picture's file.
        gait: The gait.
        optimum: An optimal gait at about its speed, whose torque is drawn beside.
    """
    figure = Figure(figsize=(9.0, 7.0), layout="constrained")
    phase, torque, circle, basin = figure.subplots(2, 2).flat
    for i, name in enumerate(("stance leg", "swing thigh", "swing shank")):
        phase.plot(gait.states[:, i], gait.states[:, 3 + i], label=name)
        phase.plot(*gait.states[0, [i, 3 + i]], "o", color=phase.lines[-1].get_color())
    phase.set(xlabel="angle (rad)", ylabel="rate / √(g/l)", title="phase portrait")
    phase.legend(frameon=False)
    torque.step(gait.times, gait.torques, where="pre", label="this policy")
    if optimum is not None:
        held = np.append(optimum.torques, optimum.torques[-1])
        tick = gait.scene.tick if gait.scene.control == "tick" else optimum.step_period
        edges = np.minimum(tick * np.arange(len(held)), optimum.step_period)
        label = f"optimal at {optimum.speed:.3f}"
        torque.step(edges, held, where="post", color="black", linestyle="--", label=label)
    torque.set(
        xlabel="time / √(l/g)", ylabel="hip torque / (m g l)", title="torque over the stride"
    )
    torque.legend(frameon=False)
    turn = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 200))
    circle.plot(np.real(turn), np.imag(turn), color="grey", linewidth=1.0)
    circle.plot(gait.multipliers.real, gait.multipliers.imag, "x")
    circle.set(aspect="equal", title="multipliers", xlabel="real", ylabel="imaginary")
    found = gait.basin()
    basin.pcolormesh(
        found.stance_angles, found.stance_rates, found.survived, cmap="Blues", vmin=0, vmax=1.5
    )
    basin.plot(gait.point[0], gait.point[1], "k.")
    basin.set(xlabel="stance angle (rad)", ylabel="stance rate / √(g/l)", title="basin")
    name = getattr(gait.policy, "name", "policy")
    figure.suptitle(
        f"{name}: speed {gait.speed:.3f} √(g l), cost of transport {gait.cost_of_transport:.4f}"
    )
    figure.savefig(path, dpi=150)
