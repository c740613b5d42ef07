"""Deliberate faults fit the sources: a fault in code that is gone would no longer be tried."""

from pathlib import Path

import pytest

from benchmarks import related_tests
from benchmarks.mutants import BLIND, FAULTS, UNSEEN, faults

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("folder", [FAULTS, BLIND, UNSEEN], ids=lambda folder: folder.name)
def test_the_code_of_each_fault_is_in_the_package(folder):
    found, gone = faults(folder)
    assert found and gone == []


def test_each_module_names_tests_that_are_there():
    package = ROOT / "gym_passive_walker"
    files = [path.relative_to(package) for path in package.rglob("*.py")]
    files += [path.relative_to(ROOT) for name in ("examples", "validation")
              for path in (ROOT / name).glob("*.py")]  # fmt: skip
    modules = {path.with_suffix("").as_posix() for path in files}
    for module in modules | {*related_tests.CHANGED}:
        tests = related_tests.tests_of(module)
        assert tests, module
        assert [name for name in tests if not (ROOT / name).exists()] == [], module
    assert {*related_tests.CHANGED} <= modules
