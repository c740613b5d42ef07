"""The command `sweep`, which repeats an analysis over many parameters."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from gym_passive_walker.apps.cli.report import Report, listing
from gym_passive_walker.apps.sweeps.cluster import HERE
from gym_passive_walker.apps.sweeps.run import sweep as swept
from gym_passive_walker.apps.sweeps.tasks import ANALYSES

_FILE = (
    f"YAML, JSON or TOML: analysis ({', '.join(ANALYSES)}; module:function with --trust), over, "
    "how, given, samples, seed, time_out"
)
_RAY = {"nargs": "?", "const": HERE, "metavar": "ADDRESS"}


def sweep(
    description: Annotated[Path, _FILE, {"metavar": "FILE"}],
    *,
    out: Annotated[
        Path | None, "output folder (the file's name without its suffix)", {"metavar": "FOLDER"}
    ] = None,
    workers: Annotated[int | None, "worker processes (one for each CPU core)"] = None,
    ray: Annotated[str | None, "use a Ray cluster (Ray on this machine)", _RAY] = None,
    branch: Annotated[bool, "use a new folder if this one has another sweep"] = False,
    retry: Annotated[bool, "repeat tasks that failed or timed out"] = False,
    trust: Annotated[
        bool,
        "permit module:function as the analysis or a scene, and module:NAME of a System as the "
        "walker; it runs with your rights",
    ] = False,
) -> Report:
    """Run an analysis over a grid, a list or a random sample, on all CPU cores; resumable.

    passive-walker sweep lab.yaml
    passive-walker sweep lab.yaml --out found --workers 2
    passive-walker sweep lab.yaml --ray

    where lab.yaml contains:

      analysis: gait
      given: {walker: lab}
      over: {slope: [0.02, 0.03, 0.036], foot_radius: [0.18, 0.2, 0.22]}
    """
    found = swept(
        description, out, workers=workers, ray=ray, branch=branch, retry=retry, trust=trust
    )
    data = {
        "tasks": found.tasks,
        "failures": found.failures,
        "folder": str(found.folder),
        "rows": str(found.folder / "rows"),
    }
    return Report(listing(f"swept {description}", data), data)
