"""Draw random changes of the package that cosmic-ray makes, for `benchmarks.mutation --sample`.

    pip install cosmic-ray
    python -m benchmarks.cosmic_ray_sample 120 --seed 20261126 --out sample.json
    python -m benchmarks.mutation --sample sample.json

A place in the source is drawn first, then one of the changes there. Annotations of types are left
out, since they have no effect, and so are `equations` and `engine`: `mutation --changes` has these.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import json
import random
from pathlib import Path

from benchmarks.mutants import BESIDE, PACKAGE, ROOT

FOLDERS = (PACKAGE, BESIDE[0])
LEFT_OUT = {"equations", "engine", "_build"}


class Bare(ast.NodeTransformer):
    """Removes annotations, so that sources are equal which differ in no more."""

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        """Remove the annotations of a function."""
        self.generic_visit(node)
        node.returns = None
        given = node.args
        for argument in [*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg,
                         given.kwarg]:  # fmt: skip
            if argument is not None:
                argument.annotation = None
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        """Remove the annotation of a variable."""
        self.generic_visit(node)
        node.annotation = ast.Constant(0)
        return node


def bare(source: str) -> str:
    """A source without annotations, layout and comments."""
    return ast.dump(Bare().visit(ast.parse(source)))


def places() -> dict[tuple[str, tuple[int, int]], list[tuple[str, int]]]:
    """Changes by file and position: the operator's name, and the number of its occurrence."""
    from cosmic_ray import plugins
    from cosmic_ray.ast import get_ast_from_path

    found: dict = {}
    for path in sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")):
        if LEFT_OUT & set(path.parts):
            continue
        tree, name = get_ast_from_path(path), str(path.relative_to(ROOT))
        for operator in plugins.operator_names():
            if "Variable" in operator:
                continue
            positions = positions_of(plugins.get_operator(operator)(), tree)
            for number, position in enumerate(positions):
                found.setdefault((name, position), []).append((operator, number))
    return found


def positions_of(operator, tree) -> list[tuple[int, int]]:
    """Where an operator of cosmic-ray changes a syntax tree, in order."""
    from cosmic_ray.ast import Visitor

    found = []

    class Noting(Visitor):
        """Visits all nodes, and changes none."""

        def visit(self, node):
            """Note the positions in a node."""
            found.extend(begin for begin, _ in operator.mutation_positions(node))
            return node

    Noting().walk(tree)
    return found


def sample(count: int, seed: int) -> list[dict]:
    """Draw changes, as fields of `Mutant`."""
    from cosmic_ray import plugins
    from cosmic_ray.mutating import mutate_code

    known, rng, drawn = places(), random.Random(seed), []
    keys = sorted(known)
    rng.shuffle(keys)
    for name, position in keys:
        if len(drawn) == count:
            break
        operator, number = rng.choice(known[name, position])
        source = (ROOT / name).read_text(encoding="utf-8")
        changed = mutate_code(source, plugins.get_operator(operator)(), number)
        try:
            if changed is None or bare(changed) == bare(source):
                continue
        except SyntaxError:
            continue
        lines = [text.splitlines() for text in (source, changed)]
        differences = list(difflib.unified_diff(*lines, lineterm="", n=0))[3:]
        file = name.removesuffix(".py").removeprefix(f"{PACKAGE}/")
        said = " | ".join(line.strip() for line in differences)
        title = f"{file} {operator}: {said}"
        drawn.append({"name": title, "file": file, "line": position[0], "source": changed})
    return drawn


def main() -> None:
    """Write a sample as JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("count", type=int, help="number of changes")
    parser.add_argument("--seed", type=int, default=1, help="seed of the draw")
    parser.add_argument("--out", type=Path, default=Path("sample.json"), help="file to write")
    options = parser.parse_args()
    options.out.write_text(json.dumps(sample(options.count, options.seed)), encoding="utf-8")


if __name__ == "__main__":
    main()
