"""A batch of walkers of a scene on a GPU."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import whole
from gym_passive_walker.devices.gpu import device, episodes
from gym_passive_walker.devices.gpu.episodes import DeviceWalkers, SceneConstants, StepBuffers
from gym_passive_walker.devices.gpu.lane import DeviceCode, device_code
from gym_passive_walker.engine.layout import RECORD
from gym_passive_walker.engine.run import options
from gym_passive_walker.envs import disturbance_kernels, interface, one_walker, task
from gym_passive_walker.envs.batch import observed_bodies, rules_of, system_in
from gym_passive_walker.envs.constraints import ROOM
from gym_passive_walker.envs.custom import Custom
from gym_passive_walker.envs.disturbances import Disturbances, disturbed
from gym_passive_walker.envs.transitions import NOTE
from gym_passive_walker.gaits.scenes.checks import checked
from gym_passive_walker.gaits.scenes.scene import Scene, SceneError, make_scene
from gym_passive_walker.gaits.scenes.starts import Starts
from gym_passive_walker.models.model import bodies, check_supports
from gym_passive_walker.models.walkers import Walker

DRAWN = 4096
"""Number of walkers that the episodes of a scene with `domain_randomization` draw from, if its
`randomization_pool` has no fewer."""


@lru_cache
def _kernels(here: DeviceCode, has_disturbances: bool) -> tuple[Any, Any]:
    """Return the kernels that reset and step walkers."""
    bound = here.bound
    if here.rules:
        bound = bound.instead({
            episodes.before_step: episodes.own_before,
            episodes.after_step: episodes.own_after,
            episodes.sight: episodes.own_sight,
        })  # fmt: skip
    if has_disturbances:
        bound = bound.instead({
            disturbance_kernels.integrate_past_events: one_walker.integrate_past_events,
            episodes.begin_disturbances: episodes.disturbed_begin,
            episodes.one_step: episodes.disturbed_step,
        })  # fmt: skip
    kernels = episodes.reset_kernel, episodes.step_kernel
    return tuple(device.cuda.jit(bound.rebound(kernel)) for kernel in kernels)  # type: ignore[return-value]


class DeviceBatch:
    """A batch of walkers of a scene on a GPU.

    The rules are those of `PassiveWalkerVectorEnv`. The step that ends an episode begins the next.
    Episodes of a walker depend on its key, `seed` plus its index, and not on other walkers.

    Args:
        count: Number of walkers.
        scene: A scene, its name, or its arguments; see `PassiveWalkerEnv`.
        step_limit: Steps after which an episode is truncated.
        seed: Key of the first walker, an integer below 2^64.
        **changes: Arguments of the scene to change; see `PassiveWalkerEnv`.

    Attributes:
        buffers: Actions, observations, rewards and terminations, on the GPU; see
            `episodes.StepBuffers`.
        walkers: State of each walker, on the GPU; see `episodes.DeviceWalkers`.
        step_limit: Steps after which an episode is truncated.

    Raises:
        NoDevice: if there is no GPU.
        SceneError: if the scene is unknown or not supported, or a function cannot be compiled.
    """

    def __init__(
        self,
        count: int,
        scene: Scene | str | Mapping[str, Any] = "level",
        *,
        step_limit: float = math.inf,
        seed: int = 0,
        **changes: Any,
    ) -> None:
        device.need_device()
        self.scene = make_scene(scene, **changes)
        checked(check_supports, self.scene.walker, "gpu episodes")
        self.count = whole(count, "count")
        self.custom = Custom(self.scene, 0)
        for name, rule in self.custom.rules.items():
            if not rule.native:
                raise SceneError(
                    f"{name} cannot be compiled, which walkers on a GPU need ({rule.untraced}): "
                    "use gpw.math, and its where() instead of if"
                )
        self._shown = interface.observation_space(self.scene).shape[0]
        self.observation_size = self.custom.observation_size or self._shown
        self._system = system_in(self.scene, self.scene.walker)
        here = device_code(
            self._system.name,
            pushed=bool(self.scene.pushes),
            watched=bool(self.scene.constraints),
            rules=tuple(self.custom.rules.values()),
        )
        has_disturbances = disturbed(self.scene)
        self._reset, self._step = _kernels(here, has_disturbances)
        drawn = self._drawn()
        constants = bodies(*drawn)[:, 0]
        self.walkers = self._walkers(constants, seed, own=has_disturbances or len(drawn) > 1)
        self.step_limit = step_limit
        self._constants = self._scene_constants(here, constants, observed_bodies(self.scene, drawn))
        self.buffers = self._buffers()

    def _drawn(self) -> list[Walker]:
        """Return the walkers that episodes draw from."""
        starts, random = Starts(self.scene), np.random.default_rng(0)
        pool = self.scene.randomization_pool
        if pool is not None and pool <= DRAWN:
            return [starts.pooled(index) for index in range(pool)]
        count = DRAWN if self.scene.domain_randomization else 1
        return [starts.varied(random) for _ in range(count)]

    def _walkers(self, drawn: NDArray, seed: int, *, own: bool) -> DeviceWalkers:
        count = self.count
        disturbed_count = count if disturbed(self.scene) else 0
        width = drawn.shape[1] + (ROOM if disturbed_count else 0)
        late = self.scene.action_delay, len(self.scene.actions)
        return DeviceWalkers(
            records=device.empty((count, 1), RECORD),
            bodies=device.empty((count, 1, width), float) if own else device.upload(drawn[:, None]),
            ledger=device.empty(count, task.LEDGER),
            reported=device.upload(np.zeros(count, task.LEDGER)),
            keys=device.upload(self._keys(seed)),
            episodes=device.upload(np.zeros(count, np.int64)),
            drawn=device.upload(np.zeros(count, np.int64)),
            disturbances=device.empty(disturbed_count, disturbance_kernels.DISTURBANCE),
            pending=device.empty((disturbed_count, *late), float),
            notes=device.upload(np.zeros(count if self.custom.rules else 0, NOTE)),
        )

    def _keys(self, seed: int | Sequence[int]) -> NDArray[np.uint64]:
        if not isinstance(seed, Sequence | np.ndarray):
            return np.uint64(seed % 2**64) + np.arange(self.count, dtype=np.uint64)
        if len(seed) != self.count:
            raise ValueError(f"{len(seed)} seeds for {self.count} walkers")
        return np.array([each % 2**64 for each in seed], np.uint64)

    def seed(self, seed: int | Sequence[int]) -> None:
        """Set the keys of the walkers to seed, seed + 1, ..., and restart their episodes.

        Args:
            seed: Key of the first walker; or the key of each.

        Raises:
            ValueError: if there is not one key for each walker.
        """
        keys, none = self._keys(seed), np.zeros(self.count, np.int64)
        self.walkers = self.walkers._replace(keys=device.upload(keys), episodes=device.upload(none))

    def set_energy_cost(self, energy: str | None) -> None:
        """Set the work that the energy term counts; see `PassiveWalkerEnv`.

        Raises:
            SceneError: if the kind of work is unknown.
        """
        scene = self.scene if energy is None else make_scene(self.scene, energy=energy)
        rules = device.upload(rules_of(scene, self._system, self.step_limit))
        self._constants = self._constants._replace(rules=rules)

    def _scene_constants(
        self, here: Any, drawn: NDArray, proportions: NDArray[np.float32]
    ) -> SceneConstants:
        starts, scene = Starts(self.scene), self.scene
        nodes, states = starts.nodes
        if len(nodes) == 1:  # the same initial state for all slopes
            nodes, states = np.array([nodes[0], np.inf]), np.repeat(states, 2, axis=0)
        disturbances = Disturbances(scene, self._system.name, 0)
        arrays = SceneConstants(
            here.phases, options(scene.tolerance, scuff=bool(scene.end_on_toe_stub)),
            rules_of(scene, self._system, self.step_limit),
            np.zeros(1, RECORD), np.zeros(1, task.LEDGER),
            np.zeros(1, disturbance_kernels.DISTURBANCE),
            np.array([starts.low, starts.high]), nodes, states, np.array([scene.reset_noise_scale]),
            drawn, proportions, disturbances.settings, here.hooks, *disturbances.terrain,
            np.array([
                self.custom.noted,
                *(here.rules.get(name, 0) for name in ("reward", "terminated", "observation")),
            ]),
        )  # fmt: skip
        return SceneConstants(*map(device.upload, arrays))

    def _buffers(self) -> StepBuffers:
        count, own = self.count, self.custom.observation_size or 0
        return StepBuffers(
            actions=device.upload(np.zeros(count * len(self.scene.actions))),
            observations=device.empty(count * self.observation_size, np.float32),
            rewards=device.empty(count, float),
            terminated=device.empty(count, bool),
            truncated=device.empty(count, bool),
            last=device.upload(np.zeros(count * self.observation_size, np.float32)),
            plain=device.empty(count * self._shown if own else 0, np.float32),
            numbers=device.empty((count, own), float),
        )

    def reset(self, *, stream: Any = 0) -> None:
        """Begin an episode of every walker."""
        self._launch(self._reset, stream)

    def step(self, *, stream: Any = 0) -> None:
        """Step every walker by `buffers.actions`; nothing is transferred.

        A non-finite action leaves its walker unchanged, and its reward is NaN.
        """
        self._launch(self._step, stream)

    def _launch(self, kernel: Any, stream: Any) -> None:
        arrays = self.walkers, self._constants, self.buffers
        device.launch(kernel, self.count, *arrays, stream=stream)
