"""Pictures of a run: its learning curve, and the gait of its policy."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from agents import envs
from agents.evaluation import EPISODES, SEED
from agents.learner import learned
from gym_passive_walker._tools.files import replacing
from gym_passive_walker.envs.disturbances import disturbed
from gym_passive_walker.envs.evaluation.walks import simulate_episodes
from gym_passive_walker.gaits.control.baselines import Passive
from gym_passive_walker.gaits.control.maps import stride_map
from gym_passive_walker.gaits.control.policy import Policy
from gym_passive_walker.pictures import strobe, strobe_of
from gym_passive_walker.pictures.axes import GREY, OWN, figure_of, legend, panels, save, series

_QUANTITIES = (
    ("distance", "distance walked / l"),
    ("strides", "strides"),
    ("speed", "speed v / √(g l)"),
    ("cost_of_transport", "cost of transport"),
)

_SETTLED, _SHOWN, _FLASHES = 20, 3, 8
"""Strides before the drawn ones, number of drawn strides, and postures of each."""


def draw_run(run: Path, rows: Sequence[dict[str, Any]], *, trust: bool = False) -> None:
    """Draw a run's learning curve, one row for each evaluation, and the gait of its policy.

    `trust` allows a scene of the user's own.
    """
    config, policy = learned(run, trust=trust)
    without = Passive(envs.scene_of(config))
    with replacing(run / "learning_curve.png") as path:
        passive = simulate_episodes(without, envs.arena(config, EPISODES), seed=SEED).summary()
        learning_curve(path, rows, passive, envs.describe(config))
    with replacing(run / "gait.png") as path:
        title = f"{config.algo.upper()} on {envs.describe(config)}"
        gait(path, policy, envs.single(config), seed=SEED, title=title)


def learning_curve(
    path: Path, rows: Sequence[dict[str, Any]], passive: dict[str, float], title: str
) -> None:
    """Draw the evaluations during training, with the passive walker as a dashed line.

    Args:
        path: The picture's file.
        rows: The curve: for each evaluation a dict of "steps", "seconds" and each quantity.
        passive: The passive walker's quantities.
        title: Title of the figure.
    """
    figure, axes = panels(2, 2, (9.0, 5.6), sharex=True)
    figure.suptitle(title, fontsize="medium")
    millions = [row["steps"] / 1e6 for row in rows]
    for ax, (name, label) in zip(axes, _QUANTITIES, strict=True):
        ax.plot(millions, [row[name] for row in rows], label="in training", **series(0))
        ax.axhline(passive[name], color=GREY, linestyle="--", linewidth=1.0, label="passive")
        ax.set_ylabel(label)
        ax.set_ylim(bottom=0.0)
    for ax in axes[2:]:
        seconds = rows[-1]["seconds"]
        ax.set_xlabel(f"million steps ({seconds:.0f} s of training in all)")
        legend(ax)
    save(figure, path)


def gait(path: Path, policy: Policy, world: gymnasium.Env, *, seed: int, title: str) -> None:
    """Draw a stroboscopic picture of an agent's gait, after its transient."""
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
    scene = walker.scene
    # Other walks are drawn as they were: a stride map has no disturbances, and no draws.
    held = scene.control == "stride" and not disturbed(scene) and not scene.domain_randomization
    if held and scene.actions == ("hip",) and "actuation" in walker.walker.supports:
        scale = walker.walker.units.torque * scene.max_hip_torque
        torque = scale * np.array(torques[shown])
        ax = strobe(
            walker.walker, walker.slope, states[begun], strides=len(torque), hip_torque=torque,
            ax=OWN,
        )  # fmt: skip
    elif held and scene.observation is None:
        strides_of = stride_map(None, walker.slope, controller=policy, scene=scene)
        ax = strobe(strides_of, state=states[begun], strides=len(states[shown]), ax=OWN)
    else:  # no stride map is of an observation of the user's own
        pace = max(1, round(strides.count(strides[begun]) / _FLASHES))
        shown = slice(begun, None, pace)
        ax = strobe_of(
            walker.walker,
            np.array(states[shown]),
            np.array(contacts[shown]),
            walker.slope,
            strides=np.array(strides[shown]),
            ax=OWN,
        )
    ax.set_title(title, fontsize="medium")  # which has the walker and the slope
    save(figure_of(ax), path)
