"""All stress tests, in the order in which they are printed."""

from __future__ import annotations

from benchmarks.stress_cases import (  # noqa: F401
    accuracy,
    anything,
    chaos,
    coincidences,
    conservation,
    drift,
    extremes,
    steps,
    strikes,
    vertical,
)
from benchmarks.stress_cases.case import CASES, Case

_ORDER = (strikes, steps, coincidences, extremes, anything, conservation, drift, chaos, accuracy)
TOPICS = [module.TOPIC for module in _ORDER]

STATEMENTS: list[Case] = sorted(CASES, key=lambda case: TOPICS.index(case.topic))
