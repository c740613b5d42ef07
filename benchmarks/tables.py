"""Tables of results in the documentation, and the commands that make them.

    python -m benchmarks.tables [NAME...]     List all tables, or make these again.
    python -m benchmarks.tables learning      Make all results of learning again: hours; resumable.

A table stands between the comments `<!-- NAME -->` and `<!-- end of NAME -->` of its page. The
list calls it PAGE/NAME; NAME is enough if only one page has it. A group is a series of tables and
commands. It skips what the present code has made, and keeps what commands print in `runs/tables`.
"""

from __future__ import annotations

import argparse
import re
import shlex
import subprocess
import sys
from pathlib import Path

DOCS = Path(__file__).parents[1] / "docs"
BENCHMARKS, GPU = DOCS / "benchmarks.md", DOCS / "gpu.md"

SCRIPTS = {
    "benchmarks/work-precision": "work_precision strides",
    "benchmarks/alone": "work_precision alone",
    "benchmarks/walks": "work_precision walks",
    "benchmarks/tick": "work_precision ticks",
    "benchmarks/penalty": "work_precision penalties",
    **{f"benchmarks/{name}": name for name in ("gradients", "integrators")},
    **{f"benchmarks/{part}": f"throughput {part}" for part in (
        "accelerations", "strides", "ticks", "threads", "learning", "on_tensors")},
    **{f"gpu/gpu {part}": f"gpu {part}" for part in ("strides", "ticks", "learning")},
    **{f"gpu/gpu {part}": f"gpu_code {part}" for part in ("launch", "warps", "kernels")},
    "benchmarks/scene cost": "scene_cost",
    **{f"simulators/{part}": f"simulators {part}" for part in (
        "walks", "contacts", "traps", "speed")},
    "simulators/transfer": "transfer",
    "benchmarks/cold start": "cold_start waits",
    **{f"benchmarks/{part}": f"cold_start {part}" for part in ("wheel", "levels", "kernels")},
    "benchmarks/parts of a stride": "performance strides",
    "benchmarks/operations": "performance operations",
    "design/cheap": "design cost",
    "design/steady": "design return",
    **{f"design/{part}": f"design {part}" for part in ("steep", "tuned")},
    "agents/random guesses": "optimum",
    "robustness/gauntlet": "gauntlet",
    "agents/policies": "policies",
    "robustness/first passage": "first_passage",
    "anywhere/anywhere": "anywhere show",
    "stability/stress": "stress --long --write",
    **{f"stability/stress {topic}": f"stress --long --only '{topic}' --write" for topic in (
        "anything at all", "uneven ground")},
    "stability/kills": "kills --kills 5 --write",
    **{f"scaling/{part}": f"sweeps {part}" for part in (
        "walkers", "parameters", "tasks", "keeper", "naps", "minutes")},
}  # fmt: skip
TABLES = {name: f"python -m benchmarks.{script}" for name, script in SCRIPTS.items()} | {
    "analyses/pairs": "python -m tests.control.test_matrix",
    "agents/benchmark": "python train.py benchmark --scenes level steep rolling lab "
    "--budget 0.2 --document docs/agents.md",
}
"""Commands by PAGE/NAME of the table that they write."""

GROUPS = {"learning": (
    "agents/random guesses",  # the optima that all costs are compared with
    "python train.py benchmark --scenes level rolling lab --agents ppo",
    "python train.py benchmark --scenes level --agents sac shac shac-learned ppo-fast",
    "python train.py benchmark --scenes rough pushed push-off commanded --agents passive constant "
    "lqr deadbeat optimal ppo --seeds 3 --budget 0.2",
    "agents/benchmark",
    "python train.py benchmark --scenes level --agents shac --budget 0.3333 --out runs/third",
    "python -m benchmarks.defaults --id PassiveWalkerEasy-v0",
    "python -m benchmarks.defaults --id PassiveWalker-v0",
    "python -m benchmarks.defaults --algo sac --envs 16 --marks 20000 50000 100000 150000",
    "python -m benchmarks.defaults --algo sac --envs 16 --marks 20000 50000 100000 150000 "
    "--id PassiveWalker-v0",
    "python -m benchmarks.defaults --algo sac --steps 50000 "
    "--marks 2000 5000 10000 15000 20000 30000 40000",
    "python train.py gait level-ppo --out docs/images/gait-level-ppo.png",
    "robustness/first passage",
    "robustness/gauntlet",
    "agents/policies",  # with the gauntlet's measures
    "python -m benchmarks.anywhere train walk optima",
    "anywhere/anywhere",
    "python -m benchmarks.off_policy --learners sac tqc crossq xqc --seeds 0 1 2 3 4 5 6 7 8 9",
)}  # fmt: skip
"""Tables and commands by the name of their group, each after those that it depends on."""

CODE = ("gym_passive_walker", "agents", "benchmarks", "train.py")
RECORDS = DOCS.parent / "runs" / "tables"
"""Folder of what the commands of groups print, if they write no table."""


def commit() -> str:
    """The present commit, with a "+" if code has changed since."""

    def git(*words: str) -> str:
        return subprocess.check_output(["git", *words], cwd=DOCS.parent, text=True)

    changed = git("status", "--porcelain", *CODE)
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


def record(command: str) -> Path:
    """The file with what a command of a group has printed."""
    return RECORDS / f"{re.sub('[^a-zA-Z0-9]+', '-', command.partition(' ')[2]).strip('-')}.md"


def made(step: str) -> bool:
    """Whether the present code made a table, or what a command prints: no commit changed it."""
    page, _, name = step.partition("/")
    path = DOCS / f"{page}.md" if step in TABLES else record(step)
    text = path.read_text(encoding="utf-8") if path.is_file() else ""
    if step in TABLES:
        text = text.partition(f"<!-- {name} -->")[2].partition(f"<!-- end of {name} -->")[0]
    commits = re.findall(r"`([0-9a-f]{7,}\+?)`", text.rstrip().rpartition("\n")[2])
    unchanged = ["git", "diff", "--quiet"]  # "+" is a commit that no repository has
    return bool(commits) and not any(
        subprocess.run(
            [*unchanged, each, "--", *CODE], cwd=DOCS.parent, stderr=subprocess.DEVNULL
        ).returncode
        for each in commits
    )


def run(step: str, *, kept: bool = False) -> int:
    """Run the command of a table, or a command; returns its exit status.

    Args:
        step: PAGE/NAME of a table, or a command.
        kept: Whether to keep what it prints in its file of `RECORDS`, if it succeeds.
    """
    command = TABLES.get(step, step)
    print(f"$ {command}", flush=True)
    words = [sys.executable, *shlex.split(command)[1:]]
    if not kept:
        return subprocess.run(words, cwd=DOCS.parent).returncode
    lines = []
    with subprocess.Popen(
        words, cwd=DOCS.parent, stdout=subprocess.PIPE, text=True, encoding="utf-8"
    ) as job:
        for line in job.stdout or ():
            print(line, end="", flush=True)
            lines.append(line)
    if not job.returncode:
        RECORDS.mkdir(parents=True, exist_ok=True)
        said = f"{''.join(lines)}\n*`{command}`, commit `{commit()}`*\n"
        record(command).write_text(said, encoding="utf-8")
    return job.returncode


def main() -> int:
    """Run from the command line; returns the exit status of the first command that fails."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    which = f"tables to make again, or a group: {', '.join(GROUPS)}"
    parser.add_argument("names", nargs="*", metavar="NAME", help=which)
    names = parser.parse_args().names
    chosen = {}
    for name in names:
        found = [key for key in TABLES if name in (key, key.partition("/")[2])]
        if len(found) != 1 and name not in GROUPS:
            parser.error(f"{name!r} is {' or '.join(found) or 'not in the list of tables'}")
        chosen[name] = GROUPS.get(name, found)
    for key in [] if names else sorted(TABLES):
        print(f"{key:<{max(map(len, TABLES))}}  {TABLES[key]}")
    for name, steps in chosen.items():
        for step in steps:
            if name in GROUPS and made(step):
                print(f"already made: {TABLES.get(step, step)}", flush=True)
            elif status := run(step, kept=step not in TABLES):
                return status
    return 0


if __name__ == "__main__":
    from gym_passive_walker._tools import console

    raise SystemExit(console.run(main))
