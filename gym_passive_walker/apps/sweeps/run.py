"""Run a sweep, or continue an interrupted one."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import boolean, whole
from gym_passive_walker._tools.loading import is_file, read_content
from gym_passive_walker._tools.progress import progress
from gym_passive_walker._tools.shown import Table
from gym_passive_walker.apps.build import processes
from gym_passive_walker.apps.sweeps.cluster import Cluster
from gym_passive_walker.apps.sweeps.description import Description
from gym_passive_walker.apps.sweeps.store import (
    DONE,
    Store,
    holds_another,
    read_columns,
    read_description,
)
from gym_passive_walker.apps.sweeps.tasks import ANALYSES, check_trust, task
from gym_passive_walker.apps.sweeps.version import version
from gym_passive_walker.apps.sweeps.workers import Task, Workers


@dataclass(frozen=True, repr=False)
class SweepResult(Table):
    """A finished sweep: a table with a row for each task.

    Attributes:
        folder: Folder of the sweep; ``folder / "rows"`` is its Parquet dataset.
        tasks: Number of tasks.
        failures: Number of tasks that failed or timed out.
        trust: Whether analysis, walkers and scenes may be code from outside the package.
    """

    folder: Path
    tasks: int
    failures: int
    trust: bool = False

    def columns(self) -> dict[str, NDArray]:
        """Return the columns by name, each (tasks,), with rows in the order of the tasks."""
        return read_columns(self.folder)

    def description(self) -> Description:
        """Return the description of the sweep."""
        return read_description(self.folder)

    def facts(self) -> dict[str, str]:
        """Number of tasks, number of failures, and folder, as text."""
        return {
            "tasks": str(self.tasks),
            "failures": str(self.failures),
            "folder": str(self.folder),
        }


def sweep(
    analysis: str | os.PathLike[str] | Callable[..., Any] | Mapping[str, Any] | Description,
    out: str | os.PathLike[str] | None = None,
    *,
    workers: int | None = None,
    ray: str | None = None,
    branch: bool = False,
    retry: bool = False,
    trust: bool = False,
    **described: Any,
) -> SweepResult:
    """Run an analysis for many sets of arguments in parallel, and store the results in a folder.

    A sweep that was interrupted at any moment continues when it is called again. A task that fails,
    hangs or crashes gives a row with its error; other tasks continue. A script must call `sweep`
    below ``if __name__ == "__main__":``, since the worker processes import the script.

    Args:
        analysis: Name of an analysis: gait, family, bifurcation, basin, robustness, check, optimal
            or evaluation. Or a function of a module of your own, or "module:function" (requires
            `trust`), that returns numbers, text and booleans by name. Or a complete `Description`,
            a mapping of its attributes, or the path of a JSON, YAML or TOML file of such a mapping.
        out: The folder, created if necessary. None is the name of the description's file without
            its ending.
        workers: Number of processes; None is one for each CPU.
        ray: "here" for Ray on this machine, or the address of a cluster. Its machines must have the
            package, and any function of your own, at the same paths.
        branch: If the folder holds a sweep with another description, use a new folder beside it
            instead of raising an error.
        retry: Repeat tasks that failed or timed out, and replace their rows.
        trust: Allow "module:function" as the analysis or a scene, and "module:NAME" of a `System`
            as the walker, which imports that module and runs its code. Not needed if `analysis` is
            the function itself.
        **described: Further attributes of the `Description`: over, how, given, samples, seed,
            time_out.

    Returns:
        The sweep: a table with a row for each task.

    Raises:
        ValueError: if the description is invalid, code is not trusted, or the folder holds
            another sweep or damaged files.
        OSError: if a file cannot be written, or no worker process can be started; earlier results
            are kept.
        ImportError: if pyarrow is not installed, or ray where it is used.
    """
    branch, retry = boolean(branch, "branch"), boolean(retry, "retry")
    if out is None and not is_file(analysis):
        raise ValueError("out must be a folder; only a description in a file has a default")
    description = _described(analysis, described)
    folder = Path(analysis).with_suffix("") if out is None else Path(out)  # type: ignore[arg-type]
    is_function = callable(analysis) and not isinstance(analysis, Mapping | Description)
    trust = check_trust(description.outside, trust or is_function)
    if branch and holds_another(folder, description):
        folder = folder.with_name(f"{folder.name}-{description.digest[:8]}")
    if workers is not None:
        workers = whole(workers, "workers")
    outside = [*description.outside, *description.policies]
    computing = version(description.analysis, outside)
    if description.analysis in ANALYSES:  # fail early on invalid arguments
        task(description.analysis, description.tasks[0])
    store = Store(folder, description, computing, retry=retry)
    try:
        left = [pair for pair in enumerate(description.tasks) if pair[0] not in store.done]
        if left:
            name, time_out = description.analysis, description.time_out
            if ray is None:
                count = min(processes(workers or os.cpu_count() or 1), len(left))
                made = Workers(name, count, time_out)
            else:
                made = Cluster(name, workers, time_out, ray, computing, outside)
            _work(made, store, left)
        store.flush(last=True)
    except KeyboardInterrupt:
        store.flush()
        said = f"{len(store.done)} of {len(description.tasks)} tasks are kept in {folder}"
        print(f"\nstopped: {said}; repeat the call to continue", file=sys.stderr)
        raise
    finally:
        store.close()
    failures = sum(status != DONE for status in store.done.values())
    return SweepResult(folder, len(description.tasks), failures, trust)


def _described(analysis: Any, rest: dict[str, Any]) -> Description:
    if isinstance(analysis, Description):
        analysis = {each.name: getattr(analysis, each.name) for each in fields(analysis)}
    if is_file(analysis):
        analysis = read_content(analysis)
    if isinstance(analysis, Mapping):
        return Description.of({**analysis, **rest})
    if callable(analysis):
        module, name = analysis.__module__, analysis.__qualname__
        if not name.isidentifier():
            raise ValueError(f"{name} cannot be found by other processes: put it into a module")
        analysis = f"{module}:{name}"
    return Description.of({"analysis": analysis, **rest})


def _work(workers: Workers | Cluster, store: Store, left: list[Task]) -> None:
    """Do the remaining tasks and store their rows."""
    failures, began, given = 0, time.monotonic(), dict(left)
    try:
        with progress("tasks", len(left)) as advance:
            for count, outcome in enumerate(workers.outcomes(left), 1):
                ended = outcome._asdict()
                results = ended.pop("results")
                store.add(given[outcome.task] | ended, results)
                failures += outcome.status != DONE
                rate = count / (time.monotonic() - began)
                rest = (len(left) - count) / rate
                advance(note=f"{rate:.3g}/s, {failures} failed, {rest:.0f} s left")
    finally:
        workers.close()
