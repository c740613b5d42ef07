"""Commands about walks: their strides, scenes, and walks under a policy."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from gym_passive_walker._tools.arguments import whole
from gym_passive_walker._tools.files import prepare, replacing
from gym_passive_walker.apps.cli.arguments import (
    A_POLICY,
    A_SCENE,
    A_WALKER,
    a_scene,
    a_walker,
    add_terrain,
    add_trust,
    add_walk,
    chosen_map,
    read_policy,
    shown_in,
    start_of,
)
from gym_passive_walker.apps.cli.report import SI, Report, listing, record, table
from gym_passive_walker.envs import explain
from gym_passive_walker.envs.evaluation.walks import evaluate as evaluated
from gym_passive_walker.envs.evaluation.walks import score_table as compared
from gym_passive_walker.envs.policies import TrainedPolicy, load_policy, shipped_policies
from gym_passive_walker.envs.registration import ID
from gym_passive_walker.gaits.control.baselines import BASELINES, Passive
from gym_passive_walker.gaits.control.controllers import acting
from gym_passive_walker.gaits.look.trajectory import Trajectory, ground_of
from gym_passive_walker.gaits.look.trajectory import simulate as simulated
from gym_passive_walker.gaits.stride import stride
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.walkers import describe

_STRIDE = ("duration", "step_length", "kneestrike_time", "kneestrike_loss", "heelstrike_loss")
_STRIDE += ("hip_work",)


def simulate(command: ArgumentParser) -> Callable[[Namespace], Report]:
    """Simulate a walk stride by stride; write its trajectory as CSV or NPZ.

    passive-walker simulate lab 0.036 --strides 20
    passive-walker simulate lab 0.036 --terrain rough:height_std=0.002 --terrain-seed 3
    passive-walker simulate lab 0.036 --state 0.3 -0.3 -0.3 -1.5 -0.8 -2 --out walk.csv
    """
    add_walk(command, strides=10)
    add = command.add_argument
    add(
        "--samples", type=int, default=100, metavar="N", help="samples of each stride (%(default)s)"
    )
    add("--out", type=Path, metavar="FILE", help=".csv or .npz file for the samples")

    def run(arguments: Namespace) -> Report:
        out: Path | None = arguments.out
        if out is not None and out.suffix.lower() not in _WRITERS:
            raise ValueError(f"--out takes a name that ends in .csv or .npz, not {out}")
        if out is not None:
            prepare(out)
        walks, slope, state = (
            chosen_map(arguments, arguments.slope),
            arguments.slope,
            start_of(arguments),
        )
        length = walks.walker.leg_length
        files = {}
        if out is not None:
            sampled = simulated(
                walks, slope, state, arguments.strides, samples=arguments.samples,
                terrain=arguments.terrain, terrain_seed=arguments.terrain_seed,
            )  # fmt: skip
            files[out] = lambda path: _WRITERS[path.suffix.lower()](sampled, path)
        rows: list[dict[str, Any]] = []
        units = SI
        strides = whole(arguments.strides, "--strides")
        ground = ground_of(arguments.terrain, arguments.terrain_seed, strides)
        for tilt, rise, turn in ground.tolist():
            walk = stride(
                walks, slope + tilt, state, height_change=rise * length, slope_change=turn
            )
            view, units = shown_in(arguments, walk)
            rows.append({"stride": len(rows) + 1, "stance_angle": state[0],
                         **record(view, _STRIDE), "outcome": walk.outcome})  # fmt: skip
            if walk.outcome != Outcome.HEELSTRIKE:
                break
            state = walk.state
        return Report(table(rows, units), rows, files)

    return run


def export(command: ArgumentParser) -> Callable[[Namespace], Report]:
    """Write a trained policy as an ONNX file, with its observation normalizer.

    passive-walker export level-ppo level-ppo.onnx
    passive-walker export my-policy my-policy.onnx
    """
    known = ", ".join(shipped_policies())
    add = command.add_argument
    add("policy", metavar="POLICY", help=f"{known}, or the folder of an exported policy")
    add("out", type=Path, metavar="FILE", help="the file; its name ends in .onnx")
    add_trust(command)

    def run(arguments: Namespace) -> Report:
        if arguments.out.suffix.lower() != ".onnx":
            raise ValueError(f"export takes a name that ends in .onnx, not {arguments.out}")
        policy = load_policy(arguments.policy, trust=arguments.trust)
        if not isinstance(policy, TrainedPolicy):
            raise ValueError(
                f"export takes a policy of the package or an exported folder, not "
                f"{arguments.policy}"
            )
        sizes = {"observation": policy.layers[0][0].shape[1], "action": len(policy.layers[-1][1])}
        text = listing(
            f"{arguments.policy}, {policy.algorithm}",
            {name: f"float32 (n, {size})" for name, size in sizes.items()},
        )
        data = {"policy": arguments.policy, "algorithm": policy.algorithm, **sizes}
        return Report(text, data, {arguments.out: policy.to_onnx})

    return run


def _write_npz(walk: Trajectory, path: Path) -> None:
    with replacing(path) as aside, aside.open("wb") as file:  # to a name, NumPy may add ".npz"
        np.savez_compressed(file, **walk.columns())  # type: ignore[arg-type]


_WRITERS = {".csv": Trajectory.to_csv, ".npz": _write_npz}


def scene(command: ArgumentParser) -> Callable[[Namespace], Report]:
    """Explain a scene: observations, actions, reward and termination reasons.

    passive-walker scene level
    passive-walker scene rough --json
    """
    command.add_argument("scene", type=a_scene, metavar="SCENE", help=A_SCENE)

    def run(arguments: Namespace) -> Report:
        return Report(explain.as_text(arguments.scene), explain.as_rows(arguments.scene))

    return run


def evaluate(command: ArgumentParser) -> Callable[[Namespace], Report]:
    """Evaluate a policy over some episodes of a scene, beside the walker without an actuator.

    passive-walker evaluate level-ppo
    passive-walker evaluate lab-ppo --scene level --walker lab --slope 0.01
    passive-walker evaluate level-ppo --terrain waves:height=0.002,strides=6
    """
    known = ", ".join([*shipped_policies(), *BASELINES])
    add = command.add_argument
    add("policy", metavar="POLICY", help=f"{known}, or {A_POLICY}")
    add("--scene", type=a_scene, metavar="SCENE",
        help=f"scene (the policy's own; level): {A_SCENE}")  # fmt: skip
    add("--walker", type=a_walker, metavar="WALKER", help=A_WALKER)
    add("--slope", type=float, metavar="RAD", help="slope in rad (the scene's)")
    add_trust(command)
    add_terrain(command)
    add("--episodes", type=int, default=20, metavar="N", help="number of episodes (%(default)s)")
    add(
        "--seed",
        type=int,
        default=1000,
        metavar="N",
        help="seed of the first episode (%(default)s)",
    )

    def run(arguments: Namespace) -> Report:
        name, episodes = arguments.policy, whole(arguments.episodes, "--episodes")
        asked = {name: getattr(arguments, name) for name in ("slope", "walker", "terrain")}
        changes = {name: value for name, value in asked.items() if value is not None}
        policy, scene = acting(read_policy(arguments, name), arguments.scene, **changes)
        arena = gym.make_vec(ID, num_envs=episodes, scene=scene)
        agents = {name: policy, "without a motor": Passive(scene)}
        walks = {
            label: evaluated(agent, arena, seed=arguments.seed) for label, agent in agents.items()
        }
        slope = " to ".join(f"{bound:g}" for bound in np.atleast_1d(scene.slope))
        title = f"{name}, {describe(scene.walker)}, slope {slope} rad; {episodes} episodes"
        return Report(
            compared(title, walks),
            [row for label, done in walks.items() for row in done.rows(label, digits=None)],
        )

    return run
