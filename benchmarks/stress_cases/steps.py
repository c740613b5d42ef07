"""Uneven ground with steps up and down: heelstrikes on the next foothold, and nowhere else."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.stress_cases.case import Finding, case
from benchmarks.stress_cases.flight import Flock, flock
from gym_passive_walker import WALKERS, Outcome
from gym_passive_walker.models.equations.legs import NARROWEST
from gym_passive_walker.models.equations.systems import UNEVEN

TOPIC = "Uneven ground"
_TOLERANCES = (1e-6, 1e-8, 1e-10, 1e-12)
_PORTION = 10_000
_GRAZE = 0.01  # relative change of an initial state within which a graze may have either outcome
_ONE_IN = 20_000


class RandomStrides(NamedTuple):
    """Strides of one walker from random states, each towards its own foothold.

    Attributes:
        flock: The walker, any number of times.
        states: Dimensionless states just after heelstrike, (n, 6).
        ground: Slope in rad, and the next foothold's dimensionless height change and slope change
            in rad, (n,) each.
    """

    flock: Flock
    states: NDArray[np.float64]
    ground: dict[str, NDArray[np.float64]]

    def walk(self, tolerance: float) -> NDArray:
        """Records of the strides at a tolerance, (n,)."""
        return self.flock.follow(self.states, tolerance=tolerance, **self.ground)

    def beside(self, i: int, count: int, rng: np.random.Generator) -> RandomStrides:
        """Strides from states near that of stride `i`, towards footholds near its own."""
        shake = 1.0 + _GRAZE * rng.uniform(-1.0, 1.0, (count, 6))
        states = self.states[i] * shake
        if not self.flock.kneed:
            states[:, [2, 5]] = states[:, [1, 4]]
        ground = {name: value[i] * shake[:, 0] for name, value in self.ground.items()}
        return self._replace(states=states, ground=ground)


def footholds(rng: np.random.Generator, count: int) -> dict[str, NDArray[np.float64]]:
    """Slopes, and footholds with random steps, stairs or slope changes, a third of each."""
    kind = rng.integers(3, size=count)
    size = rng.choice([1e-5, 1e-3, 0.01, 0.05], count)
    rises = [
        size * rng.normal(size=count),
        rng.choice([-1.0, 1.0], count) * rng.uniform(0.0, 0.15, count),
        0.02 * rng.normal(size=count) * (rng.random(count) < 0.7),
    ]
    return {
        "slope": rng.uniform(-0.1, 0.2, count),
        "rise": np.choose(kind, rises),
        "turn": np.where(kind == 2, rng.uniform(-0.3, 0.3, count), 0.0),
    }


def random_strides(rng: np.random.Generator, name: str, count: int) -> RandomStrides:
    """Strides of a preset from both feet on the ground, with random angular velocities."""
    walker = WALKERS[name]
    angle = rng.uniform(0.02, 0.7, count)
    pace = rng.choice([0.3, 1.0, 2.0], count)[:, None] * rng.normal(size=(count, 3))
    rates = pace - np.stack([3.5 * angle + 0.2, angle, angle], axis=1)
    states = np.concatenate([np.outer(angle, [1.0, -1.0, -1.0]), rates], axis=1)
    if not walker.knees:
        states[:, 5] = states[:, 4]
    return RandomStrides(flock(walker, using=UNEVEN), states, footholds(rng, count))


def portions(rng: np.random.Generator, count: int):
    """Strides of every preset in turn, each with a tolerance."""
    size = min(_PORTION, max(1, count // (len(WALKERS) * len(_TOLERANCES))))
    for _ in range(max(1, count // (size * len(WALKERS) * len(_TOLERANCES)))):
        for name in WALKERS:
            for tolerance in _TOLERANCES:
                yield random_strides(rng, name, size), tolerance


@case(
    TOPIC,
    "Wild strides on random steps, stairs and turned footholds: each strike comes with the legs "
    "apart, its energy balance closes as well as it is integrated, and no stride diverges",
    quick=60_000, long=10_000_000, bound=10.0, unit="tolerance × energy of its angles and rates",
)  # fmt: skip
def strikes_on_steps(count: int, rng: np.random.Generator) -> Finding:
    """Test the energy balance, which a heelstrike at a wrong place violates."""
    tried, failed, worst = 0, 0, 0.0
    for strides, tolerance in portions(rng, count):
        walks = strides.walk(tolerance)
        struck = walks["outcome"] == Outcome.HEELSTRIKE
        spread = walks["state"][:, 0] - walks["state"][:, 1]
        share = strides.flock.error_over_tolerance(strides.states, walks, tolerance)
        tried += len(walks)
        failed += int((walks["outcome"] == Outcome.DIVERGED).sum())
        failed += int((struck & ~(spread > NARROWEST - 1e-12)).sum())
        worst = max(worst, float(share[struck].max(initial=0.0)))
    return Finding(tried, failed, worst)


@case(
    TOPIC,
    "Wild strides on random steps, stairs and turned footholds end as they do at a tolerance of "
    "10⁻¹³, but for grazes, at each tolerance from 10⁻⁶ on",
    quick=60_000, long=10_000_000, bound=1.0, unit="1 in 20,000",
)  # fmt: skip
def ends_on_steps(count: int, rng: np.random.Generator) -> Finding:
    """Test outcomes; in a graze, a change of the state within `_GRAZE` changes the outcome."""
    tried = dict.fromkeys(_TOLERANCES, 0)
    others, failed = tried.copy(), 0
    for strides, tolerance in portions(rng, count):
        outcomes, exact = (strides.walk(x)["outcome"] for x in (tolerance, 1e-13))
        tried[tolerance] += len(exact)
        for i in np.flatnonzero(outcomes != exact):
            others[tolerance] += 1
            beside = strides.beside(i, 1000, rng).walk(1e-13)
            failed += int(outcomes[i] not in beside["outcome"])
    worst = max(others[x] * _ONE_IN / max(_ONE_IN, tried[x]) for x in _TOLERANCES)
    return Finding(sum(tried.values()), failed, worst)
