"""Mutation tests: make one random change at a time, and run the tests that execute its line.

    pip install cosmic-ray coverage
    python -m benchmarks.mutation --fresh 120                         Draw 120 changes and try them.
    python -m benchmarks.mutation --fresh 20 --packages gaits --tests tests/gaits

Which tests execute a line, fast and slow ones, is measured once by coverage.py, with the unchanged
code. Measurements and results are in `build/mutation`, so that an interrupted run is resumed by its
seed.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import json
import math
import os
import random
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from bisect import bisect
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from functools import lru_cache
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from itertools import accumulate, islice
from multiprocessing import get_context
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from benchmarks.mutants import FOLDERS, PACKAGE, ROOT, Mutant, draw, files, importers
from benchmarks.report import machine
from benchmarks.tables import commit

MOST = 240.0  # seconds of tests for a mutant
ALWAYS = "tests/test_refusals.py"  # and these
TOGETHER = 8  # files of tests that are measured in one process
PATIENCE = 300  # seconds beyond ten times the usual time, after which a test has noticed a mutant
FORKS = get_context("fork" if hasattr(os, "fork") else None)  # processes that have the libraries
LOCK = FORKS.Lock()  # of the cache that all copies begin with
LIBRARIES = ("numba", "scipy.optimize", "scipy.linalg", "gymnasium", "torch", "stable_baselines3")
"""Libraries that tests import and mutants do not change."""


class _Watch:
    """Plugin of pytest: selects tests, and records their results and the lines they execute.

    A test that takes too long ends the process.
    """

    def __init__(self, seconds: dict[str, float], coverage: Any) -> None:
        self.chosen, self.coverage = [test for test in seconds if "::" in test], coverage
        self.seconds, self.failed, self.results = seconds, "", {}
        signal.alarm(PATIENCE)  # for imports

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list) -> None:
        if self.chosen:
            by_name = {item.nodeid: item for item in items}
            items[:] = [by_name[name] for name in self.chosen if name in by_name]

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        if self.coverage:
            self.coverage.switch_context(nodeid)
            signal.alarm(3600)
        else:
            signal.alarm(PATIENCE + round(10.0 * self.seconds[nodeid]))

    def pytest_runtest_logreport(self, report: Any) -> None:
        outcome, seconds = self.results.get(report.nodeid, ("passed", 0.0))
        outcome = outcome if report.outcome == "passed" else report.outcome
        self.results[report.nodeid] = outcome, seconds + report.duration
        self.pytest_collectreport(report)

    def pytest_collectreport(self, report: Any) -> None:
        self.failed = self.failed or report.nodeid * bool(report.failed)


class Copy:
    """A copy of the repository in an empty folder.

    Its cache begins with the unchanged package's compiled code, from the folder `filled`. Changed
    sources of compiled code have another fingerprint, so that all of it is compiled for them.
    """

    def __init__(self, tree: Path, filled: Path) -> None:
        self.tree, self.cache, self.filled = tree, tree / "cache", filled
        for name in listed():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, tree / name)

    @classmethod
    @contextmanager
    def made(cls, filled: Path) -> Iterator[Copy]:
        """Make a copy in a temporary folder."""
        with tempfile.TemporaryDirectory() as folder:
            yield cls(Path(folder), filled)

    def run(
        self, tests: dict[str, float], mutant: Mutant | None = None, measured: Path | None = None
    ) -> tuple[str, dict[str, tuple[str, float]]]:
        """Run tests, or all tests of files, in a fork of this process, which has the libraries.

        The lines that they execute are written to a file. Without one, the first failure ends the
        run. The usual seconds of the tests are given. Returns the first failure ("time" if a test
        ran too long, "crash" if there are no results, "" if they pass), and the outcome and the
        seconds of each test.
        """
        shutil.rmtree(self.cache, ignore_errors=True)
        with LOCK:
            shutil.copytree(self.filled, self.cache)
        said = self.tree / "said.json"
        said.unlink(missing_ok=True)
        changed = self.tree / (mutant.file if mutant else "pyproject.toml")
        original = changed.read_bytes()
        if mutant:
            changed.write_text(mutant.source, "utf-8")
        sys.stdout.flush()
        if (child := os.fork()) == 0:
            try:
                self._test(tests, said, measured)
            finally:
                os._exit(1)
        status = None
        try:
            _, status = os.waitpid(child, 0)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(child, signal.SIGKILL)  # with the processes that tests have left
            if status is None:
                os.waitpid(child, 0)
            changed.write_bytes(original)
        if said.exists():
            return tuple(json.loads(said.read_text("utf-8")))
        late = os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGALRM
        return ("time" if late else "crash"), {}

    def _test(self, tests: dict[str, float], said: Path, measured: Path | None) -> None:
        """Run tests in this (child) process, and write their results to a file."""
        os.setsid()
        with (self.tree / "output").open("wb") as output:
            for stream in (1, 2):
                os.dup2(output.fileno(), stream)
        os.chdir(self.tree)
        sys.path.insert(0, str(self.tree))
        sys.argv, sys.dont_write_bytecode = ["pytest"], True
        os.environ |= {
            "NUMBA_CACHE_DIR": str(self.cache),
            "PYTHONPATH": os.pathsep.join([str(self.tree), os.environ.get("PYTHONPATH", "")]),
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        for name in [name for name in sys.modules if name.split(".")[0] == "benchmarks"]:
            del sys.modules[name]
        sys.modules["__main__"] = ModuleType("__main__")  # or spawned processes import this module
        coverage = None
        if measured:
            from coverage import Coverage

            coverage = Coverage(str(measured), config_file=False, source=list(FOLDERS))
            coverage.set_option("run:relative_files", True)
            coverage.set_option("run:core", "ctrace")  # others know no contexts
            coverage.start()
        watch = _Watch(tests, coverage)
        options = ["-q", "--tb=short", "-p", "no:cacheprovider", "-m", "not learning"]
        options += ["-x"] * (not measured)
        paths = dict.fromkeys(test.split("::")[0] for test in tests)
        code = pytest.main([*options, *paths], plugins=[watch])
        if coverage:
            coverage.stop()
            coverage.save()
        bad = code not in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED)
        said.write_text(json.dumps([watch.failed or "pytest" * bad, watch.results]), "utf-8")


class Measured:
    """Tests that pass, their seconds, and the lines that they execute; tests that do not pass.

    Each file of tests is measured once, some together, in a folder of measurements.
    """

    def __init__(self, kept: Path, tests: Sequence[str], workers: int) -> None:
        from coverage import CoverageData

        self.data, self.seconds, self.left, results = [], {}, {}, {}
        for test in tests:
            stem = test.removesuffix(".py").replace("/", "-")
            results[test] = kept / f"{stem}-{digest([test])}.json"
        new = {test: path for test, path in results.items() if not path.exists()}
        first, done = time.monotonic(), 0
        with ProcessPoolExecutor(workers, FORKS) as pool:
            names = iter([*new])
            groups = iter(lambda: [*islice(names, TOGETHER)], [])
            going = [
                pool.submit(measure, {test: new[test] for test in group}, kept / "cache")
                for group in groups
            ]
            for each in as_completed(going):
                done += each.result()
                minutes = (time.monotonic() - first) / 60.0
                print(f"measured {done} of {len(new)} files, {minutes:.0f} min", flush=True)
        for test in tests:
            for name, (outcome, seconds) in json.loads(results[test].read_text("utf-8")).items():
                self.left |= {} if outcome == "passed" else {name: outcome}
                self.seconds |= {name: seconds} if outcome == "passed" else {}
        for lines in sorted(kept.glob("*.coverage")):
            self.data.append(CoverageData(str(lines)))
            self.data[-1].read()

    @lru_cache  # noqa: B019 (lives as long as the program)
    def lines(self, file: str) -> dict[int, set[str]]:
        """Tests that execute each line of a module; what its import executes has none."""
        found: dict[int, set[str]] = {}
        for data in self.data:
            for line, tests in data.contexts_by_lineno(file).items():
                found.setdefault(line, set()).update(tests)
        return found

    def of(self, chosen: Iterable[str]) -> set[str]:
        """Tests that execute any line of some modules."""
        return set().union(*(tests for file in chosen for tests in self.lines(file).values()))

    def of_line(self, file: str, line: int) -> set[str]:
        """Tests that execute a line, or the lines before it of the same statement."""
        tree = ast.parse((ROOT / file).read_text("utf-8"))
        statements = [node.lineno for node in ast.walk(tree) if isinstance(node, ast.stmt)]
        first = max((begin for begin in statements if begin <= line), default=line)
        return set().union(*(self.lines(file).get(i, ()) for i in range(first, line + 1)))

    def choose(self, mutant: Mutant) -> tuple[dict[str, float], int]:
        """Choose tests for a mutant, those of quick files first.

        Returns the seconds of each test, and how many tests execute the line.
        """
        on_line = self.of_line(mutant.file, mutant.line)
        own = f"test_{Path(mutant.file).name}"  # of a module that is all compiled
        module = self.of([mutant.file]) | {x for x in self.seconds if f"/{own}::" in x}
        # What nothing imports is run in another process, by a module of its folder.
        folder = (ROOT / mutant.file).parent
        beside = [path.relative_to(ROOT).as_posix() for path in folder.glob("*.py")]
        chosen: list[str] = []
        for pool in (on_line, module, self.of(importers(mutant.file) or beside)):
            room = MOST - sum(self.seconds[test] for test in chosen)
            rest = sorted((self.seconds.keys() & pool).difference(chosen))
            rest.sort(key=self.seconds.__getitem__)
            ends = [*accumulate(self.seconds[test] for test in rest)]
            # Half the time for the quickest; these alone are tests of arguments.
            quickest = bisect(ends, 0.5 * room)
            chosen += rest[:quickest]
            every = math.ceil(max(ends[-1:] or [0.0]) / max(0.5 * room, 1e-3))
            chosen += rest[quickest :: max(every, 1)]
        chosen.sort(key=self.seconds.__getitem__)
        quick = [*dict.fromkeys(test.split("::")[0] for test in chosen)]
        chosen.sort(key=lambda test: quick.index(test.split("::")[0]))  # they share fixtures
        always = (test for test in self.seconds if test.startswith(f"{ALWAYS}::"))
        tests = {test: self.seconds[test] for test in (*chosen, *always)}
        return tests, len(self.seconds.keys() & on_line)


def measure(results: dict[str, Path], filled: Path) -> int:
    """Measure files of tests, and write their results and the lines that they execute.

    A crash is measured again with each file alone. Returns their number.
    """
    lines = next(iter(results.values())).with_suffix(".coverage")
    lines.unlink(missing_ok=True)
    with Copy.made(filled) as copy:
        failed, found = copy.run(dict.fromkeys(results, 0.0), measured=lines)
        with LOCK:
            shutil.copytree(copy.cache, filled, dirs_exist_ok=True)
    if not found and len(results) > 1:
        return sum(measure({test: path}, filled) for test, path in results.items())
    for test, path in results.items():
        own = {name: each for name, each in found.items() if name.startswith(f"{test}::")}
        none = "skipped" if found or not failed else failed
        path.write_text(json.dumps(own or {test: (none, 0.0)}), "utf-8")
    return len(results)


def attempt(mutant: Mutant, tests: dict[str, float], on_line: int, filled: Path) -> dict[str, Any]:
    """Try a mutant. A failure counts if the same tests pass without the change."""
    began, failed, left = time.monotonic(), "", []
    with Copy.made(filled) as copy:
        while tests:
            failed, _ = copy.run(tests, mutant)
            names = [*tests]
            upto = names[: names.index(failed) + 1] if failed in tests else names
            without = copy.run({test: tests[test] for test in upto})[0] if failed else ""
            if not without:
                break
            left, failed = [*left, without], ""
            if without not in tests:
                break
            del tests[without]
    return {"name": mutant.name, "noticed_by": failed, "tests": len(tests), "on_line": on_line,
            "left": left, "seconds": round(time.monotonic() - began)}  # fmt: skip


def listed() -> list[str]:
    """Files of the repository: tracked ones, and others that git does not ignore."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.check_output(command, cwd=ROOT, text=True, encoding="utf-8").split("\0")
    return sorted(name for name in names if name and (ROOT / name).is_file())


def digest(names: Iterable[str]) -> str:
    """A hash of files."""
    hashed = hashlib.sha256()
    for name in names:
        hashed.update(name.encode() + (ROOT / name).read_bytes())
    return hashed.hexdigest()[:16]


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    add = parser.add_argument
    add("--fresh", type=int, default=120, metavar="N", help="number of changes to draw")
    add("--seed", type=int, help="seed of the draw, to resume a run; random if not given")
    add("--packages", nargs="+", metavar="FOLDER", default=[], help="draw from these folders only")
    add("--tests", nargs="+", metavar="PATH", default=["tests"], help="use these tests only")
    add("--workers", type=int, default=os.cpu_count(), metavar="N", help="processes at once")
    add("--again", action="store_true", help="repeat changes that were not noticed")
    options = parser.parse_args()
    if options.workers is not None and options.workers < 1:
        parser.error("--workers must be at least 1")
    seed = random.SystemRandom().randrange(10**6) if options.seed is None else options.seed
    given = {"--seed": [seed], "--packages": options.packages, "--tests": options.tests}
    words = shlex.join(str(x) for key, values in given.items() if values for x in (key, *values))
    print(f"resumed by: python -m benchmarks.mutation --fresh {options.fresh} {words}", flush=True)
    modules = files(options.packages)
    tests = [name for name in listed() if Path(name).match("test_*.py")
             and any(Path(name).is_relative_to(path) for path in options.tests)]  # fmt: skip
    if not modules or not tests:
        parser.error(f"there is no {'test' if modules else 'module'} in these folders")
    if PACKAGE in sys.modules:
        raise RuntimeError("the package is loaded already: tests would not meet a changed one")
    for library in LIBRARIES:
        with suppress(ImportError):
            import_module(library)

    mutants = [*islice(draw(seed, modules), options.fresh)]
    used = (*FOLDERS, "tests", "train.py", "pyproject.toml")
    sources = (name for name in listed() if name.startswith(used))
    sources = (name for name in sources if not Path(name).match("test_*.py"))
    kept = ROOT / "build" / "mutation" / digest(sources)
    (kept / "cache").mkdir(parents=True, exist_ok=True)
    measured = Measured(kept, [*dict.fromkeys([*tests, ALWAYS])], options.workers)
    log = kept / f"{hashlib.sha256(words.encode()).hexdigest()[:16]}.jsonl"
    old = log.read_text("utf-8").splitlines() if log.exists() else []
    known = {record["name"]: record for record in map(json.loads, old)}
    if options.again:
        known = {name: record for name, record in known.items() if record["noticed_by"]}
    new = [mutant for mutant in mutants if mutant.name not in known]
    with ProcessPoolExecutor(options.workers, FORKS) as pool:
        chosen = ((mutant, *measured.choose(mutant)) for mutant in new)
        for done in as_completed([pool.submit(attempt, *each, kept / "cache") for each in chosen]):
            record = done.result()
            known[record["name"]] = record
            with log.open("a", encoding="utf-8") as file:
                file.write(json.dumps(record) + "\n")
            result = record["noticed_by"] or "NOT NOTICED"
            print(
                f"{len(known)}, {record['seconds']} s: {record['name']}\n    {result}", flush=True
            )
    records = [known[mutant.name] for mutant in mutants]
    for record in records:
        measured.left |= dict.fromkeys(record["left"], "failed without a change")

    left = (f"test left out, {outcome}: {test}" for test, outcome in measured.left.items())
    print("", *left, sep="\n")
    unnoticed = [record for record in records if not record["noticed_by"]]
    for record in unnoticed:
        tests = f"{record['tests']} tests, of which {record['on_line']} execute the line"
        print(f"not noticed by {tests}: {record['name']}")
    share = 1.0 - len(unnoticed) / max(1, len(records))
    print(f"\nnoticed: {share:.0%} of {len(records)}, seed {seed}, commit {commit()}, "
          f"{machine('cosmic-ray', 'coverage')}")  # fmt: skip


if __name__ == "__main__":
    # The module alone: the package must not be loaded before a change is made.
    spec = spec_from_file_location("console", ROOT / PACKAGE / "_tools" / "console.py")
    console = module_from_spec(spec)  # type: ignore[arg-type]
    spec.loader.exec_module(console)  # type: ignore[union-attr]
    raise SystemExit(console.run(main))
