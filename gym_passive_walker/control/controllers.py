"""Controllers: one place decides what may act on a walker, and in which scene it does."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias

from gym_passive_walker.arguments import shown
from gym_passive_walker.control.baselines import BASELINES
from gym_passive_walker.control.policy import Policy
from gym_passive_walker.envs.scene import Scene, make_scene

ControllerLike: TypeAlias = Policy | str | PathLike[str]
"""What a controller may be given as, wherever one is asked for; see `acting`."""

SceneLike: TypeAlias = Scene | str | Mapping[str, Any]

LOADERS: list[Callable[[str | Path], Policy]] = []
"""Reads a trained policy by its name or folder; `policies`, which imports this, enters it."""


def acting(
    controller: ControllerLike, scene: SceneLike | None = None, **changes: Any
) -> tuple[Policy, Scene]:
    """Return a controller from any form that it may be given in, and the scene in which it acts.

    Args:
        controller: An object with `predict(observation, state, episode_start, deterministic)`; the
            name of one of `BASELINES`; or the name or the folder of a trained policy.
        scene: A `Scene`, its name, or a mapping of its arguments. None is the controller's own
            scene, or "level" for a baseline.
        **changes: Arguments of `Scene` that replace the scene's own.

    Raises:
        ValueError: if there is no such controller, it cannot act, or has no scene.
    """
    if isinstance(controller, str) and controller in BASELINES:
        where = changed("level" if scene is None else scene, changes)
        return BASELINES[controller](where), where
    if isinstance(controller, str | PathLike):
        controller = LOADERS[0](controller if isinstance(controller, str) else Path(controller))
    if not callable(getattr(controller, "predict", None)):
        raise ValueError(
            "a policy acts by predict(observation, ...), as what gpw.load_policy returns, or is "
            f"named: one of {', '.join(BASELINES)} or a trained policy; not {shown(controller)}"
        )
    scene = getattr(controller, "scene", None) if scene is None else scene
    if scene is None:
        raise ValueError("say in which scene this policy acts, by scene=")
    return controller, changed(scene, changes)


def changed(scene: SceneLike, changes: Mapping[str, Any]) -> Scene:
    """A scene with changes; whether a toe stub ends a walk depends on the new walker's legs."""
    return make_scene(
        scene, **({"end_on_toe_stub": None} if "walker" in changes else {}), **changes
    )
