"""Settings for all tests."""

import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

# The first example of a test may compile a kernel, which takes as long as it takes.
settings.register_profile(
    "walkers", deadline=None, max_examples=100, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("walkers")

os.environ["MPLBACKEND"] = "Agg"  # no test opens a window
os.environ["BROWSER"] = "true"  # nor a page: `play` starts this program, which does nothing

STRICT = bool(os.environ.get("FAIL_ON_SKIP"))
"""Whether a test that is skipped for a missing library fails, as in `.ci/run`."""

MAY_LACK = (
    "ray", "sb3_contrib", "sbx", "rl_zoo3", "tianshou", "minari", "agilerl", "evotorch",
    "pinocchio", "pydrake",
)  # fmt: skip
"""Libraries that the gate does without: nox's rllib, clients and simulators install them.

ray is large, and its RLlib pins another Gymnasium; the others are tested by their first examples.
"""

FOLDERS_NEED = ("torch", "stable_baselines3")
"""Libraries without which whole folders of tests are not even collected."""


def lacking(report: Any) -> str | None:
    """The library for which a test is skipped, if that library is required."""
    if not (STRICT and report.outcome == "skipped"):
        return None
    found = re.search(r"could not import '([\w.]+)'", str(report.longrepr))
    name = found[1].partition(".")[0] if found else None
    return None if name in MAY_LACK else name


def pytest_configure() -> None:
    """Raise an error if whole folders of tests would be omitted."""
    absent = [name for name in FOLDERS_NEED if STRICT and find_spec(name) is None]
    if absent:
        raise pytest.UsageError(f"FAIL_ON_SKIP is set, and {', '.join(absent)} is not installed")


@pytest.hookimpl(tryfirst=True)  # before pytest leaves marked tests out
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the functions and cases that `tests.slow` has found to be slow."""
    measured = Path(__file__).with_name("slow.txt")
    slow = set(measured.read_text("utf-8").splitlines()) if measured.exists() else set()
    for item in items:
        if {item.nodeid, item.nodeid.partition("[")[0]} & slow:
            item.add_marker(pytest.mark.slow)


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


OF_LIBRARIES = ("pymp-", "torchinductor_", "pytest-of-", ".ses", "ray")
"""How the names of files begin that multiprocessing, torch, pytest, onnxruntime and Ray make."""


@pytest.fixture(scope="session")
def temporary_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A private temporary directory of all tests and of the processes that they start."""
    folder = tmp_path_factory.mktemp("t")  # Ray's sockets there have at most 107 bytes in a path
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TMPDIR", str(folder))
        # Where stable-baselines3 makes a folder of logs for each model that has no logger.
        patch.setenv("SB3_LOGDIR", str(tmp_path_factory.mktemp("logs")))
        patch.setattr(tempfile, "tempdir", str(folder))
        yield folder


@pytest.fixture(autouse=True)
def nothing_is_left_behind(temporary_folder: Path) -> Iterator[None]:
    """Fail a test that leaves files or folders in the temporary directory."""
    yield
    left = [path for path in temporary_folder.iterdir() if not path.name.startswith(OF_LIBRARIES)]
    for path in left:
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    assert not left, f"left in the temporary directory: {[path.name for path in left]}"


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Iterator[None]:
    """Fail a module that lacks a library."""
    return _failed_if_skipped((yield))


@pytest.fixture(autouse=True)
def _no_figures_left() -> Iterator[None]:
    """Close pyplot's figures before each test."""
    yield
    if pyplot := sys.modules.get("matplotlib.pyplot"):
        pyplot.close("all")


@pytest.fixture
def assert_same() -> Callable[[Any, Any], None]:
    """Asserts that results, infos or states are alike to the last bit."""

    def same(a: Any, b: Any, where: str = "") -> None:
        if isinstance(a, dict):
            assert set(a) == set(b), (where, set(a) ^ set(b))
            for key in a:
                same(a[key], b[key], f"{where}/{key}")
        elif isinstance(a, (list, tuple)):
            assert len(a) == len(b), where
            for i, (x, y) in enumerate(zip(a, b, strict=True)):
                same(x, y, f"{where}/{i}")
        elif isinstance(a, np.ndarray):
            assert isinstance(b, np.ndarray) and a.dtype == b.dtype and a.shape == b.shape, where
            if a.dtype == object:
                same(list(a), list(b), where)
            else:
                assert np.array_equal(a, b), (where, a, b)
        else:
            assert type(a) is type(b) and a == b, (where, a, b)

    return same
