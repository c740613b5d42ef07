"""Functions of `fates` for one walker, without working memory of their own."""

from __future__ import annotations

from gym_passive_walker.engine.run import carry_on
from gym_passive_walker.envs import fates


def carry_through(records, bodies, fates_, phases, options, tiles, courses, odds, natives):
    """Integrate the one walker to the end of its step; see `fates.carry_through`."""
    record, fate = records[0, 0], fates_[0]
    fate.until, fate.impulse = record.end, 0.0
    if not fate.idle:
        fates.meet(records, bodies, 0, fate, odds, natives)
    carry_on(records, bodies, phases, options, tiles, courses)
    while not fate.idle and record.outcome == 0 and record.time < fate.until:
        fates.meet(records, bodies, 0, fate, odds, natives)
        carry_on(records, bodies, phases, options, tiles, courses)


def as_it_is(actions):
    """Return the actions themselves, which are the walker's own copy; see `fates.copied`."""
    return actions
