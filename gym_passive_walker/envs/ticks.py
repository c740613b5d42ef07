"""Compiled control steps and starts of a batch, called with the addresses of its arrays.

Numba takes 0.3 µs to unbox an array of structures, and a control step needs eight. That is longer
than the engine takes for one walker. The addresses of arrays are therefore stored once.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.engine.compiled import PHASE
from gym_passive_walker.engine.jit import (
    Kernel,
    draw_uniform,
    entry,
    jitted,
    merged,
    named,
    stack,
    view,
)
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
from gym_passive_walker.envs import disturbance_kernels, task, transitions
from gym_passive_walker.envs.constraints import HOOK
from gym_passive_walker.envs.custom import Custom
from gym_passive_walker.envs.disturbance_kernels import DISTURBANCE, SETTINGS
from gym_passive_walker.envs.transitions import TIMED_OUT, note_for
from gym_passive_walker.gaits.scenes.scene import Scene
from gym_passive_walker.gaits.scenes.starts import DRAWS, Starts, interpolate_states

STAYS = (
    "records", "bodies", "radii", "ledger", "rules", "phases", "options", "tiles", "histories",
    "actions", "observations", "rewards", "terminated", "truncated", "generators", "nodes",
    "states", "notes", "disturbances", "pending", "settings", "hooks", "table", "spread",
    "acted",
)  # fmt: skip
"""Arrays of a batch that are allocated once; those that its scene does not need are empty."""

ADDRESSES = np.dtype(
    [(name, "i8") for name in STAYS]
    + [(f"of_{name}", "i8") for name in STAYS]  # number of entries of each
    + [("constants", "i8"), ("low", "f8"), ("high", "f8"), ("reset_noise_scale", "f8")]
    + [("noted", "i8"), ("paid", "i8"), ("ends", "i8"), ("native", "i8"), ("delay", "i8")]
)
"""Addresses of these arrays; the range of slopes at a start in rad; addresses of users' compiled
functions (see `transitions.after`); and the number of control steps of `action_delay`."""

_NUMBER, _SINGLE = np.dtype("f8"), np.dtype("f4")
_WORD, _BOOLEAN = np.dtype("i8"), np.dtype("?")
_ALL, _HALF = 1 << 62, 32
FEW = 64  # walkers that begin together: their draws and gaits are on the stack

_capsule = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(
    ("PyCapsule_GetPointer", ctypes.pythonapi)
)


@jitted
def fill(where, lanes, draws):
    """Implement `draw` for compiled callers."""
    here = view(where, (1,), ADDRESSES)[0]
    generators = view(here.generators, (here.of_generators,), _WORD)
    for j in range(len(lanes)):
        for k in range(DRAWS):
            draws[j, k] = draw_uniform(generators[lanes[j]])


@jitted
def clear(place, count):
    """Set words at an address to zero."""
    words = view(place, (count,), _WORD)
    for k in range(count):
        words[k] = 0


@Kernel
def draw_numbers(where, lanes, draws):
    """Draw the random numbers of some walkers' starts, (lanes, DRAWS)."""
    fill(where, lanes, draws)


def counts(answer: int) -> tuple[int, int]:
    """Return the numbers of strides and of episodes that end, from the answer of a kernel."""
    return answer >> _HALF, answer & ((1 << _HALF) - 1)


class Kernels(NamedTuple):
    """Compiled calls of a batch, for walkers with records of one layout."""

    begin: Kernel
    begin_alike: Kernel
    step: Kernel
    step_here: Kernel
    write_info: Kernel


@cache
def kernels_for(layout: Layout, disturbed: bool, custom: bool) -> Kernels:
    """Return the compiled calls of a batch, without code that its scene does not need.

    Args:
        layout: The layout of its records.
        disturbed: Whether the scene has any disturbance of `disturbance_kernels`.
        custom: Whether the scene has users' functions.
    """
    record, note = record_for(layout), note_for(layout)
    ledger_of, rules_of = task.ledger_for(layout), task.rules_for(layout)
    history, tile = history_for(layout), tile_for(PAIR, layout=layout)
    size, record_words = 2 * layout.links, record.itemsize // 8
    row_words = ledger_of.itemsize // 8
    drawn, numbers = FEW * DRAWS, FEW * size

    def within(compiler: Callable[..., Any]) -> Callable[..., Any]:
        kind = "wide" * (layout != NARROW) + "disturbed" * disturbed + "custom" * custom
        return lambda function: compiler(named(function, kind))

    def found(where, first, last):
        """Return the addresses at `where`, and arrays of walkers from `first` to before `last`."""
        places = view(where, (1,), ADDRESSES)
        here = places[0]
        records = view(here.records, (here.of_records, 1), record)[first:last]
        bodies = view(here.bodies, (here.of_bodies, 1, here.constants), _NUMBER)
        if here.of_bodies > 1:
            bodies = bodies[first:last]
        ledger = view(here.ledger, (here.of_ledger,), ledger_of)[first:last]
        phases = view(here.phases, (here.of_phases,), PHASE)
        return places, records, bodies, ledger, phases

    def begin_near(where, lanes, slopes, gaits, draws, observations):
        """Clear what is known of some walkers, and begin their episodes; see `task.begin`."""
        places, records, bodies, ledger, phases = found(where, 0, _ALL)
        here = places[0]
        for i in lanes:
            clear(entry(records, i), record_words)
            clear(entry(ledger, i), row_words)
        task.begin(
            records, bodies, view(here.radii, (here.of_radii,), _NUMBER), ledger, phases, lanes,
            slopes, gaits, draws, here.reset_noise_scale, observations,
        )  # fmt: skip

    @within(Kernel)
    def begin(where, lanes, slopes, gaits, draws, observations):
        """Begin episodes of some walkers, at given slopes and gaits."""
        begin_near(where, lanes, slopes, gaits, draws, observations)

    @within(merged)
    def begin_few(where, lanes, observations):
        """Begin episodes of at most FEW walkers, at slopes and gaits of the `EntryPoint`."""
        here, count = view(where, (1,), ADDRESSES)[0], len(lanes)
        slopes = view(stack(FEW), (count,), _NUMBER)
        draws = view(stack(drawn), (count, DRAWS), _NUMBER)
        fill(where, lanes, draws)
        for j in range(count):
            slopes[j] = here.low
            if here.low != here.high:
                slopes[j] = here.low + (here.high - here.low) * draws[j, 0]
        nodes = view(here.nodes, (here.of_nodes,), _NUMBER)
        gaits = view(here.states, (here.of_states, size), _NUMBER)
        if len(nodes) > 1:
            states, gaits = gaits, view(stack(numbers), (count, size), _NUMBER)
            interpolate_states(nodes, states, slopes, gaits)
        begin_near(where, lanes, slopes, gaits, draws, observations)
        if custom:
            _, records, _, ledger, phases = found(where, 0, _ALL)
            transitions.begin(
                records, ledger, phases, lanes, view(here.notes, (here.of_notes,), note)
            )

    @within(Kernel)
    def begin_alike(where, lanes, observations):
        """Begin episodes of some walkers, each with new draws; fills the flat observations."""
        for first in range(0, len(lanes), FEW):
            begin_few(where, lanes[first : first + FEW], observations)

    @within(merged)
    def tick(where, first, last, tiles, histories, observations, rewards, terminated, truncated):
        """Step some walkers by the actions at `where`.

        Returns:
            Numbers of strides and of episodes that end, as `counts` reads them. If an action is not
            finite, no walker steps, and it is -1 - i for the first walker i with such an action.
        """
        places, records, bodies, ledger, phases = found(where, first, last)
        here = places[0]
        rules = view(here.rules, (1,), rules_of)
        options = view(here.options, (1,), OPTIONS)
        actions = view(here.actions, (here.of_actions,), _NUMBER)
        each = rules[0].actions
        own = actions[first * each : last * each]
        disturbances = view(here.disturbances, (here.of_disturbances,), DISTURBANCE)[first:last]
        wrong = task.first_invalid(ledger, each, own)
        if wrong >= 0:
            return -1 - wrong
        if custom:
            notes = view(here.notes, (here.of_notes,), note)[first:last]
            transitions.before(records, notes, here.noted)
        work, guards = view(tiles, (1,), tile), view(histories, (1,), history)
        if disturbed:
            shape = here.of_pending, here.delay, each
            acted = view(here.acted, (here.of_acted,), _NUMBER)[first * each : last * each]
            for k in range(len(own)):
                acted[k] = own[k]
            strides, endings = disturbance_kernels.step(
                records, bodies, ledger, rules, phases, options, work, guards, disturbances,
                view(here.pending, shape, _NUMBER)[first:last], view(here.settings, (1,), SETTINGS),
                view(here.hooks, (here.of_hooks,), HOOK),
                view(here.table, (here.of_table, 2), _NUMBER),
                view(here.spread, (here.of_spread,), _NUMBER), acted, observations, rewards,
                terminated, truncated,
            )  # fmt: skip
        else:
            strides, endings = task.step(
                records, bodies, ledger, rules, phases, options, work, guards, own, observations,
                rewards, terminated, truncated,
            )  # fmt: skip
        if custom:
            for i in range(len(disturbances)):
                notes[i].push = disturbances[i].impulse
            endings += transitions.after(
                records, ledger, rules, phases, own, notes, here.noted, here.paid, here.ends,
                here.native != 0, rewards, terminated,
            )  # fmt: skip
        return strides << _HALF | endings

    @within(Kernel)
    def step(
        where, first, last, tiles, histories, again, observations, rewards, terminated, truncated
    ):  # fmt: skip
        """Step the walkers from `first` to before `last`, as `tick` does.

        With `again`, which requires all walkers, those that rest begin another episode. Tiles and
        histories are addresses of the working memory of a thread. The observations, flat, and the
        arrays after them are filled.
        """
        answer = tick(
            where, first, last, tiles, histories, observations, rewards, terminated, truncated
        )  # fmt: skip
        if again and answer >= 0:
            _, records, _, _, _ = found(where, first, last)
            lane = view(stack(1), (1,), _WORD)
            for i in range(len(records)):
                if records[i, 0].outcome == RESTING:
                    lane[0] = i
                    begin_few(where, lane, observations)
        return answer

    @within(Kernel)
    def step_here(where):
        """Step a single walker; results go to the arrays of the batch."""
        here = view(where, (1,), ADDRESSES)[0]
        return tick(
            where, 0, 1, here.tiles, here.histories,
            view(here.observations, (here.of_observations,), _SINGLE),
            view(here.rewards, (1,), _NUMBER),
            view(here.terminated, (1,), _BOOLEAN),
            view(here.truncated, (1,), _BOOLEAN),
        )  # fmt: skip

    @within(Kernel)
    def write_info(where, asked, ended, steps, counts, measures):
        """Write the entries of `info` for selected walkers; entries of the others are zero.

        Args:
            where: Address from `EntryPoint.address`.
            asked: Whether each walker is selected, (count,).
            ended: Walkers that have ended a stride.
            steps: Filled with the entries of EVERY_STEP except the last, (entries, count).
            counts: Filled with the number of strides and the outcome as a number, (2, count). The
                outcome is 0 if no stride or episode ends.
            measures: Filled with EVERY_STRIDE of the walkers in `ended`, (walkers, entries).
        """
        here, first = view(where, (1,), ADDRESSES)[0], len(steps)
        ledger = view(here.ledger, (here.of_ledger,), ledger_of)
        words = view(here.ledger, (here.of_ledger, row_words), _NUMBER)  # EVERY_STEP, EVERY_STRIDE
        for i in range(len(ledger)):
            for k in range(first):
                steps[k, i] = words[i, k] if asked[i] else 0.0
            counts[0, i] = ledger[i].strides if asked[i] else 0
            outcome = ledger[i].outcome
            if ledger[i].truncated != 0 and ledger[i].ending == 0:
                outcome = TIMED_OUT
            counts[1, i] = outcome if asked[i] else 0
        for row, i in enumerate(ended):
            for k in range(measures.shape[1]):
                measures[row, k] = words[i, first + k]

    return Kernels(begin, begin_alike, step, step_here, write_info)


class EntryPoint:
    """Entry point of compiled code into a batch: the addresses of its arrays.

    Args:
        scene: The scene.
        count: Number of walkers.
        observation_size: Size of an observation.
        custom: The user's own reward and termination; None without them.
        **arrays: Arrays named in STAYS; they must not be replaced afterwards.

    Attributes:
        address: Address that the kernels take.
        kernels: Kernels for the layout of the records.
        step_here: The compiled kernel that single environments call.
        workspace: Addresses of the tile and the guard history of one thread.
        actions: Actions of all walkers, flat; filled before a step.
        observations: Observations of all walkers, flat, from `step_here`.
        results: Rewards, terminations and truncations, each (count,), from `step_here`.
        words: EVERY_STEP without the strides, EVERY_STRIDE, and as integers the number of strides
            and the outcome, of the first walker: the words of its row that `info` reports.
        outcomes: The last two of them, number of strides and outcome, as integers.
    """

    def __init__(
        self,
        scene: Scene,
        count: int,
        observation_size: int,
        custom: Custom | None = None,
        **arrays: NDArray,
    ) -> None:
        self.actions = np.zeros(count * len(scene.actions))
        self.observations = np.zeros(count * observation_size, _SINGLE)
        self.results = np.zeros(count), np.zeros(count, bool), np.zeros(count, bool)
        self._randoms: list[np.random.Generator] | None = None
        self._kept: dict[str, NDArray] = {}
        self._places = np.zeros(1, ADDRESSES)
        self._places["reset_noise_scale"] = scene.reset_noise_scale
        self._places["constants"] = arrays["bodies"].shape[-1]
        self._places["delay"] = scene.action_delay
        self.address: int = self._places.ctypes.data
        layout = layout_in(arrays["records"].dtype)
        self.kernels = kernels_for(layout, "disturbances" in arrays, custom is not None)
        self.step_here = self.kernels.step_here.native(0)
        self.workspace = arrays["tiles"].ctypes.data, arrays["histories"].ctypes.data
        results = dict(zip(("rewards", "terminated", "truncated"), self.results, strict=True))
        self._put(actions=self.actions, observations=self.observations, **results, **arrays)
        if "disturbances" in arrays:
            self._put(acted=np.zeros_like(self.actions))
        if custom is not None:
            self._put(notes=custom.notes)
            self._places["noted"], self._places["native"] = custom.noted, custom.native
            self._places["paid"] = custom.address("reward")
            self._places["ends"] = custom.address("terminated")
        reported = len(task.EVERY_STEP) + len(task.EVERY_STRIDE) + 1
        self.words = arrays["ledger"].view(np.float64)[:reported]
        self.outcomes = self.words.view(np.int64)[-2:]

    @cached_property
    def step(self) -> Any:
        """The machine code of `Kernels.step`; its arrays are like `observations` and `results`."""
        return self.kernels.step.native(0, 0, 0, 0, 0, False, self.observations, *self.results)

    @cached_property
    def write_info(self) -> Any:
        """The machine code of `Kernels.write_info`."""
        lanes, table = np.zeros(0, np.int64), np.zeros((1, 1))
        given = self.results[1], lanes, table, np.zeros((1, 1), np.int64), table
        return self.kernels.write_info.native(0, *given)

    def _put(self, **arrays: NDArray) -> None:
        for name, array in arrays.items():
            assert array.flags.c_contiguous
            self._kept[name] = array
            self._places[name], self._places[f"of_{name}"] = array.ctypes.data, len(array)

    def draw_from(self, randoms: list[np.random.Generator]) -> None:
        """Set the random generators."""
        if randoms is not self._randoms:
            self._randoms = randoms
            found = [_capsule(random.bit_generator.capsule, b"BitGenerator") for random in randoms]
            self._put(generators=np.array(found, np.int64))

    def begin_at(self, starts: Starts) -> None:
        """Set the slopes and gaits from which episodes start."""
        if "nodes" not in self._kept:
            nodes, states = starts.nodes
            self._put(nodes=nodes, states=states)
            self._places["low"], self._places["high"] = starts.low, starts.high
