"""Several events in one integration step: the earliest ends the phase, for any step length."""

from __future__ import annotations

import numpy as np
import pytest

from gym_passive_walker import Outcome, stride
from gym_passive_walker.models.equations.hybrid import SMOOTH, State, Watch
from gym_passive_walker.models.walkers import WALKERS
from tests.instants import states_at

COUNT = 600


def thrown(walker, seed=0, count=COUNT):
    """Initial states so fast that one step of a coarse tolerance contains several events."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform([0.05, -0.6, -0.2], [0.4, 0.0, 0.0], (count, 3))
    angles[:, 2] += angles[:, 1]
    states = np.concatenate([angles, rng.uniform(-12.0, 12.0, (count, 3))], axis=1)
    if not WALKERS[walker].knees:
        states[:, 2], states[:, 5] = states[:, 1], states[:, 4]
    return states


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
@pytest.mark.parametrize("walker", ["lab", "C", "A", "D"])
def test_of_events_in_one_step_the_earliest_ends_the_phase(walker, tolerance):
    """As with steps so short that each contains one event only."""
    states = thrown(walker)
    coarse, fine = (stride(walker, 0.02, states, tolerance=x) for x in (tolerance, 1e-13))
    apart = np.flatnonzero(coarse.outcome != fine.outcome)
    # What differs grazes: rare, and the rarer the finer the tolerance is.
    assert len(apart) <= (0.02 if tolerance > 1e-4 else 0.004) * COUNT
    same = coarse.outcome == fine.outcome
    scale = WALKERS[walker].units.time
    late = np.abs(coarse.duration - fine.duration)[same] / scale
    assert np.quantile(late, 0.98) < 30.0 * tolerance
    assert len(set(fine.outcome.tolist())) >= 3


@pytest.mark.parametrize("walker", ["lab", "C", "A"])
def test_no_walker_goes_on_beyond_a_bound(walker):
    """All states of a stride before its end lie within all bounds of its phase."""
    body, system = WALKERS[walker].body, WALKERS[walker].equations()
    units, states = WALKERS[walker].units, thrown(walker, seed=1, count=150)
    found = stride(walker, 0.02, states, tolerance=1e-6)
    seen = set()
    for state, duration, outcome in zip(states, found.duration, found.outcome, strict=True):
        if not np.isfinite(duration) or duration <= 0.0:
            continue
        times = np.linspace(0.0, 1.0 - 1e-6, 60) * duration
        inside, phases = states_at(WALKERS[walker], 0.02, state, times, tolerance=1e-10)
        seen.add(Outcome(int(outcome)))
        for row, phase in zip(units.to_dimensionless(inside), phases, strict=True):
            (there,) = (each for each in system.phases if int(each.stage) == int(phase))
            for guard in there.guards:
                if guard.watch == Watch.BOUND and not guard.where:
                    height = guard.falls(body, State(*row), SMOOTH)
                    assert height > -1e-6, (outcome, guard.outcome, state)
    assert len(seen) >= 3


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-8])
@pytest.mark.parametrize("first", ["forward", "over"])
def test_of_two_bounds_that_a_throw_reaches_at_once_the_nearer_one_ends_it(first, tolerance):
    """A stance leg and a swing leg so fast that one step reaches both bounds."""
    stance, swing = (-50.0, 40.0) if first == "forward" else (-40.0, 90.0)
    state = [0.2, 0.0, 0.0, stance, swing, swing]
    falls, goes_over = (0.5 * np.pi + 0.2) / -stance, np.pi / swing
    assert (falls < goes_over) == (first == "forward")
    walker = WALKERS["D"]  # its legs do not act on each other
    found = stride(walker, 0.0, state, tolerance=tolerance)
    expected = Outcome.FELL_FORWARD if first == "forward" else Outcome.SWING_OVERROTATION
    ended = Outcome(int(found.outcome))
    assert ended in (expected, Outcome.HEELSTRIKE)
    fine = stride(walker, 0.0, state, tolerance=1e-13)
    assert ended == fine.outcome
    assert found.duration == pytest.approx(fine.duration, rel=10.0 * tolerance)
