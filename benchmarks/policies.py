"""A page with each shipped policy: its training, gait, robustness and a video.

    python -m benchmarks.policies

Writes docs/agents.md and docs/images/policy-*.gif, in five minutes.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

import numpy as np

import gym_passive_walker as gpw
from agents.config import Config, configure
from benchmarks.gauntlet import FALLING, ROUGHNESS, WALKERS, Scores, scores_of
from benchmarks.report import command, machine, table
from benchmarks.tables import DOCS, keep
from gym_passive_walker._tools import console
from gym_passive_walker.envs.policies import TrainedPolicy, shipped_policies
from gym_passive_walker.models.walkers import name_of
from gym_passive_walker.pictures.video import video

STRIDES = 2
"""Strides of a video."""


def trained_by(config: Config) -> str:
    """The command that trains a configuration."""
    of_preset = preset_again(config, episode_steps=None).episode_steps
    limited = config.episode_steps != of_preset
    given = {
        "algo": config.algo, "scene": config.scene, "from": config.start, "steps": config.steps,
        "seed": config.seed or None, "every": config.every,
        "episode-steps": config.episode_steps if limited else None,
    }  # fmt: skip
    words = [f" --{name} {value}" for name, value in given.items() if value is not None]
    return "python train.py" + "".join(words)


def preset_again(config: Config, *, episode_steps: int | None) -> Config:
    """A training's configuration, made again with today's preset."""
    return configure(
        config.algo, config.scene, env=dict(config.env), steps=config.steps, seed=config.seed,
        every=config.every, start=config.start, episode_steps=episode_steps,
    )  # fmt: skip


def as_today(config: Config) -> str:
    """Whether today's preset has the hyperparameters of a training."""
    today = preset_again(config, episode_steps=config.episode_steps)
    then, now = _flat(asdict(config)), _flat(asdict(today))
    changed = [
        f"{name} was {then.get(name, 'not set')}, now {now.get(name, 'not set')}"
        for name in sorted(then.keys() | now.keys())
        if then.get(name) != now.get(name)
    ]
    return "; ".join(changed) or "those of the present preset"


def _flat(values: Any, name: str = "") -> dict[str, str]:
    """Entries of nested mappings by their path, as JSON writes them."""
    if not isinstance(values, dict):
        return {name: json.dumps(values)}
    parts = (_flat(value, f"{name}.{key}".lstrip(".")) for key, value in values.items())
    return {key: value for part in parts for key, value in part.items()}


def described(name: str, found: Scores) -> str:
    """The section of a policy."""
    policy, gait = gpw.load_policy(name), found.gait
    assert isinstance(policy, TrainedPolicy)
    config, scene = Config(**policy.trained), policy.scene
    slopes = " to ".join(f"{bound:g}" for bound in np.atleast_1d(scene.slope))
    file = f"policy-{name}.gif"
    video(
        gait.stride_map, gait.slope, gait.state, DOCS / "images" / file, strides=STRIDES, shrink=3
    )
    multipliers = ", ".join(f"{size:.3f}" for size in np.abs(gait.multipliers))
    rows = [
        ("scene", f"`{config.scene}`: walker {name_of(scene.walker)}, slope {slopes} rad, "
         f"actions {', '.join(scene.actions)}"),
        ("trained by", f"`{trained_by(config)}`"),
        ("hyperparameters", as_today(config)),
        ("gait", f"at a slope of {gait.slope:g} rad: speed {gait.froude_speed:.4f} √(g l), step "
         f"length {gait.step_length / gait.walker.leg_length:.3f} l, "
         f"cost of transport {gait.cost_of_transport:.5f}"),
        ("cost above the optimum at this speed",
         f"{max(found.above, 0.0):.1%} (least cost {found.least:.5f})"),
        ("Floquet multipliers, absolute", multipliers),
        ("score of the gauntlet", found.score),
        (f"mean strides to a fall, heights with σ = {ROUGHNESS:g} l", found.lasts),
    ]  # fmt: skip
    picture = f"![Two strides under {name}](images/{file})"
    return f"### {name}\n\n{picture}\n\n{table(['', name], rows)}"


def main() -> None:
    """Write the page."""
    command(__doc__)
    sections = [described(name, scores_of(name)) for name in shipped_policies()]
    closing = (
        f"The gauntlet has {WALKERS} walks in each test. The first passage is sampled with "
        f"{FALLING.walkers} walkers and at most {FALLING.count} strides each. {machine()}."
    )
    keep("policies", "\n\n".join([*sections, closing]), DOCS / "agents.md")


if __name__ == "__main__":
    raise SystemExit(console.run(main))
