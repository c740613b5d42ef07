"""Public names of `gaits.scenes`: named tasks, and tasks of one's own."""

from gym_passive_walker.gaits.scenes.scene import (
    CONTROLS,
    SCENES,
    Scene,
    SceneError,
    make_scene,
)

__all__ = ["CONTROLS", "SCENES", "Scene", "SceneError", "make_scene"]
