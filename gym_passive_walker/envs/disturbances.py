"""Disturbances of the walkers of a batch, and what `info` has of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.envs import constraints, disturbance_kernels, saved, task
from gym_passive_walker.envs.checks import CHECKS
from gym_passive_walker.envs.scene import CALM, Scene
from gym_passive_walker.gaits.terrain import Terrain
from gym_passive_walker.walkers import state_size


class Contact(NamedTuple):
    """Where a foot touches the ground.

    Attributes:
        x: Along the slope that is walked, in the walker's own units of length.
        y: Over it, in the same units.
        tilt: By how much the ground there slopes more steeply, in rad; angles are from its normal.
    """

    x: float
    y: float = 0.0
    tilt: float = 0.0


_OF_PUSHES = ("pushes", "push_work", "episode_push_work")


def disturbed(scene: Scene) -> bool:
    """Whether walkers of a scene have any disturbance of `disturbance_kernels`."""
    return scene.command is not None or any(getattr(scene, n) != calm for n, calm in CALM.items())


class Disturbances:
    """Disturbances of walkers of a scene.

    Args:
        scene: A scene for which `disturbed` holds.
        system: Which equations they obey, by name.
        count: How many walkers.

    Attributes:
        disturbances: Shape (count,) of `disturbance_kernels.DISTURBANCE`.
        odds: Shape (1,) of `disturbance_kernels.ODDS`.
        pending: Actions that come late, (count, steps, actions).
        noise: Standard deviation of the noise on each number of a `System`'s observation.
    """

    def __init__(self, scene: Scene, system: str, count: int) -> None:
        self.scene, self._system = scene, system
        self.states, self.odds = np.zeros(count, disturbance_kernels.DISTURBANCE), _odds(scene)
        self.pending = np.zeros((count, scene.action_delay, len(scene.actions)))
        self.terrain = (scene.terrain or Terrain()).arrays()
        self._limits = saved.FateLimits(self.odds[0])
        self.noise = _noise(scene)

    @property
    def natives(self) -> tuple[NDArray, NDArray]:
        """The system's phases, and what else is done to walkers; see `constraints.natives`."""
        pushed, watched = bool(self.scene.pushes), bool(self.scene.constraints)
        return constraints.natives(self._system, pushed=pushed, watched=watched)

    def arrays(self) -> dict[str, NDArray]:
        """What `disturbance_kernels.step` reads, by the names of `ticks.STAYS`."""
        table, spread = self.terrain
        return {
            "disturbances": self.states, "pending": self.pending, "odds": self.odds,
            "natives": self.natives[1], "table": table, "spread": spread,
        }  # fmt: skip

    def begin(
        self,
        lanes: NDArray[np.int64],
        randoms: list[np.random.Generator],
        records: NDArray,
        ledger: NDArray,
    ) -> None:
        """Draw some walkers' disturbances, by a key from each one's random numbers."""
        keys = np.empty(len(lanes), np.uint64)
        for j, i in enumerate(lanes.tolist()):
            keys[j] = randoms[i].integers(2**64, dtype=np.uint64)
        disturbance_kernels.begin(
            self.states, self.odds, lanes, keys, self.pending, records, ledger, *self.terrain
        )

    def observe(self, ledger: NDArray, lanes: NDArray, observations: NDArray[np.float32]) -> None:
        """Make some walkers' observations those of their sensors."""
        disturbance_kernels.observe(
            self.states, ledger, self.odds, *self.terrain, lanes, observations
        )

    def spoil(self, ledger: NDArray, lanes: NDArray, observations: NDArray[np.float32]) -> None:
        """Add noise to some walkers' observations of a `System`."""
        if np.any(self.noise):
            disturbance_kernels.add_noise(self.states, ledger, self.noise, lanes, observations)

    def lean(self, slopes: NDArray[np.float64], lanes: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Have some walkers walk on other slopes; those of the footholds that they stand on."""
        self.states["slope"][lanes] = slopes[lanes]
        return slopes + self.states["tilt"]

    def contact(self, lane: int, rolled: float, length: float) -> Contact:
        """Where a walker touches a foothold.

        Args:
            lane: Which walker.
            rolled: How far its foot has rolled in this stride, in leg lengths.
            length: Of its leg, in its own units.
        """
        x, y, tilt = (float(self.states[name][lane]) for name in ("x", "y", "tilt"))
        x, y = x + rolled * math.cos(tilt), y - rolled * math.sin(tilt)
        return Contact(x * length, y * length, tilt)

    def pushed(self, lane: int) -> float:
        """What pushed a walker in this step, as a share of the largest push, from -1 to 1."""
        impulse = float(self.states["impulse"][lane])
        largest = max(abs(impulse), float(np.abs(self.odds["push"]).max()))
        return impulse / largest if impulse else 0.0

    def info_values(self, bodies: NDArray) -> dict[str, NDArray]:
        """Further entries of `info` at every step: a number for each walker."""
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

    def get_state(self) -> dict[str, NDArray]:
        """All that decides what comes next; a copy."""
        return {"disturbances": self.states.copy(), "pending": self.pending.copy()}

    def checked(
        self, state: Mapping[str, Any], times: NDArray[np.float64], going: NDArray[np.bool_]
    ) -> tuple[NDArray, NDArray]:
        """Disturbances and late actions of a state, as copies, if they can be put back.

        Args:
            state: What `get_state` gave, and perhaps more.
            times: Since the walkers' strides began, (count,).
            going: Whether each episode goes on, (count,).

        Raises:
            StateError: if they are damaged, or of another scene.
        """
        found = saved.like(state["disturbances"], "disturbances", self.states)
        pending = saved.like(state["pending"], "pending", self.pending)
        self._limits.check(found, pending, times, going)
        return found, pending

    def put_back(self, found: tuple[NDArray, NDArray]) -> None:
        """Go back to what was `checked`."""
        self.states[:], self.pending[:] = found


def _noise(scene: Scene) -> NDArray[np.float64]:
    """Standard deviation of the noise on each number of an observation but the command."""
    noise, size = scene.observation_noise, state_size(scene.walker)
    rest = (task.SIZE if scene.own_system is None else size + 1) - size
    given = noise if isinstance(noise, tuple) else [noise] * size + [0.0] * rest
    return np.array(given, dtype=float)


def _odds(scene: Scene) -> NDArray:
    """A scene's rules, as kernels read them."""
    odds = np.zeros(1, disturbance_kernels.ODDS)
    if scene.pushes:
        odds["rate"], odds["push"] = scene.pushes["rate"], scene.pushes["impulse"]
    if scene.own_system is None:
        odds["noise"] = _noise(scene)
        odds["noisy"] = np.any(odds["noise"])
    if scene.command is not None:
        odds["commanded"], odds["command"] = True, np.broadcast_to(scene.command, 2)
    odds["uneven"], odds["terrain_lookahead"] = scene.terrain is not None, scene.terrain_lookahead
    odds["interval"] = disturbance_kernels.INTERVAL if scene.constraints else math.inf
    odds["ends"] = [scene.constraints.get(check) == "end" for check in CHECKS]
    for name in ("action_noise", "command_weight", "friction", "knee_latch", "scuff_depth"):
        odds[name] = getattr(scene, name)
    return odds
