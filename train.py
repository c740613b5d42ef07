"""Train an agent to walk, and compare it with the passive walker.

    python train.py                               Train PPO on level ground, in about a minute.
    python train.py --scene steep --algo sac      Train SAC on the scene `steep`.
    python train.py --scene mytask:walking        Train on the scene that a function of yours makes.
    python train.py --resume runs/level-ppo-fast-1  Continue a run, to more steps with --steps.
    python train.py --scene lab --from level-ppo  Begin with a policy; all else is a new run.
    python train.py evaluate runs/level-ppo-fast-1  Evaluate its policy again.
    python train.py evaluate level-ppo            Evaluate a policy of the package.
    python train.py optimal --scene level         Print gaits of least cost of transport.
    python train.py gait level-ppo --out gait.png Find and draw the gait under a policy.
    python train.py benchmark --seeds 10          Compare all agents in all scenes; resumable.
    python train.py export RUN FOLDER             Write a policy as tensors and JSON.
    python train.py export RUN FILE.onnx          Write a policy as an ONNX file.

A run's folder contains the policy (model.zip, normalizer.npz) and its configuration (config.yml).
It also has the learning curve (CSV and PNG), the evaluation (CSV and table) and a stroboscopic
picture of the gait.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import gym_passive_walker._tools.console as console

# isort: split
# Import this first: Ctrl-C then ends the program with one line, also during the other imports.
import torch

from agents import commands, envs, evaluation, files, pictures
from agents.config import (
    ALGORITHMS,
    DEFAULT_ALGORITHM,
    DEFAULT_SCENE,
    TRUST,
    Config,
    ConfigError,
    configure,
    presets,
)
from agents.learner import begin_with, build
from agents.training import Run
from gym_passive_walker._tools.extras import need
from gym_passive_walker._tools.loading import is_file, untrusted
from gym_passive_walker.apps.cli.arguments import A_WALKER
from gym_passive_walker.gaits.scenes.named import outside
from gym_passive_walker.gaits.scenes.scene import SCENES, seen_by_policy


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    keep_to_one_thread()

    def work() -> int:
        if arguments and arguments[0] in commands.COMMANDS:
            return commands.COMMANDS[arguments[0]](arguments[1:])
        return train(train_parser().parse_args(arguments))

    return console.run(
        work,
        name="train.py: ",
        refusals={ValueError: 2, ImportError: 2, OSError: 2},
        stopped="stopped; --resume goes on from the last checkpoint",
    )


def keep_to_one_thread() -> None:
    """Limit torch to one thread; for networks of this size a second one gains nothing.

    On a busy machine, threads that wait for each other make it fifty times slower. Their number
    would also change the rounding.
    """
    torch.set_num_threads(1)


def train_parser() -> argparse.ArgumentParser:
    """The parser of a training's arguments."""
    parser = argparse.ArgumentParser(
        prog="train.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--algo", choices=ALGORITHMS, help=f"the algorithm ({DEFAULT_ALGORITHM})")
    own = "module:function, a function of yours that returns a scene or its arguments; or a JSON, "
    own += "YAML or TOML file of its arguments"
    add("--scene", help=f"the scene: {', '.join(SCENES)} ({DEFAULT_SCENE}); {own}")
    add("--trust", action="store_true", help=TRUST)
    add("--walker", metavar="WALKER", help=f"another walker: {A_WALKER}")
    add(
        "--slope", type=float, nargs="+", metavar="RAD", help="slope in rad, or the ends of a range"
    )
    add(
        "--control",
        choices=("tick", "stride"),
        help="hold a torque for a control step or for a stride",
    )
    add("--steps", type=whole, metavar="N", help="total number of environment steps (the preset's)")
    parallel = "number of parallel environments (the preset's)"
    add("--envs", dest="n_envs", type=int, metavar="N", help=parallel)
    add("--seed", type=int, help="seed of all random numbers (0)")
    limit = "steps after which a training episode is truncated (the preset's)"
    add("--episode-steps", type=whole, metavar="N", help=limit)
    add("--every", type=whole, metavar="N", help="steps between evaluations and checkpoints")
    begun = "begin with this policy, a name or a folder, in place of random weights"
    add("--from", dest="start", metavar="POLICY", help=begun)
    add("--out", type=Path, metavar="DIR", help="folder of the run (a new one under runs/)")
    resumed = "continue a run: this one, that of --out, or the latest under runs/"
    add("--resume", nargs="?", const=True, metavar="DIR", help=resumed)
    add("--tensorboard", action="store_true", help="write tensorboard's logs into the run's folder")
    searched = "try N sets of hyperparameters (requires Optuna) and store the best as a preset"
    add("--search", type=whole, metavar="N", help=searched)
    add(
        "--ray",
        nargs="?",
        const="here",
        metavar="ADDRESS",
        help="search on Ray Tune (Ray on this machine)",
    )
    add("--quiet", action="store_true", help="no progress bar")
    return parser


def whole(text: str) -> int:
    """Parse a whole number, such as 250000 or 2.5e5."""
    number = float(text)
    if not number.is_integer():
        raise argparse.ArgumentTypeError(f"{text} is not a whole number")
    return int(number)


def asked_for(args: argparse.Namespace, kept: Config | None = None) -> Config:
    """The configuration given by the arguments; other values are those of `kept`, if given."""
    of_file = bool(args.scene) and is_file(args.scene)
    env = dict(kept.env) if kept and not of_file else {}  # a file states the arguments itself
    env |= {k: getattr(args, k) for k in ("walker", "control") if getattr(args, k) is not None}
    if args.slope is not None:
        if len(args.slope) > 2:
            raise ConfigError("--slope takes one number, or the two ends of a range")
        env["slope"] = args.slope[0] if len(args.slope) == 1 else list(args.slope)

    if of_file and not args.trust:  # it may be another person's
        for address, what in outside(args.scene).items():
            raise ConfigError(untrusted(f"the {what} {address!r}"))

    values: dict[str, Any] = {"algo": DEFAULT_ALGORITHM}
    for name in ("algo", "scene", "steps", "n_envs", "seed", "every", "episode_steps", "start"):
        asked = getattr(args, name)
        if asked is None and kept is not None:
            asked = getattr(kept, name)
        if asked is not None:
            values[name] = asked
    return configure(**values, env=env)


def check_together(args: argparse.Namespace) -> None:
    """Raise an error for arguments of which one would have no effect beside another.

    Raises:
        ConfigError: if there are such arguments.
    """
    resumed = args.resume is not None
    if resumed and (args.search is not None or args.ray is not None):
        raise ConfigError(
            "--resume continues a training: leave out --search and --ray; a search continues by "
            "itself with its --out"
        )
    if resumed and args.resume is not True and args.out not in (None, Path(args.resume)):
        raise ConfigError(
            f"--resume continues {args.resume} in its own folder: leave out --out {args.out}"
        )
    if args.search is None and args.ray is not None:
        raise ConfigError("--ray goes with --search: a training is done by this process")
    if args.search is not None and args.tensorboard:
        raise ConfigError("a search writes no logs of tensorboard: leave out --tensorboard")


def run_to_resume(args: argparse.Namespace) -> tuple[Path, Config]:
    """The folder of the run to resume, and its configuration with the new number of steps."""
    folder = args.out if args.resume is True else Path(args.resume)
    folder = folder or files.latest_run()
    kept = Config.load(folder / files.CONFIG, trust=args.trust)
    # The run keeps the values of its own preset, even if the preset has changed since.
    own = ("hyperparams", "normalize", "exploration", "training", "source")
    asked = replace(asked_for(args, kept), **{name: getattr(kept, name) for name in own})
    asked.check_same(folder / files.CONFIG, ignore=("steps", "every"))
    return folder, asked


def train(args: argparse.Namespace) -> int:
    """Train and evaluate a policy, and write all files into the run's folder."""
    check_together(args)
    if args.resume is not None:
        folder, config = run_to_resume(args)
    else:
        config = asked_for(args)
        if args.search is None:  # raise a missing extra now rather than after hours of training
            need("matplotlib", "train")
        if args.tensorboard:
            need("tensorboard", "train")
        envs.check(config)  # raises an error for invalid input before a folder is made
        if config.start is not None:
            untrained = build(config, envs.training_envs(config))
            begin_with(untrained, config.start, trust=args.trust)
        if args.search is not None:
            return find_better(config, args)
        folder = files.new_run(args.out, config.name)
    run = Run(config, folder, tensorboard=args.tensorboard, trust=args.trust)
    again = f"python train.py --resume {folder}{' --trust' * bool(config.outside)}"
    print(f"{envs.describe(config)}: {config.algo.upper()}, {config.steps:,} steps, in {folder}")
    print(*(f"Left out: {sentence}\n" for sentence in run.left_out), sep="", end="")
    try:
        finished = run.train(progress=not args.quiet)
    except OSError as error:
        print(run.first_walks())
        raise ConfigError(
            f"stopped after {run.steps:,} steps: {error}; free some space, then continue "
            f"with: {again}"
        ) from None
    if not finished:
        print(f"Stopped after {run.steps:,} steps; continue with: {again}")
    text, rows = evaluation.evaluate_policy(folder, trust=True)  # as this training was
    print(text)
    print(run.first_walks())
    evaluation.write_evaluation(folder, text, rows)
    pictures.draw_run(folder, run.notes["curve"], trust=True)
    print(outlook(folder, config))
    return 0


def outlook(folder: Path, config: Config) -> str:
    """Return lines with the files of a run and what to try next."""
    trust = " --trust" if config.outside else ""
    lines = [
        f"Pictures: {folder / 'gait.png'} (the gait) and {folder / 'learning_curve.png'}",
        f"Other files in {folder}: model.zip, learning_curve.csv, evaluation.csv, evaluation.txt",
        "Next:",
    ]
    if seen_by_policy(envs.scene_of(config)).observation is None:  # else there is no stride map
        told = "torques beside the optimal ones"
        lines.append(f"  python train.py gait {folder}{trust} --out gait.png    {told}")
    if config.algo != "shac" and config.scene in presets("shac"):
        scene = "" if config.scene == DEFAULT_SCENE else f" --scene {config.scene}"
        lines.append(f"  python train.py --algo shac{scene}    learn from exact gradients")
    if config.scene != "rolling":
        lines.append("  python train.py --scene rolling    slopes from 0 to 0.06 rad")
    return "\n".join(lines)


def find_better(config: Config, args: argparse.Namespace) -> int:
    """Search for better hyperparameters, or resume a search in the same folder."""
    if args.search < 1:
        raise ConfigError(f"--search takes a number of trials from 1 on, not {args.search}")
    from agents.search import BEST, search

    folder = args.out or files.RUNS / f"search-{config.name}"
    best = search(
        config, folder, args.search, ray=args.ray, progress=not args.quiet, trust=args.trust
    )
    print("\n".join(f"{name}: {value}" for name, value in best.items()))
    print(f"Saved in {folder / BEST}, in the layout of agents/presets")
    return 0


if __name__ == "__main__":
    sys.exit(main())
