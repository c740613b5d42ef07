"""Commands that test a walk under disturbances."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from gym_passive_walker._tools.loading import has_address
from gym_passive_walker.apps.cli.arguments import (
    A_SCENE,
    A_WALKER,
    CONTROLLERS,
    OF_SCENE,
    Trust,
    read_policy,
)
from gym_passive_walker.apps.cli.report import Report, listing, record, table, table_rows
from gym_passive_walker.envs.evaluation.gauntlet import gauntlet as tested
from gym_passive_walker.envs.evaluation.robustness import robustness as tried
from gym_passive_walker.gaits.scenes.named import named_walker
from gym_passive_walker.models.walkers import is_walker
from gym_passive_walker.pictures.axes import OWN, figure_of, picture_path, save

_MEASURES = ("step_length", "step_period", "roughness", "sensitivity", "step_up", "step_down")
_MEASURES += ("initial_error", "recovered", "recovered_error", "recovery")
_COUNTS = ("falls", "strides", "states")  # of a first passage, sampled or by a mesh


def gauntlet(
    controller: Annotated[str, CONTROLLERS],
    *,
    scene: Annotated[Any, f"scene of the tests (the policy's own): {A_SCENE}", OF_SCENE] = None,
    walkers: Annotated[int, "walks in each test"] = 64,
    trust: Trust = False,
) -> Report:
    """Test a controller under fixed disturbances, terrains and bodies; one score card.

    passive-walker gauntlet level-ppo
    passive-walker gauntlet lqr --scene steep --walkers 256
    passive-walker gauntlet my-policy.onnx --scene level
    """
    found = tested(read_policy(controller, trust), scene, walkers=walkers)
    low, high = found.score_interval
    data = {"controller": found.controller_name, "score": found.score, "low": low, "high": high}
    return Report(str(found), {**data, "tests": table_rows(found.columns())})


def robustness(
    controller: Annotated[
        str,
        f"a passive walker: {A_WALKER}; or a controller: {CONTROLLERS}",
        {"metavar": "WALKER|CONTROLLER"},
    ],
    *,
    scene: Annotated[Any, f"scene (the policy's own): {A_SCENE}", OF_SCENE] = None,
    slope: Annotated[
        float | None, "slope in rad, positive downhill (the scene's)", {"metavar": "RAD"}
    ] = None,
    roughness: Annotated[
        float, "standard deviation of footholds' heights, in leg lengths", {"metavar": "L"}
    ] = 0.002,
    first_passage: Annotated[
        Literal["sampled", "mesh"], "how the mean strides to a fall are found"
    ] = "sampled",
    strides: Annotated[int, "strides on rough ground"] = 200,
    walkers: Annotated[int | None, "walkers on rough ground (4096 if passive, else 512)"] = None,
    seed: Annotated[int, "seed of terrain and initial states"] = 0,
    out: Annotated[Path | None, "picture file: .png, .pdf or .svg"] = None,
    trust: Trust = False,
) -> Report:
    """Measure robustness: rough ground, steps, pushes, initial states far from the gait.

    passive-walker robustness lab --slope 0.036
    passive-walker robustness level-ppo --roughness 0.004 --out level.png
    passive-walker robustness lab --slope 0.036 --roughness 0.001 --first-passage mesh
    """
    path = None if out is None else picture_path(out)
    name: Any = controller
    passive = has_address(name) or is_walker(name)
    if passive and scene is None and slope is None:
        raise ValueError("a passive walker needs --slope or --scene, as in --slope 0.036")
    if passive and trust:
        raise ValueError("--trust permits a controller, and this is a walker")
    found = tried(
        named_walker(name) if passive else read_policy(controller, trust),
        scene, slope=slope, roughness=roughness, first_passage=first_passage, walkers=walkers,
        strides=strides, seed=seed,
    )  # fmt: skip
    lasting = found.first_passage
    data = record(found, _MEASURES) | {
        "controller": found.controller_name, "slope": found.slope,
        "first_passage": lasting.mean, "first_passage_error": lasting.error,
        "first_passage_interval": lasting.interval,
        **{name: count for name, count in lasting._asdict().items() if name in _COUNTS},
        **found.columns(),
    }  # fmt: skip
    facts = found.facts()
    pushes = table(
        [
            {
                "push at (periods)": f"{row['push_phases']:.1f}",
                "forward (m √(g l))": row["push_forward"],
                "backward (m √(g l))": row["push_backward"],
            }
            for row in table_rows(found.columns())
        ]
    )
    said = [listing(facts.pop("controller"), facts), pushes]
    files = {} if path is None else {path: lambda path: save(figure_of(found.plot(OWN)), path)}
    return Report("\n\n".join(said), data, files)
