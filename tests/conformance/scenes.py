"""Scenes that every environment is tried in: arguments of `gymnasium.make` and `make_vec`."""

from __future__ import annotations

import gym_passive_walker as gpw
from examples.five_links import FIVE_LINKS
from examples.torso import TORSO
from gym_passive_walker.gaits.scenes.scene import OF_OWN_OBSERVATION
from gym_passive_walker.gaits.scenes.scene import SCENES as NAMED
from gym_passive_walker.models.math import exp, tanh
from tests.own.statements import DRIVEN

COUNT = 5
SEEDS = (5, 17, 3, 99, 12)


def own_reward(step):
    """Speed close to 0.15, smooth actions, a small charge."""
    change = sum((now - last) ** 2 for now, last in zip(step.action, step.last_action, strict=True))
    speed = step.distance / step.duration
    return exp(-((speed - 0.15) ** 2) / 0.01) - 0.1 * change - step.hip_work_absolute


def own_observation(step):
    """Swing leg, its rate before and after, the command and the last push."""
    state = step.state
    rates = step.before.thigh_rate, tanh(state.thigh_rate)
    return state.thigh - state.stance, *rates, step.command, step.push, step.steps


def too_fast(step):
    """A limit of the stance leg's angular velocity."""
    return abs(step.state.stance_rate) > 0.45


def shape(place):
    """A walker for a place: next to each other they differ in size, feet and masses."""
    walker = gpw.interpolate(gpw.WALKERS["C"], gpw.WALKERS["lab"], place / 4.0)
    return {**vars(walker), "gravity": 1.0 + place}


OWN = {"reward": own_reward, "observation": own_observation, "terminated": too_fast}
DISTURBED = {
    "terrain": {"rough": {"height_std": 0.002, "slope_std": 0.004}},
    "terrain_lookahead": 1,
    "pushes": {"rate": 0.5, "impulse": (-0.03, 0.03)},
    "observation_noise": 0.01,
    "action_noise": 0.2,
    "action_delay": 2,
    "command": (0.1, 0.2),
    "constraints": {"friction": "end", "contact": "report", "knee lock": "report"},
}
SCENES = {
    **{name: {"scene": name} for name in NAMED},
    "one torque a stride, straight": {"walker": "A", "control": "stride"},
    "simplest": {"walker": "D", "slope": 0.009, "actions": ("push_off", "ankle"), "tick": 0.7},
    "all actuators": {
        "walker": "E", "slope": 0.02, "actions": ("push_off", "ankle", "hip"), "tick": 0.5,
        "energy": "positive",
    },
    "passive": {"scene": "lab", "max_hip_torque": 0.0},
    "simplest, disturbed": {
        "walker": "D", "slope": 0.009, "pushes": {"rate": 0.7, "impulse": (-0.02, 0.03)},
        "observation_noise": 0.01, "action_noise": 0.1, "action_delay": 2, "command": (0.1, 0.3),
    },
    "net work": {"energy": "net", "slope": (0.0, 0.06), "actions": ("hip", "push_off")},
    "short strides": {"max_stride_time": 1.0},
    "stairs": {
        "walker": "lab-straight", "slope": 0.03, "terrain": {"stairs": {"rise": 0.003}},
        "terrain_lookahead": 1, "pushes": {"rate": 0.3, "impulse": (-0.01, 0.01)},
    },
    "varied": {"scene": "lab", "domain_randomization": {"foot_radius": 0.05, "thigh_mass": 0.1}},
    "observed bodies": {
        "domain_randomization": {"shank_length": 0.1}, "observe_body": ("thigh_com", "shank_mass"),
    },
    "pushed and constrained": {
        "pushes": {"rate": 0.5, "impulse": (-0.05, 0.05)}, "constraints": {"scuffing": "end"},
    },
    "disturbed": DISTURBED,
    "disturbed and varied": {
        **DISTURBED, "domain_randomization": {"foot_radius": 0.1}, "slope": (0.0, 0.04),
    },
    "own functions": OWN,
    "own functions, disturbed": {**DISTURBED, **OWN, **OF_OWN_OBSERVATION},
    "weights": {
        "reward": {"distance": 1.0, "energy": -2.0, "alive": 0.1, "command": -1.0},
        "reward_terms": True, "command": 0.15,
    },
    "system": {"system": TORSO, "slope": 0.03},
    "system, disturbed": {
        "system": DRIVEN, "slope": 0.05, "observe_body": ("hip",),
        "terrain": {"rough": {"height_std": 0.0005}}, "terrain_lookahead": 2,
        "pushes": {"rate": 0.2, "impulse": (-0.01, 0.01)}, "observation_noise": 0.01,
        "action_delay": 1, "command": (0.1, 0.2), "constraints": {"friction": "end"},
    },
    "system, varied": {
        "system": DRIVEN, "slope": (0.02, 0.03), "domain_randomization": {"hip": 0.05},
        "terrain": {"rough": {"height_std": 0.0005}}, "command": 0.3,
    },
    "system, disturbed and varied": {
        "system": FIVE_LINKS, "slope": 0.05, "domain_randomization": {"knee": 0.05},
        "terrain": {"rough": {"height_std": 0.0005}},
        "pushes": {"rate": 0.5, "impulse": (-0.01, 0.01)}, "observation_noise": 0.01,
        "action_noise": 0.1, "action_delay": 1, "command": (0.1, 0.2),
    },
    "walkers and slopes": {
        "walkers": [shape(i) for i in range(COUNT)],
        "slopes": [0.01, 0.054, 0.02, 0.042, 0.03],
        "start": (0.3, -0.3, -0.3, -0.42, -0.25, -0.4), "reset_noise_scale": 0.3,
    },
    "walkers and slopes, rough": {
        "walkers": ["C", "lab", {"preset": "C", "hip_mass": 0.3}, "lab", "C"],
        "slopes": [0.06, 0.03, 0.0, 0.05, 0.01], "terrain": {"rough": {"height_std": 0.002}},
    },
}  # fmt: skip


def name_time_limits(result):
    """Name the outcome of truncated episodes, which Gymnasium's wrapper of single ones does not."""
    if isinstance(result, tuple):
        *_, terminated, truncated, infos = result
        infos.get("final_info", infos)["outcome"][truncated & ~terminated] = "time_limit"
    return result
