"""The same workers on the machines of a Ray cluster, one to each processor.

Machines come and go: a watcher is given tasks once it has a place and has said that it is there,
and one that is lost with its machine leaves its tasks to the others.
"""

from __future__ import annotations

import logging
import platform
import time
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from typing import Any

from gym_passive_walker.extras import extra
from gym_passive_walker.progress import show
from gym_passive_walker.sweeps.store import FAILED
from gym_passive_walker.sweeps.version import version
from gym_passive_walker.sweeps.workers import STILLBORN, TRIES, Outcome, Pace, Task, Workers

HERE = "here"
"""The address of a cluster of this machine alone."""

_LOOK = 1.0  # seconds between two looks at what room there is
_PATIENCE = 300.0  # seconds for a cluster where nobody is at work to have room for one
_WAITS = 5  # in which these are spent, with a report of the work's progress after each


class Watcher:
    """Watches one worker, wherever Ray puts both.

    Args:
        analysis: Its name.
        time_out: Seconds after which a task is given up; None waits for ever.
    """

    def __init__(self, analysis: str, time_out: float | None) -> None:
        self._version = version(analysis)
        self._workers = Workers(analysis, 1, time_out)

    def join(self, computing: str) -> None:
        """Say that it is there, and computes by the sweep's version.

        Raises:
            ValueError: if it computes by another.
        """
        if self._version != computing:
            raise ValueError(
                f"the machine {platform.node()} of the cluster has version {self._version}, the "
                f"sweep is computed by {computing}: install that one there"
            )

    def outcomes(self, tasks: Sequence[Task]) -> list[Outcome]:
        """How tasks ended, all at once.

        Raises:
            RuntimeError: if no worker can be started.
        """
        return list(self._workers.outcomes(tasks))


class Cluster:
    """As `Workers`, on Ray.

    Args:
        analysis: Its name.
        count: How many workers; one to each of the cluster's processors if None, and at most.
        time_out: Seconds after which a task is given up; None waits for ever.
        address: Of the cluster; `HERE` starts one on this machine.
        computing: The version by which the sweep is computed.

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
    ) -> None:
        with extra("ray"):
            import ray  # type: ignore[import-not-found]
        self._ray: Any = ray
        started: Any = {"address": address}
        if address == HERE:
            started = {"address": "local", "num_cpus": count, "include_dashboard": False}
        ray.init(**started, log_to_driver=False, logging_level=logging.ERROR)
        self._asked, self._computing = count, computing
        self._made, self._given = ray.remote(num_cpus=1)(Watcher), (analysis, time_out)
        self._joining: dict[Any, Any] = {}
        self._at_work: dict[Any, tuple[Any, list[Task]]] = {}
        self._idle: list[Any] = []
        self._stillborn, self._looked = 0, 0.0

    def outcomes(self, tasks: Sequence[Task]) -> Iterator[Outcome]:
        """Do tasks, and say of each how it ended soon after it has.

        Raises:
            ValueError: if a machine of the cluster computes by another version.
            RuntimeError: if no worker can be started anywhere.
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
                show()  # how far the work is, while tasks are long
                if ended:
                    break
            if not ended and not self._at_work:
                raise RuntimeError("the cluster has no room for a worker: is all of it busy?")
            for each in ended:
                if each in self._joining:
                    self._join(each)
                    continue
                watcher, taken = self._at_work.pop(each)
                try:
                    outcomes = self._ray.get(each)
                except self._ray.exceptions.RayTaskError as error:
                    raise error.cause from None  # what a watcher itself says ends the sweep
                except self._ray.exceptions.RayError as error:  # gone, its machine perhaps too
                    tried.update(number for number, _ in taken)
                    lost += [pair for pair in taken if tried[pair[0]] < TRIES]
                    said = " ".join(str(error).split())
                    given_up = [number for number, _ in taken if tried[number] >= TRIES]
                    outcomes = [Outcome(number, FAILED, said, 0.0, {}) for number in given_up]
                else:
                    self._idle.append(watcher)
                for outcome in outcomes:
                    pace.note(outcome)
                    yield outcome

    def _join(self, said: Any) -> None:
        """A watcher has its place, or could not be made."""
        watcher = self._joining.pop(said)
        try:
            self._ray.get(said)
        except self._ray.exceptions.RayTaskError as error:
            raise error.cause from None
        except self._ray.exceptions.RayError as error:
            self._stillborn += 1
            if self._stillborn == STILLBORN:
                told = " ".join(str(error).split())
                raise RuntimeError(f"no worker can be started on Ray: {told}") from None
        else:
            self._stillborn = 0
            self._idle.append(watcher)

    def _room(self) -> int:
        """How many watchers the cluster has processors for now, as far as they were asked for."""
        processors = max(1, int(self._ray.cluster_resources().get("CPU", 0)))
        return min(self._asked or processors, processors)  # Ray lets what is too much wait

    def _fill(self) -> None:
        """Make watchers where there is room; they join once they have their place."""
        crew = len(self._joining) + len(self._at_work) + len(self._idle)
        if crew and time.monotonic() < self._looked + _LOOK:
            return
        self._looked = time.monotonic()
        for _ in range(self._room() - crew):
            watcher = self._made.remote(*self._given)
            self._joining[watcher.join.remote(self._computing)] = watcher

    def close(self) -> None:
        """Leave the cluster; one of this machine alone ends."""
        self._ray.shutdown()
