"""Fixtures of the tests of agents."""

from importlib.util import find_spec

import pytest

# What learns comes with the extra "train".
collect_ignore_glob = [] if find_spec("stable_baselines3") else ["*"]


@pytest.fixture(scope="session", autouse=True)
def _one_thread():
    """Limit torch to one thread, as `train.py` does; more threads only wait for each other."""
    import train

    train.keep_to_one_thread()


@pytest.fixture(scope="session")
def steep_run(tmp_path_factory):
    """The folder of a finished run of SAC; tests change only copies of it."""
    import train
    from tests.agents.runs import TINY

    folder = tmp_path_factory.mktemp("runs") / "steep"
    assert train.main(["--scene", "steep", "--algo", "sac", "--out", str(folder), *TINY]) == 0
    return folder
