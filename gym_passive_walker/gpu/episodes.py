"""Episodes on a device: a step of one walker, its end, and how the next one begins.

What is not here is what environments run on a processor, `task` and `fates`, each for a batch of
one. What a walker meets is a function of its key and of how many episodes it has begun: so the same
key walks the same walk whoever walks beside it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gym_passive_walker.engine.chance import uniform, word
from gym_passive_walker.engine.run import carry_on
from gym_passive_walker.envs import fates, task
from gym_passive_walker.envs.starts import DRAWS, between
from gym_passive_walker.gpu.device import cuda, kind, place_of
from gym_passive_walker.gpu.lane import RUN, TILE

_START, _WHO = 200, 201  # streams of random numbers of a walker's key


class Walkers(NamedTuple):
    """What a device keeps of each walker, in arrays of n.

    Attributes:
        records: Of `layout.RECORD`, (n, 1).
        bodies: Their constants, (n, 1, constants); (1, 1, constants) where all stay alike.
        ledger: Of `task.LEDGER`.
        told: The ledger as the last step left it, before another episode began.
        keys: 64 bits for each.
        episodes: That each has begun.
        fates: Of `fates.FATE`; of none where nothing befalls them.
        pending: Actions that come late, (n, steps, actions); likewise.
        order: Which walker each thread takes.
        counts: How many walkers stand in the first phase, and in another, as order is made.
    """

    records: Any
    bodies: Any
    ledger: Any
    told: Any
    keys: Any
    episodes: Any
    fates: Any
    pending: Any
    order: Any
    counts: Any


class World(NamedTuple):
    """What is alike for all walkers.

    Attributes:
        phases: Of the system.
        options: What the engine is told.
        rules: Of `task.RULES`.
        blank: A record as it begins, (1,).
        row: Of the ledger, likewise.
        fate: Of the fates, likewise.
        slopes: Least and greatest slope that episodes begin on.
        nodes: Slopes at which states to start from are known.
        states: These, (nodes, 6).
        perturbation: How far from them a start may be, (1,).
        drawn: Constants of the walkers that episodes draw from, (walkers, constants).
        odds: Of `fates.ODDS`.
        natives: Of `reality.NATIVE`.
        table: Of the terrain's footholds.
        spread: Likewise.
    """

    phases: Any
    options: Any
    rules: Any
    blank: Any
    row: Any
    fate: Any
    slopes: Any
    nodes: Any
    states: Any
    perturbation: Any
    drawn: Any
    odds: Any
    natives: Any
    table: Any
    spread: Any


class Play(NamedTuple):
    """What goes between agents and walkers in a step, flat: see `task.step`.

    Attributes:
        actions: Of each walker.
        observations: Filled.
        rewards: Filled.
        terminated: Filled.
        truncated: Filled.
        last: Filled with observations before another episode began.
    """

    actions: Any
    observations: Any
    rewards: Any
    terminated: Any
    truncated: Any
    last: Any


DESK = kind(
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
"""Where a thread works: arrays as a batch of one has them."""


def calm_begin(walkers, world, i, desk, observations):
    """Nothing befalls a walker."""


def fateful_begin(walkers, world, i, desk, observations):
    """Draw a walker's fate, and show what its sensors tell."""
    own, odds = slice_of(i), world.odds
    walkers.fates[i] = world.fate[0]
    fates.begin(
        walkers.fates[own], odds, desk.lanes, desk.keys, walkers.pending[own],
        walkers.records[own], walkers.ledger[own], world.table, world.spread,
    )  # fmt: skip
    fates.perceive(
        walkers.fates[i], walkers.ledger[i], odds[0], world.table, world.spread, observations, 0
    )


def slice_of(i):
    """A walker, as a batch of one."""
    return slice(i, i + 1)


def own_body(walkers, i):
    """Its constants, likewise."""
    return slice_of(i if len(walkers.bodies) == len(walkers.records) else 0)


def begin(walkers, world, i, desk, observations):
    """Begin a walker's next episode."""
    key = word(walkers.keys[i], np.uint64(walkers.episodes[i]))
    walkers.episodes[i] += 1
    desk.lanes[0], desk.keys[0] = 0, key
    for k in range(DRAWS):
        desk.draws[0, k] = uniform(key, k, _START)
    if len(walkers.bodies) == len(walkers.records):
        who = int(uniform(key, 0, _WHO) * len(world.drawn))
        for k in range(world.drawn.shape[1]):
            walkers.bodies[i, 0, k] = world.drawn[who, k]
    low, high = world.slopes[0], world.slopes[1]
    desk.slopes[0] = low if low == high else low + (high - low) * desk.draws[0, 0]
    between(world.nodes, world.states, desk.slopes, desk.gaits)
    own, bodies = slice_of(i), walkers.bodies[own_body(walkers, i)]
    radii = bodies[0, 0, fates.RADIUS : fates.RADIUS + 1]
    task.begin(
        walkers.records[own], bodies, radii, walkers.ledger[own], world.blank, world.row,
        world.phases, desk.lanes, desk.slopes, desk.gaits, desk.draws, world.perturbation[0],
        observations,
    )  # fmt: skip
    befall(walkers, world, i, desk, observations)


befall = calm_begin
"""What begins besides; bound to `fateful_begin` where something befalls walkers."""


def carry_through(records, bodies, fates_, phases, options, tiles, courses, odds, natives):
    """Carry the one walker to the end of its step; as of `fates.carry_through`."""
    record, fate = records[0, 0], fates_[0]
    fate.until, fate.impulse = record.end, 0.0
    if not fate.idle:
        fates.meet(records, bodies, 0, fate, odds, natives)
    carry_on(records, bodies, phases, options, tiles, courses)
    while not fate.idle and record.outcome == 0 and record.time < fate.until:
        fates.meet(records, bodies, 0, fate, odds, natives)
        carry_on(records, bodies, phases, options, tiles, courses)


def as_it_is(actions):
    """The thread's own copy of actions."""
    return actions


def calm_step(
    walkers, world, i, tiles, courses, actions, observations, rewards, terminated, truncated
):
    """A step of a walker that nothing befalls."""
    own, body = slice_of(i), own_body(walkers, i)
    task.step(
        walkers.records[own], walkers.bodies[body], walkers.ledger[own], world.rules, world.phases,
        world.options, tiles, courses, actions, observations, rewards, terminated,
        truncated,
    )  # fmt: skip


def fateful_step(
    walkers, world, i, tiles, courses, actions, observations, rewards, terminated, truncated
):
    """A step of another."""
    own, body = slice_of(i), own_body(walkers, i)
    fates.step(
        walkers.records[own], walkers.bodies[body], walkers.ledger[own], world.rules, world.phases,
        world.options, tiles, courses, walkers.fates[own], walkers.pending[own],
        world.odds, world.natives, world.table, world.spread, actions, observations, rewards,
        terminated, truncated,
    )  # fmt: skip


one_step = calm_step
"""A walker's step; bound to `fateful_step` where something befalls walkers."""


def command_kernel(walkers, world, play):
    """Set the torques of the walker of this thread, which waits where it stands then."""
    i = cuda.grid(1)
    if i < len(walkers.records):
        own, count = slice_of(i), len(play.actions) // len(walkers.records)
        actions = play.actions[i * count : (i + 1) * count]
        wrong = task.command(walkers.records[own], walkers.ledger[own], world.rules[0], actions)
        if wrong >= 0:  # its time is up
            walkers.records[i, 0].end = walkers.records[i, 0].time


def calm_settle(
    walkers, world, i, tiles, courses, actions, observations, rewards, terminated, truncated
):
    """What the step of a walker has come to that others have carried on."""
    own, body = slice_of(i), own_body(walkers, i)
    task.settle(
        walkers.records[own], walkers.bodies[body], walkers.ledger[own], world.rules[0],
        world.phases, observations, rewards, terminated, truncated,
    )  # fmt: skip


def play_on(walkers, world, play, i, tiles, courses, desk):
    """A step of a walker, and the beginning of its next episode if this one has ended."""
    seen, own = len(play.observations) // len(walkers.records), slice_of(i)
    observations = play.observations[i * seen : (i + 1) * seen]
    rewards, terminated, truncated = play.rewards[own], play.terminated[own], play.truncated[own]
    actions, finite = desk.actions[: len(play.actions) // len(walkers.records)], True
    for j in range(len(actions)):
        actions[j] = play.actions[i * len(actions) + j]
        finite = finite and math.isfinite(actions[j])
    if not finite:
        rewards[0], terminated[0], truncated[0] = math.nan, False, False
        return
    one_step(
        walkers, world, i, tiles, courses, actions, observations, rewards, terminated, truncated
    )  # fmt: skip
    walkers.told[i] = walkers.ledger[i]
    for k in range(seen):
        play.last[i * seen + k] = observations[k]
    if terminated[0] or truncated[0]:
        begin(walkers, world, i, desk, observations)


def reset_kernel(walkers, world, observations):
    """Begin an episode of every walker."""
    i = cuda.grid(1)
    if i < len(walkers.records):
        desks, seen = cuda.local.array(1, DESK), len(observations) // len(walkers.records)
        begin(walkers, world, i, desks[0], observations[i * seen : (i + 1) * seen])


def step_kernel(walkers, world, play):
    """A step of every walker."""
    j = cuda.grid(1)
    if j < len(walkers.records):
        i = walkers.order[j] if len(walkers.order) > 0 else j
        tiles, courses = cuda.local.array(1, TILE), cuda.local.array(1, RUN)
        desks = cuda.local.array(1, DESK)
        play_on(walkers, world, play, i, tiles, courses, desks[0])


def order_kernel(walkers):
    """Have threads that lie together take walkers in the same phase: the first from the front."""
    i = cuda.grid(1)
    there = i < len(walkers.records)
    later = there and walkers.records[i, 0].phase != 0
    place = place_of(there, 1 if later else 0, walkers.counts)
    if there:
        walkers.order[len(walkers.records) - 1 - place if later else place] = i
