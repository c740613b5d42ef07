"""Analyses of the package as tasks of a sweep; each returns a row of numbers and text."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from functools import partial
from inspect import Parameter, signature
from typing import Any

import gymnasium as gym
import numpy as np

from gym_passive_walker._tools.arguments import unknown
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
from gym_passive_walker.gaits.gait import GaitNotFound
from gym_passive_walker.gaits.look.reality import reality_check
from gym_passive_walker.gaits.robust.basin import basin_of_attraction
from gym_passive_walker.gaits.scenes.named import named_walker
from gym_passive_walker.gaits.scenes.scene import Scene, make_scene
from gym_passive_walker.models.walkers import Walker

Row = dict[str, Any]
Analysis = Callable[..., Row]

_WALKER = tuple(f.name for f in fields(Walker))
_SCENE = tuple(f.name for f in fields(Scene))


def takes(function: Callable[..., Any], *names: str) -> Callable[[Analysis], Analysis]:
    """Declare that an analysis passes these arguments to a function, which has their defaults."""

    def declared(analysis: Analysis) -> Analysis:
        there, own = signature(function).parameters, signature(analysis)
        added = [there[name].replace(kind=Parameter.KEYWORD_ONLY) for name in names]
        plain = [each for each in own.parameters.values() if each.kind is not each.VAR_KEYWORD]
        analysis.__signature__ = own.replace(parameters=plain + added)  # type: ignore[attr-defined]
        return analysis

    return declared


def _taken(options: Row, names: Iterable[str]) -> Row:
    """Remove arguments from the options, and return them."""
    return {name: options.pop(name) for name in names if name in options}


_MAP = ("walker", "controller", "scene", "terrain")


@takes(find_gait, "kind", "period")
@takes(Actuation, *Actuation._fields)
@takes(stride_map, *_MAP)
def gait(slope: float | None = None, **options: Any) -> Row:
    """Search for a gait of a kind at a slope; return its stability and its measures."""
    held, on = Actuation(**_taken(options, Actuation._fields)), _taken(options, _MAP)
    if on.get("controller") is not None and any(held):
        raise ValueError(f"{on['controller']} determines the actuation: omit torques and push-off")
    on["controller"] = on.get("controller") or held
    strides = stride_map(slope=slope, **on)
    try:
        found = find_gait(strides, slope, **options)
    except GaitNotFound:
        found = None
    names = ("stance_angle", "step_period", "step_length", "froude_speed", "cost_of_transport")
    return {
        "found": found is not None,
        "stable": found is not None and bool(found.stable),
        "multiplier": np.nan if found is None else abs(found.multipliers[0]),
        **{name: np.nan if found is None else getattr(found, name) for name in names},
    }


@takes(gait_family, "kind")
@takes(stride_map, *_MAP)
def family(slope_min: float, slope_max: float, **options: Any) -> Row:
    """Continue a branch of gaits; return its ends, their reasons, its stable range and speed."""
    strides = stride_map(**_taken(options, _MAP))
    found = gait_family(strides, slope_min, slope_max, **options)
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


@takes(bifurcation_diagram, "n_transient", "n_recorded", "kind")
@takes(stride_map, *_MAP)
def bifurcation(slope: float, **options: Any) -> Row:
    """Return the attractor at a slope: its period and the range of stance angles."""
    found = bifurcation_diagram(
        stride_map(slope=slope, **_taken(options, _MAP)), [slope], **options
    )
    angles = found.stance_angle[0]
    return {
        "walks": bool(found.walks[0]),
        "period": int(found.period[0]),
        "least_angle": angles.min(),
        "greatest_angle": angles.max(),
    }


@takes(basin_of_attraction, "resolution", "strides")
@takes(stride_map, *_MAP)
def basin(slope: float | None = None, **options: Any) -> Row:
    """Return the shares of a slice of initial states that keep walking and that reach gaits."""
    found = basin_of_attraction(stride_map(slope=slope, **_taken(options, _MAP)), slope, **options)
    return {
        "gaits": len(found.gaits),
        "walks": float(found.walks.mean()),
        "settles": float((found.settled >= 0).mean()),
    }


@takes(find_gait, "kind")
@takes(reality_check, "friction")
@takes(stride_map, *_MAP[:-1])
def check(slope: float | None = None, **options: Any) -> Row:
    """Check the feasibility constraints of a gait, item by item."""
    strides = stride_map(slope=slope, **_taken(options, _MAP))
    found = reality_check(find_gait(strides, slope, **_taken(options, ["kind"])), **options)
    items = {name.replace(" ", "_"): passed for name, passed in found.passed.items()}
    return {"holds": found.holds, **items}


@takes(robust.robustness, "roughness", "first_passage", "walkers", "strides", "initial_error",
       "starts", "seed")  # fmt: skip
def robustness(
    changes: Mapping[str, Any],
    controller: str | None = None,
    scene: str | None = None,
    **options: Any,
) -> Row:
    """Measure the robustness of a passive walker or of a controller."""
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
    return walks.simulate_episodes(agent, arena, seed=seed).summary()


ANALYSES: dict[str, Analysis] = {
    each.__name__: each
    for each in (gait, family, bifurcation, basin, robustness, check, optimal, evaluation)
}
"""Analyses that a sweep can name."""


def check_trust(outside: Mapping[str, str], trust: bool) -> bool:
    """Return `trust`, if it is True or there is no code in `outside`, see `Description.outside`.

    A description may be another person's file, and importing a module runs its code.

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
    own = has_address(rest.get("scene")) or isinstance(rest.get("scene"), Mapping)
    if own and "scene" in takes:
        rest["scene"] = make_scene(rest["scene"], trust=True)
    numbers = _WALKER
    if "walker" in takes or "changes" in takes:
        if "walker" in rest:
            rest["walker"] = named_walker(rest["walker"])
            if not isinstance(rest["walker"], Walker):
                numbers = tuple(rest["walker"].parameters)
        parts = _taken(rest, [name for name in numbers if name not in takes])
        if parts and "walker" not in rest:
            raise ValueError(f"{', '.join(parts)} needs a walker, as in walker: lab")
        if parts:
            rest["walker"] = rest["walker"].with_parameters(**parts)
    if "changes" in takes:
        rest["changes"] = _taken(rest, [name for name in _SCENE if name not in takes])
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
