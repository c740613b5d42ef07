"""Compiled control steps and starts of a batch, called with the addresses of its arrays.

Numba takes 0.3 µs to unbox an array of structures, and a control step needs eight. That is longer
than the engine takes for one walker. The addresses of arrays are therefore stored once.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache, cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.engine.jit import (
    Kernel,
    add_at,
    address,
    arrays_at,
    copy,
    draw_uniform,
    draw_word,
    merged,
    named,
    put_at,
    stack,
    view,
)
from gym_passive_walker.engine.lanes import CHUNK, RESTING
from gym_passive_walker.engine.layout import (
    NARROW,
    PAIR,
    Layout,
    history_for,
    layout_in,
    tile_for,
)
from gym_passive_walker.engine.run import thread_workspace, workspace
from gym_passive_walker.engine.team import Board, arrive, finish, helping, offer, take
from gym_passive_walker.envs import disturbance_kernels, memory, task, transitions
from gym_passive_walker.envs.memory import ARRAYS, AXES
from gym_passive_walker.envs.transitions import TIMED_OUT
from gym_passive_walker.gaits.scenes.starts import DRAWS, Starts, interpolate_states

ADDRESSES = np.dtype(
    [(name, "i8") for name in (*ARRAYS, "generators", "tiles", "histories", "ended", "measures")]
    + [(f"of_{axis}", "i8") for axis in AXES]
)
"""Addresses of a batch's arrays, of those of its random generators, of the working memory of one
thread, and of two arrays of `EntryPoint`; lengths of axes."""

ALONE, SHARED, HELPING = range(3)
"""Roles of a thread in a step: the only one, the one that steps with others, or one of those."""

_STEP = (
    "board", "threads", "large", "size", "again", "strides", "endings", "observations", "rewards",
    "terminated", "truncated", "steps", "counts",
)  # fmt: skip
STEP = np.dtype([(name, "i8") for name in _STEP])
"""What the threads of a step share: its board and number of threads; how many walkers a piece has,
where all threads are there and in this step; whether walkers begin another episode; numbers of
strides and of episodes that end; and addresses of the arrays to fill."""

_STRIDES, _ENDINGS = (8 * _STEP.index(name) for name in ("strides", "endings"))
_AT: dict[str, int] = {name: place[1] for name, place in (ADDRESSES.fields or {}).items()}
_LENGTHS = {axis: _AT[f"of_{axis}"] for axis in AXES}
_WORDS = len(_AT)
_NUMBER, _WORD, _KEY = np.dtype("f8"), np.dtype("i8"), np.dtype("u8")
_HALF = 32
SMALL = 128  # walkers that a thread takes at once while it may be alone
_TABLES = np.zeros((1, 1)), np.zeros((1, 1), np.int64)  # of the types of `write_info`
_FEW = 64  # walkers that begin together: their draws and gaits are on the stack

_capsule = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(
    ("PyCapsule_GetPointer", ctypes.pythonapi)
)


@Kernel
def draw_numbers(where, lanes, draws, keys):
    """Draw the random numbers of some walkers' starts, (lanes, DRAWS), and keys, (lanes or 0,)."""
    places = view(where, (1,), ADDRESSES)[0]
    generators = view(places.generators, (places.of_walkers,), _WORD)
    for j in range(len(lanes)):
        for k in range(DRAWS):
            draws[j, k] = draw_uniform(generators[lanes[j]])
        if j < len(keys):
            keys[j] = draw_word(generators[lanes[j]])


@Kernel
def post(shared, again, observations, rewards, terminated, truncated, steps, counts):
    """Write what the threads of a step share; see STEP and `Kernels.step`."""
    given = view(shared, (1,), STEP)[0]
    given.again = int(again)
    given.observations, given.rewards = address(observations), address(rewards)
    given.terminated, given.truncated = address(terminated), address(truncated)
    given.steps, given.counts = address(steps), address(counts)


def counts(answer: int) -> tuple[int, int]:
    """Return the numbers of strides and of episodes that end, from the answer of a kernel."""
    return answer >> _HALF, answer & ((1 << _HALF) - 1)


class Kernels(NamedTuple):
    """Compiled calls of a batch, for walkers with records of one layout."""

    begin: Kernel
    begin_alike: Kernel
    step: Kernel
    observe: Kernel
    enter: Kernel
    write_info: Kernel


@cache
def kernels_for(layout: Layout, disturbed: bool, custom: bool) -> Kernels:
    """Return the compiled calls of a batch, without code that its scene does not need.

    Args:
        layout: The layout of its records.
        disturbed: Whether the scene has any disturbance of `disturbance_kernels`.
        custom: Whether the scene has users' functions.
    """
    kind = "wide" * (layout != NARROW) + "disturbed" * disturbed + "custom" * custom
    declared = memory.present("disturbed" * disturbed, "custom" * custom)
    arrays = memory.arrays_in(kind, declared, layout, _AT, _LENGTHS, ARRAYS)
    history, tile = history_for(layout), tile_for(PAIR, layout=layout)
    size, row_words = 2 * layout.links, task.ledger_for(layout).itemsize // 8
    reported, measured = len(task.EVERY_STEP) - 1, len(task.EVERY_STRIDE)
    drawn, numbers = _FEW * DRAWS, _FEW * size

    def within(compiler: Callable[..., Any]) -> Callable[..., Any]:
        return lambda function: compiler(named(function, kind))

    @within(merged)
    def copied(where):
        """Return a copy of the addresses on the stack, to replace some in this call alone."""
        places = view(stack(_WORDS), (1,), ADDRESSES)
        copy(address(places), where, places.itemsize)
        return places

    @within(merged)
    def begin_near(here, lanes, slopes, gaits, draws, keys):
        """Begin episodes of some walkers, with disturbances of these keys; see `task.begin`."""
        task.begin(here, lanes, slopes, gaits, draws)
        if disturbed:
            for j in range(len(lanes)):
                disturbance_kernels.begin(here, lanes[j], keys[j])
        if custom:
            transitions.begin(here, lanes)
            if disturbed:
                for i in lanes:
                    here.notes[i].command = here.disturbances[i].command

    @within(Kernel)
    def begin(where, lanes, slopes, gaits, draws, keys, observations):
        """Begin episodes of some walkers, at given slopes and gaits."""
        places = copied(where)
        places[0].observations = address(observations)
        begin_near(arrays_at(address(places), arrays), lanes, slopes, gaits, draws, keys)

    @within(merged)
    def begin_few(where, here, lanes):
        """Begin episodes of at most _FEW walkers, at slopes and gaits of the `EntryPoint`."""
        low, high, count = here.slope_range[0], here.slope_range[1], len(lanes)
        slopes = view(stack(_FEW), (count,), _NUMBER)
        draws = view(stack(drawn), (count, DRAWS), _NUMBER)
        keys = view(stack(_FEW), (count * disturbed,), _KEY)
        draw_numbers(where, lanes, draws, keys)
        for j in range(count):
            slopes[j] = low
            if low != high:
                slopes[j] = low + (high - low) * draws[j, 0]
        gaits = here.states
        if len(here.nodes) > 1:
            gaits = view(stack(numbers), (count, size), _NUMBER)
            interpolate_states(here.nodes, here.states, slopes, gaits)
        begin_near(here, lanes, slopes, gaits, draws, keys)

    @within(Kernel)
    def begin_alike(where, lanes, observations):
        """Begin episodes of some walkers, each with new draws; fills the flat observations."""
        places = copied(where)
        places[0].observations = address(observations)
        here = arrays_at(address(places), arrays)
        for first in range(0, len(lanes), _FEW):
            begin_few(where, here, lanes[first : first + _FEW])

    @within(merged)
    def tick(here, first, last, tiles, histories):
        """Step some walkers by their actions; returns numbers of strides and endings."""
        if custom:
            transitions.before(here, first, last)
        work, guards = view(tiles, (1,), tile), view(histories, (1,), history)
        if disturbed:
            strides, endings = disturbance_kernels.step(here, first, last, work, guards)
        else:
            strides, endings = task.step(here, first, last, work, guards)
        if custom:
            if disturbed:
                for i in range(first, last):
                    here.notes[i].push = here.disturbances[i].impulse
            endings += transitions.after(here, first, last)
        return strides, endings

    @within(merged)
    def report(where, here, i, steps, counts):
        """Write what every step reports of a walker; see `write_info`."""
        count = len(here.ledger)
        words = view(address(here.ledger), (count, row_words), _NUMBER)
        for k in range(reported):
            steps[k, i] = words[i, k]  # EVERY_STEP first
        counts[0, i], outcome = here.ledger[i].strides, here.ledger[i].outcome
        if here.ledger[i].truncated != 0 and here.ledger[i].ending == 0:
            outcome = TIMED_OUT
        counts[1, i] = outcome
        if outcome != 0:
            places = view(where, (1,), ADDRESSES)[0]
            j = add_at(places.ended, 1)
            view(places.ended, (count + 1,), _WORD)[j + 1] = i
            measures = view(places.measures, (count, measured), _NUMBER)
            for k in range(measured):
                measures[j, k] = words[i, reported + k]

    @within(merged)
    def next_piece(given, piece, role, count):
        """Return the number of the next piece for this thread, or -1."""
        if role != ALONE:
            piece = take(given.board, role == HELPING)
        else:
            piece = piece + 1 if (piece + 1) * given.size < count else -1
        return piece

    @within(Kernel)
    def step(where, shared, role, tiles, histories):
        """Step all walkers, piece by piece, perhaps with other threads.

        Args:
            where: Address from `EntryPoint.address`.
            shared: Address of STEP: arrays of all walkers to fill, observations flat; "steps" and
                "counts" are those of `write_info`, with zeros for walkers that rest. If these are
                0, the batch's own arrays are filled. With "again", walkers that rest begin another
                episode.
            role: Role of this thread.
            tiles: Address of the working memory of this thread.
            histories: Another one.

        Returns:
            Numbers of strides and of episodes that end, as `counts` reads them; or -1 - i if the
            action of walker i is the first that is not finite: no walker steps.
        """
        given, every = view(shared, (1,), STEP)[0], arrays_at(where, arrays)
        count = len(every.ledger)
        if role == HELPING:
            arrive(given.board)
        else:
            wrong = task.first_invalid(every, 0, count)
            if wrong >= 0:
                return -1 - wrong
            given.strides, given.endings = 0, 0
            if given.steps != 0:
                put_at(view(where, (1,), ADDRESSES)[0].ended, 0)
            given.size = given.large
            if role == SHARED:
                if helping(given.board) + 1 < given.threads:  # nobody waits for one that comes late
                    given.size = SMALL
                offer(given.board, -(-count // given.size))
        piece = next_piece(given, -1, role, count)
        while piece >= 0:
            first = piece * given.size
            last = min(first + given.size, count)
            place = where
            if given.steps != 0:
                places = copied(where)
                places[0].observations, places[0].rewards = given.observations, given.rewards
                places[0].terminated, places[0].truncated = given.terminated, given.truncated
                place = address(places)
            here = arrays_at(place, arrays)
            strides, endings = tick(here, first, last, tiles, histories)
            if given.steps != 0:
                steps = view(given.steps, (reported, count), _NUMBER)
                counts = view(given.counts, (2, count), _WORD)
                lane = view(stack(1), (1,), _WORD)
                for i in range(first, last):
                    if here.records[i, 0].outcome != RESTING:
                        report(where, here, i, steps, counts)
                        continue
                    for k in range(reported):
                        steps[k, i] = 0.0
                    counts[0, i], counts[1, i], lane[0] = 0, 0, i
                    if given.again:
                        begin_few(where, here, lane)
            if role == ALONE:
                given.strides += strides
                given.endings += endings
            else:
                add_at(shared + _STRIDES, strides)
                add_at(shared + _ENDINGS, endings)
                finish(given.board)
            piece = next_piece(given, piece, role, count)
        return given.strides << _HALF | given.endings

    @within(Kernel)
    def observe(where, observations):
        """Fill the observations of all walkers, flat."""
        places = copied(where)
        places[0].observations = address(observations)
        here = arrays_at(address(places), arrays)
        for i in range(len(here.ledger)):
            task.write_observation(here, i)
            if disturbed:
                disturbance_kernels.add_observation_noise(here, i)

    @within(Kernel)
    def enter(where, pays, stops, rewards, terminated):
        """Apply rewards and terminations in the notes of all walkers; see `transitions.enter`."""
        endings = 0
        if custom:
            places = copied(where)
            places[0].rewards, places[0].terminated = address(rewards), address(terminated)
            here = arrays_at(address(places), arrays)
            endings = transitions.enter(here, 0, len(here.ledger), pays, stops)
        return endings

    @within(Kernel)
    def write_info(where, steps, counts):
        """Write what every step reports of all walkers, also to `ended` and `measures`.

        Args:
            where: Address from `EntryPoint.address`.
            steps: Filled with the entries of EVERY_STEP except the last, (entries, count).
            counts: Filled with the number of strides and the outcome as a number, (2, count). The
                outcome is 0 if no stride or episode ends.
        """
        here = arrays_at(where, arrays)
        put_at(view(where, (1,), ADDRESSES)[0].ended, 0)
        for i in range(len(here.ledger)):
            report(where, here, i, steps, counts)

    if custom:  # these kernels are the same for several kinds of scenes
        observe = kernels_for(layout, disturbed, False).observe
    if disturbed:
        enter = kernels_for(layout, False, custom).enter
    if disturbed or custom:
        write_info = kernels_for(layout, False, False).write_info
    return Kernels(begin, begin_alike, step, observe, enter, write_info)


class EntryPoint:
    """Entry point of compiled code into a batch: the addresses of its arrays.

    Args:
        arrays: Arrays of the batch by name; see `memory`. They must not be replaced afterwards.
        threads: Number of threads of a step.
        **lengths: Lengths of axes in AXES that no array has as an axis of its own.

    Attributes:
        address: Address that the kernels take.
        kernels: Kernels for the layout of the records.
        step_here: Steps a single walker; results go to the arrays of the batch; see `Kernels.step`.
        actions: Actions of all walkers, flat; filled before a step.
        observations: Default observations of all walkers, flat, from `step_here`.
        results: Rewards, terminations and truncations, each (count,), from `step_here`.
        words: EVERY_STEP without the strides, EVERY_STRIDE, and as integers the number of strides
            and the outcome, of the first walker: the words of its row that `info` reports.
        outcomes: The last two of them, number of strides and outcome, as integers.
        ended: From the last step or `write_info`: the number of walkers that ended a stride or an
            episode, and then these walkers in any order, (count + 1,).
        measures: Their EVERY_STRIDE, which are zero for all others, (count, entries).
    """

    def __init__(self, arrays: dict[str, NDArray], threads: int = 1, **lengths: int) -> None:
        self._randoms: list[np.random.Generator] | None = None
        self._kept: dict[str, NDArray] = {}
        self._places = np.zeros(1, ADDRESSES)
        self.address: int = self._places.ctypes.data
        layout = self._layout = layout_in(arrays["records"].dtype)
        self.kernels = kernels_for(layout, "disturbances" in arrays, "notes" in arrays)
        for axis, length in lengths.items():
            self._places[f"of_{axis}"] = length
        tiles, histories = workspace(layout=layout)
        count = len(arrays["ledger"])
        self.ended = np.zeros(count + 1, np.int64)
        self.measures = np.zeros((count, len(task.EVERY_STRIDE)))
        own = {"ended": self.ended, "measures": self.measures}
        self._put(**arrays, tiles=tiles, histories=histories, **own)
        self.actions, self.observations = arrays["actions"], arrays["observations"]
        self.results = arrays["rewards"], arrays["terminated"], arrays["truncated"]
        words = len(task.EVERY_STEP) + len(task.EVERY_STRIDE) + 1
        self.words = arrays["ledger"].view(np.float64)[:words]
        self.outcomes = self.words.view(np.int64)[-2:]

        self._helpers, self._board = threads - 1, Board()
        self._shared = np.zeros(2, STEP)  # of all walkers, and of a single one
        self._shared["board"], self._shared["threads"] = self._board.address, (threads, 1)
        self._shared["large"] = -(-count // (threads * -(-count // (threads * CHUNK))))
        self._of_all, here = (self._shared[i:].ctypes.data for i in range(2))
        self._workspace = tiles.ctypes.data, histories.ctypes.data
        alone = self.address, here, ALONE, *self._workspace
        self._step = self.kernels.step.native(*alone)
        self.step_here = partial(self._step, *alone)

    @cached_property
    def _post(self) -> Any:
        """The machine code of `post`."""
        return post.native(0, False, self.observations, *self.results, *_TABLES)

    @cached_property
    def write_info(self) -> Any:
        """The machine code of `Kernels.write_info`."""
        return self.kernels.write_info.native(0, *_TABLES)

    def step(self, again: bool, *arrays: NDArray) -> tuple[int, int]:
        """Step all walkers.

        Args:
            again: Whether walkers without an episode begin the next one.
            *arrays: Filled: flat observations, rewards, terminations, truncations, and the two
                arrays of `write_info`.

        Returns:
            Numbers of strides and of episodes that end; or -1 - i and 0 if the action of walker i
            is the first that is not finite.
        """
        self._post(self._of_all, again, *arrays)
        role = ALONE
        if self._helpers:
            self._board.ask(self._helpers, self._help)
            role = SHARED
        answer = self._step(self.address, self._of_all, role, *self._workspace)
        return counts(answer) if answer >= 0 else (answer, 0)

    def _help(self) -> None:
        """Help with steps in another thread, until there are none."""
        work = (part.ctypes.data for part in thread_workspace(layout=self._layout))
        self._step(self.address, self._of_all, HELPING, *work)

    def _put(self, **arrays: NDArray) -> None:
        for name, array in arrays.items():
            assert array.flags.c_contiguous
            self._kept[name], self._places[name] = array, array.ctypes.data
            axes = ARRAYS[name].axes.split() if name in ARRAYS else ()
            for axis, length in zip(axes, array.shape, strict=False):
                if axis in AXES:
                    self._places[f"of_{axis}"] = length

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
            slopes = np.array([starts.low, starts.high])
            self._put(nodes=nodes, states=states, slope_range=slopes)
