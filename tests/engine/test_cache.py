"""Compiled code is cached on disk, shared by processes, and never stale."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gym_passive_walker.engine import cache, machine
from gym_passive_walker.engine.compiled import written
from gym_passive_walker.engine.jit import Kernel
from gym_passive_walker.engine.machine import kept_code
from gym_passive_walker.models.equations import simplest

STRIDE = """
import gym_passive_walker as gpw
for name in {names!r}:
    gait = gpw.find_gait(name, 0.03)
    print(name, gait.state.tolist(), abs(gait.multipliers[0]))
"""


def python(code: str, **variables: str) -> str:
    """Output of a new process without other settings of caches."""
    inherited = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**inherited, **variables}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return done.stdout


def run(names: str, folder: object) -> dict[str, str]:
    """Gaits of some walkers, computed by a new process with this kernel cache."""
    lines = python(STRIDE.format(names=names), NUMBA_CACHE_DIR=str(folder)).splitlines()
    return dict(line.split(" ", 1) for line in lines)


@pytest.mark.slow
def test_kernels_cached_by_different_processes_are_not_mistaken_for_each_other(tmp_path):
    alone = {name: run(name, tmp_path)[name] for name in "DEC"}
    together = run("DEC", tmp_path)
    assert together == alone


def test_a_source_that_changes_has_another_fingerprint(tmp_path, monkeypatch):
    shutil.copytree(cache._ROOT, tmp_path, dirs_exist_ok=True)
    found = cache.fingerprint.__wrapped__
    before = found()
    assert all(any(cache._ROOT.glob(f"{pattern}.py")) for pattern in cache._SOURCES)
    monkeypatch.setattr(cache, "_ROOT", tmp_path)
    assert found() == before
    for source in (
        "models/equations/legs.py",
        "engine/native.py",
        "envs/constraints.py",
        "gaits/terrain.py",
    ):
        text = (tmp_path / source).read_text()
        (tmp_path / source).write_text(text + "\n")
        assert found() != before
        (tmp_path / source).write_text(text)
        assert found() == before
    (tmp_path / "models" / "equations" / "another.py").write_text("")
    assert found() != before


def test_whatever_is_compiled_is_part_of_the_fingerprint():
    """Kernels call those of other files, and native code is traced from them.

    Code for GPUs and web pages is not kept.
    """
    hashed = {path for pattern in cache._SOURCES for path in cache._ROOT.glob(f"{pattern}.py")}
    making = ("engine.jit import", "engine.native import")
    made = {
        path
        for path in cache._ROOT.rglob("*.py")
        if path.parent.name not in {"gpu", "web"} and any(m in path.read_text() for m in making)
    }
    assert len(made) > 10 and made <= hashed


COMPILE = """
import gym_passive_walker.engine.compiled as compiled
{before}
print(compiled.compiled("simplest")["guards"].tolist())
"""
REFUSE = """
def refuse(*arguments): raise AssertionError("written again")
compiled.written = refuse
"""


def test_code_that_one_process_has_compiled_another_only_loads(tmp_path):
    given = {"NUMBA_CACHE_DIR": str(tmp_path)}
    first = python(COMPILE.format(before=""), **given)
    objects = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.o")}
    assert len(objects) == 1
    assert python(COMPILE.format(before=REFUSE), **given) == first
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.o")} == objects
    assert not list(tmp_path.rglob("*.[0-9]*"))  # nothing half written


def test_to_look_at_the_package_makes_no_folder(tmp_path):
    """The folder is created for kernels, at their first use."""
    given = {"XDG_CACHE_HOME": str(tmp_path)}
    python(
        "import gym_passive_walker as gpw; print(gpw.WALKERS, gpw.stride, gpw.find_gait)", **given
    )
    assert not list(tmp_path.iterdir())


def folder(monkeypatch, **variables):
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, str(value))
    return cache.cache_directory.__wrapped__()


def test_code_is_kept_in_the_given_folder(tmp_path, monkeypatch):
    chosen, home = tmp_path / "chosen", tmp_path / "home"
    both = folder(monkeypatch, NUMBA_CACHE_DIR=chosen, XDG_CACHE_HOME=home)
    assert both == chosen / "gym_passive_walker" / cache.fingerprint()
    assert folder(monkeypatch, XDG_CACHE_HOME=home).is_relative_to(home)


def test_a_place_that_cannot_be_written_to_is_passed_over(tmp_path, monkeypatch):
    blocked = tmp_path / "a file"
    blocked.write_text("")
    monkeypatch.setattr(cache.tempfile, "gettempdir", lambda: str(tmp_path))
    found = folder(monkeypatch, NUMBA_CACHE_DIR=blocked, XDG_CACHE_HOME=blocked)
    assert found.parent.parent == tmp_path
    assert found.parent.stat().st_mode & 0o777 == 0o700
    assert folder(monkeypatch, NUMBA_CACHE_DIR=blocked, XDG_CACHE_HOME=blocked) == found


def test_without_any_place_nothing_is_kept_and_one_warning_says_so(tmp_path, monkeypatch):
    blocked = tmp_path / "a file"
    blocked.write_text("")
    monkeypatch.setattr(cache.tempfile, "gettempdir", lambda: str(blocked))
    with pytest.warns(RuntimeWarning, match="NUMBA_CACHE_DIR") as said:
        assert folder(monkeypatch, NUMBA_CACHE_DIR=blocked, XDG_CACHE_HOME=blocked) is None
        assert folder(monkeypatch, NUMBA_CACHE_DIR=blocked, XDG_CACHE_HOME=blocked) is None
    assert len(said) == 1


def test_a_user_without_a_home_has_a_cache(tmp_path, monkeypatch):
    def homeless():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(cache.Path, "home", homeless)
    monkeypatch.setattr(cache.tempfile, "gettempdir", lambda: str(tmp_path))
    assert folder(monkeypatch).is_relative_to(tmp_path)


def test_where_nothing_can_be_written_there_is_no_cache(tmp_path, monkeypatch):
    def nowhere():
        raise FileNotFoundError("No usable temporary directory found")

    blocked = tmp_path / "a file"
    blocked.write_text("")
    cache._warn.cache_clear()
    monkeypatch.setattr(cache.tempfile, "gettempdir", nowhere)
    with pytest.warns(RuntimeWarning, match="compiled code cannot be kept"):
        assert folder(monkeypatch, XDG_CACHE_HOME=blocked) is None


@pytest.mark.parametrize("filled", [True, False])
def test_a_cache_that_is_read_only_is_read_if_it_has_code(filled, tmp_path, monkeypatch):
    image, temporary = tmp_path / "image", tmp_path / "temporary"
    monkeypatch.setattr(cache.tempfile, "gettempdir", lambda: str(temporary))
    usual = folder(monkeypatch, XDG_CACHE_HOME=image)
    if filled:
        (usual / "code").write_bytes(b"")
    monkeypatch.setattr(cache.os, "access", lambda where, _: Path(where).is_relative_to(temporary))
    assert (folder(monkeypatch, XDG_CACHE_HOME=image) == usual) is filled


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="each user has folders of their own here")
def test_what_root_has_compiled_is_trusted_as_its_python_files_are(tmp_path, monkeypatch):
    usual = folder(monkeypatch, XDG_CACHE_HOME=tmp_path)
    monkeypatch.setattr(cache, "_USER", usual.stat().st_uid + 1)
    assert (folder(monkeypatch, XDG_CACHE_HOME=tmp_path) == usual) is (usual.stat().st_uid == 0)


def _open_to_all(folder):
    folder.chmod(0o777)


def _open_to_a_group(folder):
    folder.chmod(0o770)


def _a_link(folder):
    folder.rename(folder.with_name("elsewhere"))
    folder.symlink_to(folder.with_name("elsewhere"), target_is_directory=True)


def _another_users(folder):
    os.chown(folder, os.getuid() + 1, -1)


PLACES = {
    "chosen": lambda root: {"NUMBA_CACHE_DIR": root / "chosen", "XDG_CACHE_HOME": root / "own"},
    "at home": lambda root: {"XDG_CACHE_HOME": root / "home"},
}


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="each user has folders of their own here")
@pytest.mark.parametrize("trap", [_open_to_all, _open_to_a_group, _a_link, _another_users])
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("which", ["the package's", "the version's"])
def test_no_code_is_kept_in_or_run_from_a_folder_that_another_user_can_write_to(
    trap, place, which, tmp_path, monkeypatch
):
    monkeypatch.setattr(cache.tempfile, "gettempdir", lambda: str(tmp_path))
    cache._warn.cache_clear()
    usual = folder(monkeypatch, **PLACES[place](tmp_path))
    assert usual.stat().st_mode & 0o777 == usual.parent.stat().st_mode & 0o777 == 0o700
    strange = usual.parent if which == "the package's" else usual
    try:
        trap(strange)
    except PermissionError:
        pytest.skip("only root can make a folder someone else's")
    with pytest.warns(RuntimeWarning, match=rf"{strange} is not used.*remove it.*of your own") as s:
        other = folder(monkeypatch, **PLACES[place](tmp_path))
        assert folder(monkeypatch, **PLACES[place](tmp_path)) == other
    assert len(s) == 1 and not other.is_relative_to(usual.parent) and cache._private(other)


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="each user has folders of their own here")
@pytest.mark.parametrize("trap", [_open_to_all, _open_to_a_group, _another_users])
def test_a_file_that_another_user_could_have_written_is_not_read(trap, kept_in):
    cache.keep("code", b"ours")
    assert cache.found("code") == b"ours"
    try:
        trap(kept_in / "code")
    except PermissionError:
        pytest.skip("only root can make a file someone else's")
    with pytest.warns(RuntimeWarning, match="is another user's, and is not used"):
        assert cache.found("code") is None
    cache.keep("code", b"ours")  # in its place
    assert cache.found("code") == b"ours"


@pytest.mark.skipif(not hasattr(os, "umask"), reason="modes are POSIX")
def test_code_is_kept_where_a_group_may_usually_write(tmp_path, monkeypatch):
    before = os.umask(0o002)
    try:
        kept = folder(monkeypatch, NUMBA_CACHE_DIR=tmp_path / "chosen")
        monkeypatch.setattr(cache, "cache_directory", lambda: kept)
        cache.keep("code", b"ours")
    finally:
        os.umask(before)
    assert cache.found("code") == b"ours"


def _sum_of_digits(number):
    total = 0
    while number:
        total += number % 10
        number //= 10
    return total


def _bookkeeping():
    """Make and call a kernel."""
    assert Kernel(_sum_of_digits)(1234) == 10


def _equations():
    """Make the native code of equations."""
    code = kept_code("simplest", lambda: written(simplest.SYSTEM), "equations")
    assert code.get_function_address("place")


@pytest.fixture
def kept_in(tmp_path, monkeypatch):
    """A cache for this test, without earlier warnings."""
    monkeypatch.setattr(cache, "cache_directory", lambda: tmp_path)
    cache._warn.cache_clear()
    return tmp_path


@pytest.mark.parametrize("code", [_bookkeeping, _equations])
@pytest.mark.parametrize(
    "damage",
    [
        lambda whole: b"",
        lambda whole: whole[: len(whole) // 2],
        lambda whole: whole[:-1] + bytes([whole[-1] ^ 1]),
        lambda whole: bytes(len(whole)),
    ],
    ids=["empty", "half written", "one bit", "zeros"],
)
def test_damaged_code_is_made_again_with_one_warning(kept_in, code, damage):
    code()
    (kept,) = kept_in.iterdir()
    whole = kept.read_bytes()
    kept.write_bytes(damage(whole))
    with pytest.warns(RuntimeWarning, match="damaged, and is made afresh"):
        code()
    assert cache.found(kept.name) and list(kept_in.iterdir()) == [kept]
    kept.write_bytes(damage(whole))
    code()  # in silence: it has been said
    assert cache.found(kept.name)


@pytest.mark.parametrize("code", [_bookkeeping, _equations])
def test_code_on_disk_that_is_whole_is_not_made_again(kept_in, code, monkeypatch):
    code()
    monkeypatch.setattr(cache, "keep", lambda *_: pytest.fail("made again"))
    code()


@pytest.mark.parametrize("code", [_bookkeeping, _equations])
def test_a_full_disk_stops_nobody_and_keeps_no_half_of_it(kept_in, code):
    resource = pytest.importorskip("resource", reason="limits of files are POSIX")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.warns(RuntimeWarning, match="free some space") as said:
            code()
            code()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert len(said) == 1 and not list(kept_in.iterdir())


@pytest.mark.parametrize("code", [_bookkeeping, _equations])
def test_a_cache_that_goes_away_stops_nobody(kept_in, code):
    kept_in.rmdir()
    with pytest.warns(RuntimeWarning, match="cannot be kept"):
        code()


@pytest.mark.parametrize("code", [_bookkeeping, _equations])
def test_without_a_cache_code_lives_as_long_as_the_process(monkeypatch, code):
    monkeypatch.setattr(cache, "cache_directory", lambda: None)
    code()


def test_without_numba_a_kernel_that_is_not_there_says_what_to_install(kept_in, monkeypatch):
    monkeypatch.delitem(sys.modules, "gym_passive_walker.engine.compiler", raising=False)
    monkeypatch.delattr("gym_passive_walker.engine.compiler", raising=False)
    monkeypatch.setitem(sys.modules, "numba", None)
    with pytest.raises(ImportError, match=r"numba is not installed: install it, or .* wheel"):
        _bookkeeping()


def test_a_kernel_takes_and_returns_what_python_has():
    assert Kernel(_twice)(3) == 6 and Kernel(_twice)(-3) == -6
    assert Kernel(_twice)(0.75) == 1.5
    assert Kernel(_twice)(np.int64(4)) == 8
    assert Kernel(_filled)(np.zeros(3), 2.5) == 0
    for given in (np.zeros((4, 4))[:, 1], np.zeros((2, 3)).T):
        with pytest.raises(TypeError, match="contiguous arrays only"):
            Kernel(_filled)(given, 1.0)
    with pytest.raises(TypeError, match="arrays and numbers, not str"):
        Kernel(_twice)("3")


def _twice(number):
    return 2 * number


def _filled(numbers, value):
    for i in range(len(numbers)):
        numbers[i] = value


def test_a_kernel_writes_into_arrays_of_any_type_and_releases_the_lock():
    for kind in (np.float64, np.float32, np.int64):
        numbers = np.zeros((5,), kind)
        Kernel(_filled)(numbers, 3.0)
        assert np.all(numbers == 3)


def test_code_for_a_wheel_is_of_each_level_and_has_the_same_results(tmp_path, monkeypatch):
    """A kernel from bitcode, as a CPU has it for which a wheel has no objects."""
    asked = machine.asked_by([lambda: Kernel(_twice).native(1)])
    ((name, write),) = asked.items()
    text = write()
    monkeypatch.setattr(machine, "BUILT", tmp_path)
    monkeypatch.setattr(cache, "cache_directory", lambda: tmp_path)
    (tmp_path / f"{name}.bc").write_bytes(machine.bitcode(text))
    monkeypatch.setitem(sys.modules, "gym_passive_walker.engine.compiler", None)
    assert Kernel(_twice)(21) == 42
    for level in machine.LEVELS.values():
        assert len(machine.object_for(level, text)) > 300


def test_a_cpu_without_fused_multiply_adds_is_warned_of(monkeypatch):
    has = machine.llvm.get_host_cpu_features()
    monkeypatch.setattr(machine.llvm, "get_process_triple", lambda: "x86_64-unknown-linux-gnu")
    monkeypatch.setattr(machine.llvm, "get_host_cpu_features", lambda: type(has)(has, fma=False))
    for name in ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"):
        monkeypatch.delenv(name, raising=False)
    with pytest.warns(RuntimeWarning, match="no fused multiply-add"):
        machine._machine.__wrapped__()


@pytest.mark.parametrize(("asked", "found"), [("3", 3), ("1", 1), ("", None)])
def test_large_batches_have_the_threads_that_are_asked_for(asked, found, monkeypatch):
    monkeypatch.setenv(machine.THREADS, asked)
    assert machine.default_threads.__wrapped__() == (found or len(os.sched_getaffinity(0)))


@pytest.mark.parametrize("asked", ["0", "-1", "many", "1.5"])
def test_a_number_of_threads_that_is_none_is_refused(asked, monkeypatch):
    monkeypatch.setenv(machine.THREADS, asked)
    with pytest.raises(ValueError, match="NUMBA_NUM_THREADS must be"):
        machine.default_threads.__wrapped__()
