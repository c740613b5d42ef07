"""Tests that concern a module of the package: those that should detect a fault in the module."""

from __future__ import annotations

from pathlib import Path

_ROOT = Path(__file__).parents[1]
_MECHANICS = ["tests/equations", "tests/engine"]
_MACHINERY = ["tests/engine", "tests/equations", "tests/stress"]
_USERS = ["tests/equations/test_strides.py", "tests/equations"]
CHANGED = {
    **{
        f"models/equations/{name}": _MECHANICS
        for name in ("kneed", "straight", "simplest", "legs", "numbers", "hybrid", "bodies")
    },
    **{
        f"engine/{name}": _MACHINERY
        for name in ("sines", "native", "runge_kutta", "verner", "layout",
                     "equations", "step", "one_lane", "compiled", "event_location", "lanes", "run")
    },
    "models/expressions": _MACHINERY,
    **{
        f"models/walkers/{name}": ["tests/test_walkers.py", *_MECHANICS]
        for name in ("walker", "presets", "parts", "tuning")
    },
    "gaits/stride": [*_USERS, "tests/gaits/test_given.py"],
    "gaits/look/trajectory": [
        "tests/equations/test_trajectory.py", "tests/equations/test_footholds.py",
        "tests/gaits/test_tables.py", "tests/gaits/test_own_units.py",
    ],
    "gaits/look/forces": ["tests/equations/test_forces.py", "tests/equations/test_trajectory.py"],
    "_tools/arguments": ["tests/equations/test_arguments.py", "tests/test_refusals.py", *_USERS],
    "models/units": ["tests/equations/test_arguments.py", *_USERS],
}  # fmt: skip
"""Modules in which single signs are changed, and the tests that concern them."""

_CONCERNING = {
    "agents/benchmark": "results benchmark",
    "agents/callbacks": "callbacks training",
    "agents/checkpoint": "updates training",
    "agents/commands": "commands command_line",
    "agents/config": "config",
    "agents/evaluation": "commands evaluation command_line",
    "agents/exploration": "exploration training",
    "agents/files": "files training",
    "agents/learner": "config evaluation training policies/network",
    "agents/networks": "networks updates ppo_fast",
    "agents/pictures": "pictures command_line",
    "agents/results": "results benchmark",
    "agents/rllib": "trainers/rllib",
    "agents/search": "search training",
    "agents/sweep": "sweep training",
    "agents/training": "training",
    "agents/envs": "config training",
    "gaits/control/baselines": "baselines closed_loop optimal",
    "gaits/control/controlled": "controlled closed_loop matrix",
    "gaits/control/maps": "controlled closed_loop matrix",
    "gaits/control/feedback": "baselines ticks",
    "gaits/control/optimal": "optimal",
    "gaits/control/optimum": "optimal ticks",
    "gaits/control/ticks": "ticks optimal closed_loop",
    "apps/cli/gaits": "answers tables commands",
    "apps/cli/report": "answers tables",
    "apps/cli/walks": "answers tables commands",
    "apps/cli/warmup": "answers",
    "envs/batch": "batches changes vector_env starts walker_env task custom",
    "gaits/scenes/checks": "scene",
    "envs/custom": "custom explain",
    "envs/disturbances": "disturbances constraints terrain",
    "envs/disturbance_kernels": "disturbances constraints terrain",
    "envs/explain": "explain",
    "envs/frames": "frames",
    "envs/infos": "infos",
    "envs/interface": "arguments actions walker_env vector_env explain",
    "envs/one_thread": "one_thread",
    "envs/registration": "walker_env arguments",
    "envs/memory": "saved_states disturbances own_functions batches",
    "envs/saved": "saved_states batches vector_env walker_env",
    "envs/constraints": "constraints disturbances",
    "gaits/scenes/rules": "task actions batches walker_env disturbances",
    "envs/sb3": "sb3 batches",
    "gaits/scenes/scene": "scene task walker_env",
    "gaits/scenes/starts": "starts",
    "envs/task": "task actions starts vector_env batches walker_env",
    "envs/ticks": "infos batches vector_env walker_env task starts",
    "envs/transitions": "custom",
    "envs/vector_env": "batches changes vector_env",
    "envs/walker_env": "batches walker_env",
    "envs/evaluation/gauntlet": "score_cards gauntlet",
    "envs/evaluation/linearization": "score_cards linearization",
    "envs/evaluation/pictures": "score_cards robustness",
    "envs/evaluation/robustness": "score_cards robustness",
    "envs/evaluation/steps": "steps control/baselines agents/evaluation agents/benchmark",
    "envs/evaluation/walks": "score_cards agents/evaluation",
    "examples/driven_torso": "driven_torso systems",
    "examples/five_links": "systems",
    "examples/stride_controllers": "stride_controllers",
    "examples/potential_shaping": "potential_shaping",
    "examples/rimless_wheel": "systems",
    "examples/torso": "systems",
    "gaits/robust/basin": "basin bifurcation",
    "gaits/branches/bifurcation": "bifurcation basin",
    "gaits/branches/continuation": "families",
    "gaits/look/dense_stride": "series reality equations/trajectory stride_map",
    "gaits/branches/doubling": "bifurcation",
    "gaits/branches/family": "families driven varied_map",
    "gaits/robust/first_passage": "first_passage",
    "gaits/robust/first_passage_mesh": "first_passage_mesh",
    "gaits/robust/foothold_chain": "first_passage_mesh",
    "gaits/flow": "stride_map control/ticks equations/strides equations/trajectory jacobian",
    "gaits/gait": "gaits",
    "gaits/look/measures": "measures",
    "gaits/look/reality": "reality",
    "gaits/find/search": "gaits families",
    "gaits/look/stability": "jacobian",
    "gaits/stride_map": "stride_map control/controlled",
    "gaits/terrain": "envs/terrain equations/footholds first_passage",
    "gaits/branches/varied_map": "varied_map",
    "devices/gpu/batch": "batch environment conformance/conformance",
    "devices/gpu/device": "compiled batch strides",
    "devices/gpu/environment": "environment conformance/conformance",
    "devices/gpu/episodes": "batch environment conformance/conformance",
    "devices/gpu/instructions": "compiled strides",
    "devices/gpu/lane": "strides systems batch",
    "devices/gpu/primitives": "strides batch",
    "devices/gpu/simulated": "compiled strides",
    "devices/gpu/source": "compiled strides systems",
    "devices/gpu/strides": "strides systems",
    "models/math": "envs/custom",
    "envs/policies/__init__": "plain network shipped",
    "envs/policies/network": "plain network",
    "envs/policies/onnx_file": "onnx",
    "envs/policies/sb3_file": "sb3_file",
    "envs/policies/tensors": "plain network",
    "apps/sweeps/quantities": "rows meaning description",
    "apps/sweeps/tasks": "tasks meaning rows",
    "torch/environment": "lanes environment conformance/conformance",
    "torch/operation": "lanes walks rollouts",
    "torch/rollouts": "lanes rollouts conformance/conformance",
    "torch/walks": "lanes walks",
    "torch/trainers/rsl_rl": "walkers contracts",
    "torch/trainers/skrl": "walkers contracts",
    "torch/trainers/torchrl": "walkers contracts",
    "validation/page": "page rows",
    "validation/rows": "rows page",
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
    "agents/first_order": "updates reference first_order",
    "agents/learned_steps": "reference learned_steps",
    "agents/ppo_fast": "updates reference ppo_fast",
    "apps/cli/sweeps": "sweeps/options",
    "envs/disturbance_kernels": "streams",
    "gaits/terrain": "envs/streams",
}
_SINGLE = {
    "__init__": "options/test_functions test_walkers test_shown",
    "console": "test_console",
    "_version": "cli/test_commands web/test_notes",
    "gpu": "gpu/test_strides gpu/test_compiled",
    "math": "envs/test_custom",
    "modeling": "own/test_statements own/test_equations",
    "control/__init__": "control/test_baselines",
    "control/baselines": "control/test_baselines",
    "__main__": "cli/test_commands test_console",
    "_tools/extras": "test_shown cli/test_commands",
    "_tools/files": "test_files cli/test_files cli/test_answers",
    "models/math": "envs/test_custom own/test_limits own/test_numbers",
    "apps/play": "web/test_play cli/test_files",
    "apps/serve": "web/test_play",
    "apps/shown": "web/test_play web/test_widget",
    "apps/widget": "web/test_widget web/test_page",
}
"""All tests of modules outside packages, where tests have other names."""
_KEPT: dict[str, tuple[str, ...]] = {
    "agents": ("tests/pictures/test_drawn.py",),
    **dict.fromkeys(("cli", "gpu", "pictures", "sweeps", "validation", "web"), ()),
}
"""Tests by package that compare with a file of results, instead of `tests/test_results.py`."""
_EVERYWHERE = "permutations streams conformance/conformance"
"""Tests that concern every module of `envs`; they run after the module's own."""


def tests_of(file: str) -> list[str]:
    """The tests that concern a module, those most likely to detect a fault first.

    Tests listed for the module come first, then those that compare with a file of results, then
    tests of options, then all others of its package.
    """
    if file in CHANGED:
        return CHANGED[file]
    package = _folder_of(file)
    named = f"{_CONCERNING.get(file, '')} {_BESIDES.get(file, '')}".split()
    named += _EVERYWHERE.split() * (package == "envs")
    names = (name if "/" in name else f"{package}/{name}" for name in dict.fromkeys(named))
    tests = [f"tests/{Path(name).parent}/test_{Path(name).name}.py" for name in names]
    options = [_OPTIONS[package]] if package in _OPTIONS else _PUBLIC * (package not in _NOT_PUBLIC)
    if file in _SINGLE:
        return [f"tests/{name}.py" for name in _SINGLE[file].split()]
    if file == "train":
        tests = [f"tests/agents/test_{name}.py" for name in ("commands", "command_line")]
        options = [_OPTIONS["agents"]]
    # List single files: pytest orders the files of a folder differently.
    rest = [] if file == package else _tests_in(f"tests/{package}")
    named = f"tests/test_{package}.py"  # of a package without a folder of tests
    rest = rest or [named if (_ROOT / named).exists() else "tests/docs/test_names.py"]
    kept = _KEPT.get(package, ("tests/test_results.py",))
    return list(dict.fromkeys([*tests, *kept, *options, *rest]))


def _tests_in(folder: str) -> list[str]:
    """The test files of a folder."""
    return [str(path.relative_to(_ROOT)) for path in sorted((_ROOT / folder).glob("test_*.py"))]


def _folder_of(file: str) -> str:
    """The folder of a module's tests: that of the innermost room which has one."""
    if file.startswith("gaits/scenes/"):
        return "envs"
    rooms = Path(file).parent.parts
    if rooms in ((), ("_tools",)):
        return Path(file).name
    known = (room for room in reversed(rooms) if (_ROOT / "tests" / room).is_dir())
    return next(known, rooms[-1])
