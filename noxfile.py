"""The fast tests on every Python, with the oldest libraries allowed and with the newest.

`make test-matrix` runs all of it; a Python that is not on this machine is left out, and said to be.
Learning is left out too: its libraries are large, and its tests run with the pinned ones.
"""

import json
import math
import shutil
import time
from pathlib import Path
from tempfile import gettempdir
from typing import Any

import nox

nox.options.default_venv_backend = "uv"
nox.options.download_python = "never"

QUIET = {"SDL_VIDEODRIVER": "dummy", "MPLBACKEND": "Agg"}


@nox.session
@nox.parametrize(
    "python,resolution",
    [
        ("3.11", "lowest-direct"),
        ("3.11", "highest"),
        ("3.12", "highest"),
        ("3.13", "highest"),
        ("3.14", "highest"),
    ],
)
def tests(session: nox.Session, resolution: str) -> None:
    """Walk in an environment of its own, and compile its kernels again."""
    # Matplotlib 3.10.0 calls pyparsing by names that 3.3 warns of.
    bounds = ["pyparsing~=3.2.0"] * (resolution == "lowest-direct")
    session.install(f"--resolution={resolution}", "-e", ".[render,figures,test]", *bounds)
    kernels = {"XDG_CACHE_HOME": session.create_tmp()}
    session.run("python", "-m", "pytest", *session.posargs, env=QUIET | kernels)


@nox.session
def cpus(session: nox.Session) -> None:
    """Walk with the instructions of older CPUs."""
    session.install("-e", ".[test]")
    kernels = {"XDG_CACHE_HOME": session.create_tmp()}
    chosen = ["tests/engine/test_lanes.py", "-k", "another_cpu", "-m", "slow or not slow"]
    session.run("python", "-m", "pytest", *chosen, env=QUIET | kernels)


@nox.session
@nox.parametrize("numba", ["==0.61.*", ">=0.61"])
def base(session: nox.Session, numba: str) -> None:
    """Walk with a wheel and what it cannot do without: by its objects, and by its bitcode.

    The oldest numba that may build one, and the newest; the oldest LLVM that may read it, and the
    newest.
    """
    place = Path(session.create_tmp()).resolve()
    wheel, programs = _wheel(session, place, numba), _programs(place)
    session.chdir(place)  # away from the sources
    found = set()
    for resolution in ("lowest-direct", "highest"):
        session.install(f"--resolution={resolution}", "--upgrade", str(wheel), "llvmlite")
        session.run("python", "-c", "import importlib.util as u; assert not u.find_spec('numba')")
        for cpu in ({}, {"NUMBA_CPU_NAME": "x86-64-v3"}):  # a name that is given has no objects
            shutil.rmtree(place / "kernels", ignore_errors=True)
            kernels = {"XDG_CACHE_HOME": str(place / "kernels"), "PYTHONPATH": str(programs)}
            told = session.run("python", *EVERYWHERE, env=kernels | cpu, silent=True, stderr=None)
            found.add("".join(line for line in told.splitlines() if "gait of" not in line))
            session.run(
                "passive-walker", "evaluate", "level-ppo", "--episodes=2", env=kernels | cpu
            )
        session.run("python", "-c", PAGE, env={"PYTHONPATH": str(programs)})
    if len(found) > 1:
        session.error("walks have other bytes by another LLVM")


EVERYWHERE = "-m", "tests.everywhere"
"""Prints digests of walks."""

PAGE = """
from examples.torso import TORSO
from gym_passive_walker.devices import web
web.build("page", {"torso": TORSO})
"""


def _wheel(session: nox.Session, place: Path, numba: str = ">=0.61") -> Path:
    """Build a wheel, and return its path."""
    bounds, folder = place / "bounds.txt", place / "dist"
    bounds.write_text(f"numba{numba}\n")
    shutil.rmtree(folder, ignore_errors=True)
    session.run("uv", "build", "--wheel", f"--build-constraints={bounds}", f"--out-dir={folder}")
    (wheel,) = folder.glob("*.whl")
    return wheel


def _programs(place: Path) -> Path:
    """Return a folder with the tests, beside which there are no sources of the package."""
    for folder in ("tests", "examples"):
        shutil.copytree(folder, place / "programs" / folder, dirs_exist_ok=True)
    return place / "programs"


@nox.session(default=False, python="3.11")
def arm(session: nox.Session) -> None:
    """Walk on emulated ARM CPUs, by wheels, and compare the bytes with those of this CPU.

    Needs Debian's packages qemu-user and mmdebstrap, which bring Debian 12 for ARM.
    """
    if missing := [name for name in ("qemu-aarch64", "mmdebstrap") if not shutil.which(name)]:
        session.error(f"{' and '.join(missing)} missing: install qemu-user and mmdebstrap")
    place = Path(session.create_tmp()).resolve()
    debian, site, outside = place / "debian", place / "site", {"external": True}
    shutil.rmtree(debian, ignore_errors=True)
    shutil.rmtree(site, ignore_errors=True)
    session.run(
        "mmdebstrap", "--variant=extract", "--architectures=arm64",
        "--include=python3.11,libgcc-s1,libstdc++6", "bookworm", str(debian), **outside,
    )  # fmt: skip
    wheel, programs = _wheel(session, place), _programs(place)
    session.install(str(wheel))
    session.run(
        "uv", "pip", "install", "--target", str(site), "--only-binary=:all:",
        "--python-platform=aarch64-manylinux_2_28", str(wheel),
    )  # fmt: skip
    session.chdir(place)  # away from the sources
    to_text: dict[str, Any] = {"silent": True, "stderr": None}
    caches = {"XDG_CACHE_HOME": str(place / "here"), "PYTHONPATH": str(programs)}
    expected = session.run("python", *EVERYWHERE, env=caches, **to_text)
    for cpu in ("neoverse-n1", "max"):  # vectors of 128 bits, and longer ones
        began, kernels = time.monotonic(), place / cpu
        shutil.rmtree(kernels, ignore_errors=True)
        found = session.run(
            "qemu-aarch64", "-cpu", cpu, "-L", str(debian), "-E", f"XDG_CACHE_HOME={kernels}",
            "-E", f"PYTHONPATH={site}:{programs}", str(debian / "usr/bin/python3.11"), *EVERYWHERE,
            **outside, **to_text,
        )  # fmt: skip
        _compare(session, cpu, expected, found)
        session.log(f"{cpu}: all walks have the same bytes; {time.monotonic() - began:.0f} s")


def _compare(session: nox.Session, cpu: str, expected: str, found: str) -> None:
    """Compare lines of `tests.everywhere`: digests, or numbers."""
    ours, theirs = (dict(map(json.loads, text.splitlines())) for text in (expected, found))
    for name, value in ours.items():
        if isinstance(value, str):
            same = theirs[name] == value
        else:
            pairs = zip(theirs[name], value, strict=True)
            same = all(math.isclose(a, b, rel_tol=1e-9, abs_tol=1e-9) for a, b in pairs)
        if not same:
            session.error(f"on {cpu}, {name} is {theirs[name]} and not {value}")


@nox.session(default=False)
def rllib(session: nox.Session) -> None:
    """Sample, learn and sweep on Ray, with the Gymnasium that RLlib pins."""
    session.install("-e", ".[rllib,test]", "torch")
    # Ray waits forever in a temporary folder below its environment, which is nox's.
    kernels = {"XDG_CACHE_HOME": session.create_tmp(), "TMPDIR": gettempdir()}
    chosen = [
        "tests/envs/test_rllib.py",
        "tests/trainers/test_rllib.py",
        "tests/sweeps/test_ray.py",
        "-m",
        "",
    ]
    session.run("python", "-m", "pytest", *chosen, *session.posargs, env=QUIET | kernels)


@nox.session(default=False)
def simulators(session: nox.Session) -> None:
    """Read files of walkers with MuJoCo, Pinocchio and Drake."""
    session.install("-e", ".[mujoco,test]", "pin==4.1.0", "drake==1.51.1")
    kernels = {"XDG_CACHE_HOME": session.create_tmp(), "FAIL_ON_SKIP": ""}
    chosen = ["tests/bridge", "-m", "slow or not slow"]
    session.run("python", "-m", "pytest", *chosen, *session.posargs, env=QUIET | kernels)


CLIENTS = {
    "sb3_contrib": ["sb3-contrib"],
    "sbx": ["sbx-rl"],
    "rl_zoo3": ["rl_zoo3"],
    "tianshou": ["tianshou[eval]"],
    "minari": ["minari[all]", "pillow"],
    "agilerl": ["agilerl", "peft"],
    "evotorch": ["evotorch", "pandas"],
}
"""Libraries of `tests/clients/test_others.py`, and what their examples need besides."""


@nox.session(default=False)
@nox.parametrize("client", list(CLIENTS))
def clients(session: nox.Session, client: str) -> None:
    """Run a library's first example with a walker, in an environment of its own."""
    session.install("-e", ".[test,render]", "torch", *CLIENTS[client])
    kernels = {"XDG_CACHE_HOME": session.create_tmp(), "TMPDIR": gettempdir(), "FAIL_ON_SKIP": ""}
    chosen = ["tests/clients/test_others.py", "-k", client]
    session.run("python", "-m", "pytest", *chosen, *session.posargs, env=QUIET | kernels)
