"""Tests that concern a module of the package: those that should detect a fault in the module."""

from __future__ import annotations

from pathlib import Path

_MECHANICS = ["tests/physics", "tests/engine"]
_MACHINERY = ["tests/engine", "tests/physics", "tests/stress"]
_USERS = ["tests/physics/test_strides.py", "tests/physics"]
CHANGED = {
    **{
        f"physics/{name}": _MECHANICS
        for name in ("kneed", "straight", "simplest", "legs", "numbers", "hybrid", "bodies")
    },
    **{
        f"engine/{name}": _MACHINERY
        for name in ("expressions", "sines", "native", "runge_kutta", "verner", "layout",
                     "equations", "step", "one_lane", "compiled", "event_location", "lanes", "run")
    },
    **{
        f"walkers/{name}": ["tests/test_walkers.py", *_MECHANICS]
        for name in ("walker", "presets", "parts", "tuning")
    },
    "gaits/stride": [*_USERS, "tests/gaits/test_given.py"],
    "gaits/trajectory": [
        "tests/physics/test_trajectory.py", "tests/physics/test_footholds.py",
        "tests/gaits/test_tables.py", "tests/gaits/test_own_units.py",
    ],
    "gaits/forces": ["tests/physics/test_forces.py", "tests/physics/test_trajectory.py"],
    "arguments": _USERS,
    "units": _USERS,
}  # fmt: skip
"""Modules in which single signs are changed, and the tests that concern them."""

_CONCERNING = {
    "agents/benchmark": "benchmark",
    "agents/callbacks": "callbacks training",
    "agents/checkpoint": "training",
    "agents/commands": "command_line",
    "agents/config": "config",
    "agents/evaluation": "command_line",
    "agents/exploration": "exploration training",
    "agents/files": "files training",
    "agents/learner": "config evaluation training policies/network",
    "agents/results": "benchmark",
    "agents/training": "training",
    "agents/envs": "config training",
    "control/baselines": "baselines closed_loop optimal",
    "control/controlled": "controlled closed_loop matrix",
    "control/maps": "controlled closed_loop matrix",
    "control/feedback": "baselines ticks",
    "control/optimal": "optimal",
    "control/optimum": "optimal ticks",
    "control/ticks": "ticks optimal closed_loop",
    "envs/batch": "batches changes vector_env starts walker_env task custom",
    "envs/checks": "scene",
    "envs/disturbances": "disturbances constraints terrain",
    "envs/disturbance_kernels": "disturbances constraints terrain",
    "envs/infos": "infos",
    "envs/constraints": "constraints disturbances",
    "envs/rules": "task actions batches walker_env disturbances",
    "envs/sb3": "sb3 batches",
    "envs/scene": "scene task walker_env",
    "envs/starts": "starts",
    "envs/task": "task actions starts vector_env batches walker_env",
    "envs/ticks": "infos batches vector_env walker_env task starts",
    "envs/transitions": "custom",
    "envs/vector_env": "batches changes vector_env",
    "envs/walker_env": "batches walker_env",
    "evaluation/robustness": "robustness",
    "evaluation/steps": "steps baselines benchmark",
    "evaluation/linearization": "linearization",
    "evaluation/walks": "agents/evaluation",
    "examples/stride_controllers": "stride_controllers",
    "examples/potential_shaping": "potential_shaping",
    "gaits/basin": "basin bifurcation",
    "gaits/bifurcation": "bifurcation basin",
    "gaits/continuation": "families",
    "gaits/dense_stride": "series reality physics/trajectory stride_map",
    "gaits/doubling": "bifurcation",
    "gaits/family": "families driven",
    "gaits/first_passage": "first_passage",
    "gaits/first_passage_mesh": "first_passage_mesh",
    "gaits/foothold_chain": "first_passage_mesh",
    "gaits/flow": "stride_map control/ticks physics/strides physics/trajectory jacobian",
    "gaits/gait": "gaits",
    "gaits/measures": "measures",
    "gaits/reality": "reality",
    "gaits/search": "gaits families",
    "gaits/stability": "jacobian",
    "gaits/stride_map": "stride_map control/controlled",
    "gaits/terrain": "envs/terrain physics/footholds first_passage",
    "math": "envs/custom",
    "policies/__init__": "network shipped",
    "policies/network": "network",
    "policies/tensors": "network",
    "render/panels": "panels viewer/viewer",
    "validation/scaling": "scaling",
    "validation/wheel": "wheel",
}
"""Tests in a module's own package that concern the module, the likeliest to fail first."""


_OPTIONS = {
    "agents": "tests/options/test_agents.py",
    "cli": "tests/options/test_commands.py",
    "envs": "tests/options/test_environments.py",
    "torch": "tests/options/test_environments.py",
}
"""Tests of the options of a package; functions and objects of the others are in `_PUBLIC`."""

_PUBLIC = [f"tests/options/test_{of}.py" for of in ("functions", "objects", "forms")]
_NOT_PUBLIC = ("examples", "validation")
"""Folders without options."""
_BESIDES = {
    "agents/first_order": "reference first_order",
    "agents/learned_steps": "reference learned_steps",
    "agents/ppo_fast": "reference ppo_fast",
    "cli/sweeps": "sweeps/options",
    "envs/disturbance_kernels": "streams",
    "gaits/terrain": "envs/streams",
}
_EVERYWHERE = "permutations streams conformance/conformance"
"""Tests that concern every module of `envs`; they run after the module's own."""


def tests_of(file: str) -> list[str]:
    """The tests that concern a module, those most likely to detect a fault first.

    Tests listed for the module come first, then tests of options, then all others of its package.
    """
    if file in CHANGED:
        return CHANGED[file]
    package = file.split("/")[0]
    named = f"{_CONCERNING.get(file, '')} {_BESIDES.get(file, '')}".split()
    named += _EVERYWHERE.split() * (package == "envs")
    names = (name if "/" in name else f"{package}/{name}" for name in dict.fromkeys(named))
    tests = [f"tests/{Path(name).parent}/test_{Path(name).name}.py" for name in names]
    options = [_OPTIONS[package]] if package in _OPTIONS else _PUBLIC * (package not in _NOT_PUBLIC)
    if file == "train":
        tests, options = ["tests/agents/test_command_line.py"], [_OPTIONS["agents"]]
    # List single files: pytest orders the files of a folder differently.
    rest = [] if file == package else _tests_in(f"tests/{package}")
    rest = rest or [f"tests/test_{package}.py"]  # of a package without a folder of tests
    return list(dict.fromkeys([*tests, *options, *rest]))


def _tests_in(folder: str) -> list[str]:
    """The test files of a folder."""
    root = Path(__file__).parents[1]
    return [str(path.relative_to(root)) for path in sorted((root / folder).glob("test_*.py"))]
