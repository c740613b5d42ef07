"""Mutants of the package: deliberate faults, and changes of single signs.

A fault is data in `faults`: its place, a description, and the text before and after. A change is
that of one sign, number, operator or comparison of a module's source, in random order.
"""

from __future__ import annotations

import ast
import copy
import random
import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PACKAGE = "gym_passive_walker"
BESIDE = ("agents", "examples", "validation")
"""Folders outside the package that faults may be in too."""
FAULTS = Path(__file__).parent / "faults"
BLIND = FAULTS / "blind"
UNSEEN = FAULTS / "unseen"
"""Faults that nobody has tried yet: move them to BLIND once they have been."""

NOT_MOTION = {
    "fingerprint", "cache_directory", "_bases", "_private", "found", "keep", "_warn", "_name",
    "load_overload", "save_overload", "aligned", "in_parts", "_pool", "_machine", "_kept",
    "object_code", "loaded", "_parsed", "_call", "__post_init__", "_check_masses",
    "_check_places",
}  # fmt: skip
"""Functions about compiling, caching, threads and messages, which do not affect the motion."""

_SWAPS: dict[type, type] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.And: ast.Or, ast.Or: ast.And,
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt,
    ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
}  # fmt: skip


class Mutant(NamedTuple):
    """The package with one fault.

    Attributes:
        name: Description and place of the fault, without a line number, since lines may move.
        file: Path of the module in the package (or in the repository: "agents/config"), without
            its suffix.
        line: Line in the original source.
        source: Source of the whole module with the fault.
    """

    name: str
    file: str
    line: int
    source: str

    @property
    def package(self) -> str:
        """The folder of the module."""
        return Path(self.file).parent.name or self.file


def changes(node: ast.AST) -> Iterator[ast.AST]:
    """Replacements of an expression, each with one change."""
    new: ast.AST
    if isinstance(node, ast.BinOp | ast.BoolOp) and type(node.op) in _SWAPS:
        new = copy.deepcopy(node)
        new.op = _SWAPS[type(node.op)]()  # type: ignore[attr-defined]
        yield new
    elif isinstance(node, ast.AugAssign) and type(node.op) in _SWAPS:
        new = copy.deepcopy(node)
        new.op = _SWAPS[type(node.op)]()  # type: ignore[assignment]
        yield new
    elif isinstance(node, ast.Compare) and type(node.ops[0]) in _SWAPS:
        new = copy.deepcopy(node)
        new.ops[0] = _SWAPS[type(node.ops[0])]()
        yield new
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield copy.deepcopy(node.operand)
    elif isinstance(node, ast.Constant) and type(node.value) is float:
        yield ast.Constant(node.value * 1.01 if node.value else 0.01)
    elif isinstance(node, ast.Constant) and type(node.value) is int:
        yield ast.Constant(node.value + 1)


class Finder(ast.NodeVisitor):
    """Finds every number, sign and comparison of a module."""

    def __init__(self, file: str, tree: ast.Module) -> None:
        self.file, self.tree = file, tree
        self.scopes: list[str] = []
        self.found: list[Mutant] = []

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        """Enter a function's body; leave its decorators and annotations."""
        if node.name not in NOT_MOTION:
            self.scopes.append(node.name)
            for statement in node.body:
                self.visit(statement)
            self.scopes.pop()

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        """Visit the value only, not the annotation."""
        if node.value is not None:
            self.visit(node.value)

    def generic_visit(self, node: ast.AST) -> None:
        """Collect the changes of each child, and then visit the child."""
        for field, value in ast.iter_fields(node):
            children = value if isinstance(value, list) else [value]
            for index, child in enumerate(children):
                if not isinstance(child, ast.AST):
                    continue
                for new in changes(child):
                    self.add(node, field, index if isinstance(value, list) else None, child, new)
                self.visit(child)

    def add(self, parent: ast.AST, field: str, index: int | None, old: ast.AST, new: ast.AST):
        """Record the module's source with one change, and undo the change."""

        def put(node: ast.AST) -> None:
            if index is None:
                setattr(parent, field, node)
            else:
                getattr(parent, field)[index] = node

        context = ast.unparse(parent) if isinstance(old, ast.Constant) else ast.unparse(old)
        put(new)
        try:
            after = ast.unparse(parent) if isinstance(old, ast.Constant) else ast.unparse(new)
            source = ast.unparse(ast.fix_missing_locations(self.tree))
        finally:
            put(old)
        scope = ".".join(self.scopes) or "module"
        line = getattr(old, "lineno", 0)
        before, after = (" ".join(text.split())[:100] for text in (context, after))
        name = f"{self.file}.{scope}: {before} -> {after}"
        self.found.append(Mutant(name, self.file, line, source))


def path_of(file: str) -> Path:
    """A module's path within the repository."""
    beside = file == "train" or file.startswith(tuple(f"{folder}/" for folder in BESIDE))
    return Path("" if beside else PACKAGE) / f"{file}.py"


def mutants(file: str) -> list[Mutant]:
    """All mutants of a module."""
    finder = Finder(file, ast.parse((ROOT / path_of(file)).read_text("utf-8")))
    finder.visit(finder.tree)
    seen: Counter[str] = Counter()
    unique = []
    for mutant in finder.found:
        seen[mutant.name] += 1
        if (count := seen[mutant.name]) > 1:
            mutant = mutant._replace(name=f"{mutant.name} ({count})")
        unique.append(mutant)
    return unique


def sample(files: Sequence[str], seed: int) -> list[Mutant]:
    """Mutants in random order, the files in turn, so that short files are tested as much."""
    random_order = random.Random(seed)
    pools = [mutants(file) for file in files]
    for pool in pools:
        random_order.shuffle(pool)
    turns = zip_longest(*pools)
    return [mutant for turn in turns for mutant in turn if mutant is not None]


def faults(folder: Path = FAULTS) -> tuple[list[Mutant], list[str]]:
    """Every fault of a folder, and the names of those that no longer match the code."""
    found, gone = [], []
    for path in sorted(folder.glob("*.toml")):
        for fault in tomllib.loads(path.read_text(encoding="utf-8"))["fault"]:
            file, old, new = fault["file"], fault["old"], fault["new"]
            name, source = f"{file}: {fault['wrong']}", (ROOT / path_of(file)).read_text("utf-8")
            if source.count(old) != 1:
                gone.append(name)
                continue
            line = source[: source.index(old)].count("\n") + 1
            found.append(Mutant(name, file, line, source.replace(old, new)))
    return found, gone
