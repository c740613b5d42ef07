"""Simulate a device by numba; its module for devices must not be imported before."""

import os
import sys

import numba
import pytest

assert "numba.cuda" not in sys.modules, "a device can be simulated only before it is looked for"
os.environ["NUMBA_ENABLE_CUDASIM"] = "1"
numba.config.ENABLE_CUDASIM = 1


@pytest.fixture(autouse=True)
def quick_turns():
    """The simulator waits for its threads without sleeping: have it let go of Python sooner."""
    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-4)
    yield
    sys.setswitchinterval(usual)
