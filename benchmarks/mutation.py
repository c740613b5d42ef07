"""Mutation tests: put one fault at a time into the package, and check that a test fails.

    python -m benchmarks.mutation                      Try all deliberate faults.
    python -m benchmarks.mutation --blind              Try faults written without knowing the tests.
    python -m benchmarks.mutation --unseen             Try others, for which no test was written.
    python -m benchmarks.mutation --changes 100        Change single signs of equations and engine.

Each mutant is a copy of the package with one fault. In the packages from `gaits` up, it is a
plausible error of a programmer (`faults`). In `equations` and `engine`, one sign, number, operator
or comparison is changed. The tests that concern the module run, the likeliest to fail first, until
one fails. Code that the change may affect is recompiled, which takes some twenty seconds. Results
are saved, one line of JSON for each mutant, and an interrupted run is resumed.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import NoReturn

import pytest

from benchmarks.equivalent_mutants import EQUIVALENT
from benchmarks.mutants import (
    BESIDE,
    BLIND,
    FAULTS,
    PACKAGE,
    ROOT,
    UNSEEN,
    Mutant,
    faults,
    path_of,
    sample,
)
from benchmarks.related_tests import CHANGED, tests_of
from benchmarks.report import machine, table
from benchmarks.tables import DOCS, keep

PAGE = DOCS / "mutation.md"
PATIENCE = 300.0  # seconds after which a mutant that still runs counts as detected
LIBRARIES = ("numba", "scipy.optimize", "scipy.linalg", "gymnasium", "torch", "stable_baselines3")
"""Libraries that tests import and mutants do not change."""
_TICKS = ("ticks.*",)
_DISTURBED = ("disturbance_kernels.*", "*-pushed-*", "*-watched-*", *_TICKS)
WITHIN = {
    **dict.fromkeys(
        ("gaits/scenes/checks", "envs/constraints", "gaits/look/forces", "gaits/terrain"),
        _DISTURBED,
    ),
    "envs/disturbance_kernels": _TICKS,
    "envs/memory": _TICKS,
    "gaits/scenes/rules": _DISTURBED,
    "gaits/scenes/starts": _TICKS,
    "envs/task": _TICKS,
    "envs/transitions": _TICKS,
    "models/math": _DISTURBED,
}
"""Patterns of compiled code, besides a file's own, that depends on the file."""
CHANGED_BY_COPY = "tests/engine/test_cache.py::test_a_source_that_changes_has_another_fingerprint"
"""A test that is skipped, because the copy changes the behaviour under test."""


class Copy:
    """A copy of the package and its tests, with a cache of the unchanged package's compiled code.

    Args:
        tree: An empty folder.
    """

    def __init__(self, tree: Path) -> None:
        self.tree, self.cache, self.filled = tree, tree / "cache", tree / "filled"
        left = shutil.ignore_patterns("__pycache__", "_build", "jupyter_execute")
        for name in (PACKAGE, *BESIDE, "tests", "benchmarks", "docs"):
            shutil.copytree(ROOT / name, tree / name, ignore=left)
        for name in ("pyproject.toml", "constraints.txt", "train.py", "README.md"):
            shutil.copy(ROOT / name, tree)
        # The cache's path depends on all sources. In a copy the path is fixed, and `notice` removes
        # the code that a change makes stale.
        folder = tree / PACKAGE / "engine" / "cache.py"
        text = folder.read_text("utf-8")
        start = text.index("    digest = ")
        end = text.index("    return digest")
        folder.write_text(
            text[:start] + '    return "copy"\n' + text[text.index("\n", end) + 1 :], "utf-8"
        )

    def fill(self, every: Sequence[str]) -> None:
        """Run tests on the unchanged package, and save its compiled code."""
        if failure := self.tests_fail(every, patience=20.0 * PATIENCE):
            raise SystemExit(f"tests fail without any change: {failure}")
        self.cache.rename(self.filled)

    def notice(self, mutant: Mutant) -> str:
        """Return the test that detects a mutant, or an empty string."""
        path = self.tree / path_of(mutant.file)
        path.write_text(mutant.source, "utf-8")
        shutil.rmtree(self.cache, ignore_errors=True)
        if mutant.package not in ("equations", "engine", "models"):
            # numba notices a change of a kernel's own file, but not of other files that it uses.
            stale = shutil.ignore_patterns(*WITHIN.get(mutant.file, ()))
            shutil.copytree(self.filled, self.cache, ignore=stale)
        elif mutant.package == "equations" and mutant.file != "models/equations/hybrid":
            # Code compiled by numba does not contain the equations: only object files are stale.
            shutil.copytree(self.filled, self.cache, ignore=shutil.ignore_patterns("*.o"))
        try:
            return self.tests_fail(tests_of(mutant.file))
        finally:
            # Restore the modification time too, which numba's cache compares.
            shutil.copy2(ROOT / path_of(mutant.file), path)

    def tests_fail(self, tests: Sequence[str], patience: float = PATIENCE) -> str:
        """Result of tests: the first failure, "time" if they ran too long, "" if they pass.

        They run in a fork of this process, which has already imported the slow libraries.
        """
        said = self.tree / "said"
        child = os.fork()
        if child == 0:
            self._be_tested([test for test in tests if (self.tree / test).exists()], said)
        until, ended, status = time.monotonic() + patience, 0, 0
        try:
            while not ended:
                if time.monotonic() > until:
                    return "time"
                time.sleep(0.05)
                ended, status = os.waitpid(child, os.WNOHANG)
        finally:
            if not ended:
                os.killpg(child, signal.SIGKILL)
                os.waitpid(child, 0)
        if os.waitstatus_to_exitcode(status) == 0:
            return ""
        lines = [
            x for x in said.read_text("utf-8").splitlines() if x.startswith(("FAILED", "ERROR"))
        ]
        return lines[0].split(" - ")[0] if lines else "does not run"

    def _be_tested(self, tests: list[str], said: Path) -> NoReturn:
        """Run tests of the copy in this (child) process, and write their output to a file."""
        os.setsid()
        with said.open("w", encoding="utf-8") as out:
            for stream in (1, 2):
                os.dup2(out.fileno(), stream)
        os.chdir(self.tree)
        sys.path.insert(0, str(self.tree))
        paths = [str(self.tree), os.environ.get("PYTHONPATH", "")]
        os.environ |= {
            "NUMBA_CACHE_DIR": str(self.cache),
            "PYTHONPATH": os.pathsep.join(paths),
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        sys.dont_write_bytecode = True
        for name in [name for name in sys.modules if name.split(".")[0] == "benchmarks"]:
            del sys.modules[name]
        options = ["-x", "-q", "--no-header", "--tb=no", "-p", "no:cacheprovider"]
        options += ["--deselect", CHANGED_BY_COPY]
        code = 1
        try:
            code = int(pytest.main([*options, *tests]))
            sys.stdout.flush()
        finally:
            os._exit(code)


def run(
    chosen: list[Mutant], results: Path, *, again: bool = False, tried: bool = False
) -> list[dict]:
    """Try the mutants that have no result yet, and return the results of all.

    Args:
        chosen: The mutants.
        results: File of results.
        again: Whether to retry mutants that were not detected.
        tried: Whether to try none, and return the existing results.
    """
    results.parent.mkdir(parents=True, exist_ok=True)
    lines = (
        [json.loads(line) for line in results.open(encoding="utf-8")] if results.exists() else []
    )
    known = {record["name"]: record for record in lines}
    if tried:
        chosen = [mutant for mutant in chosen if mutant.name in known]
    waiting = [
        mutant
        for mutant in ([] if tried else chosen)
        if mutant.name not in known or (again and not known[mutant.name]["noticed_by"])
    ]
    if PACKAGE in sys.modules:
        raise RuntimeError("the package is loaded already: tests would not meet a changed one")
    for library in LIBRARIES:
        with suppress(ImportError):
            import_module(library)
    with tempfile.TemporaryDirectory() as folder:
        copy = Copy(Path(folder))
        if waiting:
            copy.fill(list(dict.fromkeys(t for mutant in waiting for t in tests_of(mutant.file))))
        for mutant in waiting:
            failure = copy.notice(mutant)
            record = {"name": mutant.name, "line": mutant.line, "noticed_by": failure}
            known[mutant.name] = record
            with results.open("a", encoding="utf-8") as log:
                log.write(json.dumps(record) + "\n")
            print("noticed " if failure else "SURVIVED", mutant.line, mutant.name, flush=True)
    return [{"package": mutant.package, **known[mutant.name]} for mutant in chosen]


def report(records: list[dict]) -> str:
    """The score of each package, and the mutants that were not detected."""
    rows: list[list] = []
    for package in dict.fromkeys(record["package"] for record in records):
        mine = [record for record in records if record["package"] == package]
        left = [record["name"] for record in mine if not record["noticed_by"]]
        argued = sum(name in EQUIVALENT for name in left)
        rows.append([package, len(mine), len(mine) - len(left), argued, len(left) - argued])
    rows.append(["all", *(sum(row[i] for row in rows) for i in range(1, 5))])
    for row in rows:
        row.append(f"{row[2] / max(1, row[1] - row[3]):.0%}")
    heads = ["package", "faults", "noticed", "without effect", "survived", "score"]
    text = table(heads, rows)
    left = [record["name"] for record in records if not record["noticed_by"]]
    if left:
        reasons = [(code(name), EQUIVALENT.get(name, "**survived**")) for name in left]
        text += "\n\n" + table(["not noticed", "why it changes no trajectory"], reasons)
    return text


def code(text: str) -> str:
    """Source code in Markdown, for a table."""
    return "`" + text.replace("|", "\\|") + "`"


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    add = parser.add_argument
    add("--changes", type=int, default=0, help="try this number of single changes instead")
    add("--seed", type=int, default=1, help="seed of their order")
    add("--blind", action="store_true", help="faults by someone who had not read the tests")
    add("--unseen", action="store_true", help="those of them that were not tried before")
    add("--sample", type=Path, metavar="JSON", help="those of `benchmarks.cosmic_ray_sample`")
    add("--packages", nargs="+", metavar="PACKAGE", help="only these packages")
    add("--again", action="store_true", help="repeat faults that were not noticed")
    add("--tried", action="store_true", help="only report results so far")
    add("--results", type=Path, default=ROOT / "build" / "mutants.jsonl")
    add("--write", action="store_true", help=f"put the tables into {PAGE.name}")
    options = parser.parse_args()
    pool = sample(list(CHANGED), options.seed)
    folder = UNSEEN if options.unseen else BLIND if options.blind else FAULTS
    thought_up, gone = faults(folder)
    if options.sample:
        drawn = json.loads(options.sample.read_text(encoding="utf-8"))
        thought_up, gone = [Mutant(**each) for each in drawn], []
    chosen = pool[: options.changes] or thought_up
    if options.packages:
        chosen = [mutant for mutant in chosen if mutant.package in options.packages]
    records = run(chosen, options.results, again=options.again, tried=options.tried)
    from gym_passive_walker._tools import console  # not before mutants are tried: see `run`

    console.print_in_any_encoding()
    found = report(records)
    share = f"{len(records)} of {len(pool)} single changes."
    if not options.changes:
        share = f"{len(records)} of {len(thought_up)} faults."
    for name in [] if options.changes else gone:
        share += f"\nThe code that this fault was written for has changed: {name}."
    text = "\n\n".join([share, found, f"{machine('scipy')}."])
    if options.write:
        faulty = "faults" if folder == FAULTS else f"{folder.name} faults"
        faulty = "sample" if options.sample else faulty
        keep("mutation" if options.changes else faulty, text, PAGE)
    else:
        print(f"\n{text}")


if __name__ == "__main__":
    main()
