"""What walks in the viewer: one walker, carried on by the engine from frame to frame.

Everything may change between two frames, in the midst of a stride: angles and rates stay what they
are, and the motion goes on from there under the new equations, as exactly as before.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.arguments import one_slope
from gym_passive_walker.control.controlled import ControlledMap
from gym_passive_walker.control.maps import stride_map
from gym_passive_walker.envs.starts import checked_state, gait_near
from gym_passive_walker.gaits.flow import Walkers, go_on, new_records
from gym_passive_walker.physics import legs
from gym_passive_walker.physics.hybrid import Outcome, State
from gym_passive_walker.physics.systems import bodies, system_of
from gym_passive_walker.policies import TrainedPolicy
from gym_passive_walker.units import units_of
from gym_passive_walker.walkers import Walker

_TOLERANCE = 1e-10
_SAMPLE = 0.015  # sqrt(l/g) between two samples of the trail: no corner is seen
_TRAIL = 800  # samples: about four strides
_INSTANT = 1e-9  # sqrt(l/g): times closer than this are one


class Sample(NamedTuple):
    """What the walker passed through.

    Attributes:
        strides: Heelstrikes before it.
        phase: Index of the phase in the walker's system.
        state: Angles in rad and rates in sqrt(g/l), (6,).
    """

    strides: int
    phase: int
    state: NDArray[np.float64]


class LastStride(NamedTuple):
    """Measures of a stride in which nothing was changed, dimensionless."""

    step_length: float
    step_period: float
    speed: float
    cost_of_transport: float


class LiveWalk:
    """A walk that goes on while its walker, its ground and its motor change.

    Args:
        walker: Who walks.
        slope: Slope in rad, positive downhill.
        policy: A trained policy that works the motors.
        start: Section state to start from, in the walker's own units, (6,); None is the passive
            gait of this slope, or of the nearest one that has one.

    Attributes:
        walker: Who walks.
        slope: Slope in rad.
        torque: Hip torque held now, in units of m g l.
        policy: What works the motors; None holds the torque.
        outcome: How the walk has ended; RUNNING while it goes on.
        strides: Heelstrikes since it began.
        last: The last stride; None if something was changed in it.
        trail: What it has just passed through.

    Raises:
        ValueError: if the slope or the start is none.
        SceneError: if the walker has no gait to start with.
    """

    def __init__(
        self,
        walker: Walker,
        slope: float,
        *,
        policy: TrainedPolicy | None = None,
        start: ArrayLike | None = None,
    ) -> None:
        self.walker, self.slope, self.torque = walker, one_slope(slope), 0.0
        self.policy = policy
        self.begin(start)

    def begin(self, start: ArrayLike | None = None) -> None:
        """Begin anew at a section state, or at the passive gait.

        Raises:
            ValueError: if it is no section state.
            SceneError: if the walker has no gait to start with.
        """
        if start is None:
            state = np.array(gait_near(self.walker, self.slope))
        else:
            state = np.array(checked_state(np.asarray(start, dtype=float).tolist(), self.walker))
        self._know()
        self._records = new_records(state[None], self.slope)
        self.outcome, self.strides, self.last = Outcome.RUNNING, 0, None
        self.trail: deque[Sample] = deque(maxlen=_TRAIL)
        self._origin = self.walker.foot_radius * state[0]
        self._open_stride()
        self._sample()

    @property
    def state(self) -> NDArray[np.float64]:
        """[stance, thigh, shank] angles in rad and their rates, in the walker's own units, (6,)."""
        return self._units.to_own(self._record["state"])

    @property
    def contact(self) -> float:
        """Where the stance foot touches the ground, in the walker's own units."""
        return self._origin - self.walker.foot_radius * float(self._record["state"][0])

    @property
    def knee_locked(self) -> bool:
        """Whether the swing leg is straight."""
        return self._system.phases[self._record["phase"]].links == 2

    def advance(self, duration: float) -> None:
        """Let the walker go on for a time in its own units, or until it falls."""
        if self.outcome != Outcome.RUNNING:
            return
        left = duration / self._units.time
        works, controlled = np.array(self._system.works), self._controlled
        walkers = (
            Walkers(walker=self.walker, tolerance=_TOLERANCE)
            if controlled is None
            else controlled.walkers
        )
        while left > _INSTANT and self.outcome == Outcome.RUNNING:
            record = self._record
            before = float(record["time"])
            if controlled is None:
                record["control"][0] = self.torque
            elif before > self._decision - _INSTANT:
                self._decide(controlled, before)
            if before > self._sampling - _INSTANT:
                self._sample()
            record["end"] = min(before + left, self._decision, self._sampling)
            record["moved"] = record["turned"] = 0.0
            self._records = go_on(walkers, self._records, on_section=self._on_section).here
            record = self._record
            self._on_section = False
            self._work += float(np.abs(record["control"] * works) @ record["turned"])
            left -= float(record["time"]) - before
            if record["outcome"] == Outcome.HEELSTRIKE:
                self._end_stride()
            else:
                self.outcome = Outcome(int(record["outcome"]))
        self._sample()

    def push(self, downhill: float, up: float) -> None:
        """An impulse on the hip, its parts in units of m sqrt(g l)."""
        record, body = self._record, self._system.Body(*self._bodies[0, 0])
        push = self._system.phases[record["phase"]].push
        if push is None:
            return
        jumps = push(body, State(*record["state"]), -downhill, up)
        record["state"][3:] += np.array(jumps)[[0, 1, -1]]
        self._disturb()

    def change_slope(self, slope: float) -> None:
        """Turn the ground about the contact.

        Raises:
            ValueError: if it is no slope.
        """
        self.slope = one_slope(slope)
        self._record["ground"][:2] = math.sin(self.slope), math.cos(self.slope)
        self._know()
        self._disturb()

    def hold(self, torque: float) -> None:
        """Hold another torque at the hip, in units of m g l; the policy lets go of all motors."""
        self.hand_over(None)
        self.torque = torque

    def hand_over(self, policy: TrainedPolicy | None) -> None:
        """Let a policy work the motors from now on, or nothing."""
        self.policy, self.torque = policy, 0.0
        self._record["control"], self._record["push_off"] = 0.0, 0.0
        self._know()
        self._look_now()
        self._disturb()

    def begin_as(self, walker: Walker, slope: float) -> None:
        """Begin again as another walker, at its gait on a slope in rad.

        Raises:
            ValueError: if it is no slope; nothing has changed then.
            SceneError: if the walker has no gait to start with; nothing has changed then.
        """
        before = self.walker, self.slope
        self.walker, self.slope = walker, one_slope(slope)
        try:
            self.begin()
        except ValueError:
            self.walker, self.slope = before
            raise

    def change_walker(self, walker: Walker) -> None:
        """Walk on as another walker with the same angles and rates.

        One with knees cannot go on as one without, nor the other way round: it begins anew.

        Raises:
            SceneError: if it must begin anew, and has no gait to start with; nothing has changed.
        """
        before = self.walker
        if walker.knees != before.knees:
            self.begin_as(walker, self.slope)
            return
        own, contact, old = self.state, self.contact, self._units
        self.walker = walker
        self._know()
        record = self._record
        record["state"] = self._units.to_dimensionless(own)
        for name in ("time", "step", "knee_time"):
            record[name] *= old.time / self._units.time
        self._origin = contact + walker.foot_radius * own[0]
        self._look_now()
        self._disturb()

    def _know(self) -> None:
        """What the engine needs to know of the walker."""
        self._system, self._units = system_of(self.walker), units_of(self.walker)
        self._bodies, self._controlled = bodies(self.walker), None
        if self.policy is not None:
            self._controlled = cast(
                ControlledMap,
                stride_map(self.walker, self.slope, controller=self.policy, tolerance=_TOLERANCE),
            )

    @property
    def _record(self) -> np.void:
        return self._records[0, 0]

    def _open_stride(self) -> None:
        """A stride begins: clocks and books start at zero."""
        record = self._record
        record["time"] = record["knee_time"] = record["knee_loss"] = record["heel_loss"] = 0.0
        self._on_section, self._undisturbed, self._work = True, True, 0.0
        self._memory, self._steps = None, 0
        self._look_now()

    def _end_stride(self) -> None:
        """A heelstrike: the other leg stands now, as far ahead as the hip was from both feet."""
        record, leg = self._record, self.walker.leg_length
        body = self._system.Body(*self._bodies[0, 0])
        self._origin -= 2.0 * leg * float(legs.progress(body, record["state"][0]))
        self.strides += 1
        length, period = float(record["step_length"]), float(record["time"])
        self.last = None
        if self._undisturbed:
            work = self._work + float(record["push_work"])
            cost = (float(record["gravity_work"]) + work) / length
            self.last = LastStride(length, period, length / period, cost)
        self._open_stride()

    def _look_now(self) -> None:
        """The trail's next sample is due, and the policy's next decision if there is a policy."""
        self._sampling, self._decision = 0.0, math.inf if self.policy is None else 0.0

    def _disturb(self) -> None:
        """Something was changed: this stride is no measure of the walker."""
        self._undisturbed = False

    def _decide(self, controlled: ControlledMap, time: float) -> None:
        """Ask the policy what its motors do in the next control step, as the environment would."""
        held, self._memory = controlled.act(
            self._records, np.array([self.slope]), self._memory, self._steps
        )
        controlled.command(self._records, held)
        self._steps += 1
        self.torque = float(self._record["control"][0])
        self._decision = time + controlled.hold

    def _sample(self) -> None:
        record = self._record
        self.trail.append(Sample(self.strides, int(record["phase"]), record["state"].copy()))
        self._sampling = float(record["time"]) + _SAMPLE
