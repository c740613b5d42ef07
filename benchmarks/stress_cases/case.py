"""A statement about walkers, a way to try it many times, and how far it may be off."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from typing import NamedTuple

import numpy as np


class Finding(NamedTuple):
    """What trying a statement showed.

    Attributes:
        tried: How many times it was tried.
        failed: How many times it did not hold.
        error: The largest error seen, in the unit that the case names; NaN where none is measured.
    """

    tried: int
    failed: int
    error: float = np.nan


Check = Callable[[int, np.random.Generator], Finding]


class Case(NamedTuple):
    """A statement and how it is tried.

    Attributes:
        topic: Heading under which it stands.
        statement: What must hold.
        check: Tries it about so many times, with these random numbers.
        quick: How many times in a fast test.
        long: How many times in a long one.
        bound: Largest error allowed; NaN where none is measured.
        unit: What the error is measured in.
    """

    topic: str
    statement: str
    check: Check
    quick: int
    long: int
    bound: float
    unit: str

    def run(self, *, long: bool = False) -> Finding:
        """Try it, always with the same random numbers."""
        rng = np.random.default_rng(zlib.crc32(self.statement.encode()))
        return self.check(self.long if long else self.quick, rng)

    def holds(self, finding: Finding) -> bool:
        """Whether nothing failed and the error is within its bound."""
        within = np.isnan(self.bound) or finding.error <= self.bound
        return finding.tried > 0 and finding.failed == 0 and bool(within)


CASES: list[Case] = []


def case(
    topic: str, statement: str, *, quick: int, long: int, bound: float = np.nan, unit: str = ""
) -> Callable[[Check], Check]:
    """Enter a check among the `CASES`."""

    def enter(check: Check) -> Check:
        CASES.append(Case(topic, statement, check, quick, long, bound, unit))
        return check

    return enter
