"""The environments of a run, for training and for evaluation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium

from agents.config import Config, ConfigError
from gym_passive_walker.apps.build import compile_for
from gym_passive_walker.envs.registration import ID, MAX_EPISODE_STEPS
from gym_passive_walker.gaits.scenes.named import check_source
from gym_passive_walker.gaits.scenes.scene import Scene, make_scene, seen_by_policy
from gym_passive_walker.models.walkers import name_of

if TYPE_CHECKING:
    from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv


def scene_of(config: Config, **changes: Any) -> Scene:
    """The scene of a run, with changes.

    Raises:
        ConfigError: if an argument of the scene is invalid, or the user's own scene has changed
            since the run began.
    """
    with ConfigError.instead_of(TypeError, ValueError):
        check_source(config.outside, config.source)
        return make_scene(config.scene, trust=True, **config.env | changes)


def training_envs(config: Config, count: int | None = None) -> PassiveWalkerVecEnv:
    """Training environments as a `VecEnv` of stable-baselines3.

    There are `count` environments, or `config.n_envs` if `count` is None.
    """
    # Imported here: RLlib's trainings have no stable-baselines3, and only read scenes above.
    from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv

    return PassiveWalkerVecEnv(
        config.n_envs if count is None else count,
        scene_of(config, **config.training),
        max_episode_steps=config.episode_steps or MAX_EPISODE_STEPS,
    )


def arena(config: Config, count: int) -> gymnasium.vector.VectorEnv:
    """Environments for evaluation, separate from those of the training, as a policy sees them."""
    return gymnasium.make_vec(ID, num_envs=count, scene=seen_by_policy(scene_of(config)))


def single(config: Config) -> gymnasium.Env:
    """One environment, for drawing a gait."""
    return gymnasium.make(ID, scene=seen_by_policy(scene_of(config)))


def check(config: Config) -> None:
    """Check that an episode of the scene can begin; compile what it needs, if it is not there.

    Raises:
        ConfigError: if it cannot.
    """
    compile_for(scene_of(config, **config.training))
    with ConfigError.instead_of(ValueError):
        training_envs(config, 1).reset()


def describe(config: Config) -> str:
    """A short description of a run's scene: walker, slope, control and actuators."""
    scene = scene_of(config)
    walker = name_of(scene.walker)
    slope = (
        f"slopes {scene.slope[0]:g} to {scene.slope[1]:g} rad"
        if isinstance(scene.slope, tuple)
        else f"slope {scene.slope:g} rad"
    )
    held = f"ticks of {scene.tick:g} √(l/g)" if scene.control == "tick" else "one action a stride"
    motors = ", ".join(
        f"{name.replace('_', '-')} up to {scene.largest(name):g} "
        f"{scene.actuator(name).unit.replace('sqrt', '√')}".rstrip()
        for name in scene.actions
    )
    return f"{config.scene}: walker {walker}, {slope}, {held}, {motors}"
