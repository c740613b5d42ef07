"""Would the tests notice a wrong sign? Change the physics in one place at a time and see.

    python -m benchmarks.mutation --count 200 --results build/mutants.jsonl

Each mutant is a copy of the package with one sign, number, operator or comparison changed. The
tests that concern its file run on it and should fail. What its change may have got into is compiled
anew, which takes some twenty seconds. Results are kept, one line of JSON for each, and a run that
was stopped goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmarks.equivalent_mutants import EQUIVALENT
from benchmarks.mutants import PACKAGE, ROOT, Mutant, path_of, sample
from benchmarks.report import DOCS, keep, machine, table

PAGE = DOCS / "stability.md"
PATIENCE = 300.0  # seconds after which a mutant that still runs counts as noticed

_MECHANICS = ["tests/physics", "tests/engine"]
_MACHINERY = ["tests/engine", "tests/physics", "tests/stress"]
_USERS = ["tests/physics/test_strides.py", "tests/physics"]
TESTS = {
    **{
        f"physics/{name}": _MECHANICS
        for name in ("kneed", "straight", "simplest", "legs", "numbers", "hybrid", "bodies")
    },
    **{
        f"engine/{name}": _MACHINERY
        for name in ("expressions", "native", "runge_kutta", "verner", "layout", "step", "compiled",
                     "landing", "lanes", "run")
    },
    **{
        f"walkers/{name}": ["tests/test_walkers.py", *_MECHANICS]
        for name in ("walker", "presets", "parts", "tuning")
    },
    "gaits/stride": _USERS,
    "gaits/samples": ["tests/physics/test_trajectory.py"],
    "gaits/trajectory": ["tests/physics/test_trajectory.py"],
    "gaits/forces": ["tests/physics/test_forces.py", "tests/physics/test_trajectory.py"],
    "arguments": _USERS,
    "units": _USERS,
}  # fmt: skip
"""Tests in the order in which they are likely to notice a change of a file."""


class Copy:
    """A copy of the package and its tests, with a cache of what an unchanged one compiles.

    Args:
        tree: An empty folder.
    """

    def __init__(self, tree: Path) -> None:
        self.tree, self.cache, self.filled = tree, tree / "cache", tree / "filled"
        for name in (PACKAGE, "tests", "benchmarks"):
            shutil.copytree(ROOT / name, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(ROOT / "pyproject.toml", tree)
        # The cache's place hangs on all sources; here is decided what a change makes stale.
        folder = tree / PACKAGE / "engine" / "cache.py"
        text = folder.read_text()
        start = text.index("    digest = ")
        end = text.index("    return digest")
        folder.write_text(text[:start] + '    return "copy"\n' + text[text.index("\n", end) + 1 :])

    def fill(self) -> None:
        """Let an unchanged package pass its tests, and keep what it has compiled."""
        every = list(dict.fromkeys(test for tests in TESTS.values() for test in tests))
        if failure := self.tests_fail(every, patience=20.0 * PATIENCE):
            raise SystemExit(f"tests fail without any change: {failure}")
        self.cache.rename(self.filled)

    def notice(self, mutant: Mutant) -> str:
        """Which test notices a mutant."""
        path = self.tree / path_of(mutant.file)
        path.write_text(mutant.source)
        shutil.rmtree(self.cache, ignore_errors=True)
        room = mutant.file.split("/")[0]
        if room not in ("physics", "engine"):
            shutil.copytree(self.filled, self.cache)
        elif room == "physics" and mutant.file != "physics/hybrid":
            # Bookkeeping knows no equations.
            shutil.copytree(self.filled, self.cache, ignore=shutil.ignore_patterns("*.o"))
        try:
            return self.tests_fail(TESTS[mutant.file])
        finally:
            shutil.copy2(ROOT / path_of(mutant.file), path)  # as old as before: see numba's cache

    def tests_fail(self, tests: Sequence[str], patience: float = PATIENCE) -> str:
        """What tests say: the first failure, "time" if they ran on, "" if they pass."""
        present = [test for test in tests if (self.tree / test).exists()]
        command = [
            sys.executable, "-m", "pytest", "-x", "-q", "--no-header", "--tb=no", "-p",
            "no:cacheprovider", *present,
        ]  # fmt: skip
        variables = {
            **os.environ,
            "NUMBA_CACHE_DIR": str(self.cache),
            "PYTHONPATH": os.pathsep.join([str(self.tree), os.environ.get("PYTHONPATH", "")]),
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        try:
            run = subprocess.run(
                command, cwd=self.tree, env=variables, timeout=patience, capture_output=True,
                text=True,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return "time"
        if run.returncode == 0:
            return ""
        lines = [line for line in run.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
        return lines[0].split(" - ")[0] if lines else "does not run"


def run(chosen: list[Mutant], results: Path) -> list[dict]:
    """Try the mutants that have no result yet, and return all results."""
    results.parent.mkdir(parents=True, exist_ok=True)
    known = [json.loads(line) for line in results.open()] if results.exists() else []
    done = {record["name"] for record in known}
    waiting = [mutant for mutant in chosen if mutant.name not in done]
    with tempfile.TemporaryDirectory() as folder:
        copy = Copy(Path(folder))
        if waiting:
            copy.fill()
        for mutant in waiting:
            failure = copy.notice(mutant)
            record = {"name": mutant.name, "line": mutant.line, "noticed_by": failure}
            known.append(record)
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
