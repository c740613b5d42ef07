"""Commands of `train.py` besides training."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from agents import benchmark, evaluation
from agents.checkpoint import last_policy
from agents.config import TRUST, ConfigError
from agents.envs import scene_of
from agents.learner import LearnedPolicy, export, export_onnx, learned
from gym_passive_walker import GaitNotFound
from gym_passive_walker._tools.arguments import unknown, whole
from gym_passive_walker._tools.console import cut
from gym_passive_walker._tools.files import replacing
from gym_passive_walker.apps.cli.arguments import A_SCENE, OF_SCENE, Parser
from gym_passive_walker.envs.policies import READERS, load_policy, shipped_policies
from gym_passive_walker.gaits.control import optimal
from gym_passive_walker.gaits.control.baselines import BASELINES
from gym_passive_walker.gaits.control.controllers import acting
from gym_passive_walker.gaits.control.maps import closed_loop_gait
from gym_passive_walker.gaits.control.policy import Policy
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.gaits.scenes.scene import SCENES, Scene, make_scene

GRIDS = {"level": (0.05, 0.20, 0.01), "lab": (0.15, 0.23, 0.01), "steep": (0.31, 0.34, 0.005)}
"""Speeds over sqrt(g l) of each scene's stored optimal gaits: first, last and spacing."""

FINER = 8
"""In each interval between those speeds, the number of intervals between stored costs."""


def _parser(command: str, description: str) -> Parser:
    """A parser of a command's arguments."""
    return Parser(prog=f"train.py {command}", description=description)


def evaluate(arguments: Sequence[str]) -> int:
    """Evaluate the policy of a run, or one of the package."""
    parser = _parser("evaluate", "Evaluate a policy beside the passive walker.")
    which = parser.add_mutually_exclusive_group(required=True)
    known = ", ".join(shipped_policies())
    about = f"folder of a run or of an exported policy, or a policy of the package: {known}"
    which.add_argument("run", nargs="?", metavar="RUN|POLICY", help=about)
    which.add_argument(
        "--policy", metavar="NAME", help="the same, but a policy of the package comes first"
    )
    add = parser.add_argument
    add("--trust", action="store_true", help=TRUST)
    add("--episodes", type=int, default=evaluation.EPISODES, metavar="N",
        help="number of episodes (%(default)s)")  # fmt: skip
    add("--seed", type=int, default=evaluation.SEED, help="seed of the episodes (%(default)s)")
    args = parser.parse_args(arguments)
    name = args.run or args.policy
    folder = Path(name) if Path(name).is_dir() else None
    if folder is None and name not in shipped_policies():
        near = unknown([name], shipped_policies(), "the package")
        raise ConfigError(f"{cut(name)} is not the folder of a run, and {near}")
    text, rows = evaluation.evaluate_policy(
        folder if args.run and folder else name,
        episodes=whole(args.episodes, "--episodes"), seed=whole(args.seed, "--seed", least=0),
        trust=args.trust,
    )  # fmt: skip
    print(text)
    if args.run and folder:
        evaluation.write_evaluation(folder, text, rows)
    return 0


def find_optimal(arguments: Sequence[str]) -> int:
    """Find and store the optimal gaits of a scene, or print the stored ones."""
    parser = _parser(
        "optimal",
        "Gaits of least cost of transport: prints those of a scene. With --again they are found "
        "again and stored, and the cost at eight times as many speeds, which takes ten minutes.",
    )
    parser.add_argument("--scene", choices=tuple(GRIDS), default="level", help="(%(default)s)")
    parser.add_argument("--again", action="store_true", help="find them again, and store them")
    args = parser.parse_args(arguments)
    if args.again:
        first, last, apart = GRIDS[args.scene]
        count = round((last - first) / apart)
        kept = np.linspace(first, last, count + 1).round(6).tolist()
        speeds = np.linspace(first, last, FINER * count + 1).round(6).tolist()
        found = optimal.optimal_gaits(args.scene, speeds)
        optimal.save_costs(args.scene, found)
        # The passive gait of the scene is found too, and its speed is not one of the grid.
        gaits = [
            gait
            for gait, speed in ((gait, round(gait.froude_speed, 6)) for gait in found)
            if speed in kept or speed not in speeds
        ]
        with replacing(optimal.STORE / f"{args.scene}.json") as path:
            optimal.save_gaits(path, gaits)
    print(optimal_table(optimal.load(args.scene)))
    return 0


def optimal_table(gaits: Sequence[optimal.OptimalGait]) -> str:
    """A table of optimal gaits, as text."""
    lines = [
        "speed/√(gl)  cost of transport       hip work  period  largest multiplier  optimality"
    ]
    for gait in gaits:
        lines.append(
            f"{gait.froude_speed:11.3f}  {gait.cost_of_transport:17.5f}  {gait.hip_cost:13.5f}  "
            f"{gait.dimensionless.step_period:6.3f}  {abs(gait.multipliers[0]):18.3f}  "
            f"{gait.optimality:10.1e}"
        )
    return "\n".join(lines)


def show_gait(arguments: Sequence[str]) -> int:
    """Find the gait of a walker under a policy, print it, and draw it if asked."""
    parser = _parser("gait", "The periodic gait of a walker under a policy.")
    add = parser.add_argument
    known = ", ".join([*BASELINES, *shipped_policies()])
    add("policy", help=f"folder of a run, or one of {known}")
    add("--scene", **OF_SCENE, help="scene (a learned policy's own; else "
        f"level): {A_SCENE}")  # fmt: skip
    add("--trust", action="store_true", help=TRUST)
    add(
        "--slope",
        type=float,
        metavar="RAD",
        help="slope (the scene's, or the middle of its range)",
    )
    add("--period", type=int, default=1, help="period of the gait in strides (%(default)s)")
    add("--out", type=Path, metavar="PNG", help="picture file")
    args = parser.parse_args(arguments)
    out = None
    if args.out is not None:
        from gym_passive_walker.pictures.axes import OWN, figure_of, picture_path, save

        out = picture_path(args.out)
    policy, scene = _policy_and_scene(args.policy, args.scene, trust=args.trust)
    with ConfigError.instead_of(GaitNotFound):
        gait = closed_loop_gait(policy, scene, slope=args.slope, period=args.period)
    known, least = [], float("nan")
    with suppress(ValueError):  # none are stored for this scene, or none at this speed
        there = {} if args.slope is None else {"slope": args.slope}
        name = optimal.stored_name(make_scene(scene, **there))
        known = optimal.load(name)
        least = optimal.least_cost(name, gait.froude_speed)
    print(_described(gait, least))
    if out is not None:
        near = min(
            known, key=lambda other: abs(other.froude_speed - gait.froude_speed), default=None
        )
        save(figure_of(gait.plot(OWN, optimum=near)), out)
    return 0


def _policy_and_scene(
    name: str, scene: Scene | None, *, trust: bool = False
) -> tuple[Policy, Scene]:
    """A policy by its name, and the scene in which it acts."""
    if name in BASELINES:
        return acting(name, scene)
    if Path(name).suffix.lower() in READERS:
        return acting(load_policy(name, trust=trust), scene)
    config, policy = learned(name, trust=trust)
    return policy, scene or scene_of(config)


def _described(gait: Gait, least: float) -> str:
    """A gait's measures, one line each, and the least cost at its speed, if it is known."""
    units = gait.walker.units
    rows = {
        "speed / √(g l)": f"{gait.froude_speed:.4f}",
        "step period / √(l/g)": f"{gait.step_period / units.time:.4f}",
        "step length / l": f"{gait.step_length / units.length:.4f}",
        "cost of transport": f"{gait.cost_of_transport:.5f}",
        "  gravity's": f"{gait.gravity_cost:.5f}",
        "  positive hip work": f"{gait.positive_hip_cost:.5f}",
        "  absolute hip work": f"{gait.hip_cost:.5f}",
        "  net hip work": f"{gait.net_hip_cost:.5f}",
        "  absolute ankle work": f"{gait.ankle_cost:.5f}",
        "  push-off": f"{gait.push_off_cost:.5f}",
        "multipliers' moduli": ", ".join(f"{size:.3f}" for size in np.abs(gait.multipliers)),
        "stable": "yes" if gait.stable else "no",
    }
    if np.isfinite(least):
        above = gait.cost_of_transport / least - 1.0
        rows["optimum at that speed"] = f"{least:.5f}; this is {above:.0%} above"
    return "\n".join(f"{name:<26}{value}" for name, value in rows.items())


def run_benchmark(arguments: Sequence[str]) -> int:
    """Compare agents in scenes, seed by seed; write scores, tables and a picture."""
    parser = _parser(
        "benchmark",
        "Compare agents. An interrupted command continues where it stopped.",
    )
    add = parser.add_argument
    add("--scenes", nargs="+", metavar="SCENE", help="scenes (all)")
    add("--agents", nargs="+", metavar="AGENT", help="agents (all)")
    add("--seeds", type=int, metavar="N", help="seeds of each learning agent (10)")
    add("--budget", type=float, metavar="SHARE", help="fraction of the presets' steps (1)")
    add(
        "--out",
        type=Path,
        default=Path("runs/benchmark"),
        metavar="DIR",
        help="output folder (%(default)s)",
    )
    add("--tables", nargs="?", const=True, metavar="CSV", help="only print existing results: those "
        "of the output folder, or raw scores such as docs/agents-scores.csv")  # fmt: skip
    add("--document", type=Path, metavar="MD", help="write the tables between the markers of this "
        "file, and the raw scores and pictures beside it")  # fmt: skip
    add("--quiet", action="store_true", help="no progress bar")
    args = parser.parse_args(arguments)
    usual = {"scenes": list(SCENES), "agents": list(benchmark.AGENTS), "seeds": 10, "budget": 1.0}
    asked = {name: getattr(args, name) for name in usual if getattr(args, name) is not None}
    if args.tables and asked:
        named = ", ".join(f"--{name}" for name in asked)
        raise ConfigError(f"--tables prints all results that there are: leave out {named}")
    scenes, agents, seeds, budget = (usual | asked).values()
    if not budget > 0.0:
        raise ConfigError(f"--budget must be positive, not {budget}")
    todo = benchmark.units(scenes, agents, seeds)
    from agents import results  # imported late: no other command draws a benchmark

    from_file = args.tables not in (None, True)
    if from_file and args.document is not None:
        raise ConfigError("--document requires the scores of --out: raw scores lack the falls")
    if args.document is not None:
        with ConfigError.instead_of(OSError, ValueError):  # now, and not after the benchmark
            results.around_tables(args.document)
    if from_file:
        print(results.tables(results.read_csv(Path(args.tables))))
        return 0
    if not args.tables:
        benchmark.run(args.out, todo, budget=budget, progress=not args.quiet)
    scores = benchmark.load_scores(args.out)
    if not scores:
        raise ConfigError(f"there are no scores in {args.out} yet: leave out --tables")
    text = results.tables(scores)
    print(text)
    results.write_csv(args.out / "scores.csv", scores)
    if args.document is not None:
        folder = args.document.parent
        made = results.provenance(shlex.join(["python", "train.py", "benchmark", *arguments]))
        results.write_document(args.document, f"{text}\n\n{made}")
        results.write_csv(folder / "agents-scores.csv", scores)
        results.draw(folder / "images" / "agents-pareto.png", scores)
        results.draw_learning(folder / "images" / "agents-learning.png", args.out / "runs", scores)
    return 0


def export_policy(arguments: Sequence[str]) -> int:
    """Write a run's policy as tensors and JSON, the package's own format, or as an ONNX file."""
    parser = _parser("export", "Write a run's policy as tensors and JSON, or as an ONNX file.")
    add = parser.add_argument
    add("run", help="folder of the run; for ONNX, also an exported folder or a shipped policy")
    add("output", type=Path, help="output folder, or an ONNX file (.onnx)")
    add("--onnx", action="store_true", help="write OUTPUT/policy.onnx if OUTPUT is a folder")
    add("--last", action="store_true", help="the policy of the newest checkpoint, not of the best "
        "evaluation")  # fmt: skip
    add("--trust", action="store_true", help=TRUST)
    args = parser.parse_args(arguments)
    if args.last:
        config, policy = last_policy(Path(args.run), trust=args.trust)
    else:
        config, policy = learned(args.run, trust=args.trust)
    if args.onnx or args.output.suffix.lower() == ".onnx":
        file = args.output
        if file.suffix.lower() != ".onnx":
            file = file / "policy.onnx"
        export_onnx(policy, config, file)
        print(f"Saved in {file}")
        return 0
    if not isinstance(policy, LearnedPolicy):
        raise ConfigError(f"{args.run} was exported before: its folder can be copied as it is")
    export(policy, config, args.output)
    print(f"Saved in {args.output}: {', '.join(sorted(p.name for p in args.output.iterdir()))}")
    return 0


COMMANDS = {
    "evaluate": evaluate,
    "optimal": find_optimal,
    "gait": show_gait,
    "benchmark": run_benchmark,
    "export": export_policy,
}
