"""Train an agent to walk, and judge it beside the passive walker.

    python train.py                               PPO on the recommended scene
    python train.py --scene steep --algo sac --steps 50000
    python train.py --resume runs/level-ppo-1     go on with a run, to more steps with --steps
    python train.py evaluate runs/level-ppo-1     judge its policy once more
    python train.py evaluate --policy level-ppo   or one that comes with the package
    python train.py optimal --scene level         gaits of least cost of transport
    python train.py gait level-ppo --out gait.png the gait of a walker under a policy
    python train.py benchmark --seeds 10          everyone beside everyone, resumable
    python train.py export RUN FOLDER             a policy as tensors and JSON

A run's folder keeps the policy (model.zip, normalizer.npz), its configuration (config.yml), the
learning curve (CSV and PNG), the evaluation (CSV and table) and a strobe picture of the gait.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import gym_passive_walker.console as console

# isort: split
# The package comes first: from here on Ctrl-C ends the program in a line, also while it loads.
import numba
import torch

from agents import commands, envs, evaluation, files, pictures
from agents.config import ALGORITHMS, DEFAULT_SCENE, Config, ConfigError, configure
from agents.training import Run
from gym_passive_walker.cli.arguments import A_WALKER
from gym_passive_walker.envs.scene import SCENES
from gym_passive_walker.extras import need


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
    """Keep torch to one thread: at these sizes a second one wins nothing.

    On a busy machine threads that wait for each other make it fifty times slower, and their number
    would change the rounding. Numba, where it starts its own, sets torch's anew: so it comes first.
    """
    numba.get_num_threads()
    torch.set_num_threads(1)


def train_parser() -> argparse.ArgumentParser:
    """The arguments of a training."""
    parser = argparse.ArgumentParser(
        prog="train.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--algo", choices=ALGORITHMS, help="the algorithm (ppo)")
    add("--scene", help=f"the scene: {', '.join(SCENES)} ({DEFAULT_SCENE})")
    add("--walker", metavar="WALKER", help=f"another walker: {A_WALKER}")
    add("--slope", type=float, nargs="+", metavar="RAD", help="another slope, or a range's ends")
    add("--control", choices=("tick", "stride"), help="how long a torque is held")
    add("--steps", type=whole, metavar="N", help="environment steps in all (the preset's)")
    add("--envs", type=int, metavar="N", help="environments side by side (the preset's)")
    add("--seed", type=int, help="seed of everything (0)")
    add("--every", type=whole, metavar="N", help="steps between evaluations and checkpoints")
    add("--out", type=Path, metavar="DIR", help="folder of the run (a new one under runs/)")
    resumed = "go on with a run: this one, that of --out, or the latest under runs/"
    add("--resume", nargs="?", const=True, metavar="DIR", help=resumed)
    add("--tensorboard", action="store_true", help="write tensorboard's logs into the run's folder")
    searched = "try N sets of hyperparameters (needs Optuna), and keep the best as a preset"
    add("--search", type=whole, metavar="N", help=searched)
    add("--ray", nargs="?", const="here", metavar="ADDRESS", help="search on Ray Tune (here)")
    add("--quiet", action="store_true", help="no progress bar")
    return parser


def whole(text: str) -> int:
    """A whole number, as 250000 or 2.5e5."""
    number = float(text)
    if not number.is_integer():
        raise argparse.ArgumentTypeError(f"{text} is not a whole number")
    return int(number)


def asked_for(args: argparse.Namespace, kept: Config | None = None) -> Config:
    """The configuration that the command line asks for; a kept one's values where it is silent."""
    env = dict(kept.env) if kept else {}
    env |= {k: getattr(args, k) for k in ("walker", "control") if getattr(args, k) is not None}
    if args.slope is not None:
        if len(args.slope) > 2:
            raise ConfigError("--slope takes one number, or the two ends of a range")
        env["slope"] = args.slope[0] if len(args.slope) == 1 else list(args.slope)

    def given(name: str, default: Any) -> Any:
        value = getattr(args, name)
        return default if value is None else value

    return configure(
        given("algo", kept.algo if kept else "ppo"),
        given("scene", kept.scene if kept else DEFAULT_SCENE),
        env=env,
        steps=given("steps", kept.steps if kept else None),
        n_envs=given("envs", kept.n_envs if kept else None),
        seed=given("seed", kept.seed if kept else 0),
        every=given("every", kept.every if kept else None),
    )


def run_to_resume(args: argparse.Namespace) -> tuple[Path, Config]:
    """The folder to go on with, and its configuration with the new number of steps."""
    folder = args.out if args.resume is True else Path(args.resume)
    folder = folder or files.latest_run()
    kept = Config.load(folder / files.CONFIG)
    # A preset that has changed since does not matter: the run keeps its own.
    of_preset = ("hyperparams", "normalize", "exploration", "training")
    asked = replace(asked_for(args, kept), **{name: getattr(kept, name) for name in of_preset})
    differences = kept.differences(asked, ignore=("steps", "every"))
    if differences:
        raise ConfigError(f"{folder} is another run:\n  " + "\n  ".join(differences))
    return folder, asked


def train(args: argparse.Namespace) -> int:
    """Train, evaluate, and leave everything in the run's folder."""
    if args.resume is not None:
        folder, config = run_to_resume(args)
    else:
        config = asked_for(args)
        if args.search is None:  # which is better known before than after hours of training
            need("matplotlib", "train")
        if args.tensorboard:
            need("tensorboard", "train")
        envs.check(config)  # refuses nonsense before there is a folder
        if args.search is None and args.ray is not None:
            raise ConfigError("--ray goes with --search: a training is done by this process")
        if args.search is not None:
            return find_better(config, args)
        folder = files.new_run(args.out, f"{config.scene}-{config.algo}")
    run = Run(config, folder, tensorboard=args.tensorboard)
    print(f"{envs.describe(config)}: {config.algo.upper()}, {config.steps:,} steps, in {folder}")
    try:
        finished = run.train(progress=not args.quiet)
    except OSError as error:
        print(run.first_hundred())
        raise ConfigError(
            f"stopped after {run.steps:,} steps: {error}; once there is room go on with: python "
            f"train.py --resume {folder}"
        ) from None
    if not finished:
        print(f"Stopped after {run.steps:,} steps; go on with: python train.py --resume {folder}")
    text, rows = evaluation.judge(folder)
    print(text)
    print(run.first_hundred())
    evaluation.keep(folder, text, rows)
    pictures.draw_run(folder, run.notes["curve"])
    print(f"Saved in {folder}: {', '.join(sorted(p.name for p in folder.iterdir()))}")
    return 0


def find_better(config: Config, args: argparse.Namespace) -> int:
    """Search for better hyperparameters, or go on with a search in the same folder."""
    if args.search < 1:
        raise ConfigError(f"--search takes a number of trials from 1 on, not {args.search}")
    from agents.search import BEST, search

    folder = args.out or files.RUNS / f"search-{config.scene}-{config.algo}"
    best = search(config, folder, args.search, ray=args.ray, progress=not args.quiet)
    print("\n".join(f"{name}: {value}" for name, value in best.items()))
    print(f"Saved in {folder / BEST}, in the layout of agents/presets")
    return 0


if __name__ == "__main__":
    sys.exit(main())
