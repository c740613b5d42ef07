"""Episodes on a device: a step of one walker, its end, and how the next one begins.

The rest is what environments run on a CPU, `task` and `disturbance_kernels`, for batches of one.
Disturbances of a walker are a function of its key and of how many episodes it has begun. The same
key therefore gives the same walk in any batch.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gym_passive_walker.engine.counter_rng import uniform, word
from gym_passive_walker.envs import disturbance_kernels, task, transitions
from gym_passive_walker.envs.starts import DRAWS, between
from gym_passive_walker.gpu.device import cuda, kind
from gym_passive_walker.gpu.lane import RUN, TILE

_START, _WHICH = 200, 201  # streams of random numbers of a walker's key


class Walkers(NamedTuple):
    """What a device keeps of each walker, in arrays of n.

    Attributes:
        records: Of `layout.RECORD`, (n, 1).
        bodies: Their constants, (n, 1, constants); (1, 1, constants) where all stay alike.
        ledger: Of `task.LEDGER`.
        reported: The ledger as the last step left it, before another episode began.
        keys: 64 bits for each.
        episodes: That each has begun.
        disturbances: Of `disturbance_kernels.DISTURBANCE`; of none without disturbances.
        pending: Actions that come late, (n, steps, actions); of none without delay.
        notes: Of `transitions.NOTE`; of none without users' own functions.
    """

    records: Any
    bodies: Any
    ledger: Any
    reported: Any
    keys: Any
    episodes: Any
    disturbances: Any
    pending: Any
    notes: Any


class World(NamedTuple):
    """What is alike for all walkers.

    Attributes:
        phases: Of the system.
        options: Options of the engine.
        rules: Of `task.RULES`.
        blank: A record as it begins, (1,).
        row: A row of the ledger as it begins, (1,).
        disturbance: Disturbances as they begin, (1,).
        slopes: Least and greatest slope that episodes begin on.
        nodes: Slopes at which states to start from are known.
        states: These, (nodes, 6).
        reset_noise_scale: How far from them a start may be, (1,).
        drawn: Constants of the walkers that episodes draw from, (walkers, constants).
        settings: Of `disturbance_kernels.SETTINGS`.
        hooks: Of `constraints.HOOK`.
        table: Of the terrain's footholds.
        spread: Standard deviations of random footholds.
        own: Fields that users' functions read, and the numbers by which their reward, termination
            and observation are called; see `transitions.after`.
    """

    phases: Any
    options: Any
    rules: Any
    blank: Any
    row: Any
    disturbance: Any
    slopes: Any
    nodes: Any
    states: Any
    reset_noise_scale: Any
    drawn: Any
    settings: Any
    hooks: Any
    table: Any
    spread: Any
    own: Any


class Play(NamedTuple):
    """What goes between agents and walkers in a step, flat: see `task.step`.

    Attributes:
        actions: Of each walker.
        observations: Filled.
        rewards: Filled.
        terminated: Filled.
        truncated: Filled.
        last: Filled with observations before another episode began.
        plain: The environment's observations, where a user's function makes others.
        numbers: Results of that function, (n, size).
    """

    actions: Any
    observations: Any
    rewards: Any
    terminated: Any
    truncated: Any
    last: Any
    plain: Any
    numbers: Any


SCRATCH = kind(
    np.dtype(
        [
            ("lanes", "i8", (1,)),
            ("keys", "u8", (1,)),
            ("slopes", "f8", (1,)),
            ("draws", "f8", (1, DRAWS)),
            ("gaits", "f8", (1, 6)),
            ("actions", "f8", (len(task.CHANNELS),)),
        ]
    )
)
"""Working memory of a thread: arrays of a batch of one walker."""


def calm_begin(walkers, world, i, scratch, observations):
    """Begin without disturbances."""


def disturbed_begin(walkers, world, i, scratch, observations):
    """Draw a walker's disturbances, and show what its sensors measure."""
    own, settings = slice_of(i), world.settings
    walkers.disturbances[i] = world.disturbance[0]
    disturbance_kernels.begin(
        walkers.disturbances[own], settings, scratch.lanes, scratch.keys, walkers.pending[own],
        walkers.records[own], walkers.ledger[own], world.table, world.spread,
    )  # fmt: skip
    disturbance_kernels.add_observation_noise(
        walkers.disturbances[i],
        walkers.ledger[i],
        settings[0],
        world.table,
        world.spread,
        observations,
        0,
    )


def slice_of(i):
    """A walker, as a batch of one."""
    return slice(i, i + 1)


def own_body(walkers, i):
    """Its constants, as those of a batch of one."""
    return slice_of(i if len(walkers.bodies) == len(walkers.records) else 0)


def begin(walkers, world, i, scratch, observations):
    """Begin a walker's next episode."""
    key = word(walkers.keys[i], np.uint64(walkers.episodes[i]))
    walkers.episodes[i] += 1
    scratch.lanes[0], scratch.keys[0] = 0, key
    for k in range(DRAWS):
        scratch.draws[0, k] = uniform(key, k, _START)
    if len(walkers.bodies) == len(walkers.records):
        which = int(uniform(key, 0, _WHICH) * len(world.drawn))
        for k in range(world.drawn.shape[1]):
            walkers.bodies[i, 0, k] = world.drawn[which, k]
    low, high = world.slopes[0], world.slopes[1]
    scratch.slopes[0] = low if low == high else low + (high - low) * scratch.draws[0, 0]
    between(world.nodes, world.states, scratch.slopes, scratch.gaits)
    own, bodies = slice_of(i), walkers.bodies[own_body(walkers, i)]
    radii = bodies[0, 0, disturbance_kernels.RADIUS : disturbance_kernels.RADIUS + 1]
    task.begin(
        walkers.records[own], bodies, radii, walkers.ledger[own], world.blank, world.row,
        world.phases, scratch.lanes, scratch.slopes, scratch.gaits, scratch.draws,
        world.reset_noise_scale[0],
        observations,
    )  # fmt: skip
    begin_disturbances(walkers, world, i, scratch, observations)


begin_disturbances = calm_begin
"""What begins besides; bound to `disturbed_begin` where there are disturbances."""


def plain_before(walkers, world, i):
    """Nothing is recorded before a step without users' own functions."""


def plain_after(walkers, world, i, actions, rewards, terminated):
    """Nothing is evaluated after it."""


def plain_sight(walkers, world, play, i, observations, begins):
    """Nothing else is seen."""


def own_before(walkers, world, i):
    """Record the state before a step."""
    own = slice_of(i)
    transitions.before(walkers.records[own], walkers.notes[own], world.own[0])


def own_after(walkers, world, i, actions, rewards, terminated):
    """Evaluate a user's reward and termination."""
    own = slice_of(i)
    if len(walkers.disturbances) > 0:
        walkers.notes[i].push = walkers.disturbances[i].impulse
    transitions.after(
        walkers.records[own], walkers.ledger[own], world.rules, world.phases, actions,
        walkers.notes[own], world.own[0], world.own[1], world.own[2], True, rewards, terminated,
    )  # fmt: skip


def own_sight(walkers, world, play, i, observations, begins):
    """Clear the transition if an episode begins; observe by a user's function if there is one."""
    own = slice_of(i)
    notes = walkers.notes[own]
    if begins:
        lanes = cuda.local.array(1, np.int64)
        lanes[0] = 0
        transitions.begin(walkers.records[own], walkers.ledger[own], world.phases, lanes, notes)
        if len(walkers.disturbances) > 0:
            notes[0].command = walkers.disturbances[i].command
    if world.own[3] != 0:
        transitions.look(notes, world.own[3], play.numbers[own])
        for k in range(len(observations)):
            observations[k] = play.numbers[i, k]


before, after, sight = plain_before, plain_after, plain_sight
"""Users' own functions; bound to `own_before`, `own_after`, `own_sight` where there are some."""


def calm_step(
    walkers, world, i, tiles, histories, actions, observations, rewards, terminated, truncated
):
    """A step of a walker without disturbances."""
    own, body = slice_of(i), own_body(walkers, i)
    task.step(
        walkers.records[own], walkers.bodies[body], walkers.ledger[own], world.rules, world.phases,
        world.options, tiles, histories, actions, observations, rewards, terminated,
        truncated,
    )  # fmt: skip


def disturbed_step(
    walkers, world, i, tiles, histories, actions, observations, rewards, terminated, truncated
):
    """A step of another."""
    own, body = slice_of(i), own_body(walkers, i)
    disturbance_kernels.step(
        walkers.records[own], walkers.bodies[body], walkers.ledger[own], world.rules, world.phases,
        world.options, tiles, histories, walkers.disturbances[own], walkers.pending[own],
        world.settings, world.hooks, world.table, world.spread, actions, observations, rewards,
        terminated, truncated,
    )  # fmt: skip


one_step = calm_step
"""A walker's step; bound to `disturbed_step` where there are disturbances."""


def own_rows(walkers, play, i):
    """A walker's observation, and the environment's: the same without users' own functions."""
    count = len(walkers.records)
    seen, shown = len(play.observations) // count, len(play.plain) // count
    observations = play.observations[i * seen : (i + 1) * seen]
    if shown == 0:
        return observations, observations
    return observations, play.plain[i * shown : (i + 1) * shown]


def play_on(walkers, world, play, i, tiles, histories, scratch):
    """A step of a walker, and the beginning of its next episode if this one has ended."""
    own, (observations, plain) = slice_of(i), own_rows(walkers, play, i)
    rewards, terminated, truncated = play.rewards[own], play.terminated[own], play.truncated[own]
    actions, finite = scratch.actions[: len(play.actions) // len(walkers.records)], True
    for j in range(len(actions)):
        actions[j] = play.actions[i * len(actions) + j]
        finite = finite and math.isfinite(actions[j])
    if not finite:
        rewards[0], terminated[0], truncated[0] = math.nan, False, False
        return
    before(walkers, world, i)
    one_step(
        walkers, world, i, tiles, histories, actions, plain, rewards, terminated, truncated
    )  # fmt: skip
    after(walkers, world, i, actions, rewards, terminated)
    sight(walkers, world, play, i, observations, False)
    walkers.reported[i] = walkers.ledger[i]
    for k in range(len(observations)):
        play.last[i * len(observations) + k] = observations[k]
    if terminated[0] or truncated[0]:
        begin(walkers, world, i, scratch, plain)
        sight(walkers, world, play, i, observations, True)


def reset_kernel(walkers, world, play):
    """Begin an episode of every walker."""
    i = cuda.grid(1)
    if i < len(walkers.records):
        scratch = cuda.local.array(1, SCRATCH)
        observations, plain = own_rows(walkers, play, i)
        begin(walkers, world, i, scratch[0], plain)
        sight(walkers, world, play, i, observations, True)


def step_kernel(walkers, world, play):
    """A step of every walker."""
    i = cuda.grid(1)
    if i < len(walkers.records):
        tiles, histories = cuda.local.array(1, TILE), cuda.local.array(1, RUN)
        scratch = cuda.local.array(1, SCRATCH)
        play_on(walkers, world, play, i, tiles, histories, scratch[0])
