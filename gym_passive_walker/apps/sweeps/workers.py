"""Worker processes on one machine, and their supervision.

Each worker has a pipe. It receives tasks for about one second, and returns results one by one, so
its current task is known. If that task times out or crashes the process, the worker is replaced.
Its remaining tasks go back to the queue. A worker compiles what its tasks need, and reports that:
compilation does not count towards the time-out.

Libraries were tried and keep less: pebble 5.2.3 reports a crash for another task if results wait to
be read; loky 3.7.0 and joblib 1.6.0 fail all tasks at a crash, and have no time-out of one task.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from typing import Any, NamedTuple

from gym_passive_walker._tools.progress import COMPILING, disable_progress, show
from gym_passive_walker.apps.sweeps.store import DONE, FAILED, TIMED_OUT
from gym_passive_walker.apps.sweeps.tasks import flat, task
from gym_passive_walker.engine.machine import THREADS

_MOST = 2000  # tasks sent at once
_LOOK = 5.0  # seconds between two reports of progress
STILLBORN = 3
"""Number of workers that end before they are ready, after which the sweep fails."""

TRIES = 2
"""Number of attempts at a task that crashes its process."""

Task = tuple[int, dict[str, Any]]
"""A task's number, and its arguments by name."""


class TaskOutcome(NamedTuple):
    """Outcome of a task.

    Attributes:
        task: Number of the task.
        status: `DONE`, `FAILED` or `TIMED_OUT`.
        error: Error message; None without an error.
        seconds: Duration in seconds.
        results: Results by name; empty without results.
    """

    task: int
    status: str
    error: str | None
    seconds: float
    results: dict[str, Any]


class Pace:
    """Chooses the number of tasks that take about one second.

    Args:
        workers: Number of workers.
    """

    def __init__(self, workers: int) -> None:
        self._workers, self._count, self._seconds = workers, 0, 0.0

    def note(self, outcome: TaskOutcome) -> None:
        """Record the duration of a finished task."""
        self._count, self._seconds = self._count + 1, self._seconds + outcome.seconds

    def take(self, waiting: deque[Task]) -> list[Task]:
        """Take a worker's next tasks; fewer towards the end, so that all workers end together."""
        fair = -(-len(waiting) // (2 * self._workers))
        second = int(self._count / max(self._seconds, 1e-9)) if self._count else 1
        return [waiting.popleft() for _ in range(max(1, min(fair, second, _MOST)))]


class Workers:
    """Processes that do tasks of one analysis.

    Args:
        analysis: Name of the analysis.
        count: Number of processes.
        time_out: Seconds after which a task is given up; None waits forever.
    """

    def __init__(self, analysis: str, count: int, time_out: float | None) -> None:
        self._analysis, self._time_out, self._count = analysis, time_out, count
        self._pool = [_Worker(analysis, silent=number > 0) for number in range(count)]
        self._stillborn = 0

    def outcomes(self, tasks: Sequence[Task]) -> Iterator[TaskOutcome]:
        """Do tasks, and yield the outcome of each as soon as it has ended.

        Raises:
            ChildProcessError: if no worker can be started.
        """
        waiting, tried, pace = deque(tasks), Counter(), Pace(self._count)
        while waiting or any(worker.tasks for worker in self._pool):
            for worker in self._pool:
                if worker.ready and not worker.tasks and waiting:
                    worker.send(pace.take(waiting))
            pipes = wait([worker.pipe for worker in self._pool], self._patience())
            show()
            for pipe in pipes:
                worker = next(each for each in self._pool if each.pipe is pipe)
                try:
                    outcome = worker.hear()
                except (EOFError, OSError):
                    outcome = self._lost(worker, waiting, tried)
                if outcome is not None:
                    self._stillborn = 0
                    pace.note(outcome)
                    yield outcome
            for worker in [each for each in self._pool if self._overdue(each)]:
                late, took = worker.tasks[0][0], time.monotonic() - worker.since
                self._replace(worker, waiting)
                said = f"given up after {self._time_out:g} s"
                yield TaskOutcome(late, TIMED_OUT, said, took, {})

    def close(self) -> None:
        """Kill all processes."""
        for worker in self._pool:
            worker.end()

    def _patience(self) -> float:
        """Return the seconds to the next time-out or the next report of progress."""
        since = [worker.since for worker in self._pool if worker.ready and worker.tasks]
        if self._time_out is None or not since:
            return _LOOK
        return max(0.0, min(_LOOK, min(since) + self._time_out - time.monotonic()))

    def _overdue(self, worker: _Worker) -> bool:
        if self._time_out is None or not (worker.ready and worker.tasks) or worker.pipe.poll():
            return False
        return time.monotonic() - worker.since >= self._time_out

    def _lost(self, worker: _Worker, waiting: deque[Task], tried: Counter) -> TaskOutcome | None:
        """Replace a process that ended; its task is tried once more, then fails."""
        worker.process.join()
        code, at = worker.process.exitcode, worker.tasks[0] if worker.tasks else None
        self._stillborn += not (worker.ready or worker.tasks)
        if self._stillborn >= STILLBORN:
            raise ChildProcessError(
                f"worker processes end before they start (exit code {code}): a script that sweeps "
                'does so below `if __name__ == "__main__":`'
            )
        took = time.monotonic() - worker.since
        self._replace(worker, waiting)
        if at is None:
            return None
        tried[at[0]] += 1
        if tried[at[0]] < TRIES:
            waiting.appendleft(at)
            return None
        return TaskOutcome(at[0], FAILED, f"its process ended with exit code {code}", took, {})

    def _replace(self, worker: _Worker, waiting: deque[Task]) -> None:
        """Replace a worker; tasks that it had not begun go back to the queue."""
        waiting.extendleft(reversed(list(worker.tasks)[1:]))
        worker.end()
        self._pool[self._pool.index(worker)] = _Worker(self._analysis)


class _Worker:
    """A worker process, its pipe, and its remaining tasks.

    If it is ready, the first task is running; otherwise the process starts or compiles.
    """

    def __init__(self, analysis: str, silent: bool = True) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, analysis, silent))
        self.process.start()
        theirs.close()  # so that the pipe reports the end of the process
        self.ready, self.since, self.tasks = False, time.monotonic(), deque[Task]()

    def send(self, tasks: list[Task]) -> None:
        """Send tasks to the process."""
        self.tasks.extend(tasks)
        self.since = time.monotonic()
        with suppress(OSError):  # the process has ended, which the next receive reports
            self.pipe.send(tasks)

    def hear(self) -> TaskOutcome | None:
        """Receive an outcome; None for a message on whether the process is ready."""
        said = self.pipe.recv()
        self.since = time.monotonic()
        if isinstance(said, bool):
            self.ready = said
            return None
        self.tasks.popleft()
        return said

    def end(self) -> None:
        """Kill the process, also during a task."""
        self.process.kill()
        self.process.join()
        self.pipe.close()


def _serve(pipe: Connection, analysis: str, silent: bool) -> None:
    """Do tasks in a worker process, until the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    disable_progress(notices=silent)  # all workers compile the same
    os.environ[THREADS] = "1"
    COMPILING.append(lambda begins: pipe.send(not begins))
    with suppress(EOFError, OSError):
        pipe.send(True)
        while True:
            for number, given in pipe.recv():
                pipe.send(_done(analysis, number, given))


def _done(analysis: str, number: int, given: dict[str, Any]) -> TaskOutcome:
    began = time.perf_counter()
    try:
        results, status, error = flat(task(analysis, given)()), DONE, None
    except (Exception, SystemExit) as raised:
        results, status, error = {}, FAILED, f"{type(raised).__name__}: {raised}"
    return TaskOutcome(number, status, error, time.perf_counter() - began, results)


def _leave_with_parent() -> None:
    """End this process when its parent is killed, so that no task runs without a reader."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
