"""The one way to a stride map: of a walker, passive or under a controller, on any ground."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gym_passive_walker._tools.arguments import check_tolerance, one_slope, shown
from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.gaits.control.baselines import held_by, holding
from gym_passive_walker.gaits.control.controlled import ControlledMap
from gym_passive_walker.gaits.control.controllers import ControllerLike, acting
from gym_passive_walker.gaits.control.policy import Policy
from gym_passive_walker.gaits.find.fixed_point import find_gait
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.gaits.scenes.scene import (
    UNDISTURBED,
    Scene,
    SceneLike,
    make_scene,
    undisturbed,
)
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.gaits.terrain import Terrain, TerrainLike, terrain_from
from gym_passive_walker.models.model import check_heights_only
from gym_passive_walker.models.walkers import WalkerLike, as_walker


def stride_map(
    walker: WalkerLike | None = None,
    slope: float | None = None,
    *,
    controller: ControllerLike | None = None,
    scene: SceneLike | None = None,
    terrain: TerrainLike | None = None,
    tolerance: float = 1e-12,
) -> StrideMap:
    """Return the stride map (Poincaré map) of a walker, passive or under a controller.

    Whatever takes a walker and a slope takes such a map: gaits, families, bifurcation diagrams,
    basins, simulations and all other analyses.

    Example:
        >>> import gym_passive_walker as gpw
        >>> strides = gpw.stride_map(controller=gpw.load_policy("level-ppo"))
        >>> strides.exact  # its network has a derivative, and so has the map
        True
        >>> gpw.find_gait(strides).stable
        True

    Args:
        walker: The walker, in a form that `as_walker` takes; the scene's when None.
        slope: Slope in rad; the scene's, or the middle of its range, when None. Without a scene it
            may be left to the analysis.
        controller: What works the motors: None for a passive walker; an `Actuation`, or a mapping
            of its parts or of a `System`'s controls to values, the same in each stride; an
            `OptimalGait` (its torques are applied without feedback); a trained policy, a baseline,
            or the name of either; the path of a policy that `load_policy` reads, such as an ONNX
            file; any object with `predict(observation, state, episode_start, deterministic)` or
            `plan(points, slopes)`; or a function or a torch module from observations (n, 8) to
            actions (n, actions). What it remembers starts again with each stride. A `System` is
            observed by its state, the slope and the scene's command, (n, 2 m + 1) without a
            command.
        scene: Which motors a controller has, how strong they are and how long its actions are
            held, in a form that `make_scene` takes; the policy's own or "level" when None. Its
            disturbances are left out. For passive walkers, and under an `Actuation`, its walker
            and its slope alone count.
        terrain: How footholds lie, in a form that `terrain_from` takes; smooth when None, as the
            scene's own is left out. One that repeats, such as `stairs` and `waves`: random ground
            is for `simulate` and `robustness`.
        tolerance: Error of the integration, relative to the largest angle or rate.

    Returns:
        The map. Its `apply` and `linearize` take points of the section, which `points_at` makes of
        states.

    Raises:
        ValueError: if the controller cannot act, or an argument is out of its range.
    """
    tolerance, ground = check_tolerance(tolerance), _repeating(terrain)
    heights_only = 0.0 if ground is None else ground.slopes
    of_slope = True
    if controller is None or isinstance(controller, Actuation | Mapping):
        there = None if scene is None else make_scene(scene)
        if there is not None and slope is None:
            slope = float(np.mean(there.slope))
        if walker is None and there is None:
            raise ValueError("stride_map needs a walker, a scene, or a policy")
        own = as_walker(there.walker if walker is None else walker)  # type: ignore[union-attr]
        held = held_by(own, controller)
        if isinstance(held, Actuation):
            check_heights_only(own, heights_only)
            return StrideMap.of(
                own, slope=None if slope is None else one_slope(slope), tolerance=tolerance,
                controller=held, terrain=ground,
            )  # fmt: skip
        if scene is None:
            scene = holding(own, slope or 0.0, held)
            of_slope = slope is not None
    changes: dict[str, Any] = {} if walker is None else {"walker": as_walker(walker)}
    if slope is not None:
        changes["slope"] = one_slope(slope)  # feedback is made for this slope
    agent, there = acting(controller, scene, usual="level", calmed=calm, **changes)  # type: ignore[arg-type]
    check_heights_only(there.walker, heights_only)
    return ControlledMap(
        walker=there.walker, slope=there.slope if of_slope else None,  # type: ignore[arg-type]
        agent=agent, scene=there, tolerance=tolerance, terrain=ground,
    )  # fmt: skip


def _repeating(terrain: TerrainLike | None) -> Terrain | None:
    """Return the ground of a stride map; None if it is smooth."""
    ground = terrain_from(terrain)
    if ground is None or ground.smooth:
        return None
    if ground.random or not ground.repeats:
        raise ValueError(
            "a stride map is of ground that repeats, as stairs and waves do; walk over random "
            "footholds by simulate(..., terrain=) or robustness"
        )
    return ground


def closed_loop_gait(
    policy: ControllerLike,
    scene: SceneLike | None = None,
    *,
    slope: float | None = None,
    period: int = 1,
    guess: ArrayLike | None = None,
) -> Gait:
    """Find the periodic gait of a walker under a policy: `find_gait` of its `stride_map`.

    Example:
        >>> import gym_passive_walker as gpw
        >>> from gym_passive_walker.control.baselines import LinearFeedback
        >>> gait = gpw.closed_loop_gait(LinearFeedback("steep"), "steep")
        >>> gait.stable, round(gait.froude_speed, 3)
        (True, 0.325)

    Args:
        policy: A baseline, a trained policy, or any other controller of `stride_map`.
        scene: A scene in a form that `make_scene` takes. None is the policy's own, or
            "level" for one without a scene.
        slope: Slope in rad; the scene's, or the middle of its range, if None.
        period: Strides until the gait repeats.
        guess: A section state to start from; None is where walks from the scene's start come to.

    Raises:
        GaitNotFound: if the walker falls at once, or no gait is found.
        ValueError: if the policy cannot act, or an argument is out of its range.
    """
    strides = stride_map(None, slope, controller=policy, scene=scene)
    if strides.passive:
        raise ValueError(
            f"closed_loop_gait needs a policy, or what else acts, not {shown(policy)}: find_gait "
            "finds passive gaits"
        )
    return find_gait(strides, period=period, guess=guess)


def acting_as(strides: StrideMap, slope: float) -> tuple[Policy, Scene]:
    """Return a map's controller as a policy, and the scene in which it acts.

    Args:
        strides: A map of a walker that is not passive.
        slope: Slope in rad.
    """
    if isinstance(strides, ControlledMap):
        return strides.agent, make_scene(strides.scene, walker=strides.walker, slope=slope)
    held, stub = strides.controller, strides.end_on_toe_stub
    return acting(held, holding(strides.walker, slope, held, end_on_toe_stub=stub))


def map_in(scene: Scene, policy: Policy | None) -> StrideMap:
    """Return the stride map of a scene's walker on smooth ground, without disturbances.

    Args:
        scene: The scene, of one slope.
        policy: The controller; None for a passive walker.

    Raises:
        ValueError: if a stride depends on more than the state in which it begins: the policy
            remembers, actions are delayed, or commands vary.
    """
    if policy is None:
        return StrideMap.of(
            scene.walker, slope=float(np.mean(scene.slope)), tolerance=scene.tolerance,
            end_on_toe_stub=bool(scene.end_on_toe_stub and scene.walker.toe_stubs),
        )  # fmt: skip
    depends = "a stride must depend on the state in which it begins, and "
    if scene.action_delay:
        raise ValueError(f"{depends}action_delay={scene.action_delay} carries actions over")
    if np.ptp(np.ravel(scene.command or 0.0)):
        raise ValueError(f"{depends}commands vary in this scene: choose one, as command=0.15")
    there = calm(scene)
    strides = ControlledMap(
        walker=there.walker, slope=there.slope,  # type: ignore[arg-type]
        agent=policy, scene=there, tolerance=scene.tolerance,
    )  # fmt: skip
    if strides.remembers:
        raise ValueError(f"{depends}{strides.controller_name} remembers earlier ones")
    return strides


def calm(scene: Scene) -> Scene:
    """Return a scene without disturbances, on smooth ground of one slope, with one command.

    These are the middles of their ranges. Motors are charged for absolute work, and an agent that
    sees the ground ahead sees that it is smooth.
    """
    command = None if scene.command is None else float(np.mean(scene.command))
    undisturbed(scene, "controllers of stride maps go", {"observation": None})
    alike: dict[str, Any] = {"energy": "absolute", "reset_noise_scale": 0.0}
    alike |= {"domain_randomization": {}, "randomization_pool": None}
    alike |= UNDISTURBED | {"slope": float(np.mean(scene.slope)), "command": command}
    if scene.terrain_lookahead:
        alike |= {"terrain": Terrain(), "terrain_lookahead": scene.terrain_lookahead}
    return make_scene(scene, **alike)
