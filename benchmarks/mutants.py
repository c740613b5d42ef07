"""Mutants: single modules with a random change by cosmic-ray."""

from __future__ import annotations

import ast
import difflib
import random
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[1]
PACKAGE = "gym_passive_walker"
FOLDERS = (PACKAGE, "agents", "examples", "validation")


class Mutant(NamedTuple):
    """A module of the repository with one change: its path, line, description and source."""

    file: str
    line: int
    name: str
    source: str


def files(packages: Sequence[str] = ()) -> list[str]:
    """Modules in folders of these names; all modules if there are no names."""
    paths = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py"))
    found = [path.relative_to(ROOT) for path in paths]
    return [x.as_posix() for x in found if not packages or {*packages} & {*x.parent.parts}]


def bare(source: str) -> str:
    """A source without annotations, layout and comments."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        for name in {"annotation", "returns"}.intersection(node._fields):
            setattr(node, name, None)
    return ast.dump(tree)


def places(modules: Sequence[str]) -> dict[tuple[str, tuple[int, int]], list[tuple[str, int]]]:
    """Changes by module and position: the operator's name, and the number of its occurrence."""
    from cosmic_ray import plugins
    from cosmic_ray.ast import ast_nodes, get_ast_from_path

    names = [name for name in plugins.operator_names() if "Variable" not in name]
    operators = {name: plugins.get_operator(name)() for name in names}
    found: dict = {}
    for file in modules:
        nodes = [*ast_nodes(get_ast_from_path(ROOT / file))]
        for name, operator in operators.items():
            positions = (each for node in nodes for each, _ in operator.mutation_positions(node))
            for number, position in enumerate(positions):
                found.setdefault((file, position), []).append((name, number))
    return found


def draw(seed: int, modules: Sequence[str]) -> Iterator[Mutant]:
    """Yield mutants in random order: first a place is drawn, then one of the changes there.

    Changes of annotations and of layout alone are left out.
    """
    from cosmic_ray import plugins
    from cosmic_ray.mutating import mutate_code

    known, rng = places(modules), random.Random(seed)
    keys = sorted(known)
    rng.shuffle(keys)
    for file, position in keys:
        operator, number = rng.choice(known[file, position])
        source = (ROOT / file).read_text(encoding="utf-8")
        changed = mutate_code(source, plugins.get_operator(operator)(), number)
        try:
            if changed is None or bare(changed) == bare(source):
                continue
        except SyntaxError:
            continue
        lines = source.splitlines(), changed.splitlines()
        differences = [*difflib.unified_diff(*lines, lineterm="", n=0)][3:]
        said = " | ".join(f"{line[0]} {line[1:].strip()}" for line in differences)
        name = f"{file}:{position[0]} {operator.removeprefix('core/')}: {said}"
        yield Mutant(file, position[0], name, changed)


@cache
def sources() -> set[str]:
    """Modules on which compiled code depends, as the cache of it lists them.

    Coverage does not trace compiled code.
    """
    text = (ROOT / PACKAGE / "engine" / "cache.py").read_text(encoding="utf-8")
    patterns = ast.literal_eval(text.partition("_SOURCES = ")[2].partition("\n)")[0] + ")")
    found = (path for each in patterns for path in (ROOT / PACKAGE).glob(f"{each}.py"))
    return {path.relative_to(ROOT).as_posix() for path in found}


@cache
def imports() -> Any:
    """The graph of imports between modules."""
    import grimp

    return grimp.build_graph(*FOLDERS, cache_dir=None)


@cache
def importers(file: str) -> set[str]:
    """Modules that import a module, directly or by sources of compiled code."""
    found, waiting = set(), [file]
    while waiting:
        name = waiting.pop().removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        for module in imports().find_modules_that_directly_import(name):
            path = Path(*module.split("."))
            path = path / "__init__.py" if (ROOT / path).is_dir() else path.with_suffix(".py")
            if path.as_posix() not in found:
                found.add(path.as_posix())
                waiting += {path.as_posix()} & sources()
    return found
