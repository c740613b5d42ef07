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
PATIENCE = 150.0  # seconds after which a mutant that still runs counts as noticed

_ENGINE = [
    "test_events", "test_strides", "test_outcomes", "test_ledger", "test_tolerance",
    "test_derivatives",
]  # fmt: skip
_WALKERS = ["../test_walkers", "test_motion"]
TESTS = {
    "kneed": ["test_motion", "test_collisions", *_ENGINE],
    "compass": ["test_motion", "test_collisions", *_ENGINE],
    "simplest": ["test_motion", "test_collisions", *_ENGINE],
    "constants": ["test_motion", "test_collisions", *_ENGINE],
    "forces": ["test_forces", "test_trajectory"],
    "trajectory": ["test_trajectory"],
    "lanes": ["test_motion", "test_strides", "test_derivatives"],
    "walker": _WALKERS,
    "presets": _WALKERS,
    "parts": _WALKERS,
    "tuning": _WALKERS,
    "verner": ["test_tolerance", *_ENGINE],
    "runge_kutta": ["test_tolerance", *_ENGINE],
    "events": _ENGINE,
    "record": _ENGINE,
    "tile": _ENGINE,
    "landing": _ENGINE,
    "integrator": _ENGINE,
    "engine": _ENGINE,
    "ledger": _ENGINE,
    "frame": ["test_forces", *_ENGINE],
    "arguments": _ENGINE,
    "stride": _ENGINE,
}
"""Fast tests in the order in which they are likely to notice a change of a file."""

_HARD = ("events", "tile", "landing", "integrator", "engine")
"""Files whose faults may show in hard strikes only."""

SLOW_WITHOUT_COMPILER = (
    "not (any_throw or any_size or any_shape or crowd or beside_whom or threads or many_shapes "
    "or samples_follow or depend_on_the_others)"
)

HARD_STRIKES = (
    "almost_tangential or pair_of_roots or near_miss or mere_touch or grazing_fall "
    "or strike_or_fall or any_throw"
)

PLAIN_PYTHON = """

def get(tile, row, lane):
    return tile[row * WIDTH + lane]


def put(tile, row, lane, value):
    tile[row * WIDTH + lane] = value


np.seterr(all="ignore")
"""
"""Put at the end of `lanes`, this stands in for what numba compiles by hand."""


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
    failure = failure or tests_fail(tree, TESTS[file])
    return failure or (look_closely(tree) if file in _HARD else "")


def look_closely(tree: Path) -> str:
    """Which of the hard strikes, compiled, notices what the plain tests did not."""
    lanes = tree / path_of("lanes")
    plain_lanes = lanes.read_text()
    lanes.write_text((ROOT / path_of("lanes")).read_text())
    failure = tests_fail(tree, ["../stress/test_stress"], which=HARD_STRIKES, compiled=True)
    lanes.write_text(plain_lanes)
    return "" if failure == "time" else failure  # a compiler may be slow without any change


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
            for file in ("lanes", "forces", "walker", "stride"):
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
