"""Scenes in which each two options of different arguments occur together, where both can be.

`python -m tests.conformance.pairs` draws them, and writes them to `pairs.json`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from itertools import chain, combinations
from pathlib import Path
from random import Random
from typing import Any

import gym_passive_walker as gpw
from examples.driven_torso import DRIVEN_TORSO
from examples.five_links import FIVE_LINKS
from examples.rimless_wheel import RIMLESS_WHEEL
from examples.unequal_legs import PROSTHESIS
from gym_passive_walker.gaits.scenes.scene import SceneError, make_scene
from gym_passive_walker.models.math import tanh
from tests.conformance.scenes import own_reward

DRAWN = Path(__file__).with_name("pairs.json")


def own_observation(step):
    """Numbers of every part of a step, whatever the model."""
    numbers = step.state[0], step.before[-1], step.command, step.push, step.steps, step.time
    return *numbers, *map(tanh, step.last_action)


def too_fast(step):
    """A limit of the last angular velocity."""
    return abs(step.state[-1]) > 0.7


C = gpw.WALKERS["C"]
OPTIONS: dict[str, tuple[Any, ...]] = {
    "walker": (
        "C", "lab", "A", "D", replace(gpw.WALKERS["lab"], knees="held"),
        replace(C, gravity=9.81, hip_mass=3.0, hip_stiffness=0.02),
        DRIVEN_TORSO, RIMLESS_WHEEL, FIVE_LINKS, PROSTHESIS,
    ),
    "slope": (0.0, 0.03, -0.01, (0.01, 0.05)),
    "control": ("tick", "stride"),
    "tick": (0.1, 0.7),
    "actions": (None, ("push_off",), ("hip", "push_off"), ("ankle", "hip")),
    "energy": ("absolute", "positive", "net"),
    "end_on_toe_stub": (None, False),
    "max_hip_torque": (None, 0.0),
    "domain_randomization": (
        {}, {"slope": 0.2}, {"thigh_mass, shank_mass": 0.1},
        {"action_delay": {"choices": (0, 2), "operation": "abs"}},
        {"max_hip_torque": 0.5, "curriculum": 3}, {"friction": 0.5, "reset_noise_scale": 0.5},
    ),
    "randomization_pool": (None, 3),
    "observe_body": ((), ("foot_radius",)),
    "max_stride_time": (20.0, 1.5),
    "pushes": ({}, {"rate": 0.5, "impulse": (-0.02, 0.02)}),
    "observation_noise": (0.0, 0.01),
    "action_noise": (0.0, 0.2),
    "action_delay": (0, 1),
    "command": (None, 0.15, (0.1, 0.2)),
    "constraints": ({}, {"friction": "end"}, {"contact": "report", "friction": "report"}),
    "terrain": (
        None, {"rough": {"height_std": 0.001}}, {"footholds": {"heights": (0.0, 0.002, -0.001)}},
        {"rough": {"height_std": 0.001, "slope_std": 0.003}},
    ),
    "terrain_lookahead": (0, 2),
    "reward": (None, own_reward, {"distance": 1.0, "energy": -2.0, "alive": 0.1}),
    "observation": (None, own_observation),
    "terminated": (None, too_fast),
    "reward_terms": (False, True),
}  # fmt: skip
"""Values of a scene's arguments, the default first."""

PICKS = [(name, i) for name, values in OPTIONS.items() for i in range(len(values))]
Pair = frozenset[tuple[str, int]]


def scene(chosen: dict[str, int]) -> dict[str, Any]:
    """The arguments of a scene by the places of their values; defaults are left out."""
    return {name: OPTIONS[name][i] for name, i in chosen.items() if i}


def accepted(chosen: dict[str, int]) -> bool:
    """Whether a scene can be made."""
    try:
        make_scene(**scene(chosen))
    except SceneError:
        return False
    return True


def together(chosen: dict[str, int]) -> Iterable[Pair]:
    """All pairs of options of a scene."""
    return map(frozenset, combinations(chosen.items(), 2))


def left(drawn: Iterable[dict[str, int]]) -> set[Pair]:
    """Pairs of options that are in no scene."""
    pairs = {pair for pair in map(frozenset, combinations(PICKS, 2)) if len(dict(pair)) == 2}
    return pairs.difference(*map(together, drawn))


def ways(pair: Pair, most: int) -> Iterable[dict[str, int]]:
    """A pair of options alone, and with up to `most` others that it may need."""
    needs = chain.from_iterable(combinations(PICKS, count) for count in range(most + 1))
    return (dict(need) | dict(pair) for need in needs)


def draw(seed: int) -> list[dict[str, int]]:
    """Draw scenes until no pair is missing.

    Each begins with a missing pair, and with what that needs. The other arguments follow in random
    order; each takes the value that adds most missing pairs, of those that can be.
    """
    rng, drawn = Random(seed), []
    missing = left(drawn)
    while missing:
        pair = min(missing, key=sorted)
        chosen = next(filter(accepted, ways(pair, 2)), None)
        if chosen is None:
            missing.remove(pair)
            continue
        for name in rng.sample([*OPTIONS], len(OPTIONS)):
            if name not in chosen:
                tried = [chosen | {name: i} for i in range(len(OPTIONS[name]))]
                rng.shuffle(tried)
                tried.sort(key=lambda way: -len(missing.intersection(together(way))))
                chosen = next(filter(accepted, tried))
        missing -= {*together(chosen)}
        drawn.append({name: chosen[name] for name in OPTIONS})
    return drawn


ROWS = [
    dict(zip(OPTIONS, row, strict=True))
    for row in (json.loads(DRAWN.read_text("utf-8")) if DRAWN.exists() else [])
]
PAIRS = {f"pairs {number}": scene(chosen) for number, chosen in enumerate(ROWS)}
"""Arguments of scenes by their names."""

if __name__ == "__main__":
    rows = [json.dumps([*chosen.values()]) for chosen in draw(0)]
    DRAWN.write_text("[\n" + ",\n".join(rows) + "\n]\n", "utf-8")
