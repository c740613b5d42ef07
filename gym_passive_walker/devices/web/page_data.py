"""Data of a page besides compiled code: layouts, walkers, gaits to start from, policies."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gym_passive_walker._tools.arguments import shown
from gym_passive_walker._version import __version__
from gym_passive_walker.devices.web import kernels, system_kernels
from gym_passive_walker.engine.layout import layout_of
from gym_passive_walker.engine.own import system as own
from gym_passive_walker.engine.run import options
from gym_passive_walker.envs import disturbance_kernels, task
from gym_passive_walker.envs.batch import rules_of
from gym_passive_walker.envs.constraints import ROOM
from gym_passive_walker.envs.policies import (
    DESCRIPTION,
    PolicyError,
    policy_folder,
    shipped_policies,
)
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.gaits.scenes import rules
from gym_passive_walker.gaits.scenes.checks import CHECKS
from gym_passive_walker.gaits.scenes.scene import SCENES, Scene, make_scene
from gym_passive_walker.gaits.scenes.starts import REFERENCE_SLOPES, searched_gait
from gym_passive_walker.models.equations.hybrid import Outcome, System
from gym_passive_walker.models.walkers import WALKERS, Walker, as_walker
from gym_passive_walker.models.walkers.presets import ABOUT
from gym_passive_walker.models.walkers.walker import PARAMETERS

TOLERANCES = (1e-6, 1e-8, 1e-10, 1e-12)
"""Tolerances of the integration that a page may choose from."""

SECTION = "gym_passive_walker"
"""Name of the custom section of a module with its notes."""

IN_PYTHON = (
    "domain_randomization", "randomization_pool", "observe_body", "constraints", "friction",
    "knee_latch", "scuff_depth", "reward", "observation", "terminated", "reward_terms",
)  # fmt: skip
"""Arguments of a scene that a page lacks."""

_KINDS = {"f8": "f8", "f4": "f4", "i8": "i8", "u8": "u8"}


def _places(layout: np.dtype, origin: int = 0, prefix: str = "") -> dict[str, list]:
    """Return the offset, the kind and the number of entries of each field, also of nested ones."""
    found: dict[str, list] = {}
    for name, (field, offset, *_) in (layout.fields or {}).items():
        place = origin + offset
        if field.base.names:
            found[prefix + name] = [place, "record", field.itemsize]
            found |= _places(field.base, place, f"{prefix}{name}.")
        else:
            count = int(np.prod(field.shape, dtype=int))
            found[prefix + name] = [place, _KINDS[field.base.str[1:]], count]
    return found


def of_module(kind: System, variants: tuple[str, ...], end: int) -> bytes:
    """Return the notes of a module, as JSON.

    Args:
        kind: The kind of walker.
        variants: Endings of the names of its systems.
        end: First address after the module's data.
    """
    content = {
        "kind": kind.name,
        "variants": variants,
        "constants": len(kind.Body._fields),  # type: ignore[attr-defined]
        "readings": ROOM,
        "rules": _rules(kind),
        "points": kernels.POINTS,
    }
    return _noted(kind, end, content)


def of_system(system: own.System, end: int, variants: Sequence[System], gait: Gait | None) -> bytes:
    """Return the notes of the module of a user's system, as JSON.

    Args:
        system: The system.
        end: First address after the module's data.
        variants: The system, and its form for uneven ground if it has one.
        gait: A gait of the system, in which a page begins; None is the system's `start`.
    """
    layout = layout_of(system.hybrid)
    start = system.start if gait is None else gait.state
    start = None if start is None else list(map(float, start))
    lines = system.drawn(np.zeros(2 * system.coordinates) if start is None else start)
    points = sum(len(line) for line in lines)
    content = {
        "system": system.title,
        "body": system.body._asdict(),
        "state": system.State._fields,  # type: ignore[attr-defined]
        "controls": system.controls,
        "start": start,
        "slope": 0.0 if gait is None else gait.slope,
        "lines": [len(line) for line in lines],
        "outcomes": [outcome.name for outcome in Outcome],
        "room": layout.links,
        # Bytes of a body, of a state, and of the points that show it.
        "scratch": 8 * (len(system.body) + 2 * system.coordinates + 2 * points),
        "uneven": len(variants) > 1,
        "pushed": "pushes" in system.supports,
    }
    return _noted(system.hybrid, end, content, system_kernels.block_for(layout))


def _noted(
    system: System, end: int, content: dict[str, Any], block: np.dtype = kernels.WALK
) -> bytes:
    """Return notes with what all modules share: places of fields, and options of the engine."""
    left = {"tile", "history"}
    shared = {
        "version": __version__,
        "end": end,
        "size": block.itemsize,
        "places": {
            name: place
            for name, place in _places(block).items()
            if name.partition(".")[0] not in left and not name.startswith(("blank", "before."))
        },
        "locked": [phase.knee_locked for phase in system.phases],
        "options": {
            f"{tolerance:g}": [options(tolerance)[name].item() for name in _OPTIONS]
            for tolerance in TOLERANCES
        },
    }
    return json.dumps(shared | content, separators=(",", ":"), allow_nan=False).encode()


def _rules(kind: System) -> dict[str, list[float]]:
    """Return the rules of a passive walker of a kind that a page does not change."""
    name = next(name for name, walker in WALKERS.items() if walker.kind == kind.name)
    rules = rules_of(make_scene({"walker": name}), kind, 0.0)[0]
    left = ("tick", "step_limit")  # infinite here or in a page
    return {
        field: np.atleast_1d(rules[field]).tolist()
        for field in rules.dtype.names or ()
        if field not in left
    }


_OPTIONS = ("tolerance", "landing", "doubt", "first_step", "fineness")


def of_all() -> dict[str, Any]:
    """Return the data that all modules share."""
    return {
        "version": __version__,
        "parameters": PARAMETERS,
        "walkers": {
            name: {
                "kind": walker.kind,
                "about": ABOUT[name],
                "parameters": {field: getattr(walker, field) for field in (*PARAMETERS, "knees")},
                "gaits": _gaits(name),
            }
            for name, walker in WALKERS.items()
        },
        "outcomes": [outcome.name for outcome in Outcome],
        "channels": rules.CHANNELS,
        "energies": rules.ENERGIES,
        "every_step": task.EVERY_STEP,
        "every_stride": task.EVERY_STRIDE,
        "bounds": rules.BOUNDS.tolist(),
        "checks": CHECKS,
        "in_python": IN_PYTHON,
        "friction": Scene.friction,
        "latest": kernels.LATEST,
        "farthest": kernels.FARTHEST,
        "passed": disturbance_kernels.PASSED,
        "scenes": SCENES,
        "policies": {name: of_policy(policy_folder(name)) for name in shipped_policies()},
    }


def _gaits(name: str) -> list[list[Any]]:
    """Return slopes at which a walker has a stable or unstable long gait, and its states there."""
    slopes = sorted({*REFERENCE_SLOPES, *_SLOPES})
    found = ((slope, searched_gait(WALKERS[name], slope)) for slope in slopes)
    return [[slope, list(state)] for slope, state in found if state is not None]


_SLOPES = (0.0025, 0.004, 0.008, 0.015, 0.03, 0.045, 0.05, 0.07, 0.08, 0.11)


def of_policy(folder: Path) -> dict[str, Any]:
    """Return the options of a trained policy's network, and its scene.

    Raises:
        ValueError: if a page has no such scene or walker.
    """
    content = json.loads((folder / DESCRIPTION).read_text(encoding="utf-8"))
    options = {key: content[key] for key in ("algo", "activation", "normalizer")}
    name = content["scene"]
    if not isinstance(name, str) or name not in SCENES:
        raise PolicyError(
            f"{folder}: a page has the scenes {', '.join(SCENES)}, and this policy's is "
            f"{shown(name)}: draw it by picture= or video="
        )
    scene = SCENES[name] | content["env"]
    if isinstance(scene.get("walker"), Mapping):
        preset, changes = as_changes(as_walker(scene["walker"]))
        scene["walker"] = {"preset": preset, **changes}
    return options | {"scene": scene}


def as_changes(walker: Walker) -> tuple[str, dict[str, float]]:
    """Return the most similar named walker, and the parameters in which this one differs.

    Raises:
        ValueError: if a page has no such walker.
    """
    if walker.knees == "held":
        raise ValueError("a page has no walkers with held knees: draw this by picture= or video=")
    found = {
        name: {
            parameter: getattr(walker, parameter)
            for parameter in PARAMETERS
            if getattr(walker, parameter) != getattr(preset, parameter)
        }
        for name, preset in WALKERS.items()
        if preset.kind == walker.kind
    }
    return min(found.items(), key=lambda entry: len(entry[1]))
