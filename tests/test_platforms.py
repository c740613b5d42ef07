"""What depends on the operating system, with stand-ins for macOS and Windows."""

import ctypes
import ctypes.util
import errno
import os
import tempfile
import warnings
from pathlib import Path
from types import SimpleNamespace

import pytest

import gym_passive_walker as gpw
from gym_passive_walker._tools import console, files
from gym_passive_walker.apps import build
from gym_passive_walker.engine import cache, machine
from tests import everywhere


class System:
    """The module `os` with other entries."""

    def __init__(self, **others):
        vars(self).update(others)

    def __getattr__(self, name):
        return getattr(os, name)


def test_windows_takes_the_mathematics_of_pythons_c_library(monkeypatch):
    named, asked = {}, []
    library = ctypes.CDLL(ctypes.util.find_library("m"))
    of_windows = SimpleNamespace(
        CDLL=lambda name: asked.append(name) or library, cast=ctypes.cast, c_void_p=ctypes.c_void_p
    )
    monkeypatch.setattr(machine, "os", System(name="nt"))
    monkeypatch.setattr(machine, "ctypes", of_windows)
    monkeypatch.setattr(machine, "add_symbol", named.__setitem__)
    machine._machine.__wrapped__()
    assert asked == ["ucrtbase"] and set(named) == set(machine._MATHEMATICS) and all(named.values())


@pytest.mark.parametrize("triple", ["x86_64-pc-windows-msvc", "arm64-apple-darwin24.0.0"])
def test_code_in_a_wheel_is_for_linux(triple, monkeypatch):
    for name in ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"):
        monkeypatch.delenv(name, raising=False)
    features = dict.fromkeys(machine._V4, True)
    monkeypatch.setattr(machine.llvm, "get_host_cpu_features", lambda: features)
    for given, level in (("x86_64-unknown-linux-gnu", "x86-64-v4"), (triple, None)):
        monkeypatch.setattr(machine.llvm, "get_process_triple", lambda given=given: given)
        assert machine._level.__wrapped__() == level


@pytest.mark.parametrize(("counted", "found"), [(6, 6), (None, 1)])
def test_where_free_cpus_are_not_known_all_are_used(counted, found, monkeypatch):
    monkeypatch.setattr(machine, "os", SimpleNamespace(environ={}, cpu_count=lambda: counted))
    assert machine.default_threads.__wrapped__() == found


def test_windows_has_folders_of_each_user(monkeypatch):
    monkeypatch.setattr(cache, "_USER", None)
    assert list(cache._bases())[-1] == Path(tempfile.gettempdir()) / "gym_passive_walker"
    assert cache._ours(os.stat_result([0o777, 0, 0, 0, 12345, 0, 0, 0, 0, 0]))


def test_code_that_another_process_holds_open_is_kept(monkeypatch, tmp_path):
    def replace(*_):
        raise PermissionError(13, "Access is denied")

    cache._warn.cache_clear()
    monkeypatch.setattr(cache, "cache_directory", lambda: tmp_path)
    monkeypatch.setattr(cache, "os", System(name="nt", replace=replace))
    (tmp_path / "held").touch()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cache.keep("held", b"code")
    with pytest.warns(RuntimeWarning, match="cannot be kept"):
        cache.keep("other", b"code")
    assert [path.name for path in tmp_path.iterdir()] == ["held"]


@pytest.mark.filterwarnings("error")
def test_two_threads_keep_code_of_one_name(monkeypatch, tmp_path):
    """The second one keeps its code while the first one is about to rename its file."""

    def replace(*paths):
        monkeypatch.setattr(cache, "os", os)
        cache.keep("code", b"second")
        assert cache.found("code") == b"second"
        os.replace(*paths)

    cache._warn.cache_clear()
    monkeypatch.setattr(cache, "cache_directory", lambda: tmp_path)
    monkeypatch.setattr(cache, "os", System(replace=replace))
    cache.keep("code", b"first")
    assert cache.found("code") == b"first"
    assert [path.name for path in tmp_path.iterdir()] == ["code"]


def test_windows_asks_no_process_whether_it_lives(monkeypatch):
    def kill(*_):
        pytest.fail("on Windows this ends the process")

    monkeypatch.setattr(files, "os", System(name="nt", kill=kill))
    made = "-" + "0" * 16
    assert not files._abandoned(f"1{made}") and files._abandoned(f"{os.getpid()}{made}")


@pytest.mark.parametrize(("system", "most"), [("nt", 61), ("posix", 100)])
def test_windows_waits_for_61_processes_at_most(system, most, monkeypatch):
    monkeypatch.setattr(build, "os", System(name=system))
    assert (build.processes(100), build.processes(4)) == (most, 4)


@pytest.mark.parametrize(
    ("system", "error", "status"),
    [
        ("nt", OSError(errno.EINVAL, "Invalid argument"), 0),
        ("nt", OSError(errno.EINVAL, "Invalid argument", "a file"), 2),
        ("posix", OSError(errno.EINVAL, "Invalid argument"), 2),
        ("posix", BrokenPipeError(errno.EPIPE, "Broken pipe"), 0),
    ],
)
def test_a_reader_that_closes_the_pipe_ends_a_program(system, error, status, monkeypatch, capsys):
    def work():
        raise error

    forgotten = []
    monkeypatch.setattr(console, "os", System(name=system))
    monkeypatch.setattr(console, "forget_output", lambda: forgotten.append(True))
    assert console.run(work) == status
    assert bool(forgotten) == (status == 0) != ("error" in capsys.readouterr().err)


def test_digests_of_walks_are_of_numbers_alone():
    found = everywhere.strides("D")
    assert found == everywhere.strides("D") != everywhere.strides("E")
    with pytest.raises(TypeError, match="addresses"):
        everywhere.digest(gpw.WALKERS["D"])
