"""Events end a phase where their guard falls through zero."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gym_passive_walker import Outcome
from gym_passive_walker.engine.compiled import compiled
from gym_passive_walker.engine.run import advance, integrate, new_records, options, workspace
from gym_passive_walker.models.equations.hybrid import SMOOTH, State, Watch
from gym_passive_walker.models.equations.systems import UNEVEN
from gym_passive_walker.models.model import bodies
from tests.equations.statements import KINDS
from tests.equations.test_statements import EXAMPLES, PHASES

GUARDS = [
    pytest.param(
        system, index, number, id=f"{name}-{phase.stage.name}-{number}-{guard.outcome.name}"
    )
    for name, system in KINDS.items()
    for index, phase in enumerate(system.phases)
    for number, guard in enumerate(phase.guards)
]

INSIDE = State(0.1, 0.05, -0.3, -1.0, 0.5, 0.8)
"""A leg in full swing, behind the other; that of a straight leg has its shank at 0.05."""

EVENTS = {
    Outcome.KNEESTRIKE: [dict(thigh=0.2, shank=0.2)],
    Outcome.HEELSTRIKE: [dict(stance=-0.3, thigh=0.3, shank=0.3)],
    Outcome.FELL_FORWARD: [dict(stance=-0.5 * math.pi)],
    Outcome.FELL_BACKWARD: [dict(stance=0.5 * math.pi)],
    Outcome.SWING_OVERROTATION: [
        dict(thigh=math.pi), dict(thigh=-math.pi), dict(shank=math.pi), dict(shank=-math.pi),
    ],
    # A straight leg touches the ground where the legs are side by side, or mirror each other.
    Outcome.STUBBED_TOE: [dict(stance=0.1, thigh=0.1), dict(stance=0.3, thigh=-0.3)],
}  # fmt: skip
"""States, but for the rest of them, on each event."""


@pytest.mark.parametrize(("system", "index", "number"), GUARDS)
def test_a_guard_is_zero_on_its_event_and_has_a_sign_beside_it(system, index, number):
    guard, body = system.phases[index].guards[number], EXAMPLES[system.name].body
    on = [INSIDE._replace(**event) for event in EVENTS[guard.outcome]]
    values = [abs(guard.falls(body, state, SMOOTH)) for state in on]
    assert min(values) < 1e-15
    if guard.watch == Watch.BOUND:
        assert guard.falls(body, INSIDE, SMOOTH) > 0.0


@pytest.mark.parametrize(("system", "index"), PHASES)
def test_a_walker_in_full_swing_is_inside_all_bounds(system, index):
    body = EXAMPLES[system.name].body
    outcomes = set()
    for guard in system.phases[index].guards:
        outcomes.add(guard.outcome)
        if guard.watch == Watch.BOUND:
            assert guard.falls(body, INSIDE, SMOOTH) > 0.0
    assert {Outcome.FELL_FORWARD, Outcome.FELL_BACKWARD, Outcome.SWING_OVERROTATION} < outcomes
    assert set(system.phases[index].resets) < outcomes


@pytest.mark.parametrize(("system", "index", "number"), GUARDS)
def test_a_walker_that_begins_beyond_a_bound_has_ended_at_once(system, index, number):
    guard = system.phases[index].guards[number]
    if guard.watch != Watch.BOUND:
        return
    walker = EXAMPLES[system.name]
    for event in EVENTS[guard.outcome]:
        state = INSIDE._replace(**{name: 1.2 * value for name, value in event.items()})
        if guard.falls(walker.body, state, SMOOTH) > 0.0:
            continue
        records = new_records(np.array([state]), 0.0)
        records["phase"] = index
        before = records.copy()
        advance(system, bodies(walker), records, tolerance=1e-10, from_section=False)
        assert records["outcome"] == guard.outcome
        before["outcome"] = guard.outcome
        np.testing.assert_array_equal(records, before)


def phases_whose_strikes_do_nothing(system):
    """The phases of a system; their outcomes are 100 and the number of the guard that fell."""
    phases = compiled(system.name).copy()
    for phase in phases:
        phase["outcomes"] = 100 + np.arange(len(phase["outcomes"]))
    return phases


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-10, 1e-14])
@pytest.mark.parametrize(("system", "index"), PHASES)
def test_a_walker_lands_where_its_guard_is_zero(system, index, tolerance):
    """To rounding at the finest tolerance; else to a share of the tolerance, on either side."""
    rng, walker, count = np.random.default_rng(1), EXAMPLES[system.name], 200
    states = np.array(INSIDE) + rng.normal(size=(count, 6)) * [0.1, 0.1, 0.1, 1.5, 1.5, 1.5]
    if system.phases[index].links == 2:
        states[:, 2], states[:, 5] = states[:, 1], states[:, 4]
    records = new_records(states, rng.uniform(-0.1, 0.1, count))
    records["phase"] = index
    phases = phases_whose_strikes_do_nothing(system)
    integrate(records, bodies(walker), phases, options(tolerance), *workspace())
    values, fell = records[:, 0], set()
    assert walker.equations(UNEVEN if "uneven" in system.name else ()) is system
    for record in values[values["outcome"] >= 100]:
        number = int(record["outcome"]) - 100
        guard, state = system.phases[index].guards[number], State(*record["state"])
        fell.add(guard.outcome)
        height = guard.falls(walker.body, state, SMOOTH)
        speed = np.abs(record["state"][3:]).max()
        assert abs(height) < (1.0 + speed) * (0.1 * tolerance + 1e-14)
        assert all(where(walker.body, state, SMOOTH) > 0.0 for where in guard.where)
    assert set(system.phases[index].resets) <= fell
    assert len(fell) >= 3
