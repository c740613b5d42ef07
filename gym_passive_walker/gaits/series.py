"""A quantity over a phase of a stride as a Chebyshev series in time.

Between impacts everything is analytic, so a series through a few dozen exact samples holds the
quantity to rounding at every instant, ends included, and its derivative says where it turns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.polynomial.chebyshev import chebinterpolate, chebpts1
from numpy.typing import NDArray
from scipy.optimize import brentq

_FEWEST, _MOST = 32, 256  # samples of a phase
_ROUNDING = 1e-14
_LOOKS = 6  # at a series, for each of its coefficients, when its turns are sought


class Extreme(NamedTuple):
    """A value, and the time at which it is taken."""

    value: float
    time: float


def fit(
    samples: Callable[[NDArray], NDArray],
    start: float,
    end: float,
    *,
    units: NDArray,
    accuracy: float,
) -> list[Chebyshev]:
    """Series of several quantities over a phase.

    Args:
        samples: Takes times (n,) inside the phase to quantities (n, k).
        start: When the phase starts.
        end: When it ends.
        units: Of the quantities, (k,): they carry rounding errors of numbers of this size.
        accuracy: Of the samples, relative to the largest of each quantity.
    """
    count, before = _FEWEST, np.full(len(units), np.inf)
    while True:
        values = samples(0.5 * (start + end) + 0.5 * (end - start) * chebpts1(count))
        columns = chebinterpolate(lambda _, values=values: values, count - 1)  # type: ignore
        size, tail = np.abs(columns).max(axis=0), np.abs(columns[-4:]).max(axis=0)
        resolved = tail <= accuracy * size + _ROUNDING * units
        noisy = tail > 0.1 * before  # more samples bring no more digits
        if count >= _MOST or np.all(resolved | noisy):
            break
        count, before = 2 * count, tail
    return [
        Chebyshev(column, domain=(start, end)).trim(noise)
        for column, noise in zip(columns.T, tail, strict=True)
    ]


def _zeros(function: Callable[[NDArray], NDArray], series: Chebyshev) -> list[float]:
    """Where a function with no more detail than a series changes sign inside its phase."""
    start, end = series.domain
    looks = -np.cos(np.linspace(0.0, np.pi, _LOOKS * (len(series.coef) + 2)))  # denser at the ends
    times = 0.5 * (start + end) + 0.5 * (end - start) * looks
    signs = np.signbit(function(times))
    return [
        float(brentq(function, times[i], times[i + 1], xtol=1e-15 * (end - start)))  # type: ignore
        for i in np.flatnonzero(signs[1:] != signs[:-1])
    ]


def turns(pieces: Iterable[Chebyshev]) -> list[Extreme]:
    """A quantity where it turns and where phases meet, in order of time: monotone in between."""
    found = []
    for piece in pieces:
        start, end = piece.domain
        times = [start, *_zeros(piece.deriv(), piece), end]
        found += [Extreme(float(piece(t)), float(t)) for t in times]
    return found


def ratio_turns(pieces: Iterable[tuple[Chebyshev, Chebyshev]]) -> list[Extreme]:
    """As `turns`, of quotients of two series; infinite where the denominator is not positive."""
    found = []
    for above, below in pieces:
        rise, lift = above.deriv(), below.deriv()

        def slope(t, above=above, below=below, rise=rise, lift=lift):
            return rise(t) * below(t) - above(t) * lift(t)

        finer = max(above, below, key=lambda series: len(series.coef))
        for t in [*(turn.time for turn in turns([below])), *_zeros(slope, finer)]:
            quotient = above(t) / below(t) if below(t) > 0.0 else np.inf
            found.append(Extreme(float(quotient), float(t)))
    return sorted(found, key=lambda turn: turn.time)


def least(candidates: Iterable[Extreme]) -> Extreme:
    """The smallest value, and the first time of it; NaN of nothing."""
    return min(candidates, key=lambda extreme: extreme.value, default=Extreme(np.nan, np.nan))


def greatest(candidates: Iterable[Extreme]) -> Extreme:
    """The largest value, and the first time of it; NaN of nothing."""
    return max(candidates, key=lambda extreme: extreme.value, default=Extreme(np.nan, np.nan))
