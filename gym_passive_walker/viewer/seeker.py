"""Looks for the gait behind what is shown, while frames go on."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.control.maps import stride_map
from gym_passive_walker.envs.scene import SceneError
from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.gaits.fixed_point import find_gait
from gym_passive_walker.gaits.gait import GaitNotFound
from gym_passive_walker.policies import TrainedPolicy
from gym_passive_walker.units import units_of
from gym_passive_walker.viewer.walk import LiveWalk
from gym_passive_walker.walkers import Walker


class Question(NamedTuple):
    """Whose gait: of a walker on a slope under a torque in units of m g l, or under a policy."""

    walker: Walker
    slope: float
    torque: float
    policy: TrainedPolicy | None

    @classmethod
    def of(cls, walk: LiveWalk) -> Question:
        """What a walk asks for now."""
        torque = walk.torque if walk.policy is None else 0.0
        return cls(walk.walker, walk.slope, torque, walk.policy)


class Answer(NamedTuple):
    """The gait that was asked for.

    Attributes:
        question: Whose gait it is.
        state: Its section state in the walker's own units, (6,); None if there is none.
        multipliers: Its multipliers, largest modulus first; empty if there is none.
    """

    question: Question
    state: NDArray[np.float64] | None
    multipliers: NDArray[np.complex128]

    @property
    def stable(self) -> bool:
        """Whether small disturbances die out."""
        return self.state is not None and bool(abs(self.multipliers[0]) < 1.0)


def answer(question: Question) -> Answer:
    """Find the gait: of period one, its step the long one where nobody works the hip."""
    walker, slope, torque, policy = question
    controller = policy or Actuation(hip_torque=torque * units_of(walker).torque)
    try:
        gait = find_gait(stride_map(walker, slope, controller=controller))
        return Answer(question, gait.state, gait.multipliers)
    except (GaitNotFound, SceneError):
        return Answer(question, None, np.empty(0, complex))


class Seeker:
    """Answers one question at a time in a thread of its own; the newest one is next."""

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="gaits")
        self._search: Future[Answer] | None = None
        self._last: Answer | None = None

    def look(self, question: Question) -> Answer | None:
        """The last gait found; its own question tells whose it is. Never waits."""
        if self._search is not None and self._search.done():
            self._last, self._search = self._search.result(), None
        if self._search is None and (self._last is None or self._last.question != question):
            self._search = self._thread.submit(answer, question)
        return self._last

    def close(self) -> None:
        """Let the thread go."""
        self._thread.shutdown(wait=False, cancel_futures=True)
