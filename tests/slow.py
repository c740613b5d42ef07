"""Which tests are slow, by measurement: `tests/slow.txt` names the functions and the cases.

    python -m pytest -m "not learning" --durations=0 -vv > report.txt
    python -m tests.slow report.txt          Write the list.

A function is slow if its cases take longer than the limit on average; else those of its cases are
that do. Tests with a marker in their file are slow whatever they take.
"""

from __future__ import annotations

import argparse
import re
from collections import Counter, defaultdict
from pathlib import Path

LIST = Path(__file__).with_name("slow.txt")
LIMIT = 0.5  # seconds, on two free cores
_LINE = re.compile(r"\s*([\d.]+)s (?:call|setup|teardown) +(tests/\S.*)")


def slow_in(report: str, limit: float = LIMIT) -> list[str]:
    """Return the slow functions and cases in a report of pytest with all durations."""
    seconds: Counter[str] = Counter()
    for line in report.splitlines():
        if found := _LINE.match(line):
            seconds[found[2]] += float(found[1])
    cases = defaultdict(list)
    for test in seconds:
        cases[test.partition("[")[0]].append(test)
    slow = []
    for function, tests in cases.items():
        if sum(seconds[test] for test in tests) > limit * len(tests):
            slow.append(function)
        else:
            slow += [test for test in tests if seconds[test] > limit]
    return sorted(slow)


def main() -> None:
    """Write the list from a report."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("report", type=Path, help="what pytest wrote, with --durations=0 -vv")
    parser.add_argument("--limit", type=float, default=LIMIT, help="seconds (%(default)s)")
    given = parser.parse_args()
    found = slow_in(given.report.read_text(encoding="utf-8"), given.limit)
    LIST.write_text("\n".join(found) + "\n", encoding="utf-8")
    print(f"{len(found)} functions and cases in {LIST}")


if __name__ == "__main__":
    main()
