"""The command `sweep`, which repeats an analysis over many parameters."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from pathlib import Path

from gym_passive_walker.apps.cli.report import Report, listing
from gym_passive_walker.apps.sweeps.cluster import HERE
from gym_passive_walker.apps.sweeps.run import sweep as swept
from gym_passive_walker.apps.sweeps.tasks import ANALYSES


def sweep(command: ArgumentParser) -> Callable[[Namespace], Report]:
    """Run an analysis over a grid, a list or a random sample, on all CPU cores; resumable.

    passive-walker sweep lab.yaml
    passive-walker sweep lab.yaml --out found --workers 2
    passive-walker sweep lab.yaml --ray

    where lab.yaml contains:

      analysis: gait
      given: {walker: lab}
      over: {slope: [0.02, 0.03, 0.036], foot_radius: [0.18, 0.2, 0.22]}
    """
    add = command.add_argument
    known = ", ".join(ANALYSES)
    add("description", type=Path, metavar="FILE", help="YAML, JSON or TOML: analysis "
        f"({known}; module:function with --trust), over, how, given, samples, seed, "
        "time_out")  # fmt: skip
    add(
        "--out",
        type=Path,
        metavar="FOLDER",
        help="output folder (the file's name without its suffix)",
    )
    add("--workers", type=int, metavar="N", help="worker processes (one for each CPU core)")
    add(
        "--ray",
        nargs="?",
        const=HERE,
        metavar="ADDRESS",
        help="use a Ray cluster (Ray on this machine)",
    )
    add("--branch", action="store_true", help="use a new folder if this one has another sweep")
    add("--retry", action="store_true", help="repeat tasks that failed or timed out")

    add("--trust", action="store_true", help="permit module:function as the analysis or a "
        "scene, and module:NAME of a System as the walker; it runs with your rights")  # fmt: skip

    def run(arguments: Namespace) -> Report:
        found = swept(
            arguments.description,
            arguments.out,
            workers=arguments.workers,
            ray=arguments.ray,
            branch=arguments.branch,
            retry=arguments.retry,
            trust=arguments.trust,
        )
        data = {
            "tasks": found.tasks,
            "failures": found.failures,
            "folder": str(found.folder),
            "rows": str(found.folder / "rows"),
        }
        return Report(listing(f"swept {arguments.description}", data), data)

    return run
