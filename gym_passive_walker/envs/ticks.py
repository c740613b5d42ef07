"""A batch's ticks and starts as one call each, by where the batch's arrays lie.

Numba takes a third of a microsecond to recognise an array of structures, and a tick needs eight: as
long as the engine needs for a walker. What stays in its place from tick to tick is told once.
"""

from __future__ import annotations

import ctypes
import numpy as np
from numba import carray
from numpy.typing import NDArray

from gym_passive_walker.engine.compiled import PHASE
from gym_passive_walker.engine.jit import Kernel, inlined, jitted, pointer, uniform
from gym_passive_walker.engine.lanes import RESTING
from gym_passive_walker.engine.layout import COURSE, RECORD, TILE
from gym_passive_walker.engine.run import OPTIONS
from gym_passive_walker.envs import task
from gym_passive_walker.envs.scene import Scene
from gym_passive_walker.envs.starts import DRAWS, Starts, between

STAYS = (
    "records", "bodies", "radii", "ledger", "rules", "phases", "options", "tiles", "courses",
    "actions", "rewards", "terminated", "truncated", "generators", "nodes", "states",
)  # fmt: skip
"""Arrays of a batch that stay where they are."""

PLACES = np.dtype(
    [(name, "i8") for name in STAYS]
    + [(f"of_{name}", "i8") for name in STAYS]  # how many entries each has
    + [("constants", "i8"), ("low", "f8"), ("high", "f8"), ("perturbation", "f8")]
)
"""Where they are, and what starts go by besides: constants of a body, and the range of slopes."""

_NUMBER, _WORD, _TRUTH, _PLACES = np.dtype("f8"), np.dtype("i8"), np.dtype("?"), PLACES

_capsule = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(
    ("PyCapsule_GetPointer", ctypes.pythonapi)
)


@inlined
def found(where):
    """What a door has noted, and the walkers there."""
    places = carray(pointer(where), (1,), _PLACES)
    here = places[0]
    records = carray(pointer(here.records), (here.of_records, 1), RECORD)
    bodies = carray(pointer(here.bodies), (here.of_bodies, 1, here.constants), _NUMBER)
    ledger = carray(pointer(here.ledger), (here.of_ledger,), task.LEDGER)
    phases = carray(pointer(here.phases), (here.of_phases,), PHASE)
    return places, records, bodies, ledger, phases


@Kernel
def begin(where, lanes, observations):
    """Begin episodes of walkers that all start alike, by the numbers that each one draws."""
    places, records, bodies, ledger, phases = found(where)
    here = places[0]
    radii = carray(pointer(here.radii), (here.of_radii,), _NUMBER)
    generators = carray(pointer(here.generators), (here.of_generators,), _WORD)
    nodes = carray(pointer(here.nodes), (here.of_nodes,), _NUMBER)
    states = carray(pointer(here.states), (here.of_states, 6), _NUMBER)
    draws, slopes = np.empty((len(lanes), DRAWS)), np.empty(len(lanes))
    for j in range(len(lanes)):
        for k in range(DRAWS):
            draws[j, k] = uniform(generators[lanes[j]])
        slopes[j] = here.low
        if here.low != here.high:
            slopes[j] = here.low + (here.high - here.low) * draws[j, 0]
    gaits = states
    if len(nodes) > 1:
        gaits = np.empty((len(lanes), 6))
        between(nodes, states, slopes, gaits)
    task.begin(
        records, bodies, radii, ledger, np.zeros(1, RECORD), np.zeros(1, task.LEDGER), phases,
        lanes, slopes, gaits, draws, here.perturbation, observations,
    )  # fmt: skip


@Kernel
def draw(where, lanes, draws):
    """Draw the numbers that some walkers' starts take, (lanes, DRAWS)."""
    here = carray(pointer(where), (1,), _PLACES)[0]
    generators = carray(pointer(here.generators), (here.of_generators,), _WORD)
    for j in range(len(lanes)):
        for k in range(DRAWS):
            draws[j, k] = uniform(generators[lanes[j]])


@jitted
def tick(where, again, observations, rewards, terminated, truncated):
    """A step of every walker by the actions that lie there, or the start `again` of who rests."""
    places, records, bodies, ledger, phases = found(where)
    here = places[0]
    rules = carray(pointer(here.rules), (1,), task.RULES)
    options = carray(pointer(here.options), (1,), OPTIONS)
    tiles = carray(pointer(here.tiles), (1,), TILE)
    courses = carray(pointer(here.courses), (1,), COURSE)
    actions = carray(pointer(here.actions), (here.of_actions,), _NUMBER)
    answer = task.step(
        records, bodies, ledger, rules, phases, options, tiles, courses, actions, observations,
        rewards, terminated, truncated,
    )  # fmt: skip
    if again and answer[0] < 0:
        resting = np.empty(len(records), np.int64)
        count = 0
        for i in range(len(records)):
            if records[i, 0].outcome == RESTING:
                resting[count] = i
                count += 1
        begin(where, resting[:count], observations)
    return answer


@Kernel
def step(where, again, observations, rewards, terminated, truncated):
    """See `tick`; returns what `task.step` does."""
    return tick(where, again, observations, rewards, terminated, truncated)


@Kernel
def step_here(where, observations):
    """Likewise, with rewards and endings in the batch's own arrays."""
    here = carray(pointer(where), (1,), _PLACES)[0]
    count = here.of_records
    return tick(
        where, False, observations, carray(pointer(here.rewards), (count,), _NUMBER),
        carray(pointer(here.terminated), (count,), _TRUTH),
        carray(pointer(here.truncated), (count,), _TRUTH),
    )  # fmt: skip


@Kernel
def tell(where, asked, steps, counts, measures):
    """`task.tell` of the walkers there."""
    here = carray(pointer(where), (1,), _PLACES)[0]
    ledger = carray(pointer(here.ledger), (here.of_ledger,), task.LEDGER)
    return task.tell(ledger, asked, steps, counts, measures)


class Door:
    """Where compiled code finds the arrays of a batch.

    Args:
        scene: What is simulated.
        count: How many walkers.
        **arrays: Of STAYS; they stay where they are from now on.

    Attributes:
        where: The address that kernels take.
        actions: Of all walkers, flat, to be filled before a step.
        results: Rewards and both kinds of endings, (count,), as `step_here` leaves them.
        of_step: What the first walker's ledger tells of EVERY_STEP but the strides.
        of_stride: What it tells of EVERY_STRIDE.
        counts: Its strides, and its outcome.
    """

    def __init__(self, scene: Scene, count: int, **arrays: NDArray) -> None:
        self.actions = np.zeros(count * len(scene.actions))
        self.results = np.zeros(count), np.zeros(count, bool), np.zeros(count, bool)
        self._randoms: list[np.random.Generator] | None = None
        self._kept: dict[str, NDArray] = {}
        self._places = np.zeros(1, PLACES)
        self._places["perturbation"] = scene.perturbation
        self._places["constants"] = arrays["bodies"].shape[-1]
        self.where: int = self._places.ctypes.data
        results = dict(zip(("rewards", "terminated", "truncated"), self.results, strict=True))
        self._put(actions=self.actions, **results, **arrays)
        ledger, steps = arrays["ledger"], len(task.EVERY_STEP) - 1
        words = steps + len(task.EVERY_STRIDE)
        numbers = ledger.view(np.float64)[:words]
        self.of_step, self.of_stride = numbers[:steps], numbers[steps:]
        self.counts = ledger.view(np.int64)[words : words + 2]

    def _put(self, **arrays: NDArray) -> None:
        for name, array in arrays.items():
            assert array.flags.c_contiguous
            self._kept[name] = array
            self._places[name], self._places[f"of_{name}"] = array.ctypes.data, len(array)

    def draw_from(self, randoms: list[np.random.Generator]) -> None:
        """Draw from these generators from now on."""
        if randoms is not self._randoms:
            self._randoms = randoms
            found = [_capsule(random.bit_generator.capsule, b"BitGenerator") for random in randoms]
            self._put(generators=np.array(found, np.int64))

    def begin_at(self, starts: Starts) -> None:
        """Begin all episodes there, from now on."""
        if "nodes" not in self._kept:
            nodes, states = starts.nodes
            self._put(nodes=nodes, states=states)
            self._places["low"], self._places["high"] = starts.low, starts.high
