"""Commands about walks: their strides, scenes, and walks under a policy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from gym_passive_walker._tools.files import prepare, replacing
from gym_passive_walker._tools.shown import WRITERS, table_ending
from gym_passive_walker.apps.cli.arguments import (
    A_SCENE,
    A_WALKER,
    CONTROLLERS,
    OF_SCENE,
    AScene,
    ATerrain,
    AWalker,
    Strides,
    Trust,
    Walk,
    read_policy,
)
from gym_passive_walker.apps.cli.report import Report, listing, record, table, table_rows
from gym_passive_walker.bridge.comparison import TIMESTEPS
from gym_passive_walker.bridge.comparison import compare as compared
from gym_passive_walker.bridge.export import FORMATS, checked_format, text_for
from gym_passive_walker.bridge.mjcf import SOFTNESS, TIMESTEP
from gym_passive_walker.envs import explain
from gym_passive_walker.envs.evaluation.comparison import evaluate as evaluated
from gym_passive_walker.envs.policies import TrainedPolicy, load_policy, shipped_policies
from gym_passive_walker.gaits.control.controllers import acting
from gym_passive_walker.gaits.find.fixed_point import find_gait
from gym_passive_walker.gaits.look.trajectory import simulate as simulated
from gym_passive_walker.gaits.scenes.named import named_walker
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.walkers import describe

_STRIDE = ("duration", "step_length", "kneestrike_time", "kneestrike_loss", "heelstrike_loss")
_STRIDE += ("hip_work",)
_OF_GAIT = "slope", "stance_angle", "step_period", "step_length", "speed"


def simulate(
    walk: Walk,
    *,
    samples: Annotated[int, "samples of each stride"] = 100,
    out: Annotated[Path | None, f"{', '.join(WRITERS)} file for the samples"] = None,
) -> Report:
    """Simulate a walk stride by stride; write its trajectory to a file.

    passive-walker simulate lab 0.036 --strides 20
    passive-walker simulate lab 0.036 --terrain rough:height_std=0.002 --terrain-seed 3
    passive-walker simulate lab 0.036 --state 0.3 -0.3 -0.3 -1.5 -0.8 -2 --out walk.csv
    """
    if out is not None:
        table_ending(out)
        prepare(out)
    walked = simulated(
        walk.map, walk.slope, walk.start, walk.strides, samples=samples,
        terrain=walk.terrain, terrain_seed=walk.terrain_seed,
    )  # fmt: skip
    view, units = walk.machine.shown(walked.taken)
    rows = table_rows({
        "stride": range(1, len(walked.outcomes) + 1), "stance_angle": walked.states[::samples, 0],
        **record(view, _STRIDE), "outcome": map(Outcome, walked.outcomes),
    })  # fmt: skip
    return Report(table(rows, units), rows, {} if out is None else {out: walked.save})


def export(
    name: Annotated[
        str,
        f"for .onnx: {', '.join(shipped_policies())}, or the folder of an exported policy; else a "
        f"walker: {A_WALKER}",
    ],
    out: Annotated[
        Path, "the file; its name ends in .onnx, .xml (MJCF), .urdf or .sdf", {"metavar": "FILE"}
    ],
    *,
    slope: Annotated[
        float | None, "slope in rad of the walker's gait, which is written too", {"metavar": "RAD"}
    ] = None,
    timestep: Annotated[
        float | None, f"timestep of MJCF in s ({TIMESTEP:g})", {"metavar": "S"}
    ] = None,
    unit_length: Annotated[
        float | None, "unit of length of a System in m", {"metavar": "M"}
    ] = None,
    unit_mass: Annotated[float | None, "unit of mass of a System in kg", {"metavar": "KG"}] = None,
    trust: Trust = False,
) -> Report:
    """Write a trained policy as an ONNX file, or a walker as a file for other simulators.

    passive-walker export level-ppo level-ppo.onnx
    passive-walker export my-policy my-policy.onnx
    passive-walker export lab lab.xml --slope 0.036
    passive-walker export C C.urdf
    """
    ending = out.suffix.lower()
    sizes = {"timestep": timestep, "unit_length": unit_length, "unit_mass": unit_mass}
    asked = {each: size for each, size in sizes.items() if size is not None}
    if ending in FORMATS.values():
        if trust:
            raise ValueError("--trust permits a policy, and this is a walker")
        kind = checked_format(out, None)
        walker = named_walker(name)
        gait = None if slope is None else find_gait(walker, slope)
        content = text_for(walker if gait is None else gait, kind, **asked)
        facts = {"format": kind, **({"timestep": TIMESTEP} if kind == "mjcf" else {}), **asked}
        facts |= record(gait, _OF_GAIT) if gait is not None else {}

        def write(path: Path) -> None:
            with replacing(path) as aside:
                aside.write_text(content, encoding="utf-8")

        return Report(listing(describe(walker), facts), {"walker": name, **facts}, {out: write})
    if ending != ".onnx":
        raise ValueError(
            f"export takes a name that ends in .onnx, {', '.join(FORMATS.values())}, not {out}"
        )
    for each in asked if slope is None else ("slope", *asked):
        raise ValueError(f"--{each.replace('_', '-')} is that of a walker: an ONNX file has none")
    read = load_policy(name, trust=trust)
    if not isinstance(read, TrainedPolicy):
        raise ValueError(f"export takes a policy of the package or an exported folder, not {name}")
    shapes = {"observation": read.layers[0][0].shape[1], "action": len(read.layers[-1][1])}
    text = listing(
        f"{name}, {read.algorithm}",
        {each: f"float32 (n, {size})" for each, size in shapes.items()},
    )
    data = {"policy": name, "algorithm": read.algorithm, **shapes}
    return Report(text, data, {out: read.to_onnx})


def compare(
    controller: Annotated[str, CONTROLLERS],
    *,
    scene: Annotated[Any, f"scene (the controller's own; level): {A_SCENE}", OF_SCENE] = None,
    walker: AWalker = None,
    slope: Annotated[float | None, "slope in rad (the scene's)", {"metavar": "RAD"}] = None,
    timesteps: Annotated[
        list[float], "timesteps in s", {"nargs": "+", "type": float, "metavar": "S"}
    ] = list(TIMESTEPS),  # noqa: B006
    softness: Annotated[
        list[float],
        "time constants of contacts in timesteps; 0 for the simulator's own contacts",
        {"nargs": "+", "type": float, "metavar": "N"},
    ] = [SOFTNESS],  # noqa: B006
    strides: Strides = 40,
    trust: Trust = False,
) -> Report:
    """Walk in MuJoCo, and compare the gait with the exact one.

    passive-walker compare passive --walker lab --slope 0.036
    passive-walker compare level-ppo --timesteps 0.002 0.001 --softness 2 0
    """
    given = read_policy(controller, trust)
    found = compared(
        given, _scene_of(given, scene, slope=slope, walker=walker), timesteps=timesteps,
        strides=strides, softness=[soft or None for soft in softness],
    )  # fmt: skip
    return Report(str(found), {"exact": found.exact, "walks": table_rows(found.columns())})


def _scene_of(controller: Any, scene: Any, **asked: Any) -> Any:
    """Return the scene in which a controller acts, with the arguments that are not None."""
    changes = {name: value for name, value in asked.items() if value is not None}
    return acting(controller, scene, **changes)[1]


def scene(scene: AScene, *, trust: Trust = False) -> Report:
    """Explain a scene: observations, actions, reward and termination reasons.

    passive-walker scene level
    passive-walker scene rough --json
    """
    return Report(explain.as_text(scene), explain.as_rows(scene))


def evaluate(
    policy: Annotated[str, CONTROLLERS],
    *,
    scene: Annotated[Any, f"scene (the policy's own; level): {A_SCENE}", OF_SCENE] = None,
    walker: AWalker = None,
    slope: Annotated[float | None, "slope in rad (the scene's)", {"metavar": "RAD"}] = None,
    trust: Trust = False,
    terrain: ATerrain = None,
    episodes: Annotated[int, "number of episodes"] = 20,
    seed: Annotated[int, "seed of the first episode"] = 1000,
    time_limit: Annotated[
        float, "largest time of each search for an optimal gait, in s; 0 for none"
    ] = 60.0,
) -> Report:
    """Evaluate a policy beside the passive walker, feedback and the optimum at its speed.

    passive-walker evaluate level-ppo
    passive-walker evaluate lab-ppo --scene level --walker lab --slope 0.01
    passive-walker evaluate level-ppo --terrain waves:height=0.002,strides=6
    """
    controller = read_policy(policy, trust)
    where = _scene_of(controller, scene, slope=slope, walker=walker, terrain=terrain)
    found = evaluated(controller, where, episodes=episodes, seed=seed, time_limit=time_limit)
    rows = [
        row | {"least_cost": found.least_cost[name]}
        for name, made in found.walks.items()
        for row in made.rows(name, digits=None)
    ]
    return Report(str(found), rows)
