"""Episodes on a GPU: control steps of one walker, and starts of episodes.

The functions of `task`, `disturbance_kernels` and `transitions` run for batches of one. Random
numbers of a walker are a function of its key and of the number of its episodes. Equal keys
therefore give equal trajectories in any batch.
"""

from __future__ import annotations

import math

import numpy as np

from gym_passive_walker.devices.gpu.device import cuda, kind
from gym_passive_walker.devices.gpu.lane import RUN, TILE
from gym_passive_walker.engine.counter_rng import uniform, word
from gym_passive_walker.engine.layout import WIDE
from gym_passive_walker.envs import disturbance_kernels, task, transitions
from gym_passive_walker.envs.memory import BatchArray
from gym_passive_walker.envs.randomized import SETTLED
from gym_passive_walker.envs.task import ledger_for
from gym_passive_walker.gaits.scenes.randomization import CURRICULUM_LEVELS, WHICH
from gym_passive_walker.gaits.scenes.starts import DRAWS, between

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
    "last": BatchArray("f4", "walkers*shown"),  # observations before another episode began
    "shown": BatchArray("f4", "walkers*shown"),  # results of a user's observation
    "numbers": BatchArray("f8", "walkers shown"),  # the same, in double precision
}
"""Arrays of a batch on a GPU, besides those of `memory`."""

PASSED = (
    "actions", "acted", "observations", "shown", "numbers", "last", "rewards", "terminated",
    "truncated",
)  # fmt: skip
"""Arrays outside the columns: what a step takes and returns."""

WRITTEN = ("reported", "reported_draw")
"""Arrays in the columns that a step only writes."""

READ = WORDS = 0
"""Numbers of words of a column, which a step reads and writes; set for each scene."""

SCRATCH = kind(np.dtype([
    ("lanes", "i8", (1,)),
    ("slopes", "f8", (1,)),
    ("draws", "f8", (1, DRAWS)),
    ("gaits", "f8", (1, 2 * WIDE.links)),
]))  # fmt: skip
"""Working memory of a thread: the start of one walker."""


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


def unpack(table, i, column):
    """Return the arrays of walker i; `primitives.unpacker` returns the function instead."""


def fetch(words, i, column):
    """Copy the column of walker i to the memory of the thread."""
    for k in range(READ):
        column[k] = words[k, i]


def keep(column, words, i):
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


def step_and_restart(here, i, tiles, histories, scratch):
    """Step a walker, and begin its next episode if this one has ended."""
    finite, count = True, here.rules[0].actions
    for j in range(count):
        finite = finite and math.isfinite(here.actions[i * count + j])
    if not finite:
        here.rewards[i], here.terminated[i], here.truncated[i] = math.nan, False, False
        return
    before_step(here, i, i + 1)
    task.step(here, i, i + 1, tiles, histories)
    observe_body(here, i)
    after_step(here, i, i + 1)
    show_observation(here, i)
    here.reported[i], here.reported_draw[i] = here.ledger[i], here.drawn[i]
    size = len(here.last) // len(here.records)
    for k in range(i * size, (i + 1) * size):
        here.last[k] = here.shown[k]
    if here.terminated[i] or here.truncated[i]:
        begin_episode(here, i, scratch)


def reset_kernel(table):
    """Begin an episode of every walker."""
    i, column = cuda.grid(1), cuda.local.array(WORDS, np.float64)
    here = unpack(table, i, column)
    if i < here.words.shape[1]:
        scratch = cuda.local.array(1, SCRATCH)
        fetch(here.words, i, column)
        begin_episode(here, 0, scratch[0])
        here.reported_draw[0] = here.drawn[0]
        keep(column, here.words, i)


def step_kernel(table):
    """Step every walker."""
    i, column = cuda.grid(1), cuda.local.array(WORDS, np.float64)
    here = unpack(table, i, column)
    if i < here.words.shape[1]:
        tiles, histories = cuda.local.array(1, TILE), cuda.local.array(1, RUN)
        scratch = cuda.local.array(1, SCRATCH)
        fetch(here.words, i, column)
        step_and_restart(here, 0, tiles, histories, scratch[0])
        keep(column, here.words, i)
