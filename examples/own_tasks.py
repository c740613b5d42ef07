"""Three tasks that are not built in, and the most reward that each can earn.

    python -m examples.own_tasks
    python train.py --scene examples.own_tasks:tracking

`tracking` follows a speed that varies, on rough ground with pushes. `positive_work` walks with
little positive work of ankle and hip. `upright` keeps a torso upright. `optimum` finds the gait of
most reward by `gpw.optimal_gait`, with exact derivatives.
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from typing import NamedTuple

import numpy as np

import gym_passive_walker as gpw
from examples.torso import TORSO
from gym_passive_walker import console
from gym_passive_walker.math import sin, where

MEAN, AMPLITUDE, PERIOD = 0.15, 0.02, 200.0
"""Mean and amplitude of the target speed over sqrt(g l), and its period over sqrt(l/g)."""

PUSHING = {
    "walker": "C", "slope": 0.0, "control": "stride", "actions": ("hip", "push_off"),
}  # fmt: skip
"""The scene of `tracking`, on smooth ground without pushes: a torque and a push-off a stride."""

TARGETS = 4
"""Number of constant target speeds, at equal distances in a period, for the optimum."""


def target(time):
    """Target speed of `tracking` at a time."""
    return MEAN + AMPLITUDE * sin(2.0 * math.pi / PERIOD * time)


def at_speed(step, speed):
    """Distance, less the square of what a stride is longer or shorter than the speed asks for."""
    error = where(step.heelstrike, step.step_length - speed * step.step_period, 0.0)
    return step.distance - 20.0 * error**2


def track(step):
    """The reward of `tracking`."""
    return at_speed(step, target(step.time)) - 2.0 * step.energy


def seen(step):
    """The observation of `tracking`: state, knee, slope and target speed."""
    return [*step.state, step.knee_locked, step.slope, target(step.time)]


def tracking() -> dict:
    """Return a scene: a speed that varies, on rough ground with pushes."""
    return PUSHING | {
        "reward": track, "observation": seen, "terrain": gpw.rough(height_std=0.0005),
        "pushes": {"rate": 0.02, "impulse": (-0.005, 0.005)}, "reset_noise_scale": 0.05,
    }  # fmt: skip


def work(step):
    """The reward of `positive_work`, at a speed of 0.15 sqrt(g l)."""
    hip = 0.5 * (step.hip_work + step.hip_work_absolute)
    ankle = 0.5 * (step.ankle_work + step.ankle_work_absolute)
    return at_speed(step, 0.15) - 5.0 * (hip + ankle)


def positive_work() -> dict:
    """Return a scene: little positive work of ankle and hip, by straight legs on a gentle slope."""
    return {
        "walker": "E", "slope": 0.01, "control": "stride", "actions": ("hip", "ankle"),
        "reward": work, "energy": "positive", "reset_noise_scale": 0.05,
    }  # fmt: skip


class Hips(NamedTuple):
    """Torques between the torso and each leg."""

    stance_hip: float
    swing_hip: float


ACTUATED_TORSO = replace(
    TORSO,
    name="actuated torso",
    Control=Hips,
    travel=lambda s: Hips(s.stance - s.torso, s.swing - s.torso),
)
"""The walker of `examples.torso`, with its spring, and torques on the legs."""


def stay(step):
    """The reward of `upright`: the torso's angle after each heelstrike counts, at 0.2 sqrt(g l)."""
    return at_speed(step, 0.2) - 2.0 * step.energy - 10.0 * step.state.torso**2


def upright() -> dict:
    """Return a scene: a torso that has to stay upright, downhill."""
    return {
        "system": ACTUATED_TORSO, "slope": 0.03, "control": "stride", "reward": stay,
        "reset_noise_scale": 0.05,
    }  # fmt: skip


TASKS = {"tracking": tracking, "positive_work": positive_work, "upright": upright}


def optimum(name: str, **options) -> float:
    """Return the most reward of a control step in a task.

    Of `tracking` it is the mean over target speeds that are constant, on smooth ground without
    pushes: a reference for what ground, pushes and the change of the target cost.

    Args:
        name: Name of the task.
        **options: Options of `gpw.optimal_gait`.
    """
    if name != "tracking":
        return gpw.optimal_gait(TASKS[name](), **options).reward_per_control_step
    found = []
    for speed in target((np.arange(TARGETS) + 0.5) / TARGETS * PERIOD):
        gait = gpw.optimal_gait(
            PUSHING,
            reward=lambda step, speed=speed: at_speed(step, speed) - 2.0 * step.energy,
            **options,
        )
        found.append(gait.reward_per_control_step)
    return float(np.mean(found))


def main() -> None:
    """Print the most reward of each task."""
    for name in TASKS:
        print(f"{name}: {optimum(name):.6f} for each control step")


if __name__ == "__main__":
    sys.exit(console.run(main))
