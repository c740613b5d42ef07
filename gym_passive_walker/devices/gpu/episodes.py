"""Episodes on a GPU: control steps of one walker, and starts of episodes.

The functions of `task`, `disturbance_kernels` and `transitions` run for batches of one. Random
numbers of a walker are a function of its key and of the number of its episodes. Equal keys
therefore give equal trajectories in any batch.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gym_passive_walker.devices.gpu.device import cuda, kind
from gym_passive_walker.devices.gpu.lane import RUN, TILE
from gym_passive_walker.engine.counter_rng import uniform, word
from gym_passive_walker.envs import disturbance_kernels, task, transitions
from gym_passive_walker.gaits.scenes.rules import CHANNELS
from gym_passive_walker.gaits.scenes.starts import DRAWS, between

_START, _WHICH = 200, 201  # streams of random numbers of a walker's key


class DeviceWalkers(NamedTuple):
    """State of n walkers, on the GPU.

    Attributes:
        records: States of the integration, (n, 1) of `layout.RECORD`.
        bodies: Constants, (n, 1, constants); (1, 1, constants) if they are equal and do not change.
        ledger: Accounts of stride and episode, (n,) of `task.LEDGER`.
        reported: The ledger after the last step, before another episode began, (n,).
        keys: Keys of the random numbers, 64 bits each, (n,).
        episodes: Number of episodes that have begun, (n,).
        drawn: Index in `SceneConstants.drawn` of the episode's constants, (n,).
        disturbances: Disturbance states, (n,) of `disturbance_kernels.DISTURBANCE`; (0,) without
            disturbances.
        pending: Delayed actions, (n, steps, actions); (0, steps, actions) without disturbances.
        notes: Transitions, (n,) of `transitions.note_for`; (0,) without users' functions.
    """

    records: Any
    bodies: Any
    ledger: Any
    reported: Any
    keys: Any
    episodes: Any
    drawn: Any
    disturbances: Any
    pending: Any
    notes: Any


class SceneConstants(NamedTuple):
    """Constants that all walkers of a scene share.

    Attributes:
        phases: Phases of the system.
        options: Options of the engine.
        rules: Rules of the scene, (1,) of `task.RULES`.
        blank: Record at the beginning of an episode, (1,).
        row: Row of the ledger at the beginning of an episode, (1,).
        disturbance: Disturbance state at the beginning of an episode, (1,).
        slopes: Smallest and largest slope of initial states in rad, (2,).
        nodes: Slopes at which initial states are known, in rad, (nodes,).
        states: Initial states there, (nodes, 6).
        reset_noise_scale: Relative range of initial states, (1,).
        drawn: Constants of walkers that episodes draw from, (walkers, constants).
        proportions: Observed proportions of these walkers, (walkers, numbers).
        settings: Settings of the disturbances, (1,) of `disturbance_kernels.SETTINGS`.
        hooks: Functions for pushes and checks, (phases,) of `constraints.HOOK`.
        table: Footholds of the terrain.
        spread: Standard deviations of random footholds.
        own: Groups of fields that users' functions read, and the numbers by which reward,
            termination and observation are called; see `transitions.after`.
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
    proportions: Any
    settings: Any
    hooks: Any
    table: Any
    spread: Any
    own: Any


class StepBuffers(NamedTuple):
    """Actions and results of a step of n walkers, flat; see `task.step`.

    Attributes:
        actions: Actions, (n * actions,).
        observations: Filled, (n * observation size,).
        rewards: Filled, (n,).
        terminated: Filled, (n,).
        truncated: Filled, (n,).
        last: Filled with the observations before another episode began.
        plain: The default observations, if a user's function returns others; else (0,).
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


SCRATCH = kind(np.dtype([
    ("lanes", "i8", (1,)),
    ("keys", "u8", (1,)),
    ("slopes", "f8", (1,)),
    ("draws", "f8", (1, DRAWS)),
    ("gaits", "f8", (1, 6)),
    ("actions", "f8", (len(CHANNELS),)),  # disturbed in place
]))  # fmt: skip
"""Working memory of a thread: arrays of a batch of one walker."""


def begin_disturbances(walkers, constants, i, scratch, observations):
    """Draw no disturbances; `disturbed_begin` replaces this in scenes with disturbances."""


def disturbed_begin(walkers, constants, i, scratch, observations):
    """Draw a walker's disturbances, and add them to its observation."""
    own, settings = slice_of(i), constants.settings
    walkers.disturbances[i] = constants.disturbance[0]
    disturbance_kernels.begin(
        walkers.disturbances[own], settings, scratch.lanes, scratch.keys, walkers.pending[own],
        walkers.records[own], walkers.ledger[own], constants.table, constants.spread,
    )  # fmt: skip
    disturbance_kernels.add_observation_noise(
        walkers.disturbances[i], walkers.ledger[i], settings[0], constants.table, constants.spread,
        observations, 0,
    )  # fmt: skip


def slice_of(i):
    """Return the slice of one walker: a batch of one."""
    return slice(i, i + 1)


def own_body(walkers, i):
    """Return the slice of a walker's constants; all walkers can share one row."""
    return slice_of(i if len(walkers.bodies) == len(walkers.records) else 0)


def begin_episode(walkers, constants, i, scratch, observations):
    """Begin a walker's next episode."""
    key = word(walkers.keys[i], np.uint64(walkers.episodes[i]))
    walkers.episodes[i] += 1
    scratch.lanes[0], scratch.keys[0] = 0, key
    for k in range(DRAWS):
        scratch.draws[0, k] = uniform(key, k, _START)
    if len(walkers.bodies) == len(walkers.records):
        walkers.drawn[i] = int(uniform(key, 0, _WHICH) * len(constants.drawn))
        for k in range(constants.drawn.shape[1]):
            walkers.bodies[i, 0, k] = constants.drawn[walkers.drawn[i], k]
    low, high = constants.slopes[0], constants.slopes[1]
    scratch.slopes[0] = low if low == high else low + (high - low) * scratch.draws[0, 0]
    between(constants.nodes, constants.states, scratch.slopes, scratch.gaits)
    own, bodies = slice_of(i), walkers.bodies[own_body(walkers, i)]
    radii = bodies[0, 0, disturbance_kernels.RADIUS : disturbance_kernels.RADIUS + 1]
    walkers.records[i, 0], walkers.ledger[i] = constants.blank[0], constants.row[0]
    task.begin(
        walkers.records[own], bodies, radii, walkers.ledger[own], constants.phases, scratch.lanes,
        scratch.slopes, scratch.gaits, scratch.draws, constants.reset_noise_scale[0], observations,
    )  # fmt: skip
    begin_disturbances(walkers, constants, i, scratch, observations)
    observe_body(walkers, constants, i, observations)


def observe_body(walkers, constants, i, observations):
    """Write the observed proportions of a walker at the end of its observation."""
    proportions = constants.proportions
    first = len(observations) - proportions.shape[1]
    for k in range(proportions.shape[1]):
        observations[first + k] = proportions[walkers.drawn[i], k]


# Functions beginning with `own_` replace the next three in scenes with users' functions.


def before_step(walkers, constants, i):
    """Record nothing before a step."""


def after_step(walkers, constants, buffers, i, rewards, terminated):
    """Evaluate nothing after a step."""


def sight(walkers, constants, buffers, i, observations, begins):
    """Leave the default observation."""


def own_before(walkers, constants, i):
    """Record the state before a step."""
    own = slice_of(i)
    transitions.before(walkers.records[own], walkers.notes[own], constants.own[0])


def own_after(walkers, constants, buffers, i, rewards, terminated):
    """Evaluate a user's reward and termination."""
    own, count = slice_of(i), len(buffers.actions) // len(walkers.records)
    actions = buffers.actions[i * count : (i + 1) * count]
    if len(walkers.disturbances) > 0:
        walkers.notes[i].push = walkers.disturbances[i].impulse
    transitions.after(
        walkers.records[own], walkers.ledger[own], constants.rules, constants.phases, actions,
        walkers.notes[own], constants.own[0], constants.own[1], constants.own[2], True, rewards,
        terminated,
    )  # fmt: skip


def own_sight(walkers, constants, buffers, i, observations, begins):
    """Clear the transition if an episode begins; evaluate a user's observation if there is one."""
    own = slice_of(i)
    notes = walkers.notes[own]
    if begins:
        lanes = cuda.local.array(1, np.int64)
        lanes[0] = 0
        transitions.begin(walkers.records[own], walkers.ledger[own], constants.phases, lanes, notes)
        if len(walkers.disturbances) > 0:
            notes[0].command = walkers.disturbances[i].command
    if constants.own[3] != 0:
        transitions.look(notes, constants.own[3], buffers.numbers[own])
        for k in range(len(observations)):
            observations[k] = buffers.numbers[i, k]


def one_step(
    walkers, constants, i, tiles, histories, actions, observations, rewards, terminated, truncated
):
    """Step a walker; `disturbed_step` replaces this in scenes with disturbances."""
    own, body = slice_of(i), own_body(walkers, i)
    task.step(
        walkers.records[own], walkers.bodies[body], walkers.ledger[own], constants.rules,
        constants.phases, constants.options, tiles, histories, actions, observations, rewards,
        terminated, truncated,
    )  # fmt: skip


def disturbed_step(
    walkers, constants, i, tiles, histories, actions, observations, rewards, terminated, truncated
):
    """Step a walker with disturbances."""
    own, body = slice_of(i), own_body(walkers, i)
    disturbance_kernels.step(
        walkers.records[own], walkers.bodies[body], walkers.ledger[own], constants.rules,
        constants.phases, constants.options, tiles, histories, walkers.disturbances[own],
        walkers.pending[own], constants.settings, constants.hooks, constants.table,
        constants.spread, actions, observations, rewards, terminated, truncated,
    )  # fmt: skip


def own_rows(walkers, buffers, i):
    """Return the views of a walker's observation and of its default observation."""
    count = len(walkers.records)
    seen, shown = len(buffers.observations) // count, len(buffers.plain) // count
    observations = buffers.observations[i * seen : (i + 1) * seen]
    if shown == 0:
        return observations, observations
    return observations, buffers.plain[i * shown : (i + 1) * shown]


def step_and_restart(walkers, constants, buffers, i, tiles, histories, scratch):
    """Step a walker, and begin its next episode if this one has ended."""
    own, (observations, plain) = slice_of(i), own_rows(walkers, buffers, i)
    rewards, terminated = buffers.rewards[own], buffers.terminated[own]
    truncated = buffers.truncated[own]
    actions, finite = scratch.actions[: len(buffers.actions) // len(walkers.records)], True
    for j in range(len(actions)):
        actions[j] = buffers.actions[i * len(actions) + j]
        finite = finite and math.isfinite(actions[j])
    if not finite:
        rewards[0], terminated[0], truncated[0] = math.nan, False, False
        return
    before_step(walkers, constants, i)
    one_step(
        walkers, constants, i, tiles, histories, actions, plain, rewards, terminated, truncated
    )
    observe_body(walkers, constants, i, plain)
    after_step(walkers, constants, buffers, i, rewards, terminated)
    sight(walkers, constants, buffers, i, observations, False)
    walkers.reported[i] = walkers.ledger[i]
    for k in range(len(observations)):
        buffers.last[i * len(observations) + k] = observations[k]
    if terminated[0] or truncated[0]:
        begin_episode(walkers, constants, i, scratch, plain)
        sight(walkers, constants, buffers, i, observations, True)


def reset_kernel(walkers, constants, buffers):
    """Begin an episode of every walker."""
    i = cuda.grid(1)
    if i < len(walkers.records):
        scratch = cuda.local.array(1, SCRATCH)
        observations, plain = own_rows(walkers, buffers, i)
        begin_episode(walkers, constants, i, scratch[0], plain)
        sight(walkers, constants, buffers, i, observations, True)


def step_kernel(walkers, constants, buffers):
    """Step every walker."""
    i = cuda.grid(1)
    if i < len(walkers.records):
        tiles, histories = cuda.local.array(1, TILE), cuda.local.array(1, RUN)
        scratch = cuda.local.array(1, SCRATCH)
        step_and_restart(walkers, constants, buffers, i, tiles, histories, scratch[0])
