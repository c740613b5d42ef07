"""A scene's walkers on a device: they begin, act and begin again there."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.arguments import whole
from gym_passive_walker.engine.layout import RECORD
from gym_passive_walker.engine.run import options
from gym_passive_walker.envs import fates, task
from gym_passive_walker.envs.batch import rules_of, system_in
from gym_passive_walker.envs.custom import RULES
from gym_passive_walker.envs.disturbances import Disturbances, disturbed
from gym_passive_walker.envs.reality import ROOM
from gym_passive_walker.envs.scene import Scene, make_scene, plain
from gym_passive_walker.envs.starts import Starts
from gym_passive_walker.gpu import device, episodes
from gym_passive_walker.gpu.bookkeeping import Bound
from gym_passive_walker.gpu.episodes import Play, Walkers, World
from gym_passive_walker.gpu.lane import machinery
from gym_passive_walker.gpu.strides import Strides
from gym_passive_walker.physics.systems import bodies

DRAWN = 4096
"""Walkers that the episodes of a scene with random ones draw from."""


WAYS = "loop", "sorted", "passes"
"""How threads go through phases: each takes its walker through all of them, in the order of their
numbers or so that neighbours begin in the same phase; or one phase after the other, over those
alone who wait in it, where nothing befalls walkers on their way."""


@lru_cache
def _kernels(
    system: str, pushed: bool, watched: bool, fateful: bool, way: str
) -> tuple[Any, Any, Any]:
    """What resets walkers, what steps them, and what commands them before passes."""
    bound = machinery(system, pushed=pushed, watched=watched).bound
    if fateful:
        bound = bound.instead({
            fates.copied: episodes.as_it_is,
            fates.carry_through: episodes.carry_through,
            episodes.calm_begin: episodes.fateful_begin,
            episodes.calm_step: episodes.fateful_step,
        })  # fmt: skip
    if way == "passes":
        bound = bound.instead({episodes.calm_step: episodes.calm_settle})
    kernels = episodes.reset_kernel, episodes.step_kernel, episodes.command_kernel
    return tuple(device.kernel(bound.rebound(kernel)) for kernel in kernels)  # type: ignore[return-value]


class Crowd:
    """Walkers of a scene, on a device.

    A walker's episodes are those of its key, `seed` plus its number, whoever walks beside it. They
    go by the rules of `PassiveWalkerVectorEnv`, and the next one begins in the step that ends one.

    Args:
        count: How many walkers.
        scene: As of `PassiveWalkerEnv`.
        step_limit: Steps after which an episode is truncated.
        seed: Of the first walker: any whole number below 2^64.
        way: How threads go through phases, one of WAYS.
        **changes: As of `PassiveWalkerEnv`.

    Attributes:
        play: Actions, observations, rewards and endings, on the device; see `episodes.Play`.
        walkers: What is kept of each walker, likewise.

    Raises:
        NoDevice: if there is no device.
        SceneError: if there is no such scene.
    """

    def __init__(
        self,
        count: int,
        scene: Scene | str | Mapping[str, Any] = "level",
        *,
        step_limit: float = math.inf,
        seed: int = 0,
        way: str = "sorted",
        **changes: Any,
    ) -> None:
        device.need_device()
        self.scene = plain(make_scene(scene, **changes), "walkers on a device have", *RULES)
        self.count = whole(count, "count")
        self.seen = task.SIZE + (self.scene.command is not None) + 2 * self.scene.preview
        system, fateful = system_in(self.scene, self.scene.walker), disturbed(self.scene)
        self._system, pushed, watched = system, bool(self.scene.pushes), bool(self.scene.reality)
        if way not in WAYS or (fateful and way == "passes"):
            raise ValueError(
                f"threads go through phases as {', '.join(WAYS)} (passes where nothing befalls "
                f"walkers on their way), not {way!r}"
            )
        self._way = way
        kernels = _kernels(system.name, pushed, watched, fateful, way)
        self._reset, self._step, self._command = kernels
        here = machinery(system.name, pushed=pushed, watched=watched)
        drawn = self._drawn()
        self.walkers = self._walkers(drawn, seed, own=fateful or len(drawn) > 1)
        self._limit = step_limit
        self._world = self._as_told(here, drawn)
        self.play = self._play()
        self._order, self._none = _ordering()
        self._passes = Strides(system.name, "passes") if way == "passes" else None

    def _drawn(self) -> NDArray[np.float64]:
        """Constants of the walkers that episodes draw from."""
        starts, random = Starts(self.scene), np.random.default_rng(0)
        if not self.scene.randomise:
            return bodies(self.scene.walker)[:, 0]
        return bodies(*(starts.varied(random) for _ in range(DRAWN)))[:, 0]

    def _walkers(self, drawn: NDArray, seed: int, *, own: bool) -> Walkers:
        count, fateful = self.count, disturbed(self.scene)
        width = drawn.shape[1] + (ROOM if fateful else 0)
        late = self.scene.motor_delay, len(self.scene.actions)
        return Walkers(
            records=device.room((count, 1), RECORD),
            bodies=device.room((count, 1, width), float) if own else device.put(drawn[:, None]),
            ledger=device.room(count, task.LEDGER),
            told=device.put(np.zeros(count, task.LEDGER)),
            keys=device.put(self._keys(seed)),
            episodes=device.put(np.zeros(count, np.int64)),
            fates=device.room(count if fateful else 0, fates.FATE),
            pending=device.room((count if fateful else 0, *late), float),
            order=device.room(count if self._way == "sorted" else 0, np.int64),
            counts=device.room(2, np.int64),
        )

    def _keys(self, seed: int) -> NDArray[np.uint64]:
        return np.uint64(seed % 2**64) + np.arange(self.count, dtype=np.uint64)

    def seed(self, seed: int) -> None:
        """Begin all over, each walker with a key of its own, from a seed on."""
        keys, none = self._keys(seed), np.zeros(self.count, np.int64)
        self.walkers = self.walkers._replace(keys=device.put(keys), episodes=device.put(none))

    def charge_for(self, energy: str | None) -> None:
        """Charge the motors of all walkers for another kind of work; see `PassiveWalkerEnv`.

        Raises:
            SceneError: if there is no such kind.
        """
        scene = self.scene if energy is None else make_scene(self.scene, energy=energy)
        rules = device.put(rules_of(scene, self._system, self._limit))
        self._world = self._world._replace(rules=rules)

    def _as_told(self, here: Any, drawn: NDArray) -> World:
        starts, scene = Starts(self.scene), self.scene
        nodes, states = starts.nodes
        if len(nodes) == 1:  # as it is, wherever it begins
            nodes, states = np.array([nodes[0], np.inf]), np.repeat(states, 2, axis=0)
        befall = Disturbances(scene, self._system.name, 0)
        arrays = World(
            here.phases, options(scene.tolerance, scuff=bool(scene.stub)),
            rules_of(scene, self._system, self._limit),
            np.zeros(1, RECORD), np.zeros(1, task.LEDGER), np.zeros(1, fates.FATE),
            np.array([starts.low, starts.high]), nodes, states, np.array([scene.perturbation]),
            drawn, befall.odds, here.natives, *befall.terrain,
        )  # fmt: skip
        return World(*map(device.put, arrays))

    def _play(self) -> Play:
        count = self.count
        return Play(
            actions=device.put(np.zeros(count * len(self.scene.actions))),
            observations=device.room(count * self.seen, np.float32),
            rewards=device.room(count, float),
            terminated=device.room(count, bool),
            truncated=device.room(count, bool),
            last=device.put(np.zeros(count * self.seen, np.float32)),
        )

    def reset(self, *, stream: Any = 0) -> None:
        """Begin an episode of every walker."""
        arguments = self.walkers, self._world, self.play.observations
        device.launch(self._reset, self.count, *arguments, stream=stream)

    def step(self, *, stream: Any = 0) -> None:
        """A step of every walker, by `play.actions`: nothing is moved to or from the device.

        A walker whose action is no finite number stays as it is, and its reward is not a number.
        """
        count, everything = self.count, (self.walkers, self._world, self.play)
        if self._way == "sorted":
            device.launch(self._none, 1, self.walkers.counts, stream=stream)
            device.launch(self._order, count, self.walkers, stream=stream)
        elif self._passes:
            device.launch(self._command, count, *everything, stream=stream)
            self._passes(
                self.walkers.records, self.walkers.bodies, tolerance=self.scene.tolerance,
                scuff=bool(self.scene.stub), from_section=False, stream=stream,
            )  # fmt: skip
        device.launch(self._step, count, *everything, stream=stream)


@lru_cache
def _ordering() -> tuple[Any, Any]:
    """What orders walkers, and what begins to count them."""
    order = Bound({}).rebound(episodes.order_kernel)
    return device.kernel(order), device.kernel(device.none_kernel)
