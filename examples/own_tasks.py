"""Three tasks that are not built in, and the most reward that each can earn.

    python -m examples.own_tasks
    python train.py --scene examples.own_tasks:tracking

`tracking` follows a speed that varies, on rough ground with pushes. `positive_work` walks with the
least positive work of ankle and hip. `upright` keeps a torso upright. `optimum` finds the gait of
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

MEAN, RANGE, PERIOD = 0.15, 0.02, 200.0
"""Mean and amplitude of the target speed over sqrt(g l), and its period over sqrt(l/g)."""


def target(time):
    """Target speed of `tracking` at a time."""
    return MEAN + RANGE * sin(2.0 * math.pi / PERIOD * time)


def tracked(step, speed):
    """Distance, less work and the square of what a stride is too long for a speed."""
    late = where(step.heelstrike, step.step_length - speed * step.step_period, 0.0)
    return step.distance - 2.0 * step.energy - 20.0 * late**2


def track(step):
    """The reward of `tracking`."""
    return tracked(step, target(step.time))


def seen(step):
    """The observation of `tracking`: state, knee, slope and target speed."""
    return [*step.state, step.knee_locked * 1.0, step.slope, target(step.time)]


def tracking() -> dict:
    """A speed that varies, on rough ground with pushes."""
    return {
        "walker": "C", "slope": 0.0, "tick": 0.2, "reward": track, "observation": seen,
        "terrain": gpw.rough(height_std=0.001), "pushes": {"rate": 0.02, "impulse": (-0.01, 0.01)},
    }  # fmt: skip


def work(step):
    """The reward of `positive_work`: distance less ten times the positive work."""
    hip = 0.5 * (step.hip_work + step.hip_work_absolute)
    ankle = 0.5 * (step.ankle_work + step.ankle_work_absolute)
    return step.distance - 10.0 * (hip + ankle)


def positive_work() -> dict:
    """The least positive work of ankle and hip, by straight legs on level ground."""
    return {
        "walker": "E", "slope": 0.0, "tick": 0.2, "actions": ("hip", "ankle"), "reward": work,
        "energy": "positive",
    }  # fmt: skip


class Hips(NamedTuple):
    """Torques of the torso on the stance leg and on the swing leg."""

    stance_hip: float
    swing_hip: float


ACTUATED_TORSO = replace(
    TORSO,
    name="actuated torso",
    Control=Hips,
    travel=lambda s: Hips(s.stance - s.torso, s.swing - s.torso),
)
"""The torso of `examples.torso`, with its spring, and a torque on each leg."""


def stay(step):
    """The reward of `upright`: distance, less work and the square of the torso's angle."""
    return step.distance - 5.0 * step.energy - 10.0 * step.state.torso**2 * step.duration


def upright() -> dict:
    """A torso that has to stay upright, on a slope."""
    return {
        "system": ACTUATED_TORSO, "slope": 0.03, "tick": 0.2, "reward": stay,
        "reset_noise_scale": 0.05,
    }  # fmt: skip


TASKS = {"tracking": tracking, "positive_work": positive_work, "upright": upright}


def optimum(name: str, **options) -> float:
    """Return the most reward of a task's control steps.

    Of `tracking` it is the mean over target speeds that are constant, on smooth ground without
    pushes: a reference for what ground, pushes and the change of the target cost.
    """
    scene = TASKS[name]()
    if name != "tracking":
        return gpw.optimal_gait(scene, **options).reward_per_control_step
    scene = {"walker": "C", "slope": 0.0, "tick": scene["tick"]}
    phases, gait, found = (np.arange(4) + 0.5) / 4.0, None, []
    for speed in MEAN + RANGE * np.cos(math.pi * phases):
        gait = gpw.optimal_gait(
            scene, reward=lambda step, speed=speed: tracked(step, speed), start=gait, **options
        )
        found.append(gait.reward_per_control_step)
    return float(np.mean(found))


def main() -> None:
    """Print the most reward of each task."""
    for name in TASKS:
        print(f"{name}: {optimum(name):.6f} for each control step")


if __name__ == "__main__":
    sys.exit(console.run(main))
