"""A search for the periodic gait of the setup that is shown, while frames continue."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

from gym_passive_walker.envs.scene import SceneError
from gym_passive_walker.gaits.fixed_point import find_gait
from gym_passive_walker.gaits.gait import Gait, GaitNotFound
from gym_passive_walker.viewer.walk import Setup


class Found(NamedTuple):
    """The result of a search: the setup, and its periodic gait; None if it has none."""

    setup: Setup
    gait: Gait | None


def search(setup: Setup) -> Found:
    """Search for the gait of period one: of a passive walker that with the long step."""
    try:
        return Found(setup, find_gait(setup.stride_map()))
    except (GaitNotFound, SceneError):
        return Found(setup, None)


class GaitSearch:
    """Searches for one gait at a time, in a thread of its own; the newest setup is next."""

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="gaits")
        self._running: Future[Found] | None = None
        self._last: Found | None = None

    def look(self, setup: Setup) -> Found | None:
        """Return the last result, even of another setup, and search if it is. Never waits."""
        if self._running is not None and self._running.done():
            self._last, self._running = self._running.result(), None
        if self._running is None and (self._last is None or self._last.setup != setup):
            self._running = self._thread.submit(search, setup)
        return self._last

    def close(self) -> None:
        """Stop searching, without waiting for a search that is running."""
        self._thread.shutdown(wait=False, cancel_futures=True)
