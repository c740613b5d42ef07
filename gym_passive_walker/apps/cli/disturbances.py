"""Commands that test a walk under disturbances."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from pathlib import Path

from gym_passive_walker._tools.loading import has_address
from gym_passive_walker.apps.cli.arguments import (
    A_POLICY,
    A_SCENE,
    A_WALKER,
    a_scene,
    add_trust,
    read_policy,
)
from gym_passive_walker.apps.cli.report import Report, listing, table
from gym_passive_walker.envs.evaluation.gauntlet import gauntlet as tested
from gym_passive_walker.envs.evaluation.robustness import robustness as tried
from gym_passive_walker.envs.policies import shipped_policies
from gym_passive_walker.gaits.control.baselines import BASELINES
from gym_passive_walker.gaits.scenes.named import named_walker
from gym_passive_walker.models.walkers import is_walker
from gym_passive_walker.pictures.axes import OWN, figure_of, picture_path, save

_MEASURES = ("step_length", "step_period", "roughness", "sensitivity", "step_up", "step_down")
_MEASURES += ("initial_error", "recovered", "recovered_error", "recovery")
_COUNTS = ("falls", "strides", "states")  # of a first passage, sampled or by a mesh


def gauntlet(command: ArgumentParser) -> Callable[[Namespace], Report]:
    """Test a controller under fixed disturbances, terrains and bodies; one score card.

    passive-walker gauntlet level-ppo
    passive-walker gauntlet lqr --scene steep --walkers 256
    passive-walker gauntlet my-policy.onnx --scene level
    """
    add = command.add_argument
    known = ", ".join([*shipped_policies(), *BASELINES])
    add("controller", metavar="CONTROLLER", help=f"{known}, or {A_POLICY}")
    add("--scene", type=a_scene, metavar="SCENE",
        help=f"scene of the tests (the policy's own): {A_SCENE}")  # fmt: skip
    add("--walkers", type=int, default=64, metavar="N", help="walks in each test (%(default)s)")
    add_trust(command)

    def run(arguments: Namespace) -> Report:
        controller = read_policy(arguments, arguments.controller)
        found = tested(controller, arguments.scene, walkers=arguments.walkers)
        columns = found.columns()
        rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        low, high = found.score_interval
        data = {"controller": found.controller_name, "score": found.score, "low": low, "high": high}
        return Report(str(found), {**data, "tests": rows})

    return run


def robustness(command: ArgumentParser) -> Callable[[Namespace], Report]:
    """Measure robustness: rough ground, steps, pushes, initial states far from the gait.

    passive-walker robustness lab --slope 0.036
    passive-walker robustness level-ppo --roughness 0.004 --out level.png
    passive-walker robustness lab --slope 0.036 --roughness 0.001 --first-passage mesh
    """
    known = ", ".join([*shipped_policies(), *BASELINES])
    add = command.add_argument
    add(
        "controller",
        metavar="WALKER|CONTROLLER",
        help=f"a passive walker: {A_WALKER}; or a controller: {known}, or {A_POLICY}",
    )
    add("--scene", type=a_scene, metavar="SCENE",
        help=f"scene (the policy's own): {A_SCENE}")  # fmt: skip
    add("--slope", type=float, metavar="RAD", help="slope in rad, positive downhill (the scene's)")
    add("--roughness", type=float, default=0.002, metavar="L",
        help="standard deviation of footholds' heights, in leg lengths (%(default)s)")  # fmt: skip
    add("--first-passage", choices=("sampled", "mesh"), default="sampled",
        help="how the mean strides to a fall are found (%(default)s)")  # fmt: skip
    add(
        "--strides",
        type=int,
        default=200,
        metavar="N",
        help="strides on rough ground (%(default)s)",
    )
    add(
        "--walkers",
        type=int,
        metavar="N",
        help="walkers on rough ground (4096 if passive, else 512)",
    )
    add(
        "--seed",
        type=int,
        default=0,
        metavar="N",
        help="seed of terrain and initial states (%(default)s)",
    )
    add("--out", type=Path, metavar="FILE", help="picture file: .png, .pdf or .svg")
    add_trust(command)

    def run(arguments: Namespace) -> Report:
        out = None if arguments.out is None else picture_path(arguments.out)
        name = arguments.controller
        walker = has_address(name) or is_walker(name)
        if walker and arguments.scene is None and arguments.slope is None:
            raise ValueError("a passive walker needs --slope or --scene, as in --slope 0.036")
        if walker and arguments.trust:
            raise ValueError("--trust permits a controller, and this is a walker")
        read = named_walker(name) if walker else read_policy(arguments, arguments.controller)
        found = tried(
            read, arguments.scene, slope=arguments.slope,
            roughness=arguments.roughness, first_passage=arguments.first_passage,
            walkers=arguments.walkers, strides=arguments.strides, seed=arguments.seed,
        )  # fmt: skip
        lasting = found.first_passage
        data = {name: getattr(found, name) for name in _MEASURES} | {
            "controller": found.controller_name, "slope": found.slope,
            "first_passage": lasting.mean, "first_passage_error": lasting.error,
            "first_passage_interval": lasting.interval,
            **{name: count for name, count in lasting._asdict().items() if name in _COUNTS},
            **found.columns(),
        }  # fmt: skip
        columns = found.columns()
        rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        facts = found.facts()
        pushes = table(
            [
                {
                    "push at (periods)": f"{row['push_phases']:.1f}",
                    "forward (m √(g l))": row["push_forward"],
                    "backward (m √(g l))": row["push_backward"],
                }
                for row in rows
            ]
        )
        said = [listing(facts.pop("controller"), facts), pushes]
        files = {} if out is None else {out: lambda path: save(figure_of(found.plot(OWN)), path)}
        return Report("\n\n".join(said), data, files)

    return run
