"""A batch of walkers of a scene on a GPU."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import whole
from gym_passive_walker.devices.gpu import device, episodes, primitives
from gym_passive_walker.devices.gpu.columns import WalkerColumns
from gym_passive_walker.devices.gpu.lane import DeviceCode, device_code
from gym_passive_walker.engine import lanes
from gym_passive_walker.engine.layout import layout_of
from gym_passive_walker.engine.run import options
from gym_passive_walker.envs import (
    disturbance_kernels,
    interface,
    memory,
    one_walker,
    task,
    transitions,
)
from gym_passive_walker.envs.batch import observed_bodies, rules_of, system_in
from gym_passive_walker.envs.constraints import ROOM
from gym_passive_walker.envs.custom import Custom
from gym_passive_walker.envs.disturbances import Disturbances, disturbed
from gym_passive_walker.envs.randomized import settled
from gym_passive_walker.gaits.scenes.randomization import CURRICULUM, CURRICULUM_LEVELS, Drawn
from gym_passive_walker.gaits.scenes.scene import SceneError, SceneLike, make_scene
from gym_passive_walker.gaits.scenes.starts import Starts
from gym_passive_walker.models.model import bodies

DRAWN = 4096
"""Largest `randomization_pool`, and that of scenes with `domain_randomization` that have none."""

_LARGEST_KEY = 2**64 - 1


@lru_cache
def _kernels(
    here: DeviceCode, has_disturbances: bool, kinds: Any, own: Any, read: int
) -> list[Any]:
    """Return the kernels that reset and step walkers of a system; see `episodes`.

    Args:
        here: Code of the system.
        has_disturbances: Whether the scene has disturbances.
        kinds: Types of the arrays, from `primitives.type_of_arrays`.
        own: Names of arrays in the columns, and their places.
        read: Words of a column that a step reads.
    """
    places = dict(own)
    records = places["records"]
    names = here.scratch | {
        "READ": read,
        "WORDS": sum(place.words for place in places.values()),
        "PHASE_WORD": records.first + records.kind.fields["phase"][1] // 8,
    }
    bound = here.bound.instead({episodes.unpack: primitives.unpacker(kinds, places)})
    for each in (episodes.fetch, episodes.store):
        moved = bound.rebound(each)
        moved.__globals__.update(names)
        bound = bound.instead({each: primitives.jitted(moved)})
    if has_disturbances:
        bound = bound.instead({
            disturbance_kernels.integrate_past_events: one_walker.integrate_past_events,
            episodes.begin_disturbances: disturbance_kernels.begin,
            episodes.settle: episodes.own_settle,
            task.step: disturbance_kernels.step,
            episodes.note_disturbances: episodes.own_note,
        })  # fmt: skip
    if here.rules:
        bound = bound.instead({
            episodes.begin_notes: episodes.own_begin,
            episodes.before_step: transitions.before,
            episodes.after_step: episodes.own_after,
        })  # fmt: skip
    if "observation" in here.rules:
        bound = bound.instead({episodes.show_observation: episodes.own_show})
    once = bound.instead({lanes.integrate_phase: episodes.integrate_once})
    made = [
        once.rebound(episodes.plain_kernel),
        bound.rebound(episodes.event_kernel),
        bound.rebound(episodes.reset_kernel),
    ]
    for kernel in made:
        kernel.__globals__.update(names)
    return [device.cuda.jit(kernel) for kernel in made]


class DeviceBatch:
    """A batch of walkers of a scene on a GPU.

    The rules are those of `PassiveWalkerVectorEnv`. The step that ends an episode begins the next.
    Episodes of a walker depend on its key, `seed` plus its index, and not on other walkers.

    Args:
        count: Number of walkers.
        scene: A scene, its name, or its arguments; see `PassiveWalkerEnv`.
        step_limit: Steps after which an episode is truncated.
        seed: Key of the first walker, an integer from 0 to 2^64 - 1.
        **changes: Arguments of the scene to change; see `PassiveWalkerEnv`.

    Attributes:
        scene: The scene; one with `domain_randomization` has a `randomization_pool` here.
        drawn: Values that a scene with `domain_randomization` draws, by name, each (pool,): rows of
            the arrays `drawn` and `reported_draw`.
        arrays: Arrays on the GPU, by name; see `envs.memory` and `episodes.DEVICE_ARRAYS`. Their
            last axis is of walkers. Fill `actions`, (actions, count), before a step, which fills
            `shown` (observations), (size, count), and `rewards`, `terminated`, `truncated`, each
            (count,). Arrays of structures are `columns.Fields`: `arrays.ledger["steps"]`.
        step_limit: Steps after which an episode is truncated.

    Raises:
        NoDevice: if there is no GPU.
        SceneError: if the scene is unknown or not supported, or a function cannot be compiled.
        ValueError: if the seed is no such integer.
    """

    def __init__(
        self,
        count: int,
        scene: SceneLike = "level",
        *,
        step_limit: float = math.inf,
        seed: int = 0,
        **changes: Any,
    ) -> None:
        device.need_device()
        self.scene = made = make_scene(scene, **changes)
        if made.domain_randomization and not (made.randomization_pool or DRAWN + 1) <= DRAWN:
            self.scene = make_scene(made, randomization_pool=DRAWN)
        self.count = whole(count, "count")
        if self.scene.groups:
            raise SceneError(
                "walkers on a GPU have one observation for actor and critic: give observation a "
                "function, or use the CPU"
            )
        self.custom = Custom(self.scene, 1)  # as a thread has them
        for name, rule in self.custom.rules.items():
            if not rule.native:
                raise SceneError(
                    f"{name} cannot be compiled, which walkers on a GPU need ({rule.untraced}): "
                    "use gpw.math, and its where() instead of if"
                )
        shown = interface.observation_space(self.scene).shape[0]
        self.observation_size = self.custom.observation_size or shown
        self._system = system_in(self.scene, self.scene.walker)
        here = device_code(
            self._system.name,
            pushed=bool(self.scene.pushes),
            watched=bool(self.scene.constraints),
            rules=tuple(self.custom.rules.values()),
        )
        self.step_limit = step_limit
        self._columns = there = self._made(here, shown)
        self._place()
        self.seed(seed)
        kinds, own = primitives.type_of_arrays(there.ones), tuple(there.own.items())
        kernels = _kernels(here, disturbed(self.scene), kinds, own, there.read)
        self._plain, self._events, self._reset = kernels

    def _drawn(self, starts: Starts) -> list[Drawn]:
        """Return what episodes draw, of each level of a curriculum one after another."""
        drawing, pool = starts.randomization, self.scene.randomization_pool
        if drawing is None or pool is None:
            return [Drawn(self.scene.walker, ())]
        levels = range(CURRICULUM_LEVELS + 1) if drawing.curriculum else (CURRICULUM_LEVELS,)
        return [drawing.member(index, level) for level in levels for index in range(pool)]

    def _made(self, code: DeviceCode, shown: int) -> WalkerColumns:
        """Return the arrays on the GPU."""
        scene, starts = self.scene, Starts(self.scene)
        draws = self._drawn(starts)
        drawn, names = [each.walker for each in draws], scene.randomized
        values = np.array([each.values for each in draws]).reshape(len(draws), -1)
        self.drawn = dict(zip(names, values.T, strict=True))
        pool, (nodes, states) = bodies(*drawn)[:, 0], starts.nodes
        if len(nodes) == 1:  # the same initial state for all slopes
            nodes, states = np.array([nodes[0], np.inf]), np.repeat(states, 2, axis=0)
        given = {
            "phases": code.phases, "hooks": code.hooks, "nodes": nodes,
            "options": options(scene.tolerance, scuff=bool(scene.end_on_toe_stub)),
            "rules": rules_of(scene, self._system, self.step_limit), "pool": pool,
            "slope_range": np.array([starts.low, starts.high]), "states": states,
            "proportions": observed_bodies(scene, drawn),
            "settled": settled(scene, names, values),
            "growth": np.array([
                scene.randomization_pool or 1, scene.domain_randomization.get(CURRICULUM, 0)
            ]),
        }  # fmt: skip
        features, width = [], pool.shape[1]
        if disturbed(scene):
            features, width = ["disturbed"], width + ROOM
            given |= Disturbances(scene, self._system.name, 1).arrays()
        if self.custom.rules:
            features.append("custom")
            given |= self.custom.arrays(code.rules)
        lengths = {
            "walkers": 1, "rows": 1, "constants": width, "seen": shown,
            "channels": len(scene.actions), "delay": int(scene.ends("action_delay")[1]),
            "shown": self.observation_size, "listable": self.count,
        }  # fmt: skip
        declared = memory.present(*features) | episodes.DEVICE_ARRAYS
        one = memory.made(declared, layout_of(self._system), lengths, given)
        if not self.custom.observation_size:
            one["shown"] = one["observations"]
        return WalkerColumns(
            self.count, declared, one, episodes.GIVEN_ARRAYS, episodes.WRITTEN_ARRAYS
        )

    def _place(self) -> None:
        """Set the arrays that kernels find."""
        self.arrays = self._columns.arrays
        self._table, self._words = device.placed(primitives.words_of(self._columns))

    def _keys(self, seed: Any) -> NDArray[np.uint64]:
        """Return the keys of the walkers, (count,); see `seed`."""
        if np.ndim(seed) == 0:
            first = np.uint64(whole(seed, "seed", 0, _LARGEST_KEY))
            return first + np.arange(self.count, dtype=np.uint64)
        if len(seed) != self.count:
            raise ValueError(f"{len(seed)} seeds for {self.count} walkers")
        keys = [whole(each, f"seed[{i}]", 0, _LARGEST_KEY) for i, each in enumerate(seed)]
        return np.array(keys, np.uint64)

    def seed(self, seed: int | Sequence[int]) -> None:
        """Set the keys of the walkers to seed, seed + 1, ..., and restart their episodes.

        Args:
            seed: Key of the first walker; or the key of each.

        Raises:
            ValueError: if there is not one key for each walker, or one is not a whole number from 0
                to 2^64 - 1.
        """
        device.write(self.arrays.keys, self._keys(seed))
        device.write(self.arrays.episodes, np.zeros(self.count, np.int64))

    def set_energy_cost(self, energy: str | None) -> None:
        """Set the work that the energy term counts; see `PassiveWalkerEnv`.

        Raises:
            SceneError: if the kind of work is unknown.
        """
        scene = self.scene if energy is None else make_scene(self.scene, energy=energy)
        self._columns.replace(rules=rules_of(scene, self._system, self.step_limit))
        self._place()

    def reset(self, *, stream: Any = 0) -> None:
        """Begin an episode of every walker."""
        self._launch(self._reset, stream)

    def step(self, *, stream: Any = 0) -> None:
        """Step every walker by the actions in `arrays`; nothing is transferred.

        A non-finite action leaves its walker unchanged, and its reward is NaN.
        """
        self._launch(self._plain, stream)
        self._launch(self._events, stream)

    def _launch(self, kernel: Any, stream: Any) -> None:
        device.launch(kernel, self.count, self._table, stream=stream)
