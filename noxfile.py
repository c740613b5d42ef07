"""The fast tests on every Python, with the oldest libraries allowed and with the newest.

`make test-matrix` runs all of it; a Python that is not on this machine is left out, and said to be.
Learning is left out too: its libraries are large, and its tests run with the pinned ones.
"""

from tempfile import gettempdir

import nox

nox.options.default_venv_backend = "uv"
nox.options.download_python = "never"

QUIET = {"SDL_VIDEODRIVER": "dummy", "MPLBACKEND": "Agg"}


@nox.session
@nox.parametrize(
    "python,resolution",
    [("3.11", "lowest-direct"), ("3.11", "highest"), ("3.12", "highest"), ("3.13", "highest")],
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
def base(session: nox.Session) -> None:
    """Walk with a wheel and what it cannot do without: by its objects, and by its bitcode."""
    session.install(".")
    session.run("python", "-c", "import importlib.util as u; assert u.find_spec('numba') is None")
    session.chdir(session.create_tmp())  # away from the sources
    for cpu in ({}, {"NUMBA_CPU_NAME": "x86-64-v3"}):  # a name that is given has no objects
        kernels = {"XDG_CACHE_HOME": session.create_tmp(), **cpu}
        session.run("passive-walker", "evaluate", "level-ppo", "--episodes", "2", env=kernels)
        session.run("passive-walker", "gait", "lab", "0.036", env=kernels)


@nox.session(default=False)
def rllib(session: nox.Session) -> None:
    """Sample and learn through RLlib, with the Gymnasium that it pins."""
    session.install("-e", ".[rllib,test]", "torch")
    # Ray waits forever in a temporary folder below its environment, which is nox's.
    kernels = {"XDG_CACHE_HOME": session.create_tmp(), "TMPDIR": gettempdir()}
    chosen = [
        "tests/envs/test_rllib.py",
        "tests/trainers/test_rllib.py",
        "-m",
        "learning or not slow",
    ]
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
