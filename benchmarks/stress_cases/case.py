"""A stress test: a statement about walkers, its check with random trials, and an error bound."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from typing import NamedTuple

import numpy as np


class Finding(NamedTuple):
    """Result of a stress test.

    Attributes:
        tried: Number of trials.
        failed: Number of trials in which the statement did not hold.
        error: Largest error, in the unit of the case; NaN if no error is measured.
    """

    tried: int
    failed: int
    error: float = np.nan


Check = Callable[[int, np.random.Generator], Finding]


class Case(NamedTuple):
    """A stress test.

    Attributes:
        topic: Heading of the test in the table.
        statement: Property that must hold.
        check: Function of an approximate number of trials and a random generator.
        quick: Number of trials in a fast test.
        long: Number of trials in a long test.
        bound: Largest permitted error; NaN if no error is measured.
        unit: Unit of the error.
    """

    topic: str
    statement: str
    check: Check
    quick: int
    long: int
    bound: float
    unit: str

    def run(self, trials: int) -> Finding:
        """Run the test with about so many trials; random numbers are equal in every run.

        The seed is computed from the statement, so another wording has other random numbers.
        """
        rng = np.random.default_rng(zlib.crc32(self.statement.encode()))
        return self.check(trials, rng)

    def holds(self, finding: Finding) -> bool:
        """Whether no trial failed and the error is within its bound."""
        within = np.isnan(self.bound) or finding.error <= self.bound
        return finding.tried > 0 and finding.failed == 0 and bool(within)


CASES: list[Case] = []


def case(
    topic: str, statement: str, *, quick: int, long: int, bound: float = np.nan, unit: str = ""
) -> Callable[[Check], Check]:
    """Decorator that adds a check to `CASES`."""

    def enter(check: Check) -> Check:
        CASES.append(Case(topic, statement, check, quick, long, bound, unit))
        return check

    return enter
