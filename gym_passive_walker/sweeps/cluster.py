"""The same workers on the machines of a Ray cluster, one to each processor."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any

from gym_passive_walker.extras import extra
from gym_passive_walker.sweeps.store import FAILED
from gym_passive_walker.sweeps.workers import Outcome, Pace, Task, Workers

HERE = "here"
"""The address of a cluster of this machine alone."""

_RESTARTS = 3  # of a watcher whose machine is lost


class Watcher:
    """Watches one worker, wherever Ray puts both."""

    def __init__(self, analysis: str, time_out: float | None) -> None:
        self._workers = Workers(analysis, 1, time_out)

    def outcomes(self, tasks: Sequence[Task]) -> list[Outcome]:
        """How tasks ended, all at once."""
        return list(self._workers.outcomes(tasks))


class Cluster:
    """As `Workers`, on Ray.

    Args:
        analysis: Its name.
        count: How many workers; one to each of the cluster's processors if None, and at most.
        time_out: Seconds after which a task is given up; None waits for ever.
        address: Of the cluster; `HERE` starts one on this machine.

    Raises:
        ImportError: if ray is not installed.
        ConnectionError: if there is no cluster at the address.
    """

    def __init__(
        self, analysis: str, count: int | None, time_out: float | None, address: str
    ) -> None:
        with extra("ray"):
            import ray  # type: ignore[import-not-found]
        self._ray: Any = ray
        started: Any = {"address": address}
        if address == HERE:
            started = {"num_cpus": count, "include_dashboard": False}
        ray.init(**started, log_to_driver=False, logging_level=logging.ERROR)
        processors = int(ray.cluster_resources()["CPU"])
        self._count = min(count or processors, processors)  # Ray lets what is too much wait
        remote = ray.remote(num_cpus=1, max_restarts=_RESTARTS, max_task_retries=_RESTARTS)(Watcher)
        self._crew = [remote.remote(analysis, time_out) for _ in range(self._count)]

    def outcomes(self, tasks: Sequence[Task]) -> Iterator[Outcome]:
        """Do tasks, and say of each how it ended soon after it has."""
        waiting, pace, at_work = deque(tasks), Pace(self._count), {}
        idle = list(self._crew)
        while waiting or at_work:
            while idle and waiting:
                watcher, taken = idle.pop(), pace.take(waiting)
                at_work[watcher.outcomes.remote(taken)] = watcher, taken
            (first,), _ = self._ray.wait(list(at_work))
            watcher, taken = at_work.pop(first)
            try:
                outcomes = self._ray.get(first)
            except self._ray.exceptions.RayError as error:
                said = " ".join(str(error).split())
                outcomes = [Outcome(number, FAILED, said, 0.0, {}) for number, _ in taken]
            idle.append(watcher)
            for outcome in outcomes:
                pace.note(outcome)
                yield outcome

    def close(self) -> None:
        """Leave the cluster; one of this machine alone ends."""
        self._ray.shutdown()
