"""Episodes on a GPU: control steps of one walker, and starts of episodes.

The functions of `task`, `disturbance_kernels` and `transitions` run for batches of one. Random
numbers of a walker are a function of its key and of the number of its episodes. Equal keys
therefore give equal trajectories in any batch.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from gym_passive_walker.devices.gpu.device import BLOCK, cuda, kind
from gym_passive_walker.devices.gpu.lane import ONE_HISTORY, ONE_TILE
from gym_passive_walker.engine import lanes
from gym_passive_walker.engine.counter_rng import uniform, word
from gym_passive_walker.engine.event_location import TIME_UP
from gym_passive_walker.engine.jit import address, call
from gym_passive_walker.engine.lanes import WAITING
from gym_passive_walker.engine.layout import WIDE
from gym_passive_walker.engine.step import UP
from gym_passive_walker.envs import disturbance_kernels, task, transitions
from gym_passive_walker.envs.memory import BatchArray
from gym_passive_walker.envs.randomized import SETTLED
from gym_passive_walker.envs.task import ledger_for
from gym_passive_walker.gaits.scenes.randomization import CURRICULUM_LEVELS, WHICH
from gym_passive_walker.gaits.scenes.starts import DRAWS, between
from gym_passive_walker.models.equations.hybrid import Outcome

_STALLED = int(Outcome.STALLED)
_START = 200  # stream of random numbers of a walker's key

DEVICE_ARRAYS = {
    "reported": BatchArray(
        ledger_for, "walkers"
    ),  # after the last step, before another episode began
    "keys": BatchArray("u8", "walkers"),  # of the random numbers
    "episodes": BatchArray("i8", "walkers"),  # number of episodes that have begun
    "pool": BatchArray("f8", "drawable constants"),  # of walkers that episodes draw from
    "proportions": BatchArray("f4", "drawable proportions"),  # of these walkers, as observed
    "settled": BatchArray(SETTLED, "drawable"),  # what these draw besides
    "growth": BatchArray("i8", "2"),  # members of the pool at a level; episodes of a curriculum
    "drawn": BatchArray("i8", "walkers"),  # index in the pool
    "reported_draw": BatchArray("i8", "walkers"),  # before another episode began
    "listed": BatchArray("i8", "listable"),  # walkers that `plain_kernel` leaves, from both ends
    "counts": BatchArray("i8", "3"),  # their numbers; blocks of `event_kernel` that have read them
    "last": BatchArray("f4", "walkers*shown"),  # observations before another episode began
    "shown": BatchArray("f4", "walkers*shown"),  # results of a user's observation
    "numbers": BatchArray("f8", "walkers shown"),  # the same, in double precision
}
"""Arrays of a batch on a GPU, besides those of `memory`."""

GIVEN_ARRAYS = (
    "actions", "acted", "observations", "shown", "numbers", "last", "rewards", "terminated",
    "truncated",
)  # fmt: skip
"""Arrays outside the columns: what a step takes and returns."""

WRITTEN_ARRAYS = ("reported", "reported_draw")
"""Arrays in the columns that a step only writes."""

READ = WORDS = PHASE_WORD = 0
"""Words of a column that a step reads and writes, and the row of the phase; set for each scene."""

SCRATCH = kind(np.dtype([
    ("lanes", "i8", (1,)),
    ("slopes", "f8", (1,)),
    ("draws", "f8", (1, DRAWS)),
    ("gaits", "f8", (1, 2 * WIDE.links)),
]))  # fmt: skip
"""Working memory of a thread: the start of one walker."""


def integrate_once(records, bodies, phase, number, tiles, histories, options):
    """Integrate the one walker that waits in a phase by a step, which must reach its time limit.

    Else the outcome is STALLED. See `lanes.integrate_phase` for the arguments.
    """
    record = records[0, 0]
    if record.phase != number or record.outcome != WAITING:
        return
    tile = address(tiles)
    call(phase.load_constants, tile, address(bodies[0]), 0, 0, 0.0, 0.0)
    call(phase.load, tile, address(records[0]), 0, 0, options.first_step, 0.0)
    call(phase.first, tile, tile, 0, 0, 0.0, 0.0)
    call(phase.sweep, tile, tile, 0, 0, options.fineness, float(options.scuff))
    if tiles[0].verdict[0] == UP:
        lanes.leave(records[0], bodies[0], tiles, phase, 0, TIME_UP, options)
    else:
        record.outcome = _STALLED


def begin_episode(here, i, scratch):
    """Begin a walker's next episode."""
    key, episode = word(here.keys[i], np.uint64(here.episodes[i])), here.episodes[i]
    here.episodes[i] += 1
    scratch.lanes[0] = i
    for k in range(DRAWS):
        scratch.draws[0, k] = uniform(key, k, _START)
    if len(here.bodies) == len(here.records):
        here.drawn[i] = which_drawn(here.growth, key, episode)
        here.ledger[i].strides = 0  # the body is that of a first stride
        for k in range(here.pool.shape[1]):
            here.bodies[i, 0, k] = here.pool[here.drawn[i], k]
        if here.rules[0].coordinates == 0:  # feet of a system roll by their own equations
            here.radii[i] = here.bodies[i, 0, disturbance_kernels.RADIUS]
    low, high, settled = here.slope_range[0], here.slope_range[1], here.settled[here.drawn[i]]
    scratch.slopes[0] = low if low == high else low + (high - low) * scratch.draws[0, 0]
    if math.isfinite(settled.slope):
        scratch.slopes[0] = settled.slope
    for k in range(1, DRAWS):
        scratch.draws[0, k] = 0.5 + settled.noise * (scratch.draws[0, k] - 0.5)
    between(here.nodes, here.states, scratch.slopes, scratch.gaits)
    task.begin(here, scratch.lanes, scratch.slopes, scratch.gaits, scratch.draws)
    begin_disturbances(here, i, key)
    settle(here, i)
    observe_body(here, i)
    begin_notes(here, i, scratch.lanes)
    show_observation(here, i)


def observe_body(here, i):
    """Write the observed proportions of a walker at the end of its observation."""
    count = here.proportions.shape[1]
    first = (i + 1) * (len(here.observations) // len(here.records)) - count
    for k in range(count):
        here.observations[first + k] = here.proportions[here.drawn[i], k]


def which_drawn(growth, key, episode):
    """Return the row of the pool for an episode; see `Randomization.drawn`."""
    size, episodes = growth[0], growth[1]
    level = min(CURRICULUM_LEVELS, CURRICULUM_LEVELS * episode // episodes) if episodes > 0 else 0
    return level * size + int(uniform(key, 0, WHICH) * size)


def unpack(table, i, column) -> Any:
    """Return the arrays of walker i; `primitives.unpacker` returns the function instead."""


def fetch(words, i, column):
    """Copy the column of walker i to the memory of the thread."""
    for k in range(READ):
        column[k] = words[k, i]


def store(column, words, i):
    """Copy a column back."""
    for k in range(WORDS):
        words[k, i] = column[k]


# Functions of scenes with disturbances or users' functions replace the next seven.


def settle(here, i):
    """Set no draws of disturbances."""


def begin_disturbances(here, i, key):
    """Draw no disturbances; see `disturbance_kernels.begin`."""


def begin_notes(here, i, lanes):
    """Record nothing at the beginning of an episode."""


def before_step(here, first, last):
    """Record nothing before a step; see `transitions.before`."""


def after_step(here, first, last):
    """Record nothing after a step; see `transitions.after`."""


def note_disturbances(here, i):
    """Record no disturbances."""


def show_observation(here, i):
    """Leave the default observation."""


def own_settle(here, i):
    """Set a walker's draws of disturbances; see `Disturbances.settle`."""
    disturbance, settled = here.disturbances[i], here.settled[here.drawn[i]]
    disturbance.delay, disturbance.friction = settled.delay, settled.friction
    for j in range(len(disturbance.strength)):
        disturbance.strength[j] = settled.strength[j]


def own_begin(here, i, lanes):
    """Clear a walker's transition."""
    transitions.begin(here, lanes)
    note_disturbances(here, i)


def own_after(here, first, last):
    """Record a step, and evaluate a user's reward and termination."""
    note_disturbances(here, first)
    transitions.after(here, first, last)


def own_note(here, i):
    """Record a walker's command and its pushes."""
    here.notes[i].command = here.disturbances[i].command
    here.notes[i].push = here.disturbances[i].impulse


def own_show(here, i):
    """Evaluate a user's observation."""
    transitions.look(here.notes[i : i + 1], here.own[0].look, here.numbers[i : i + 1])
    count = here.numbers.shape[1]
    for k in range(count):
        here.shown[i * count + k] = here.numbers[i, k]


def step_walker(here, i, tiles, histories):
    """Step a walker; an episode that has ended is not begun again.

    Returns:
        Whether its action is finite; else it is left unchanged.
    """
    finite, count = True, here.rules[0].actions
    for j in range(count):
        finite = finite and math.isfinite(here.actions[i * count + j])
    if not finite:
        here.rewards[i], here.terminated[i], here.truncated[i] = math.nan, False, False
        return False
    before_step(here, i, i + 1)
    task.step(here, i, i + 1, tiles, histories)
    observe_body(here, i)
    after_step(here, i, i + 1)
    show_observation(here, i)
    here.reported[i], here.reported_draw[i] = here.ledger[i], here.drawn[i]
    size = len(here.last) // len(here.records)
    for k in range(i * size, (i + 1) * size):
        here.last[k] = here.shown[k]
    return True


def reset_kernel(table):
    """Begin an episode of every walker."""
    i, column = cuda.grid(1), cuda.local.array(WORDS, np.float64)
    words = unpack(table, 0, column).words
    if i < words.shape[1]:
        scratch = cuda.local.array(1, SCRATCH)
        here = unpack(table, i, column)
        fetch(words, i, column)
        begin_episode(here, 0, scratch[0])
        here.reported[0], here.reported_draw[0] = here.ledger[0], here.drawn[0]
        store(column, words, i)


def plain_kernel(table):
    """Step every walker for which one integration step suffices, and list the others.

    The others have an event, need more integration steps, or end their episodes. The result of
    their step is not kept here. Each phase has its own integration step. The first threads of a
    block therefore take the walkers in the first phase, and the last threads take the others.
    """
    column, thread = cuda.local.array(WORDS, np.float64), cuda.threadIdx.x
    found = cuda.shared.array(2, np.int32)  # walkers of this block in the first phase, and others
    order = cuda.shared.array(BLOCK, np.int64)
    i, words = cuda.grid(1), unpack(table, 0, column).words
    order[thread] = -1
    if thread == 0:
        found[0], found[1] = 0, 0
    cuda.syncthreads()
    if i < words.shape[1]:
        if words[PHASE_WORD, i] == 0.0:  # the bits of an integer
            order[cuda.atomic.add(found, 0, 1)] = i
        else:
            order[cuda.blockDim.x - 1 - cuda.atomic.add(found, 1, 1)] = i
    cuda.syncthreads()
    i = order[thread]
    if i >= 0:
        tiles, histories = cuda.local.array(1, ONE_TILE), cuda.local.array(1, ONE_HISTORY)
        here = unpack(table, i, column)
        fetch(words, i, column)
        if not step_walker(here, 0, tiles, histories):
            return
        if here.records[0, 0].outcome == WAITING and not (here.terminated[0] or here.truncated[0]):
            store(column, words, i)
        elif words[PHASE_WORD, i] == 0.0:
            here.listed[cuda.atomic.add(here.counts, 0, 1)] = i
        else:
            here.listed[words.shape[1] - 1 - cuda.atomic.add(here.counts, 1, 1)] = i


def event_kernel(table):
    """Step the walkers in the list; where an episode ends, begin the next one."""
    column, k = cuda.local.array(WORDS, np.float64), cuda.grid(1)
    here = unpack(table, 0, column)
    first, others, count = here.counts[0], here.counts[1], here.words.shape[1]
    cuda.syncthreads()  # all threads of the block have read
    if cuda.threadIdx.x == 0 and cuda.atomic.add(here.counts, 2, 1) == cuda.gridDim.x - 1:
        for entry in range(3):  # the last block clears the list
            here.counts[entry] = 0
    if k < first + others:
        i = here.listed[k if k < first else count - 1 - (k - first)]
        tiles, histories = cuda.local.array(1, ONE_TILE), cuda.local.array(1, ONE_HISTORY)
        scratch = cuda.local.array(1, SCRATCH)
        here = unpack(table, i, column)
        fetch(here.words, i, column)
        step_walker(here, 0, tiles, histories)
        if here.terminated[0] or here.truncated[0]:
            begin_episode(here, 0, scratch[0])
        store(column, here.words, i)
