"""Run time of a stride and of a control step, for each option of a scene.

    python -m benchmarks.scene_cost

Run times are ratios to the simplest scene with that walker, from alternating measurements in one
run. The table is written to docs/benchmarks.md.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial

import gymnasium as gym
import numba
import numpy as np

import gym_passive_walker as gpw
from benchmarks.engine import again, new_batch
from benchmarks.problem import problem
from benchmarks.report import command, machine, seconds, table
from benchmarks.tables import BENCHMARKS, keep
from gym_passive_walker._tools import console
from gym_passive_walker.gaits.look.trajectory import simulate

BEFALLS = {
    "pushes, one in twenty ticks": {"pushes": {"rate": 0.5, "impulse": (-1e-4, 1e-4)}},
    "sensor noise": {"observation_noise": 1e-3},
    "motor noise": {"action_noise": 1e-3},
    "motor delay": {"action_delay": 2},
    "command": {"command": (0.1, 0.2)},
    "constraints reported": {
        "constraints": dict.fromkeys(("contact", "friction", "knee lock", "scuffing"), "report")
    },
}
"""Disturbances, a commanded speed and reported constraints; each is timed by itself."""

COUNT = 2048
ROUNDS = 5


def by_turns(jobs: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Seconds of each job: the least over some rounds, each of which runs all jobs."""
    rounds = [
        [seconds(job, at_least=0.1, repeats=2) for job in jobs.values()] for _ in range(ROUNDS)
    ]
    return dict(zip(jobs, map(min, *rounds), strict=True))


def kinds() -> str:
    """A stride of each kind of walker, passive and with a constant torque."""
    jobs: dict[str, Callable[[], object]] = {}
    for name in ("simplest", "straight", "kneed"):
        p = problem(name)
        for torque in (0.0, 1e-3):
            torqued = "torque" if torque else "passive"
            jobs[f"{name}, {torqued}"] = again(p, new_batch(p, COUNT, torque), 1e-8)
    p = problem("kneed")
    jobs["kneed, passive, watched for stubbed toes"] = again(
        p, new_batch(p, COUNT), 1e-8, end_on_toe_stub=True
    )
    times = by_turns(jobs)
    lean = times["simplest, passive"]
    rows = []
    for name, time in times.items():
        own = times[f"{name.split(',')[0]}, passive"]
        rows.append((name, time / COUNT * 1e6, time / lean, time / own))
    heads = ["a stride, tolerance 1e-08", "µs", "× simplest", "× own passive"]
    return table(heads, rows)


def analysis() -> str:
    """Results beyond a stride's end: energy balance, trajectory and feasibility check."""
    gait = gpw.find_gait("lab", 0.036)
    walker = gpw.WALKERS["lab"]
    p = problem("kneed")
    times = by_turns(
        {
            "kernel alone": again(p, new_batch(p, 1), 1e-10),
            "stride(), with its ledger and units": lambda: gpw.stride(walker, 0.036, gait.state),
            "simulate()": lambda: simulate(walker, 0.036, gait.state),
            "reality_check()": lambda: gpw.reality_check(walker, 0.036, gait.state),
        }
    )
    base = times["kernel alone"]
    return table(
        ["one stride of lab, tolerance 1e-10", "µs", "× kernel"],
        [(name, time * 1e6, time / base) for name, time in times.items()],
    )


def derivatives() -> str:
    """Exact derivatives of a stride by the coordinates of the section, in strides a direction."""
    rows = []
    for walker, slope in (("D", 0.009), ("A", 0.03), ("lab", 0.036)):
        strides = gpw.stride_map(walker, slope)
        gait = gpw.find_gait(strides)
        for count in (64, 4096):
            spread = np.random.default_rng(0).uniform(0.999, 1.001, (count, strides.dimension))
            points = spread * strides.points_at(gait.state)
            jobs: dict[str, Callable[[], object]] = {
                "stride": partial(strides.apply, points),
                "derivative": partial(strides.linearize, points),
            }
            times = by_turns(jobs)
            stride, more = times["stride"], times["derivative"] - times["stride"]
            rows.append((walker, count, stride / count * 1e6, more / strides.dimension / stride))
    heads = ["walker", "at once", "µs a stride, tolerance 1e-13", "strides a direction"]
    return table(heads, rows)


def environments() -> str:
    """A control step of the environment, with each option of the scene."""
    scenes = {
        "simplest, passive": {"walker": "D", "slope": 0.009, "max_hip_torque": 0.0},
        "straight, passive": {"walker": "A", "slope": 0.03, "max_hip_torque": 0.0},
        "kneed, passive": {"walker": "lab", "slope": 0.036, "max_hip_torque": 0.0,
        "end_on_toe_stub": False},
        "kneed, motor": {"walker": "lab", "slope": 0.036, "end_on_toe_stub": False},
        "kneed, motor, stub": {"walker": "lab", "slope": 0.036, "end_on_toe_stub": True},
        "kneed, motor, stub, random slope": {"walker": "lab", "slope": (0.03, 0.04)},
        "kneed, motor, stub, random walker": {
            "walker": "lab", "slope": 0.036, "domain_randomization": {"foot_radius": 0.01},
        },
        **{
            f"kneed, motor, stub, {name}": {"walker": "lab", "slope": 0.036} | arguments
            for name, arguments in BEFALLS.items()
        },
    }  # fmt: skip
    jobs: dict[str, Callable[[], object]] = {}
    actions = np.zeros((COUNT, 1))
    for name, scene in scenes.items():
        envs = gym.make_vec(
            "PassiveWalker-v0", num_envs=COUNT, reset_noise_scale=0.01, threads=1,
            max_episode_steps=-1, **scene,
        )  # fmt: skip
        envs.reset(seed=0)
        jobs[name] = lambda envs=envs: envs.step(actions)
    times = by_turns(jobs)
    lean = times["simplest, passive"]
    text = table(
        [f"a tick, {COUNT} environments, zero action", "µs each", "× simplest, passive"],
        [(name, time / COUNT * 1e6, time / lean) for name, time in times.items()],
    )
    kneed = {"scene": "lab", "max_episode_steps": -1}
    bare, drawn = gym.make("PassiveWalker-v0", **kneed), None
    bare.reset(seed=0)
    single = {"no picture": lambda: bare.step(np.zeros(1))}
    try:
        drawn = gym.make("PassiveWalker-v0", render_mode="rgb_array", **kneed)
        drawn.reset(seed=0)
        single["render_mode given, no picture asked for"] = lambda: drawn.step(np.zeros(1))
        single["a picture at each tick"] = lambda: (drawn.step(np.zeros(1)), drawn.render())
    except ImportError:
        pass
    times = by_turns(single)
    return f"{text}\n\n" + table(
        ["a tick, one environment", "µs", "× no picture"],
        [(name, time * 1e6, time / times["no picture"]) for name, time in times.items()],
    )


def with_arrays(step: gpw.Transition) -> np.ndarray:
    """The built-in reward, in a function that cannot be compiled."""
    return np.asarray(step.distance - 10.0 * step.energy)


def rewards() -> str:
    """A control step with the built-in reward, and with the same reward as a user's function."""
    given = {
        "built-in": {},
        "compiled function": {"reward": lambda step: step.distance - 10.0 * step.energy},
        "function of arrays": {"reward": with_arrays},
    }
    rows = []
    for count in (1, 64, 1024):
        jobs: dict[str, Callable[[], object]] = {}
        for name, reward in given.items():
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # that the last one cannot be compiled
                envs = gym.make_vec(
                    "PassiveWalker-v0", num_envs=count, scene="lab", threads=1, **reward
                )
            envs.reset(seed=0)
            actions = np.zeros((count, 1))
            jobs[name] = lambda envs=envs, actions=actions: envs.step(actions)
        times = by_turns(jobs)
        for name, time in times.items():
            rows.append((count, name, time / count * 1e6, time / times["built-in"]))
    heads = ["environments of lab", "reward", "µs a tick", "× built-in"]
    return table(heads, rows)


def main() -> None:
    """Print the tables and write them to the page."""
    command(__doc__)
    numba.set_num_threads(1)
    text = "\n\n".join([kinds(), analysis(), derivatives(), environments(), rewards()])
    keep("scene cost", f"{text}\n\nOne core. {machine('gymnasium')}.", BENCHMARKS)


if __name__ == "__main__":
    raise SystemExit(console.run(main))
