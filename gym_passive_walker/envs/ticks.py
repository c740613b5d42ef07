"""A batch's ticks and starts as one call each, by where the batch's arrays lie.

Numba takes a third of a microsecond to recognise an array of structures, and a tick needs eight:
longer than the engine takes for one walker. What stays in its place is noted once.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.engine.compiled import PHASE
from gym_passive_walker.engine.jit import Kernel, inlined, jitted, named, uniform, view
from gym_passive_walker.engine.lanes import RESTING
from gym_passive_walker.engine.layout import (
    NARROW,
    PAIR,
    Layout,
    history_for,
    layout_in,
    record_for,
    tile_for,
)
from gym_passive_walker.engine.run import OPTIONS
from gym_passive_walker.envs import task, transitions
from gym_passive_walker.envs.custom import Custom
from gym_passive_walker.envs.scene import Scene
from gym_passive_walker.envs.starts import DRAWS, Starts, between
from gym_passive_walker.envs.transitions import note_for

STAYS = (
    "records", "bodies", "radii", "ledger", "rules", "phases", "options", "tiles", "histories",
    "actions", "rewards", "terminated", "truncated", "generators", "nodes", "states", "notes",
)  # fmt: skip
"""Arrays of a batch that stay where they are."""

PLACES = np.dtype(
    [(name, "i8") for name in STAYS]
    + [(f"of_{name}", "i8") for name in STAYS]  # how many entries each has
    + [("constants", "i8"), ("low", "f8"), ("high", "f8"), ("reset_noise_scale", "f8")]
    + [("noted", "i8"), ("paid", "i8"), ("ends", "i8"), ("native", "i8")]
)
"""Where they are, and what starts go by besides: constants of a body, and the range of slopes; and
what rules of the user's own need and where their native functions lie: see `transitions.after`."""

_NUMBER, _WORD, _TRUTH = np.dtype("f8"), np.dtype("i8"), np.dtype("?")
_ALL = 1 << 62

_capsule = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(
    ("PyCapsule_GetPointer", ctypes.pythonapi)
)


@jitted
def fill(where, lanes, draws):
    """See `draw`."""
    here = view(where, (1,), PLACES)[0]
    generators = view(here.generators, (here.of_generators,), _WORD)
    for j in range(len(lanes)):
        for k in range(DRAWS):
            draws[j, k] = uniform(generators[lanes[j]])


@Kernel
def draw(where, lanes, draws):
    """Draw the numbers that some walkers' starts take, (lanes, DRAWS)."""
    fill(where, lanes, draws)


class Kernels(NamedTuple):
    """Compiled calls of a batch, for walkers with records of one layout."""

    begin: Kernel
    step: Kernel
    step_here: Kernel
    write_info: Kernel


@cache
def kernels_for(layout: Layout) -> Kernels:
    """The compiled calls of batches of which the records have a layout."""
    record, ledger_of, rules_of = (
        record_for(layout),
        task.ledger_for(layout),
        task.rules_for(layout),
    )
    note, history, tile = note_for(layout), history_for(layout), tile_for(PAIR, layout=layout)
    size = 2 * layout.links

    def within(compiler: Callable[..., Any]) -> Callable[..., Any]:
        return lambda function: compiler(named(function, "wide" * (layout != NARROW)))

    @within(inlined)
    def found(where, first, last):
        """What a `Door` has noted, and its walkers from one to before another."""
        places = view(where, (1,), PLACES)
        here = places[0]
        records = view(here.records, (here.of_records, 1), record)[first:last]
        bodies = view(here.bodies, (here.of_bodies, 1, here.constants), _NUMBER)
        if here.of_bodies > 1:
            bodies = bodies[first:last]
        ledger = view(here.ledger, (here.of_ledger,), ledger_of)[first:last]
        phases = view(here.phases, (here.of_phases,), PHASE)
        return places, records, bodies, ledger, phases

    @within(Kernel)
    def begin(where, lanes, alike, slopes, gaits, draws, observations):
        """Begin episodes of some walkers, as `task.begin` does.

        Args:
            where: Address of a `Door`.
            lanes: Which walkers.
            alike: Whether they start as the `Door` has noted, by the numbers that each one draws;
                the next three are ignored then.
            slopes: As for `task.begin`, as all that follow.
            gaits: Theirs.
            draws: Theirs.
            observations: Filled, flat.
        """
        places, records, bodies, ledger, phases = found(where, 0, _ALL)
        here = places[0]
        radii = view(here.radii, (here.of_radii,), _NUMBER)
        if alike:
            draws, slopes = np.empty((len(lanes), DRAWS)), np.empty(len(lanes))
            fill(where, lanes, draws)
            for j in range(len(lanes)):
                slopes[j] = here.low
                if here.low != here.high:
                    slopes[j] = here.low + (here.high - here.low) * draws[j, 0]
            nodes = view(here.nodes, (here.of_nodes,), _NUMBER)
            gaits = view(here.states, (here.of_states, size), _NUMBER)
            if len(nodes) > 1:
                states, gaits = gaits, np.empty((len(lanes), size))
                between(nodes, states, slopes, gaits)
        task.begin(
            records, bodies, radii, ledger, np.zeros(1, record), np.zeros(1, ledger_of), phases,
            lanes, slopes, gaits, draws, here.reset_noise_scale, observations,
        )  # fmt: skip

    @within(jitted)
    def tick(where, first, last, tiles, histories, observations, rewards, terminated, truncated):
        """A step of some walkers by the actions that lie there; see `task.step`."""
        places, records, bodies, ledger, phases = found(where, first, last)
        here = places[0]
        rules = view(here.rules, (1,), rules_of)
        options = view(here.options, (1,), OPTIONS)
        actions = view(here.actions, (here.of_actions,), _NUMBER)
        each = rules[0].actions
        own = actions[first * each : last * each]
        notes = view(here.notes, (here.of_notes,), note)[first:last]
        if here.of_notes > 0:
            transitions.before(records, notes, here.noted)
        wrong, strides, endings = task.step(
            records, bodies, ledger, rules, phases, options, view(tiles, (1,), tile),
            view(histories, (1,), history), own, observations, rewards, terminated, truncated,
        )  # fmt: skip
        if here.of_notes > 0 and wrong < 0:
            endings += transitions.after(
                records, ledger, rules, phases, own, notes, here.noted, here.paid, here.ends,
                here.native != 0, rewards, terminated,
            )  # fmt: skip
        return wrong, strides, endings

    @within(Kernel)
    def step(
        where, first, last, tiles, histories, again, observations, rewards, terminated, truncated
    ):  # fmt: skip
        """A step of the walkers from `first` to before `last`; `again` starts those that rest.

        Args:
            where: Address of a `Door`.
            first: The first of them.
            last: The one after the last of them.
            tiles: Address of the tile to work with.
            histories: Address of the guard history to work with.
            again: Whether they are all there are, and those that rest begin another episode.
            observations: Filled, flat, as all that follow.
            rewards: Filled.
            terminated: Filled.
            truncated: Filled.

        Returns:
            As `task.step`.
        """
        answer = tick(
            where, first, last, tiles, histories, observations, rewards, terminated, truncated
        )  # fmt: skip
        if again and answer[0] < 0:
            _, records, _, _, _ = found(where, first, last)
            resting, count = np.empty(len(records), np.int64), 0
            for i in range(len(records)):
                if records[i, 0].outcome == RESTING:
                    resting[count] = i
                    count += 1
            none = np.empty((0, size))
            begin(where, resting[:count], True, np.empty(0), none, none, observations)
        return answer

    @within(Kernel)
    def step_here(where, observation):
        """A step of a single walker, with reward and endings in the batch's own arrays."""
        here = view(where, (1,), PLACES)[0]
        return tick(
            where, 0, 1, here.tiles, here.histories, observation,
            view(here.rewards, (1,), _NUMBER),
            view(here.terminated, (1,), _TRUTH),
            view(here.truncated, (1,), _TRUTH),
        )  # fmt: skip

    @within(Kernel)
    def write_info(where, asked, steps, counts, measures):
        """`task.write_info` of the walkers there."""
        here = view(where, (1,), PLACES)[0]
        ledger = view(here.ledger, (here.of_ledger,), ledger_of)
        return task.write_info(ledger, asked, steps, counts, measures)

    return Kernels(begin, step, step_here, write_info)


class Door:
    """Where compiled code finds the arrays of a batch.

    Args:
        scene: What is simulated.
        count: How many walkers.
        **arrays: Of STAYS; they stay where they are from now on.

    Attributes:
        where: The address that kernels take.
        kernels: The kernels, for records of these walkers' layout.
        step_here: Of these, compiled, that which single environments call.
        desk: Those of the tile and the history where one thread works.
        actions: Of all walkers, flat, to be filled before a step.
        results: Rewards and both kinds of endings, (count,), as `step_here` leaves them.
        of_step: Numbers of EVERY_STEP but the strides, in the first walker's ledger.
        of_stride: Numbers of EVERY_STRIDE in it.
        counts: Its strides, and its outcome.
    """

    def __init__(self, scene: Scene, count: int, **arrays: NDArray) -> None:
        self.actions = np.zeros(count * len(scene.actions))
        self.results = np.zeros(count), np.zeros(count, bool), np.zeros(count, bool)
        self._randoms: list[np.random.Generator] | None = None
        self._kept: dict[str, NDArray] = {}
        self._places = np.zeros(1, PLACES)
        self._places["reset_noise_scale"] = scene.reset_noise_scale
        self._places["constants"] = arrays["bodies"].shape[-1]
        self.where: int = self._places.ctypes.data
        self.kernels = kernels_for(layout_in(arrays["records"].dtype))
        self.step_here = self.kernels.step_here.compiled
        self.desk = arrays["tiles"].ctypes.data, arrays["histories"].ctypes.data
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

    def judge_by(self, custom: Custom) -> None:
        """Judge steps by rules of the user's own from now on."""
        self._put(notes=custom.notes)
        self._places["noted"], self._places["native"] = custom.noted, custom.native
        self._places["paid"] = custom.address("reward")
        self._places["ends"] = custom.address("terminated")

    def begin_at(self, starts: Starts) -> None:
        """Begin all episodes there, from now on."""
        if "nodes" not in self._kept:
            nodes, states = starts.nodes
            self._put(nodes=nodes, states=states)
            self._places["low"], self._places["high"] = starts.low, starts.high
