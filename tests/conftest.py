"""Settings for every test."""

import os
import re
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

# The first example of a test may compile a kernel, which takes as long as it takes.
settings.register_profile(
    "walkers", deadline=None, max_examples=100, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("walkers")

STRICT = bool(os.environ.get("FAIL_ON_SKIP"))
"""Whether a test that is skipped for a missing library fails, as in `.ci/run`."""

MAY_LACK = ("ray",)
"""Libraries that the gate does without: ray is large, and its RLlib pins another Gymnasium."""

FOLDERS_NEED = ("torch", "stable_baselines3")
"""Libraries without which whole folders of tests are not even collected."""


def lacking(report: Any) -> str | None:
    """The library for which something is skipped, if that may not be."""
    if not (STRICT and report.outcome == "skipped"):
        return None
    found = re.search(r"could not import '([\w.]+)'", str(report.longrepr))
    name = found[1].partition(".")[0] if found else None
    return None if name in MAY_LACK else name


def pytest_configure() -> None:
    """Refuse to test with whole folders left out."""
    absent = [name for name in FOLDERS_NEED if STRICT and find_spec(name) is None]
    if absent:
        raise pytest.UsageError(f"FAIL_ON_SKIP is set, and {', '.join(absent)} is not installed")


def _failed_if_skipped(report: Any) -> Any:
    if name := lacking(report):
        report.outcome = "failed"
        report.longrepr = (
            f"skipped, since {name} is not installed: add it to the extra dev and to "
            "constraints.txt, or to MAY_LACK in tests/conftest.py with the reason"
        )
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Iterator[None]:
    """Fail a test that lacks a library."""
    return _failed_if_skipped((yield))


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Iterator[None]:
    """Fail a module that lacks a library."""
    return _failed_if_skipped((yield))
