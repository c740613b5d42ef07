"""Agents that learn nothing, which any learned one has to be better than.

Each is a policy object: `predict` takes one observation or a batch, and returns actions as
stable-baselines3 does.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agents.feedback import Method, coordinates, gains, powered_gait
from gym_passive_walker.envs.scene import Scene, make_scene

_STANDS = 1e-5  # rad, in single precision: legs that mirror each other have just changed roles


class ConstantTorque:
    """The same torque all along.

    Args:
        torque: Torque in units of m g l.
        scene: A `Scene`, its name, or a mapping of its arguments; gives what action 1 stands for.
    """

    name = "constant torque"

    def __init__(self, torque: float, scene: Scene | str | dict[str, Any]) -> None:
        self.torque = float(torque)
        self.scale = make_scene(scene).max_hip_torque

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """The action, whatever is observed."""
        shape = np.shape(observation)[:-1]
        action = 0.0 if self.torque == 0.0 else np.clip(self.torque / self.scale, -1.0, 1.0)
        return np.full((*shape, 1), action, np.float32), state


class Passive(ConstantTorque):
    """No torque: what McGeer's walkers do."""

    name = "passive"

    def __init__(self) -> None:
        super().__init__(0.0, "level")


class LinearFeedback:
    """One torque a stride, set at its start by how far the walker is from its gait.

    With `control="tick"` it is held through all ticks of the stride: `state` says which torque.

    Args:
        scene: A `Scene`, its name, or a mapping of its arguments, with one slope: the gains belong
            to the gait at the middle of a range.
        method: "lqr" or "deadbeat".
        torque_weight: Of "lqr"; see `feedback.gains`.

    Raises:
        GaitNotFound: if there is no gait to hold.
    """

    def __init__(
        self,
        scene: Scene | str | dict[str, Any] = "level",
        method: Method = "lqr",
        *,
        torque_weight: float = 100.0,
    ) -> None:
        scene = make_scene(scene)
        walker, self.name = scene.walker, {"lqr": "LQR", "deadbeat": "deadbeat"}.get(method, "")
        self.gait = powered_gait(walker, float(np.mean(scene.slope)))
        row = gains(self.gait, method, torque_weight=torque_weight)
        # In what the agent sees and does: dimensionless rates, and shares of the largest torque.
        unit = walker.total_mass * walker.gravity * walker.leg_length * scene.max_hip_torque
        self._seen = coordinates(walker)
        scale = np.array([1.0] + [walker.time_unit] * (len(self._seen) - 1))
        self._row = row / scale / unit
        self._point = self.gait.state[self._seen] * scale
        self._nominal = self.gait.hip_torque / unit

    def predict(
        self,
        observation: ArrayLike,
        state: tuple[NDArray, ...] | None = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], tuple[NDArray, ...] | None]:
        """The stride's action: a new one just after heelstrike, else the one under way.

        Args:
            observation: One observation or a batch.
            state: What the last call returned; None at the beginning.
            episode_start: Which walkers have just begun an episode.
            deterministic: There is no other way.
        """
        seen = np.atleast_2d(np.asarray(observation, dtype=float))
        deviation = seen[:, self._seen] - self._point
        action = np.clip(self._nominal - deviation @ self._row, -1.0, 1.0)
        if state is not None:
            begun = np.max(np.abs(seen[:, :1] + seen[:, 1:3]), axis=1) < _STANDS
            if episode_start is not None:
                begun |= np.asarray(episode_start, dtype=bool)
            action = np.where(begun, action, state[0])
        shaped = action.astype(np.float32).reshape(*np.shape(observation)[:-1], 1)
        return shaped, (action,)
