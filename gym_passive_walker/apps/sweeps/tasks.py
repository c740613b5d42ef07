"""Analyses of the package as tasks of a sweep; each returns a row of numbers and text."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import partial
from inspect import Parameter, signature
from typing import Any, Literal

import gymnasium as gym
import numpy as np

from gym_passive_walker._tools.arguments import gait_kind, unknown, whole
from gym_passive_walker._tools.loading import function_at, has_address, untrusted
from gym_passive_walker.envs.evaluation import robustness as robust
from gym_passive_walker.envs.evaluation import walks
from gym_passive_walker.envs.registration import ID
from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.gaits.branches.bifurcation import bifurcation_diagram
from gym_passive_walker.gaits.branches.family import gait_family
from gym_passive_walker.gaits.control.controllers import acting, with_changes
from gym_passive_walker.gaits.control.maps import stride_map
from gym_passive_walker.gaits.control.optimal import optimal_gait
from gym_passive_walker.gaits.find.fixed_point import find_gait
from gym_passive_walker.gaits.find.search import seek
from gym_passive_walker.gaits.look.reality import reality_check
from gym_passive_walker.gaits.robust.basin import basin_of_attraction
from gym_passive_walker.gaits.scenes.named import named_scene, named_walker
from gym_passive_walker.gaits.scenes.scene import Scene
from gym_passive_walker.models.walkers import Walker

Row = dict[str, Any]

_WALKER = tuple(f.name for f in fields(Walker))
_SCENE = tuple(f.name for f in fields(Scene))


def gait(
    walker: Walker | None = None,
    slope: float | None = None,
    kind: str = "long",
    period: int = 1,
    hip_torque: float = 0.0,
    ankle_torque: float = 0.0,
    push_off: float = 0.0,
    controller: str | None = None,
    scene: Any = None,
    terrain: Any = None,
) -> Row:
    """Search for a gait of a kind at a slope; return its stability and its measures."""
    held = Actuation(hip_torque, ankle_torque, push_off)
    if controller is not None and any(held):
        raise ValueError(f"{controller} determines the actuation: omit torques and push-off")
    strides = stride_map(walker, slope, controller=controller or held, scene=scene, terrain=terrain)
    sought = strides.chosen(slope), gait_kind(kind)
    found = seek(strides, *sought, period=whole(period, "period")).gait
    names = ("stance_angle", "step_period", "step_length", "froude_speed", "cost_of_transport")
    return {
        "found": found is not None,
        "stable": found is not None and bool(found.stable),
        "multiplier": np.nan if found is None else abs(found.multipliers[0]),
        **{name: np.nan if found is None else getattr(found, name) for name in names},
    }


def family(
    slope_min: float,
    slope_max: float,
    walker: Walker | None = None,
    kind: str = "long",
    controller: str | None = None,
    scene: Any = None,
    terrain: Any = None,
) -> Row:
    """Continue a branch of gaits; return its ends, their reasons, its stable range and speed."""
    strides = stride_map(walker, controller=controller, scene=scene, terrain=terrain)
    found = gait_family(strides, slope_min, slope_max, kind)  # type: ignore[arg-type]
    steady = found.slope[found.stable]
    ends = {
        f"{side}_{name}": value
        for side, end in zip(("first", "last"), found.ends, strict=True)
        for name, value in (("end", float(end.value)), ("reason", end.reason))
    }
    return {
        "gaits": len(found),
        **ends,
        "folds": len(found.folds),
        "period_doubling": min(found.period_doublings, default=np.nan),
        "stable_from": steady.min(initial=np.inf) if len(steady) else np.nan,
        "stable_to": steady.max(initial=-np.inf) if len(steady) else np.nan,
        "fastest": float(np.max(found.froude_speed)),
    }


def bifurcation(
    slope: float,
    walker: Walker | None = None,
    n_transient: int = 500,
    n_recorded: int = 64,
    kind: str = "long",
    controller: str | None = None,
    scene: Any = None,
    terrain: Any = None,
) -> Row:
    """Return the attractor at a slope: its period and the range of stance angles."""
    strides = stride_map(walker, slope, controller=controller, scene=scene, terrain=terrain)
    found = bifurcation_diagram(
        strides, [slope], n_transient=n_transient, n_recorded=n_recorded, kind=kind  # type: ignore[arg-type]
    )  # fmt: skip
    angles = found.stance_angle[0]
    return {
        "walks": bool(found.walks[0]),
        "period": int(found.period[0]),
        "least_angle": angles.min(),
        "greatest_angle": angles.max(),
    }


def basin(
    walker: Walker | None = None,
    slope: float | None = None,
    resolution: int = 100,
    strides: int = 300,
    controller: str | None = None,
    scene: Any = None,
    terrain: Any = None,
) -> Row:
    """Return the shares of a slice of initial states that keep walking and that reach gaits."""
    where = stride_map(walker, slope, controller=controller, scene=scene, terrain=terrain)
    found = basin_of_attraction(where, slope, resolution=resolution, strides=strides)
    return {
        "gaits": len(found.gaits),
        "walks": float(found.walks.mean()),
        "settles": float((found.settled >= 0).mean()),
    }


def check(
    walker: Walker | None = None,
    slope: float | None = None,
    kind: str = "long",
    friction: float = 0.8,
    controller: str | None = None,
    scene: Any = None,
) -> Row:
    """Check the feasibility constraints of a gait, item by item."""
    strides = stride_map(walker, slope, controller=controller, scene=scene)
    gait = find_gait(strides, slope, kind)  # type: ignore[arg-type]
    found = reality_check(gait, friction=friction)
    items = {name.replace(" ", "_"): passed for name, passed in found.passed.items()}
    return {"holds": found.holds, **items}


def robustness(
    changes: Mapping[str, Any],
    controller: str | None = None,
    scene: str | None = None,
    roughness: float = 0.002,
    first_passage: Literal["sampled", "mesh"] = "sampled",
    walkers: int | None = None,
    strides: int = 200,
    initial_error: float = 0.5,
    starts: int = 512,
    seed: int = 0,
) -> Row:
    """Measure the robustness of a passive walker or of a controller."""
    options: Row = {"roughness": roughness, "walkers": walkers, "strides": strides}
    options["first_passage"] = first_passage
    options |= {"initial_error": initial_error, "starts": starts, "seed": seed}
    if controller is None and scene is None and changes.keys() == {"walker", "slope"}:
        found = robust.robustness(changes["walker"], slope=changes["slope"], **options)
    else:
        agent, where = acting(controller or "passive", scene, **changes)
        found = robust.robustness(agent, where, **options)
    lasting = found.first_passage
    names = ("sensitivity", "step_up", "step_down", "recovered", "recovered_error", "recovery")
    return {
        "first_passage": lasting.mean,
        "first_passage_error": lasting.error,
        **{name: float(getattr(found, name)) for name in names},
        "push_forward": float(np.min(found.push_forward)),
        "push_backward": float(np.min(found.push_backward)),
    }


def optimal(changes: Mapping[str, Any], speed: float, scene: str = "level") -> Row:
    """Compute the gait of least cost of transport at a speed; its quantities are dimensionless."""
    found = optimal_gait(with_changes(scene, changes), speed).dimensionless
    names = ("cost_of_transport", "hip_cost", "ankle_cost", "push_off_cost")
    names += ("step_period", "step_length", "froude_speed", "stable", "stubs")
    row = {name: getattr(found, name) for name in names}
    return row | {"push_off": float(found.held.get("push_off", [np.nan])[0])}


def evaluation(
    changes: Mapping[str, Any],
    controller: str,
    scene: str | None = None,
    episodes: int = 20,
    seed: int = 0,
) -> Row:
    """Evaluate a controller over some episodes; the first one has the seed."""
    agent, where = acting(controller, scene, **changes)
    arena = gym.make_vec(ID, num_envs=episodes, scene=where)
    return walks.evaluate(agent, arena, seed=seed).summary()


ANALYSES: dict[str, Callable[..., Row]] = {
    each.__name__: each
    for each in (gait, family, bifurcation, basin, robustness, check, optimal, evaluation)
}
"""Analyses that a sweep can name."""


def check_trust(outside: Mapping[str, str], trust: bool) -> bool:
    """Check that the user trusts the code from outside the package.

    A description may be another person's file, and importing a module runs its code.

    Args:
        outside: What that is, by its "module:name", as in `Description.outside`.
        trust: Whether it is trusted.

    Returns:
        The argument `trust`.

    Raises:
        ValueError: if trust is required and `trust` is False.
    """
    if not isinstance(trust, bool):
        raise ValueError(f"trust must be True or False, not {trust!r}")
    if not trust and outside:
        address, what = next(iter(outside.items()))
        known = f"; the package has {', '.join(ANALYSES)}" * (what == "analysis")
        raise ValueError(untrusted(f"the {what} {address!r}") + known)
    return trust


def function(analysis: str) -> Callable[..., Any]:
    """Return the function of an analysis, by its name or as "module:function".

    The module is imported without a check of trust.

    Raises:
        ValueError: if there is no such analysis.
    """
    if analysis in ANALYSES:
        return ANALYSES[analysis]
    if not has_address(analysis):
        raise ValueError(
            f"no analysis {analysis!r}: choose from {', '.join(ANALYSES)}, or give a function of "
            'your own as "module:function"'
        )
    return function_at(analysis, "the analysis")


def task(analysis: str, given: Mapping[str, Any]) -> Callable[[], Any]:
    """Return an analysis with its arguments, as a function without arguments.

    Walker parameters change the given walker. Scene arguments are passed as a mapping to functions
    with an argument `changes`. The seed is passed to functions that accept it.

    Raises:
        ValueError: if an argument is unknown or missing, or the walker is invalid.
    """
    called, rest = function(analysis), dict(given)
    takes = signature(called).parameters
    anything = any(each.kind is Parameter.VAR_KEYWORD for each in takes.values())
    if has_address(rest.get("scene")) and "scene" in takes:
        rest["scene"] = named_scene(rest["scene"], trust=True)
    numbers = _WALKER
    if "walker" in takes or "changes" in takes:
        if "walker" in rest:
            rest["walker"] = named_walker(rest["walker"])
            numbers = tuple(rest["walker"].parameters)
        parts = {name: rest.pop(name) for name in numbers if name in rest and name not in takes}
        if parts and "walker" not in rest:
            raise ValueError(f"{', '.join(parts)} needs a walker, as in walker: lab")
        if parts:
            rest["walker"] = rest["walker"].with_parameters(**parts)
    if "changes" in takes:
        rest["changes"] = {
            name: rest.pop(name) for name in _SCENE if name in rest and name not in takes
        }
    if "seed" not in takes and not anything:
        rest.pop("seed", None)
    known = [name for name in takes if name != "changes"]
    known += _SCENE if "changes" in takes else []
    known += [name for name in numbers if "walker" in known]
    if not anything and (said := unknown([n for n in rest if n != "changes"], known, analysis)):
        raise ValueError(said)
    lacking = [
        name
        for name, each in takes.items()
        if each.default is Parameter.empty and name not in rest and "VAR" not in each.kind.name
    ]
    if "walker" in takes and "controller" in takes and not {"controller", "scene"} & rest.keys():
        for name in [n for n in ("walker", "slope") if n in takes and n not in rest]:
            raise ValueError(f"{analysis} needs a {name}, or a controller that has one")
    if lacking:
        raise ValueError(f"{analysis} needs {', '.join(lacking)} besides")
    return partial(called, **rest)


def flat(found: Any) -> Row:
    """Return results as a row of numbers, text and booleans by name; a single one is "value".

    Raises:
        TypeError: if a result has another type, or an integer needs more than 64 bits.
    """
    row: Row = {}
    for name, value in (found if isinstance(found, Mapping) else {"value": found}).items():
        value = value.item() if isinstance(value, np.generic | np.ndarray) else value
        if not isinstance(value, bool | int | float | str):
            raise TypeError(f"{name} must be a number, a string or a boolean, not {value!r}")
        if isinstance(value, int) and not -(2**63) <= value < 2**63:
            raise TypeError(f"{name} must fit into 64 bits, and {value} does not")
        row[str(name)] = value
    return row
