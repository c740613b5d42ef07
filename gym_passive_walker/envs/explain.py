"""Tables of the observation, action, reward and termination of a scene."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import gymnasium
import numpy as np

from gym_passive_walker._tools.arguments import shown
from gym_passive_walker._tools.console import cut, in_columns
from gym_passive_walker.envs import interface
from gym_passive_walker.envs.batch import Batch
from gym_passive_walker.envs.custom import Custom, is_custom
from gym_passive_walker.envs.registration import MAX_EPISODE_STEPS
from gym_passive_walker.gaits.scenes.rewards import ABOUT_TERMS, DRAWN, OWN
from gym_passive_walker.gaits.scenes.scene import Scene, make_scene
from gym_passive_walker.gaits.scenes.starts import Starts
from gym_passive_walker.gaits.terrain import Terrain
from gym_passive_walker.models.model import Model
from gym_passive_walker.models.walkers import describe

_CHECKS = {
    "contact": "the ground would have to pull at the foot",
    "friction": "the foot needs more friction than {friction:g}",
    "knee lock": "the stance knee flexes against more than {knee_latch:g} m g l",
    "scuffing": "the swing foot is more than {scuff_depth:g} l below the ground",
}

Rows = list[dict[str, Any]]


def explain(env: Any = "level") -> None:
    """Print observation, action, reward and termination of an environment.

    A table of the scene's arguments follows, with those that differ from the default scene's.

    Args:
        env: An environment, single, vector or stable-baselines3's; or a scene, by its name, as a
            mapping or as a `Scene`. Of an environment, the present observation and the terms of the
            last reward are printed as well. Of several walkers, the first is explained, with the
            walker and the slope that are given for it.

    Raises:
        SceneError: if there is no such scene.
        TypeError: if the environment is not of this package.

    Example:
        >>> import gym_passive_walker as gpw
        >>> gpw.explain("pushed")  # doctest: +ELLIPSIS
        walker 'C', slope ...
    """
    print(as_text(env))


def as_text(env: Any = "level") -> str:
    """Return the tables of `explain` as text."""
    scene, *_ = _parts(env)
    every = f"every {scene.tick:g} sqrt(l/g) and" if scene.control == "tick" else "only"
    subject = describe(scene.walker)
    slope = " to ".join(f"{bound:g}" for bound in np.atleast_1d(scene.slope))
    lines = [
        f"{subject}, slope {slope} rad; an action is chosen {every} after a heelstrike.",
        "Units: leg length l, mass m, time sqrt(l/g)."
        if "units" in scene.walker.supports
        else "Units: those of the system, in which gravity is 1; energies over its weight.",
    ]
    for title, rows in as_rows(env).items():
        heads = list(rows[0])
        cells = [heads, *([_written(row[head]) for head in heads] for row in rows)]
        table = in_columns(cells, left=range(len(heads)))
        lines += ["", title, *(f"  {line}".rstrip() for line in table)]
    return "\n".join(lines)


def as_rows(env: Any = "level") -> dict[str, Rows]:
    """Return the rows of the tables of a scene or an environment, by title.

    The titles are "observation", "action", "reward", "episode end", "domain randomization", and
    "scene" for the arguments in which the scene differs from the default one. Tables without rows
    are left out.
    """
    scene, batch, limit = _parts(env)
    seen: Rows = [{"number": i, **row} for i, row in enumerate(_observed(scene))]
    paid = _rewarded(scene)
    if batch is not None:
        for row, value in zip(seen, batch.observe()[0].tolist(), strict=True):
            row["now"] = value
        last = {name: float(term[0]) for name, term in batch.reward_terms().items()}
        for row in paid:
            row["last"] = last[row["term"]]
    acts: Rows = [
        {
            "number": i,
            "action": scene.actuator(name).about,
            "min": scene.least(name),
            "max": 1.0,
            "action 1 is": f"{_largest(scene, name)} {scene.actuator(name).unit}".rstrip(),
        }
        for i, name in enumerate(scene.actions)
    ]
    ends = _ends(scene, limit)
    tables = {"observation": seen, "action": acts, "reward": paid, "episode end": ends}
    tables["domain randomization"] = _drawn(scene, batch)
    tables["scene"] = _differences(scene)
    return {title: rows for title, rows in tables.items() if rows}


def _largest(scene: Scene, channel: str) -> str:
    """Return what the action 1 is in a channel: a number, or its range if it is drawn."""
    limit, most = scene.actuator(channel).limit, scene.largest(channel)
    if limit not in scene.randomized:
        return f"{most:g}"
    low, high = scene.ends(str(limit))
    return f"{most * low / high:g} to {most:g}"


def _parts(env: Any) -> tuple[Scene, Batch | None, float | None]:
    """Return a scene as it is for the first walker, its batch in an episode, and its limit."""
    if isinstance(env, Scene | str | os.PathLike | Mapping):
        return make_scene(env), None, MAX_EPISODE_STEPS
    inner: Any = getattr(env, "envs", getattr(env, "unwrapped", env))
    if not hasattr(inner, "batch") and np.iterable(inner):  # single environments in a row
        env = next(iter(inner), env)
        inner = getattr(env, "unwrapped", env)
    batch: Any = getattr(inner, "batch", None)
    if not isinstance(scene := getattr(batch, "scene", None), Scene):
        raise TypeError(
            f"explain takes an environment of this package or a scene, not {shown(env)}"
        )
    limit = batch.step_limit
    if limit == np.inf and isinstance(env, gymnasium.Env):  # a batch counts its own steps
        limit = getattr(env.spec, "max_episode_steps", None) or np.inf
    if isinstance(batch, Batch):
        scene = make_scene(scene, energy=inner.energy_cost, **batch.of_first)
    if not isinstance(batch, Batch) or not batch.randoms or not np.any(batch.records["state"]):
        batch = None  # on a GPU, or before the first episode
    return scene, batch, None if limit == np.inf else limit


def _observed(scene: Scene) -> Rows:
    """Return name, unit and bounds of each number in the observation."""
    own = Custom(scene, 0) if is_custom(scene) else None
    space = interface.observation_space(scene, own)
    names = list(scene.walker.observed)
    if scene.command is not None:
        names.append(("commanded speed", "sqrt(g l)"))
    for k in range(1, scene.terrain_lookahead + 1):
        names += [(f"height of foothold {k} ahead over the one before", "l")]
        names += [("its slope less that of the one before", "rad")]
    names += [(f"the walker's {name}", "dimensionless") for name in scene.observe_body]
    if own is not None and own.groups is not None:
        return _of_groups(own, names, space, scene)
    if scene.observation is not None:
        names = [(f"{_name(scene.observation)}[{i}]", "") for i in range(len(space.low))]
    return [
        {"observation": name, "unit": unit, "min": float(low), "max": float(high)}
        for (name, unit), low, high in zip(names, space.low, space.high, strict=True)
    ]


def _of_groups(own: Custom, names: list[tuple[str, str]], space: Any, scene: Scene) -> Rows:
    """Return the numbers of an observation with groups, one group after another."""
    rows: Rows = []
    drawn = [(f"the draw of {name}", "-1 to 1 in its range") for name in scene.randomized]
    for group, part, place in own.parts:
        known = {OWN: names, DRAWN: drawn}.get(part) if isinstance(part, str) else None
        if known is None:
            known = [(f"{_name(part)}[{i}]", "") for i in range(place.stop - place.start)]
        first = place.start - own.groups[group].start  # type: ignore[index]
        for i, (name, unit) in enumerate(known, first):
            low, high = (float(end[i]) for end in (space[group].low, space[group].high))
            rows.append(
                {"group": group, "observation": name, "unit": unit, "min": low, "max": high}
            )
    return rows


def _rewarded(scene: Scene) -> Rows:
    """Return the terms of the reward, which is their sum."""
    if isinstance(scene.reward, Mapping):
        about = {name: f"{w:g} times {ABOUT_TERMS[name]}" for name, w in scene.reward.items()}
    elif scene.reward is not None:
        about = {"function": f"result of {_name(scene.reward)}"}
    else:
        weight, kind = scene.energy_weight, scene.energy
        about = {
            "distance": f"{ABOUT_TERMS['distance']}; a stride that falls loses its own",
            "energy": f"{-weight:g} times the {kind} work of the actuators / (m g l)",
        }
        if scene.command is not None:
            about["command"] = (
                f"{-scene.command_weight:g} times {ABOUT_TERMS['command']}, at most its length"
            )
    return [{"term": name, "what": text} for name, text in about.items()]


def _ends(scene: Scene, limit: float | None) -> Rows:
    """Return the outcomes that end an episode, and their conditions."""
    found = scene.walker.endings | {
        "stalled": f"no heelstrike within {scene.max_stride_time:g} sqrt(l/g)",
        "diverged": "the motion is no longer finite",
    }
    if scene.walker.kind in ("kneed", "held"):
        found["knee_not_locked"] = "the foot lands before the knee has locked"
    if scene.end_on_toe_stub:
        found["stubbed_toe"] = "the locked swing leg is below the ground"
    for check, answer in scene.constraints.items():
        if answer == "end":
            found[interface.REASONS[check]] = _CHECKS[check].format(**vars(scene))
    if scene.terminated is not None:
        found["stopped"] = f"{_name(scene.terminated)} holds"
    rows = [{"outcome": name, "when": when, "kind": "terminated"} for name, when in found.items()]
    if limit is not None:
        rows.append({"outcome": "", "when": f"{limit:g} steps", "kind": "truncated"})
    return rows


def _drawn(scene: Scene, batch: Batch | None) -> Rows:
    """Return the parameters that each reset draws, with their values in the walker's own units."""
    drawing, rows = Starts(scene).randomization, []
    if drawing is None:
        return []
    now = batch.randomized.info_values() if batch is not None and batch.randomized else {}
    for entry in drawing.entries:
        for name in entry.names:
            low, high = entry.ends(drawing.nominal[name])
            row: dict[str, Any] = {"parameter": name, "scene": drawing.nominal[name]}
            row |= {"drawn": entry.about(), "min": low, "max": high}
            if len(entry.names) > 1:
                others = [other for other in entry.names if other != name]
                row["drawn"] += f", with {' and '.join(others)}"
            rows.append(row | ({"now": float(now[name][0])} if now else {}))
    if drawing.curriculum:
        rows[0]["drawn"] += f"; all grow over {drawing.curriculum:,} episodes"
    return rows


def _differences(scene: Scene) -> Rows:
    """Return the arguments of a scene that differ from those of the default scene."""
    default = Scene()
    return [
        {"argument": each.name, "default": _stated(usual), "value": _stated(value)}
        for each in fields(Scene)
        if (value := getattr(scene, each.name)) != (usual := getattr(default, each.name))
    ]


def _stated(value: Any) -> str:
    """Return the text of a scene's argument."""
    if isinstance(value, Model):
        return describe(value)
    if isinstance(value, Terrain):
        own = {each.name: getattr(value, each.name) for each in fields(value)}
        parts = [f"{name}={x!r}" for name, x in own.items() if x != getattr(Terrain(), name)]
        return cut(f"Terrain({', '.join(parts)})")
    if isinstance(value, Mapping) and "policy" in value:  # an observation
        parts = {name: row if isinstance(row, tuple) else (row,) for name, row in value.items()}
        texts = (f"{name}: {' and '.join(map(_part, row))}" for name, row in parts.items())
        return cut(", ".join(texts))
    return _name(value) if callable(value) else shown(value)


def _part(part: Any) -> str:
    """Return the name of a part of an observation."""
    return part if isinstance(part, str) else _name(part)


def _name(function: Any) -> str:
    """Return the name of a function."""
    return getattr(function, "__qualname__", type(function).__name__)


def _written(value: Any) -> str:
    """Return the text of a cell."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
