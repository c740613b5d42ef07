"""A name that modules share means one thing, or a reason says why it does not."""

import ast
from collections import defaultdict
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "gym_passive_walker"

FAMILIES = {
    "kinds of walkers": ("models/equations/kneed", "models/equations/straight",
                         "models/equations/simplest"),
    "what compiled code calls": ("engine/jit", "devices/gpu/instructions", "devices/gpu/simulated",
                                 "devices/gpu/primitives"),
    "programs": ("apps/sweeps/tasks", *(f"apps/cli/{path.stem}"
                                        for path in (PACKAGE / "apps/cli").glob("*.py"))),
}  # fmt: skip
"""Modules that state the same things by the same names, one in place of another."""

_COMMAND = "the command or the analysis of a sweep has the name of what it runs"
_PAGE = "JavaScript calls the page's functions by these names"
_TASK = "in scenes with disturbances its function replaces that of `envs/task`"
_DEVICE = "the same on another device, or for one walker"
SHARED = {
    **dict.fromkeys(
        ("check", "compare", "evaluate", "export", "gauntlet", "play", "robustness", "simulate",
         "strobe", "sweep", "video"), _COMMAND,
    ),
    **dict.fromkeys(("lay_ground", "push", "run"), _PAGE),
    **dict.fromkeys(("begin", "step"), _TASK),
    **dict.fromkeys(
        ("advance", "entry", "integrate_past_events", "integrate_phase", "sqrt"), _DEVICE
    ),
    **dict.fromkeys(("Stride", "stride"), "public, and the same with tensors or on a GPU"),
    "main": "what `python -m` runs",
    "System": "public for a walker of one's own; and what the engine is given",
    "Number": "a number of any kind in equations; and a number of a user's function",
    "forces": "in equations those of the coordinates; of a stride those on ground and joints",
    "potential_gain": "of one leg, of which those of the walkers consist",
}  # fmt: skip
"""Names that modules share, and why."""


def places():
    """Modules that define each public name at their top, families as one."""
    found = defaultdict(set)
    for path in PACKAGE.rglob("*.py"):
        module = path.relative_to(PACKAGE).with_suffix("").as_posix()
        family = next((name for name, modules in FAMILIES.items() if module in modules), module)
        for line in ast.parse(path.read_text(encoding="utf-8")).body:
            targets = getattr(line, "targets", [getattr(line, "target", line)])
            names = [getattr(each, "id", getattr(each, "name", "_")) for each in targets]
            for name in names:
                found[name].add(family)
    return {name: where for name, where in found.items() if not name.startswith("_")}


def test_each_name_that_modules_share_has_its_reason():
    shared = {name for name, where in places().items() if len(where) > 1}
    assert shared == {*SHARED}
    assert len(shared) <= 30
