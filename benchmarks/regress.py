"""Compare the speed and the results of two commits, in alternating measurements.

    python -m benchmarks.regress OLD           Compare this working tree with a commit.
    python -m benchmarks.regress OLD NEW       Compare two commits.

Each side is a process with its own sources and kernels. The sides alternate in each piece of work,
so that the machine's load affects both equally. Times are CPU seconds. The first ratio new / old is
that of the least times; the quartiles of the ratios of single turns follow. On a quiet machine,
equal code gives ratios within 3 % of 1 (try OLD twice). The exit code is 1 if a piece is slower
than the limit, or if results differ.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
from tqdm import tqdm

from benchmarks.report import machine, table
from gym_passive_walker._tools import console

ROOT = Path(__file__).parent.parent
WORK = Path(__file__).parent / "regress_work.py"
_ALIKE = 1e-9  # largest relative difference of equal results


class Side:
    """A process that runs pieces of work with one tree's package.

    Attributes:
        pieces: Names of the pieces of work.
        walks: Results of some walks, by name.
    """

    def __init__(self, tree: Path) -> None:
        environment = {**os.environ, "PYTHONPATH": str(tree), "NUMBA_NUM_THREADS": "1"}
        self._process = subprocess.Popen(
            [sys.executable, "-u", "-W", "ignore", str(WORK)], env=environment, cwd=tree,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        self.pieces: list[str] = []
        self.walks: dict[str, float] = {}
        self._tree = tree

    def begin(self) -> None:
        """Wait until the process is ready: kernels are compiled, and every piece has run once."""
        self.pieces, self.walks = json.loads(self._answer())

    def seconds(self, piece: str) -> float:
        """Run a piece of work; returns its CPU seconds."""
        assert self._process.stdin
        print(piece, file=self._process.stdin, flush=True)
        return float(self._answer())

    def end(self) -> None:
        """Stop the process."""
        self._process.kill()
        self._process.wait()

    def _answer(self) -> str:
        assert self._process.stdout
        for line in self._process.stdout:
            if line.startswith("="):
                return line[1:]
        raise SystemExit(f"the side in {self._tree} has failed; what it said stands above")


@contextmanager
def tree_of(commit: str) -> Iterator[Path]:
    """Context manager: the sources of a commit, in a temporary folder."""
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        add = ["git", "worktree", "add", "--detach", "--force", str(tree), commit]
        made = subprocess.run(add, cwd=ROOT, capture_output=True, text=True)
        if made.returncode:
            raise SystemExit(f"no commit {commit!r} to compare with: {made.stderr.strip()}")
        try:
            yield tree
        finally:
            remove = ["git", "worktree", "remove", "--force", str(tree)]
            subprocess.run(remove, cwd=ROOT, capture_output=True)


def turns(old: Side, new: Side, pieces: list[str], count: int) -> dict[str, np.ndarray]:
    """CPU seconds of each piece, shape (2, count): old and new side, `count` turns."""
    taken = {piece: np.empty((2, count)) for piece in pieces}
    for turn in tqdm(range(count), unit="turn", disable=not sys.stderr.isatty()):
        for piece in pieces:
            for side in (0, 1) if turn % 2 else (1, 0):
                taken[piece][side, turn] = (old, new)[side].seconds(piece)
    return taken


def differing(old: dict[str, float], new: dict[str, float]) -> list[str]:
    """Walks with different results, one line each."""
    return [
        f"other walks: {name} came to {old[name]!r}, and comes to {new[name]!r}"
        for name in old.keys() & new.keys()
        if not abs(new[name] - old[name]) <= _ALIKE * abs(old[name])
    ]


def main(arguments: list[str] | None = None) -> int:
    """Compare two sides and print the results; returns 0 if nothing regressed, else 1."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.regress", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("old", help="commit to compare with")
    parser.add_argument("new", nargs="?", help="another one (the working tree)")
    parser.add_argument("--turns", type=int, default=40, help="of each piece (%(default)s)")
    parser.add_argument("--bar", type=float, default=1.03, help="slowest ratio (%(default)s)")
    parser.add_argument("--only", default="", metavar="WORD", help="pieces with this in their name")
    asked = parser.parse_args(arguments)
    if asked.turns < 1:
        parser.error(f"--turns must be at least 1, not {asked.turns}")
    with ExitStack() as open_things:
        trees = [open_things.enter_context(tree_of(asked.old))]
        trees.append(open_things.enter_context(tree_of(asked.new)) if asked.new else ROOT)
        sides = []
        for tree in trees:
            sides.append(Side(tree))
            open_things.callback(sides[-1].end)
        print("both sides compile what they need, and do everything once ...", file=sys.stderr)
        for side in sides:
            side.begin()
        old, new = sides
        pieces = [x for x in old.pieces if x in new.pieces and asked.only in x]
        if not pieces:
            parser.error(f"no piece has {asked.only!r} in its name: {', '.join(old.pieces)}")
        taken = turns(old, new, pieces, asked.turns)
    rows, worst = [], 0.0
    for piece, (before, after) in taken.items():
        ratio = after.min() / before.min()
        low, high = np.quantile(after / before, (0.25, 0.75))
        rows.append([piece, f"{before.min():.3g}", f"{ratio:.3f}", f"{low:.3f} to {high:.3f}"])
        worst = max(worst, ratio)
    print(table(["work", "CPU s, old", "new / old", "quartiles of turns"], rows))
    others = differing(old.walks, new.walks)
    print("\n".join(["", *others, f"worst {worst:.3f}, bar {asked.bar:g}. {machine('scipy')}."]))
    return int(worst > asked.bar or bool(others))


if __name__ == "__main__":
    raise SystemExit(console.run(main))
