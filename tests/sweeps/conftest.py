"""A module of unusual tasks, in a folder from which worker processes import it."""

import sys

import pytest

ODD = '''
import os, signal, time
from pathlib import Path


def square(x, seed=0):
    return {"square": x * x, "odd": x % 2 == 1, "word": f"{x} {seed}"}


def noted(x, folder, processes=1):
    """Says that it was done, so that it can be seen how often; waits for other processes."""
    notes = Path(folder) / "noted"
    with open(notes, "a") as file:
        file.write(f"{x} {os.getpid()}\\n")
    end = time.monotonic() + 20.0
    while time.monotonic() < end:
        time.sleep(0.02)
        if len({line.split()[1] for line in notes.read_text().splitlines()}) >= processes:
            break
    return {"square": x * x}


def dies(x, times, folder):
    """Takes its process with it, the first few times."""
    lives = Path(folder) / "lives"
    if x == 5 and (len(lives.read_text()) if lives.exists() else 0) < times:
        with lives.open("a") as file:
            file.write("x")
        os.kill(os.getpid(), signal.SIGKILL)
    return {"square": x * x}


def orphans(x, folder):
    """Takes with it the process that watches its own, once."""
    reported = Path(folder) / "reported"
    if x == 5 and not reported.exists():
        reported.touch()
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(60.0)
    return {"square": x * x}


def hangs(x):
    if x == 2:
        time.sleep(600)
    if x == 3:
        raise ValueError("three is too many")
    return {"square": x * x}


def compiles(x):
    from gym_passive_walker._tools.progress import compiling

    with compiling("a test"):
        time.sleep(1.5)
    time.sleep(60.0 * x)
    return {"square": x * x}


def changeable(x):
    return {"square": x} if x else {"cube": x}
'''


@pytest.fixture
def odd(tmp_path, monkeypatch):
    """The folder of the module."""
    (tmp_path / "odd_tasks.py").write_text(ODD)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    yield tmp_path
    for name in ("odd_tasks", "own_things"):
        sys.modules.pop(name, None)
