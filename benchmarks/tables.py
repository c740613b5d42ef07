"""Tables of results in the documentation, and the commands that make them.

    python -m benchmarks.tables [NAME...]     List all tables, or make these again.

A table stands between the comments `<!-- NAME -->` and `<!-- end of NAME -->` of its page. The
list calls it PAGE/NAME; NAME is enough if only one page has it.
"""

from __future__ import annotations

import argparse
import shlex
import subprocess
import sys
from pathlib import Path

DOCS = Path(__file__).parents[1] / "docs"
PRECISION, SPEED = DOCS / "benchmarks-precision.md", DOCS / "benchmarks-speed.md"

SCRIPTS = {
    "benchmarks-precision/work-precision": "work_precision strides",
    "benchmarks-precision/walks": "work_precision walks",
    "benchmarks-precision/tick": "work_precision ticks",
    "benchmarks-precision/penalty": "work_precision penalties",
    **{f"benchmarks-precision/{name}": name for name in ("gradients", "integrators")},
    **{f"benchmarks-speed/{part}": f"throughput {part}" for part in (
        "accelerations", "strides", "ticks", "learning", "on_tensors")},
    **{f"benchmarks-speed/gpu {part}": f"gpu {part}" for part in ("strides", "ticks", "learning")},
    "benchmarks-speed/scene cost": "scene_cost",
    "benchmarks-start/cold start": "cold_start waits",
    **{f"benchmarks-start/{part}": f"cold_start {part}" for part in ("levels", "kernels")},
    **{f"performance/{part}": f"performance {part}" for part in ("strides", "operations")},
    "design/cheap": "design cost",
    "design/steady": "design return",
    **{f"design/{part}": f"design {part}" for part in ("steep", "tuned")},
    "agents/random guesses": "optimum",
    "robustness/gauntlet": "gauntlet",
    "policies/policies": "policies",
    "robustness/first passage": "first_passage",
    "anywhere/anywhere": "anywhere show",
    "stability/stress": "stress --long --write",
    **{f"stability/stress {topic}": f"stress --long --only '{topic}' --write" for topic in (
        "anything at all", "uneven ground")},
    "stability/kills": "kills --kills 5 --write",
    "mutation/faults": "mutation --write",
    "mutation/mutation": "mutation --changes 74 --write",
    **{f"scaling/{part}": f"sweeps {part}" for part in (
        "walkers", "parameters", "tasks", "keeper", "naps", "minutes")},
}  # fmt: skip
TABLES = {name: f"python -m benchmarks.{script}" for name, script in SCRIPTS.items()} | {
    "analyses/pairs": "python -m tests.control.test_matrix",
    "benchmarks-agents/benchmark": "python train.py benchmark --scenes level steep rolling lab "
    "--budget 0.2 --document docs/benchmarks-agents.md",
}
"""Commands by PAGE/NAME of the table that they write."""


def commit() -> str:
    """The present commit, with a "+" if code has changed since."""

    def git(*words: str) -> str:
        return subprocess.check_output(["git", *words], cwd=DOCS.parent, text=True)

    changed = git("status", "--porcelain", "gym_passive_walker", "agents", "benchmarks")
    return git("rev-parse", "--short=7", "HEAD").strip() + "+" * bool(changed)


def keep(name: str, text: str, page: Path) -> None:
    """Print a table and write it into a page, with its command and commit."""
    given = shlex.join([Path(sys.argv[0]).stem, *sys.argv[1:]])
    made = TABLES.get(f"{page.stem}/{name}", f"python -m benchmarks.{given}")
    text = f"{text}\n\n*`{made}`, commit `{commit()}`*"
    print(f"\n{text}", flush=True)
    first, last = f"<!-- {name} -->", f"<!-- end of {name} -->"
    old = page.read_text(encoding="utf-8")
    before, rest = (old if first in old else f"{old}\n{first}{last}\n").split(first)
    page.write_text(before + f"{first}\n\n{text}\n\n{last}" + rest.split(last)[1], "utf-8")


def main() -> int:
    """Run from the command line; returns the exit status of the first command that fails."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="tables to make again")
    names = parser.parse_args().names
    chosen = [[key for key in TABLES if name in (key, key.partition("/")[2])] for name in names]
    for name, found in zip(names, chosen, strict=True):
        if len(found) != 1:
            parser.error(f"{name!r} is {' or '.join(found) or 'not in the list of tables'}")
    for key in [] if names else sorted(TABLES):
        print(f"{key:<{max(map(len, TABLES))}}  {TABLES[key]}")
    for (key,) in chosen:
        print(f"$ {TABLES[key]}", flush=True)
        words = [sys.executable, *shlex.split(TABLES[key])[1:]]
        if status := subprocess.run(words, cwd=DOCS.parent).returncode:
            return status
    return 0


if __name__ == "__main__":
    from gym_passive_walker import console

    raise SystemExit(console.run(main))
