"""Disturbances of the walkers of a batch, and their entries in `info`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.envs import constraints, disturbance_kernels
from gym_passive_walker.gaits.scenes.checks import CHECKS
from gym_passive_walker.gaits.scenes.randomization import OF_STEPS
from gym_passive_walker.gaits.scenes.scene import UNDISTURBED, Scene
from gym_passive_walker.gaits.terrain import Terrain


class Contact(NamedTuple):
    """Contact point of a foot.

    Attributes:
        x: Coordinate along the mean slope, in the walker's units of length.
        y: Height above the mean slope, in the walker's units of length.
        tilt: Slope of the foothold minus the mean slope, in rad; angles are relative to the
            normal of the foothold.
    """

    x: float
    y: float = 0.0
    tilt: float = 0.0


_OF_PUSHES = ("pushes", "push_work", "episode_push_work")


def disturbed(scene: Scene) -> bool:
    """Return whether a scene has any disturbance of `disturbance_kernels`."""
    drawn = not set(OF_STEPS).isdisjoint(scene.randomized)
    return (
        drawn
        or scene.command is not None
        or any(getattr(scene, n) != calm for n, calm in UNDISTURBED.items())
    )


class Disturbances:
    """Disturbances of walkers of a scene.

    Args:
        scene: A scene for which `disturbed` holds.
        system: Name of the system of equations.
        count: Number of walkers.

    Attributes:
        states: Disturbance states, (count,) of `disturbance_kernels.DISTURBANCE`.
        settings: Settings of the scene, (1,) of `disturbance_kernels.SETTINGS`.
        terrain: Footholds and standard deviations of the terrain; see `Terrain.arrays`.
    """

    def __init__(self, scene: Scene, system: str, count: int) -> None:
        self.scene, self._system = scene, system
        self.states = np.zeros(count, disturbance_kernels.DISTURBANCE)
        self.settings = settings_of(scene)
        self.terrain = (scene.terrain or Terrain()).arrays()

    @property
    def hooks(self) -> tuple[NDArray, NDArray]:
        """Phases of the system and addresses of its hooks; see `constraints.hooks`."""
        pushed, watched = bool(self.scene.pushes), bool(self.scene.constraints)
        return constraints.hooks(self._system, pushed=pushed, watched=watched)

    def arrays(self) -> dict[str, NDArray]:
        """Return the arrays with content but `hooks`, by their names in `memory`."""
        table, spread = self.terrain
        found = {"disturbances": self.states, "settings": self.settings}
        return found | {"table": table, "spread": spread}

    def settle(self, lanes: NDArray[np.int64], drawn: NDArray) -> None:
        """Set what domain randomization drew for some walkers, (lanes,) of `SETTLED`."""
        for name in ("delay", "friction", "strength"):
            self.states[name][lanes] = drawn[name]

    def set_slopes(
        self, slopes: NDArray[np.float64], lanes: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Set the mean slopes of some walkers; returns the slopes of their footholds, in rad."""
        self.states["slope"][lanes] = slopes[lanes]
        return slopes + self.states["tilt"]

    def pushed(self, lane: int) -> float:
        """Return the impulse on a walker in this step, over the largest impulse: from -1 to 1."""
        impulse = float(self.states["impulse"][lane])
        largest = max(abs(impulse), float(np.abs(self.settings["push"]).max()))
        return impulse / largest if impulse else 0.0

    def info_values(self, bodies: NDArray) -> dict[str, NDArray]:
        """Return entries of `info` at every step by name: arrays (count,)."""
        found = {}
        if self.scene.command is not None:
            found["command"] = self.states["command"]
        if self.scene.pushes:
            found |= {name: self.states[name] for name in _OF_PUSHES}
        notes = bodies[:, 0, -constraints.ROOM :]
        for check in self.scene.constraints:
            for name in constraints.READINGS[check]:
                found[name] = notes[:, constraints.NOTES.index(name)]
        return found


def settings_of(scene: Scene) -> NDArray:
    """Return the settings of a scene's disturbances, (1,) of SETTINGS."""
    settings = np.zeros(1, disturbance_kernels.SETTINGS)
    if scene.pushes:
        settings["rate"], settings["push"] = scene.pushes["rate"], scene.pushes["impulse"]
    noise, size = scene.observation_noise, scene.walker.size
    given = noise if isinstance(noise, tuple) else (noise,) * size
    settings["noise"][0, : len(given)], settings["noisy"] = given, any(given)
    if scene.command is not None:
        settings["commanded"], settings["command"] = True, np.broadcast_to(scene.command, 2)
    settings["uneven"] = scene.terrain is not None
    settings["interval"] = disturbance_kernels.INTERVAL if scene.constraints else math.inf
    settings["ends"] = [scene.constraints.get(check) == "end" for check in CHECKS]
    for name in (
        "terrain_lookahead", "action_noise", "command_weight", "friction", "knee_latch",
        "scuff_depth",
    ):  # fmt: skip
        settings[name] = getattr(scene, name)
    return settings
