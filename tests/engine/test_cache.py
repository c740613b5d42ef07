"""Compiled code is kept on disk, shared by processes, and never stale."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import pytest

from gym_passive_walker.engine import cache
from gym_passive_walker.engine import compiled as machinery
from gym_passive_walker.physics import simplest

STRIDE = """
import gym_passive_walker as gpw
for name in {names!r}:
    gait = gpw.find_gait(name, 0.03)
    print(name, gait.state.tolist(), abs(gait.multipliers[0]))
"""


def python(code: str, **variables: str) -> str:
    """What a fresh process prints that is told nothing else of caches."""
    inherited = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**inherited, **variables}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return done.stdout


def run(names: str, folder: object) -> dict[str, str]:
    """Gaits of some walkers as a fresh process with that kernel cache finds them."""
    lines = python(STRIDE.format(names=names), NUMBA_CACHE_DIR=str(folder)).splitlines()
    return dict(line.split(" ", 1) for line in lines)


@pytest.mark.slow
def test_kernels_cached_by_different_processes_are_not_mistaken_for_each_other(tmp_path):
    alone = {name: run(name, tmp_path)[name] for name in "DEC"}
    together = run("DEC", tmp_path)
    assert together == alone


def test_a_source_that_changes_has_another_fingerprint(tmp_path, monkeypatch):
    root = cache._ROOT
    for room in ("physics", "engine"):
        shutil.copytree(root / room, tmp_path / room)
    found = cache.fingerprint.__wrapped__
    before = found()
    monkeypatch.setattr(cache, "_ROOT", tmp_path)
    assert found() == before
    for source in ("physics/legs.py", "engine/native.py"):
        text = (tmp_path / source).read_text()
        (tmp_path / source).write_text(text + "\n")
        assert found() != before
        (tmp_path / source).write_text(text)
        assert found() == before
    (tmp_path / "physics" / "another.py").write_text("")
    assert found() != before


COMPILE = """
import gym_passive_walker.engine.compiled as compiled
{before}
print(compiled.compiled("simplest")["guards"].tolist())
"""
REFUSE = """
def refuse(*arguments): raise AssertionError("written anew")
compiled.written = refuse
"""


def test_code_that_one_process_has_compiled_another_only_loads(tmp_path):
    told = {"NUMBA_CACHE_DIR": str(tmp_path)}
    first = python(COMPILE.format(before=""), **told)
    objects = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.o")}
    assert len(objects) == 1
    assert python(COMPILE.format(before=REFUSE), **told) == first
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.o")} == objects
    assert not list(tmp_path.rglob("*.[0-9]*"))  # nothing half written


def test_to_look_at_the_package_makes_no_folder(tmp_path):
    """It is made for kernels, when they are first needed."""
    told = {"XDG_CACHE_HOME": str(tmp_path)}
    python(
        "import gym_passive_walker as gpw; print(gpw.WALKERS, gpw.stride, gpw.find_gait)", **told
    )
    assert not list(tmp_path.iterdir())


def folder(monkeypatch, **variables):
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, str(value))
    return cache.cache_directory.__wrapped__()


def test_code_is_kept_where_it_is_told_to_be(tmp_path, monkeypatch):
    chosen, home = tmp_path / "chosen", tmp_path / "home"
    both = folder(monkeypatch, NUMBA_CACHE_DIR=chosen, XDG_CACHE_HOME=home)
    assert both == chosen / "gym_passive_walker" / cache.fingerprint()
    assert folder(monkeypatch, XDG_CACHE_HOME=home).is_relative_to(home)


def test_a_place_that_cannot_be_written_to_is_passed_over(tmp_path, monkeypatch):
    blocked = tmp_path / "a file"
    blocked.write_text("")
    monkeypatch.setattr(cache.tempfile, "gettempdir", lambda: str(tmp_path / "last"))
    found = folder(monkeypatch, NUMBA_CACHE_DIR=blocked, XDG_CACHE_HOME=blocked)
    assert found.is_relative_to(tmp_path / "last")
    monkeypatch.setattr(cache.tempfile, "gettempdir", lambda: str(blocked))
    with pytest.raises(OSError, match="NUMBA_CACHE_DIR"):
        folder(monkeypatch, NUMBA_CACHE_DIR=blocked, XDG_CACHE_HOME=blocked)


def test_damaged_code_is_made_again(tmp_path, monkeypatch):
    monkeypatch.setattr(machinery, "cache_directory", lambda: tmp_path)
    made = []

    def write():
        made.append(1)
        return machinery.written(simplest.SYSTEM)

    machinery._kept("simplest", write)
    (kept,) = tmp_path.glob("*.o")
    whole = kept.read_bytes()
    for damaged in (b"", whole[: len(whole) // 2], whole[:-1] + b"?", bytes(len(whole))):
        kept.write_bytes(damaged)
        machinery._kept("simplest", write)
        assert kept.read_bytes() == whole
    machinery._kept("simplest", write)
    assert len(made) == 5
