"""Controllers: one place decides what may act on a walker, and in which scene it does."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias

from gym_passive_walker._tools.arguments import near, shown
from gym_passive_walker._tools.loading import POLICIES
from gym_passive_walker.gaits.control.baselines import BASELINES
from gym_passive_walker.gaits.control.policy import FunctionPolicy, ModulePolicy, Policy, is_module
from gym_passive_walker.gaits.scenes.scene import Scene, make_scene

ControllerLike: TypeAlias = Policy | Callable[..., Any] | str | PathLike[str]
"""Type of controller arguments; see `acting`."""

SceneLike: TypeAlias = Scene | str | Mapping[str, Any]


def as_policy(controller: ControllerLike) -> Policy:
    """Return a controller from any form that it may be given in, apart from baselines.

    Args:
        controller: The name or the path of a trained policy, as `load_policy` reads it; an object
            with `predict(observation, state, episode_start, deterministic)`; a torch module or a
            function, from observations (n, size) to actions (n, actions).

    Raises:
        ValueError: if there is no such controller, or it cannot act.
    """
    if isinstance(controller, str | PathLike):
        try:
            named = controller if isinstance(controller, str) else Path(controller)
            return import_module(POLICIES[0]).load_policy(named)
        except ValueError:
            if Path(controller).suffix or not (like := near(controller, BASELINES)):
                raise
            raise ValueError(
                f"no controller {shown(controller)}{like}: give a feedback, one of "
                f"{', '.join(BASELINES)}, or the name or path of a trained policy"
            ) from None
    if callable(getattr(controller, "predict", None)):
        return controller  # type: ignore[return-value]
    if is_module(controller):
        return ModulePolicy(controller)
    if callable(controller):
        return FunctionPolicy(controller)
    raise ValueError(
        "a policy acts by predict(observation, ...), as what gpw.load_policy returns; or it is a "
        "function or a torch module from observations (n, size) to actions (n, actions); the path "
        "of an ONNX file (.onnx) or of a file of stable-baselines3 (.zip); or a name, one of "
        f"{', '.join(BASELINES)} or of a trained policy; not {shown(controller)}"
    )


def acting(
    controller: ControllerLike, scene: SceneLike | None = None, **changes: Any
) -> tuple[Policy, Scene]:
    """Return a controller from any form that it may be given in, and the scene in which it acts.

    Args:
        controller: The name of one of `BASELINES`, or what `as_policy` takes.
        scene: A `Scene`, its name, or a mapping of its arguments. None is the controller's own
            scene, or "level" for a baseline.
        **changes: Arguments of `Scene` that replace the scene's own.

    Raises:
        ValueError: if there is no such controller, it cannot act, or has no scene.
    """
    if isinstance(controller, str) and controller in BASELINES:
        where = with_changes("level" if scene is None else scene, changes)
        return BASELINES[controller](where), where
    policy = as_policy(controller)
    scene = getattr(policy, "scene", None) if scene is None else scene
    if scene is None:
        raise ValueError("say in which scene this policy acts, by scene=")
    return policy, with_changes(scene, changes)


def with_changes(scene: SceneLike, changes: Mapping[str, Any]) -> Scene:
    """A scene with changes; whether a toe stub ends a walk depends on the new walker's legs."""
    return make_scene(
        scene, **({"end_on_toe_stub": None} if "walker" in changes else {}), **changes
    )
