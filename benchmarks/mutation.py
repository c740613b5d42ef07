"""Would the tests notice a wrong sign? Change the physics in one place at a time and see.

    python -m benchmarks.mutation --count 200 --results build/mutants.jsonl

Each mutant is a copy of the package with one sign, number, operator or comparison changed. The
fast tests that concern its file run on it and should fail. They run without the compiler: in the
copy a tile holds a single walker and kernels are plain Python, so a mutant takes seconds instead of
the minute that compiling every kernel anew would take. Results are kept, one line of JSON for each,
and a run that was stopped goes on where it was.
"""

from __future__ import annotations

import argparse
import ast
import copy
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

from benchmarks.equivalent_mutants import EQUIVALENT
from benchmarks.report import DOCS, keep, machine, table

ROOT = Path(__file__).parents[1]
PACKAGE = "gym_passive_walker"
PAGE = DOCS / "stability.md"
PATIENCE = 150.0  # seconds after which a mutant that still runs counts as noticed

_ENGINE = [
    "test_events", "test_strides", "test_outcomes", "test_ledger", "test_tolerance",
    "test_derivatives",
]  # fmt: skip
TESTS = {
    "kneed": ["test_motion", "test_collisions", *_ENGINE],
    "compass": ["test_motion", "test_collisions", *_ENGINE],
    "simplest": ["test_motion", "test_collisions", *_ENGINE],
    "constants": ["test_motion", "test_collisions", *_ENGINE],
    "forces": ["test_forces", "test_trajectory"],
    "trajectory": ["test_trajectory"],
    "lanes": ["test_motion", "test_strides", "test_derivatives"],
    "walkers": ["../test_walkers", "test_motion"],
    "dormand_prince": ["test_tolerance", *_ENGINE],
    "events": _ENGINE,
    "integrator": _ENGINE,
    "stride": [*_ENGINE, "test_trajectory"],
}
"""Fast tests in the order in which they are likely to notice a change of a file."""

SLOW_WITHOUT_COMPILER = (
    "not (any_throw or any_size or any_shape or crowd or beside_whom or threads or many_shapes "
    "or samples_follow or depend_on_the_others)"
)

NOT_MOTION = {
    "_use_full_vectors", "cache_directory", "_kernels_cached_here", "_entry", "_get", "_put",
    "_reciprocal", "in_parts", "_crew", "__post_init__", "_check_masses",
}  # fmt: skip
"""Functions about compiling, caching, threads and messages: no walker moves by them."""

PLAIN_PYTHON = """

def get(tile, row, lane):
    return tile[row * WIDTH + lane]


def put(tile, row, lane, value):
    tile[row * WIDTH + lane] = value


np.seterr(all="ignore")
"""
"""Put at the end of `lanes`, this stands in for what numba compiles by hand."""

_SWAPS: dict[type, type] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.And: ast.Or, ast.Or: ast.And,
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt,
    ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
}  # fmt: skip


class Mutant(NamedTuple):
    """One change.

    Attributes:
        file: Module, without its suffix.
        line: Where, in the original.
        scope: The function around it.
        before: The expression changed, as source.
        after: What it became.
        source: The whole module with the change.
    """

    file: str
    line: int
    scope: str
    before: str
    after: str
    source: str

    @property
    def name(self) -> str:
        """What identifies it though lines may move."""
        return f"{self.file}.{self.scope}: {self.before} -> {self.after}"


def changes(node: ast.AST) -> Iterator[ast.AST]:
    """What may stand in an expression's place, one change each."""
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
    """Every place of a module where a number, a sign or a comparison stands."""

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
        """A type is no number."""
        if node.value is not None:
            self.visit(node.value)

    def generic_visit(self, node: ast.AST) -> None:
        """Look at each child for changes, and then inside it."""
        for field, value in ast.iter_fields(node):
            children = value if isinstance(value, list) else [value]
            for index, child in enumerate(children):
                if not isinstance(child, ast.AST):
                    continue
                for new in changes(child):
                    self.add(node, field, index if isinstance(value, list) else None, child, new)
                self.visit(child)

    def add(self, parent: ast.AST, field: str, index: int | None, old: ast.AST, new: ast.AST):
        """Write the module down with one change, and undo it."""

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
        short = [" ".join(text.split())[:100] for text in (context, after)]
        self.found.append(Mutant(self.file, line, scope, *short, source))


def path_of(file: str) -> Path:
    """A module's path within the tree."""
    return Path(PACKAGE) / ("" if file == "walkers" else "physics") / f"{file}.py"


def mutants(file: str) -> list[Mutant]:
    """All mutants of a module."""
    finder = Finder(file, ast.parse((ROOT / path_of(file)).read_text()))
    finder.visit(finder.tree)
    seen: Counter[str] = Counter()
    unique = []
    for mutant in finder.found:
        seen[mutant.name] += 1
        if (count := seen[mutant.name]) > 1:
            mutant = mutant._replace(after=f"{mutant.after} ({count})")
        unique.append(mutant)
    return unique


def sample(files: Sequence[str], seed: int) -> list[Mutant]:
    """Mutants in random order, the files in turn, so that short ones are looked at as closely."""
    random_order = random.Random(seed)
    pools = [mutants(file) for file in files]
    for pool in pools:
        random_order.shuffle(pool)
    turns = zip_longest(*pools)
    return [mutant for turn in turns for mutant in turn if mutant is not None]


def plain_copy(target: Path) -> None:
    """Copy the package and its tests, to run as plain Python with one walker in a tile."""
    for name in (PACKAGE, "tests", "benchmarks"):
        shutil.copytree(ROOT / name, target / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", target)


def plain(file: str, source: str) -> str:
    """A module's source for the copy."""
    if file != "lanes":
        return source
    for name in ("GROUP", "WIDTH"):
        start = source.index(f"\n{name} = ") + 1
        source = source[:start] + f"{name} = 1" + source[source.index("\n", start) :]
    return source + PLAIN_PYTHON


def tests_fail(
    tree: Path, names: Sequence[str], *, which: str = SLOW_WITHOUT_COMPILER, compiled: bool = False
) -> str:
    """What tests say of a tree: the first failure, "time" where they ran on, "" if they pass."""
    tests = [f"tests/physics/{name}.py" for name in names]
    command = [
        sys.executable, "-m", "pytest", "-x", "-q", "--no-header", "--tb=no", "-p",
        "no:cacheprovider", "-k", which, *tests,
    ]  # fmt: skip
    variables = {
        **os.environ,
        "NUMBA_DISABLE_JIT": str(int(not compiled)),
        "NUMBA_CACHE_DIR": str(tree / "cache"),
        "PYTHONPATH": str(tree),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    try:
        run = subprocess.run(
            command, cwd=tree, env=variables, timeout=PATIENCE, capture_output=True, text=True
        )
    except subprocess.TimeoutExpired:
        return "time"
    if run.returncode == 0:
        return ""
    lines = [line for line in run.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return lines[0].split(" - ")[0] if lines else "does not import"


def notice(tree: Path, file: str) -> str:
    """Which test notices what was done to a file."""
    failure = ""
    if file == "lanes":  # the last digit of a sine is the compiler's
        failure = tests_fail(tree, ["test_lanes"], which="sine or cosine", compiled=True)
    return failure or tests_fail(tree, TESTS[file])


def run(chosen: list[Mutant], results: Path) -> list[dict]:
    """Try the mutants that have no result yet, and return all results."""
    results.parent.mkdir(parents=True, exist_ok=True)
    known = [json.loads(line) for line in results.open()] if results.exists() else []
    done = {record["name"] for record in known}
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder)
        plain_copy(tree)
        original = {file: plain(file, (ROOT / path_of(file)).read_text()) for file in TESTS}
        (tree / path_of("lanes")).write_text(original["lanes"])
        if not done:
            for file in ("lanes", "forces", "walkers", "stride"):
                if failure := notice(tree, file):
                    raise SystemExit(f"the tests of {file} fail without any change: {failure}")
        for mutant in chosen:
            if mutant.name in done:
                continue
            (tree / path_of(mutant.file)).write_text(plain(mutant.file, mutant.source))
            failure = notice(tree, mutant.file)
            (tree / path_of(mutant.file)).write_text(original[mutant.file])
            record = {"name": mutant.name, "line": mutant.line, "noticed_by": failure}
            known.append(record)
            done.add(mutant.name)
            with results.open("a") as log:
                log.write(json.dumps(record) + "\n")
            print("noticed " if failure else "SURVIVED", mutant.line, mutant.name, flush=True)
    chosen_names = {mutant.name for mutant in chosen}
    return [record for record in known if record["name"] in chosen_names]


def report(records: list[dict]) -> str:
    """Score and survivors."""
    rows = []
    for file in TESTS:
        mine = [r for r in records if r["name"].startswith(file + ".")]
        survived = [r for r in mine if not r["noticed_by"]]
        argued = [r for r in survived if r["name"] in EQUIVALENT]
        if mine:
            noticed, unexplained = len(mine) - len(survived), len(survived) - len(argued)
            rows.append([file, len(mine), noticed, len(argued), unexplained])
    rows.append(["all", *(sum(row[i] for row in rows) for i in range(1, 5))])
    text = table(["file", "changes", "noticed", "without effect", "survived"], rows)
    left = [r for r in records if not r["noticed_by"]]
    if left:
        reasons = [(code(r["name"]), EQUIVALENT.get(r["name"], "**survived**")) for r in left]
        text += "\n\n" + table(["change not noticed", "why it changes no walk"], reasons)
    return text


def code(text: str) -> str:
    """Source as it may stand in a table."""
    return "`" + text.replace("|", "\\|") + "`"


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--count", type=int, default=200, help="how many changes to try")
    parser.add_argument("--file", choices=sorted(TESTS), help="one module only")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--results", type=Path, default=ROOT / "build" / "mutants.jsonl")
    parser.add_argument("--write", action="store_true", help=f"put the tables into {PAGE.name}")
    options = parser.parse_args()
    pool = sample([options.file] if options.file else list(TESTS), options.seed)
    found = report(run(pool[: options.count], options.results))
    command = " ".join(["python -m benchmarks.mutation", *sys.argv[1:]])
    share = f"{min(options.count, len(pool))} of {len(pool)} possible changes."
    text = f"`{command}`\n{machine('scipy')}\n\n{share}\n\n{found}"
    if options.write:
        keep("mutation", text, PAGE)
    else:
        print(f"\n{text}")


if __name__ == "__main__":
    main()
