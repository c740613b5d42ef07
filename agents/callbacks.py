"""Callbacks of a training: evaluations, progress and stop requests."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable
from types import FrameType

from stable_baselines3.common.callbacks import BaseCallback
from tqdm import tqdm

_EARLIEST = 1 / 64  # first milestone, as a share of the interval


class StopRequest:
    """Turns the first Ctrl-C or termination signal into a stop request; the second interrupts."""

    def __init__(self) -> None:
        self.made = False
        self._former: dict[int, object] = {}

    def __enter__(self) -> StopRequest:
        # Python permits signal handlers in the main thread only.
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._former[number] = signal.signal(number, self._wish)
        return self

    def __exit__(self, *error: object) -> None:
        for number, handler in self._former.items():
            signal.signal(number, handler)  # type: ignore[arg-type]

    def _wish(self, number: int, frame: FrameType | None) -> None:
        if self.made:
            raise KeyboardInterrupt
        self.made = True
        tqdm.write("Stopping after this update; once more to stop at once.")


class Milestones(BaseCallback):
    """Calls a function after every interval of steps, and at a stop request, between two updates.

    Agents learn fastest in the beginning, so there are further milestones at a half of the first
    interval, a quarter of it, and so on.

    Between two updates the state is complete: a training saved there resumes as if uninterrupted.

    Args:
        every: Steps from one milestone to the next.
        reach: Function called at each milestone, with the training seconds since the last one.
        stop: The stop request.
        bar: Progress bar of the steps.
    """

    def __init__(
        self, every: int, reach: Callable[[float], None], stop: StopRequest, bar: tqdm
    ) -> None:
        super().__init__()
        self.every, self.reach, self.stop, self.bar = every, reach, stop, bar
        self.stopped = False
        self._reached: int | None = None
        self._since = 0.0

    def _init_callback(self) -> None:
        if self.model.num_timesteps > 0:  # a resumed run was saved at a milestone
            self._reached = self.model.num_timesteps
        self._since = time.perf_counter()

    def _on_rollout_start(self) -> None:
        steps = self.model.num_timesteps
        due = self._reached is None or self._rank(steps) > self._rank(self._reached)
        self.stopped = self.stop.made
        if due or self.stopped:
            self.finish()

    def _rank(self, steps: int) -> int:
        """Index of the last milestone before a number of steps."""
        if steps >= self.every:
            return steps // self.every
        return math.floor(math.log2(max(steps / self.every, _EARLIEST))) + 1

    def _on_step(self) -> bool:
        self.bar.update(self.model.num_timesteps - self.bar.n)
        # After a stop, the last step is discarded: the milestone before it has saved everything.
        return not self.stopped

    def finish(self) -> None:
        """Call `reach` at the current step, unless it was called there already."""
        if self._reached != self.model.num_timesteps:
            self._reached = self.model.num_timesteps
            self.reach(time.perf_counter() - self._since)
            self._since = time.perf_counter()
