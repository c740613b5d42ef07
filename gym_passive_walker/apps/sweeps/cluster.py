"""Workers on the machines of a Ray cluster, one for each CPU.

Machines may join and leave during a sweep. A watcher receives tasks once it has started. If its
machine is lost, other watchers do its tasks.
"""

from __future__ import annotations

import logging
import platform
import time
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from typing import Any

from gym_passive_walker._tools.extras import extra
from gym_passive_walker._tools.progress import show
from gym_passive_walker.apps.sweeps.store import FAILED
from gym_passive_walker.apps.sweeps.version import version
from gym_passive_walker.apps.sweeps.workers import (
    STILLBORN,
    TRIES,
    Pace,
    Task,
    TaskOutcome,
    Workers,
)

HERE = "here"
"""Address that starts a cluster of only this machine."""

_LOOK = 1.0  # seconds between two checks for free CPUs
_PATIENCE = 300.0  # seconds to wait for a free CPU while no task is running
_WAITS = 5  # parts of this wait, with a report of progress after each


class Watcher:
    """Supervises one worker, on the machine that Ray chooses.

    Args:
        analysis: Name of the analysis.
        time_out: Seconds after which a task is given up; None waits forever.
        outside: What stands outside the package besides, as in `version`.
    """

    def __init__(self, analysis: str, time_out: float | None, outside: Sequence[str]) -> None:
        self._version = version(analysis, outside)
        self._workers = Workers(analysis, 1, time_out)

    def join(self, computing: str) -> None:
        """Check that the machine has the sweep's version.

        Raises:
            ValueError: if the machine has another version.
        """
        if self._version != computing:
            raise ValueError(
                f"the machine {platform.node()} of the cluster has version {self._version}, the "
                f"sweep is computed by {computing}: install that version there"
            )

    def outcomes(self, tasks: Sequence[Task]) -> list[TaskOutcome]:
        """Do tasks, and return how each ended.

        Raises:
            ChildProcessError: if no worker can be started.
        """
        return list(self._workers.outcomes(tasks))


class Cluster:
    """Workers on a Ray cluster, with the interface of `Workers`.

    Args:
        analysis: Name of the analysis.
        count: Number of workers, at most one for each CPU of the cluster; None is one for each CPU.
        time_out: Seconds after which a task is given up; None waits forever.
        address: Address of the cluster; `HERE` starts one on this machine.
        computing: Version of the code that computes the sweep.
        outside: What stands outside the package besides the analysis, as in `version`.

    Raises:
        ImportError: if ray is not installed.
        ConnectionError: if there is no cluster at the address.
    """

    def __init__(
        self,
        analysis: str,
        count: int | None,
        time_out: float | None,
        address: str,
        computing: str,
        outside: Sequence[str],
    ) -> None:
        with extra("ray"):
            import ray  # type: ignore[import-not-found]
        self._ray: Any = ray
        started: Any = {"address": address}
        if address == HERE:
            started = {"address": "local", "num_cpus": count, "include_dashboard": False}
        ray.init(**started, log_to_driver=False, logging_level=logging.ERROR)
        self._asked, self._computing = count, computing
        self._made, self._given = ray.remote(num_cpus=1)(Watcher), (analysis, time_out, outside)
        self._joining: dict[Any, Any] = {}
        self._at_work: dict[Any, tuple[Any, list[Task]]] = {}
        self._idle: list[Any] = []
        self._stillborn, self._looked = 0, 0.0

    def outcomes(self, tasks: Sequence[Task]) -> Iterator[TaskOutcome]:
        """Do tasks, and yield the outcome of each soon after it has ended.

        Raises:
            ValueError: if a machine of the cluster has another version.
            ConnectionError: if no worker can be started on the cluster.
        """
        waiting, lost, tried = deque(tasks), deque[Task](), Counter[int]()
        pace = Pace(self._room())
        while waiting or lost or self._at_work:
            self._fill()
            while self._idle and (waiting or lost):
                watcher = self._idle.pop()
                taken = [lost.popleft()] if lost else pace.take(waiting)
                self._at_work[watcher.outcomes.remote(taken)] = watcher, taken
            for _ in range(_WAITS):
                awaited = [*self._at_work, *self._joining]
                ended = self._ray.wait(awaited, timeout=_PATIENCE / _WAITS)[0]
                show()  # progress, also during long tasks
                if ended:
                    break
            if not ended and not self._at_work:
                raise ConnectionError(
                    "the cluster has no free CPU for a worker: wait until other programs end"
                )
            for each in ended:
                if each in self._joining:
                    self._join(each)
                    continue
                watcher, taken = self._at_work.pop(each)
                try:
                    outcomes = self._ray.get(each)
                except self._ray.exceptions.RayTaskError as error:
                    raise error.cause from None  # a watcher's own error ends the sweep
                except self._ray.exceptions.RayError as error:  # lost, perhaps with its machine
                    tried.update(number for number, _ in taken)
                    lost += [pair for pair in taken if tried[pair[0]] < TRIES]
                    said = " ".join(str(error).split())
                    given_up = [number for number, _ in taken if tried[number] >= TRIES]
                    outcomes = [TaskOutcome(number, FAILED, said, 0.0, {}) for number in given_up]
                else:
                    self._idle.append(watcher)
                for outcome in outcomes:
                    pace.note(outcome)
                    yield outcome

    def _join(self, said: Any) -> None:
        """Register a watcher that has started, or count one that could not start."""
        watcher = self._joining.pop(said)
        try:
            self._ray.get(said)
        except self._ray.exceptions.RayTaskError as error:
            raise error.cause from None
        except self._ray.exceptions.RayError as error:
            self._stillborn += 1
            if self._stillborn == STILLBORN:
                message = " ".join(str(error).split())
                raise ConnectionError(f"no worker can be started on Ray: {message}") from None
        else:
            self._stillborn = 0
            self._idle.append(watcher)

    def _room(self) -> int:
        """Return the number of watchers for the cluster's present CPUs, at most `count`."""
        processors = max(1, int(self._ray.cluster_resources().get("CPU", 0)))
        return min(self._asked or processors, processors)  # Ray queues any excess

    def _fill(self) -> None:
        """Create watchers for free CPUs; they join once Ray has started them."""
        started = len(self._joining) + len(self._at_work) + len(self._idle)
        if started and time.monotonic() < self._looked + _LOOK:
            return
        self._looked = time.monotonic()
        for _ in range(self._room() - started):
            watcher = self._made.remote(*self._given)
            self._joining[watcher.join.remote(self._computing)] = watcher

    def close(self) -> None:
        """Disconnect from the cluster; a cluster of only this machine ends."""
        self._ray.shutdown()
