"""Stress tests: check every property of the simulation under difficult conditions.

``python -m benchmarks.stress`` takes half a minute; ``--long`` tries ten million random states and
a million strides.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from benchmarks.report import machine, table
from benchmarks.stress_cases.case import Case, Finding
from benchmarks.stress_cases.everything import STATEMENTS
from benchmarks.tables import DOCS, keep
from gym_passive_walker._tools import console

PAGE = DOCS / "stability.md"


def row(case: Case, finding: Finding) -> list[object]:
    """A row of the table: a stress test and its result."""
    if np.isnan(case.bound):
        error = ""
    else:
        error = f"{finding.error:.1e} of {case.bound:g} allowed ({case.unit})"
    return [case.topic, case.statement, finding.tried, finding.failed, error]


def main() -> int:
    """Run from the command line; returns 0 if all tests pass, else 1."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--long", action="store_true", help="try each a hundred times as often")
    parser.add_argument("--only", default="", help="statements or topics that contain this")
    parser.add_argument("--write", action="store_true", help=f"put the table into {PAGE.name}, "
        "where that of all statements stands, or that of those asked for")  # fmt: skip
    options = parser.parse_args()
    rows, broken = [], 0
    for case in STATEMENTS:
        if options.only.lower() not in f"{case.topic} {case.statement}".lower():
            continue
        before = time.perf_counter()
        finding = case.run(case.long if options.long else case.quick)
        held = case.holds(finding)
        broken += not held
        rows.append(row(case, finding))
        mark = "    " if held else "NOT "
        print(f"{mark}{time.perf_counter() - before:7.1f} s  {case.statement}", flush=True)
    heads = ["topic", "statement", "tried", "failed", "largest error"]
    text = f"{table(heads, rows)}\n\n{machine('scipy')}."
    if options.write:
        keep(f"stress {options.only}".strip(), text, PAGE)
    else:
        print(f"\n{text}")
    return 1 if broken else 0


if __name__ == "__main__":
    raise SystemExit(console.run(main))
