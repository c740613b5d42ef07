"""Controllers: one place decides what may act on a walker, and in which scene it does."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias

from gym_passive_walker._tools.arguments import near, shown
from gym_passive_walker._tools.loading import POLICIES
from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.gaits.control.baselines import BASELINES, Held, Schedule
from gym_passive_walker.gaits.control.optimum import OptimalGait
from gym_passive_walker.gaits.control.policy import (
    FunctionPolicy,
    ModulePolicy,
    NormalizedPolicy,
    Planner,
    Policy,
    StridePlan,
    is_module,
    method_of,
    policy_name,
)
from gym_passive_walker.gaits.scenes.scene import Scene, SceneLike, make_scene, seen_by_policy

ControllerLike: TypeAlias = (
    Policy | Planner | Callable[..., Any] | str | PathLike[str]
    | Actuation | Mapping[str, Any] | OptimalGait
)  # fmt: skip
"""Type of controller arguments; see `acting`."""


def acting(
    controller: ControllerLike,
    scene: SceneLike | None = None,
    *,
    usual: SceneLike | None = None,
    calmed: Callable[[Scene], Scene] | None = None,
    **changes: Any,
) -> tuple[Policy, Scene]:
    """Return a controller from any form that it may be given in, and the scene in which it acts.

    Args:
        controller: The name of one of `BASELINES`; the name or the path of a trained policy, as
            `load_policy` reads it; an object with `predict(observation, state, episode_start,
            deterministic)`, or with `plan(points, slopes)`, see `StridePlan`; a model of
            stable-baselines3, with its `VecNormalize` if it has one; a torch module or a function,
            from observations (n, size) to actions (n, actions); an `Actuation`, or a mapping of
            names of a walker's controls to values, equal in each stride; or an `OptimalGait`, of
            which torques and push-off are applied without feedback.
        scene: A scene in a form that `make_scene` takes. None is the controller's own
            scene, or "level" for a baseline.
        usual: Scene of a controller without a scene; None refuses it.
        calmed: Function of the scene that returns the one to act in, as without disturbances;
            the controller is made for that one.
        **changes: Arguments of `Scene` that replace the scene's own.

    Returns:
        The policy; and the scene, of which a policy observes "policy" alone.

    Raises:
        ValueError: if there is no such controller, it cannot act, or has no scene.
    """
    if isinstance(controller, str) and controller in BASELINES:
        made: Callable[[Scene], Policy] = BASELINES[controller]
        usual = "level"
    else:
        if isinstance(controller, str | PathLike):
            controller = _loaded(controller)
        made = _form(controller)
        if isinstance(controller, OptimalGait):
            usual, changes = None, {"slope": controller.slope} | changes
    if scene is None:
        scene = getattr(controller, "scene", None) or usual
    if scene is None:
        raise ValueError("say in which scene this policy acts, by scene=")
    there = seen_by_policy(with_changes(scene, changes))
    there = there if calmed is None else calmed(there)
    return made(there), there


def _form(controller: Any) -> Callable[[Scene], Policy]:
    """Return the function that makes a policy of a controller for a scene."""
    if isinstance(controller, Actuation | Mapping):
        return lambda scene: Held(scene, controller)
    if isinstance(controller, OptimalGait):
        return lambda scene: Schedule(scene, controller)
    if method_of(controller, "predict"):
        scales = method_of(controller, "get_vec_normalize_env")
        if scales and (normalizer := scales()) is not None:
            return lambda scene: NormalizedPolicy(controller, normalizer)
        return lambda scene: controller
    if plan := method_of(controller, "plan"):
        plan_by, name = method_of(controller, "plan_by"), policy_name(controller)
        return lambda scene: StridePlan(scene, plan, plan_by, name)
    if is_module(controller):
        return lambda scene: ModulePolicy(controller)
    if callable(controller):
        return lambda scene: FunctionPolicy(controller)
    raise ValueError(
        "a policy acts by predict(observation, ...), as what gpw.load_policy returns, or plans by "
        "plan(points, slopes); or it is a function or a torch module from observations (n, size) "
        "to actions (n, actions); an Actuation, a mapping of controls, or an OptimalGait; the path "
        "of an ONNX file (.onnx) or of a file of stable-baselines3 (.zip); or a name, one of "
        f"{', '.join(BASELINES)} or of a trained policy; not {shown(controller)}"
    )


def _loaded(name: str | PathLike[str]) -> Policy:
    """Return a trained policy by its name or path."""
    try:
        return import_module(POLICIES[0]).load_policy(name if isinstance(name, str) else Path(name))
    except ValueError:
        if Path(name).suffix or not (like := near(name, BASELINES)):
            raise
        raise ValueError(
            f"no controller {shown(name)}{like}: give a feedback, one of "
            f"{', '.join(BASELINES)}, or the name or path of a trained policy"
        ) from None


def with_changes(scene: SceneLike, changes: Mapping[str, Any]) -> Scene:
    """A scene with changes; whether a toe stub ends a walk depends on the new walker's legs."""
    if not changes.keys().isdisjoint(("walker", "system")):
        changes = {"end_on_toe_stub": None, **changes}
    return make_scene(scene, **changes)
