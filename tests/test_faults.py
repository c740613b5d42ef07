"""Deliberate faults fit the sources: a fault in code that is gone would no longer be tried."""

import pytest

from benchmarks.mutants import BLIND, FAULTS, UNSEEN, faults


@pytest.mark.parametrize("folder", [FAULTS, BLIND, UNSEEN], ids=lambda folder: folder.name)
def test_the_code_of_each_fault_is_in_the_package(folder):
    found, gone = faults(folder)
    assert found and gone == []
