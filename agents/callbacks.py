"""What happens while an algorithm learns: evaluations, progress, a wish to stop."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable
from types import FrameType

from stable_baselines3.common.callbacks import BaseCallback
from tqdm import tqdm

_EARLIEST = 1 / 64  # of an interval; no milestone comes sooner


class StopRequest:
    """Turns the first Ctrl-C (or a termination signal) into a wish; the second one interrupts."""

    def __init__(self) -> None:
        self.made = False
        self._former: dict[int, object] = {}

    def __enter__(self) -> StopRequest:
        # Only a program's main thread may listen to signals.
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
    """Calls a function every so many steps, and when training is to stop, between two updates.

    Agents learn fastest in the beginning: before the first whole interval there are milestones at
    a half of it, a quarter, and so on.

    Between updates nothing is half done: what is saved there can go on as if uninterrupted.

    Args:
        every: Steps from one milestone to the next.
        reach: Called at each; is told the seconds spent training since the last one.
        stop: Who may ask for an end.
        bar: Shows the steps made.
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
        if self.model.num_timesteps > 0:  # a resumed run stood at its milestone when it was saved
            self._reached = self.model.num_timesteps
        self._since = time.perf_counter()

    def _on_rollout_start(self) -> None:
        steps = self.model.num_timesteps
        due = self._reached is None or self._rank(steps) > self._rank(self._reached)
        self.stopped = self.stop.made
        if due or self.stopped:
            self.finish()

    def _rank(self, steps: int) -> int:
        """Which milestone has been passed."""
        if steps >= self.every:
            return steps // self.every
        return math.floor(math.log2(max(steps / self.every, _EARLIEST))) + 1

    def _on_step(self) -> bool:
        self.bar.update(self.model.num_timesteps - self.bar.n)
        # The step that was just made is forgotten: the milestone before it holds everything.
        return not self.stopped

    def finish(self) -> None:
        """Reach a milestone here, unless this is one."""
        if self._reached != self.model.num_timesteps:
            self._reached = self.model.num_timesteps
            self.reach(time.perf_counter() - self._since)
            self._since = time.perf_counter()
