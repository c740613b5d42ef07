"""What the tests of agents share."""

import pytest

import train


@pytest.fixture(scope="session", autouse=True)
def _one_thread():
    """Learn as `train.py` does; more threads only wait for each other."""
    train.keep_to_one_thread()
