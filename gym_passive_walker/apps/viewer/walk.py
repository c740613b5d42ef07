"""A walk that is followed from frame to frame, and that can be changed within a stride.

A change takes effect at once: angles and angular velocities stay, and the motion continues under
the new equations, as exactly as before.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.engine.layout import layout_of
from gym_passive_walker.envs.policies import TrainedPolicy
from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.gaits.control.controlled import ControlledMap
from gym_passive_walker.gaits.control.maps import stride_map
from gym_passive_walker.gaits.find.fixed_point import find_gait
from gym_passive_walker.gaits.flow import go_on, new_records, put_states, states_in
from gym_passive_walker.gaits.gait import Gait, GaitNotFound
from gym_passive_walker.gaits.scenes.scene import SceneError
from gym_passive_walker.gaits.scenes.starts import REFERENCE_SLOPES, checked_state, gait_near
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.models.equations.hybrid import Outcome, Stage
from gym_passive_walker.models.walkers import Mechanism, Walker

_SAMPLE = 0.015  # sqrt(l/g) between two samples of the trail: its curve has no visible corners
_TRAIL = 800  # samples: about four strides
_INSTANT = 1e-9  # sqrt(l/g): times closer than this are equal


class Setup(NamedTuple):
    """A walker, its slope and its controller.

    Attributes:
        walker: The walker.
        slope: Slope in rad, positive downhill.
        controller: A trained policy, or a constant torque in units of m g l: of the hip, or of the
            first control of a `System`.
    """

    walker: Walker
    slope: float
    controller: TrainedPolicy | float = 0.0

    def stride_map(self) -> StrideMap:
        """The stride map of the walker under the controller.

        Raises:
            ValueError: if the slope is out of range, or the controller does not fit the walker.
        """
        acts: Any = self.controller
        if isinstance(acts, float) and isinstance(self.walker, Mechanism):
            acts = {name: acts * self.walker.total_mass for name in self.walker.controls[:1]}
        elif isinstance(acts, float):
            acts = Actuation(hip_torque=acts * self.walker.units.torque)
        return stride_map(self.walker, self.slope, controller=acts)

    def gait(self) -> Gait | None:
        """Search for the periodic gait of period one (the long-step one); None if there is none."""
        try:
            return find_gait(self.stride_map())
        except (GaitNotFound, SceneError):
            return None


def gentle_slope(walker: Walker, *wanted: float) -> float:
    """A slope in rad with a stable gait, if one is found: one of those wanted, or a gentle one."""
    slopes = (*wanted, *REFERENCE_SLOPES)
    gaits = ((slope, Setup(walker, slope).gait()) for slope in slopes)
    return next((slope for slope, gait in gaits if gait and gait.stable), REFERENCE_SLOPES[0])


def _kind(walker: Walker) -> Any:
    """Return a walker's kind; a walk that changes it begins again."""
    return walker.hybrid.name if isinstance(walker, Mechanism) else walker.knees


class Sample(NamedTuple):
    """A point of a walk: heelstrikes before it, is the shank free, dimensionless state (6,).

    The state of a `System` is (2 m,).
    """

    strides: int
    free: bool
    state: NDArray[np.float64]


class LastStride(NamedTuple):
    """Dimensionless measures of a stride without changes."""

    step_length: float
    step_period: float
    cost_of_transport: float


class LiveWalk:
    """A walk that continues while its setup changes.

    Args:
        setup: The setup that it begins with.
        start: State on the Poincaré section in the walker's own units, (6,); None is the passive
            gait of the slope, or of the nearest slope that has one.

    Attributes:
        setup: The setup now.
        map: The stride map of the setup.
        outcome: `Outcome` of the walk; RUNNING while it continues.
        strides: Heelstrikes since it began.
        last: The last stride; None if something changed during it.
        trail: The latest samples.

    Raises:
        ValueError: if the setup or the start is invalid, or there is no gait to start from.
    """

    def __init__(self, setup: Setup, start: ArrayLike | None = None) -> None:
        self.begin(setup, start)

    def begin(self, setup: Setup, start: ArrayLike | None = None) -> None:
        """Begin again with a setup; an error, as in the class, leaves the walk as it is."""
        walker, strides = setup.walker, setup.stride_map()
        if start is None:
            state = gait_near(walker, setup.slope)
        else:
            state = checked_state(np.asarray(start, dtype=float).tolist(), walker)
        self.setup, self.map = setup, strides
        self._records = new_records(
            np.array([state]), setup.slope, layout=layout_of(strides.system)
        )
        self.outcome, self.strides, self.last = Outcome.RUNNING, 0, None
        self.trail: deque[Sample] = deque(maxlen=_TRAIL)
        self._origin = walker.foot_radius * state[0]
        self._begin_stride()
        self._sample()

    @property
    def state(self) -> NDArray[np.float64]:
        """[stance, thigh, shank] angles in rad, then their angular velocities, own units, (6,).

        Of a `System` its coordinates, then their rates, (2 m,).
        """
        return self.map.units.to_own(self._dimensionless)

    @property
    def _dimensionless(self) -> NDArray[np.float64]:
        return states_in(self._record, self.map.system.coordinates)

    @property
    def _weight(self) -> float:
        """The unit of dimensionless torques and energies: 1, or the weight of a `System`."""
        walker = self.setup.walker
        return walker.total_mass if isinstance(walker, Mechanism) else 1.0

    @property
    def contact(self) -> float:
        """Position of the contact point along the slope, in the walker's own units."""
        return self._origin - self.setup.walker.foot_radius * float(self._record["state"][0])

    @property
    def torque(self) -> float:
        """Torque of the hip, or of the first control of a `System`, in units of m g l."""
        controller = self.setup.controller
        if isinstance(controller, float):
            return controller
        return float(self._record["control"][0]) / self._weight

    def advance(self, duration: float) -> None:
        """Continue for a time in the walker's own units, or until the walker falls."""
        if self.outcome != Outcome.RUNNING:
            return
        left, works = duration / self.map.units.time, np.array(self.map.system.works)
        while left > _INSTANT and self.outcome == Outcome.RUNNING:
            record = self._record
            before = float(record["time"])
            if before > self._decision - _INSTANT:
                self._decide()
            if before > self._sampling - _INSTANT:
                self._sample()
            record["end"] = min(before + left, self._decision, self._sampling)
            record["moved"] = record["turned"] = 0.0
            self._records = go_on(self.map.walkers, self._records, on_section=self._on_section).here
            self._on_section, record = False, self._record
            held = record["control"][: len(works)] * works
            self._work += float(np.abs(held) @ record["turned"][: len(works)])
            left -= float(record["time"]) - before
            if record["outcome"] == Outcome.HEELSTRIKE:
                self._end_stride()
            else:
                self.outcome = Outcome(int(record["outcome"]))
        self._sample()

    def push(self, downhill: float, up: float) -> None:
        """Apply an impulse to the hip; its components are in units of m sqrt(g l).

        It acts at the centre of mass of a `System`.
        """
        system, state = self.map.system, self._dimensionless.copy()
        push = system.phases[self._record["phase"]].push
        if push is not None:
            body = system.Body(*self.map.walkers.constants[0, 0])
            jumps = list(push(body, system.State(*state), -downhill, up))
            jumps += jumps[-1:] * (system.coordinates - len(jumps))  # one body: thigh and shank
            state[system.coordinates :] += jumps
            put_states(self._record, state)
            self._undisturbed = False

    def change(self, setup: Setup) -> None:
        """Continue with another setup from the same angles, angular velocities and contact point.

        A walker with knees cannot continue as one without knees, or the reverse, nor a `System` as
        another one: it begins again.

        Raises:
            ValueError: as the class does; the walk is then as it was.
        """
        if _kind(setup.walker) != _kind(self.setup.walker):
            self.begin(setup)
            return
        strides, before = setup.stride_map(), self.setup
        record, state, contact = self._record, self.state, self.contact
        slower = self.map.units.time / strides.units.time
        self.setup, self.map = setup, strides
        put_states(record, strides.units.to_dimensionless(state))
        record["ground"][:2] = math.sin(setup.slope), math.cos(setup.slope)
        for name in ("time", "step", "knee_time"):
            record[name] *= slower
        self._sampling, self._decision = self._sampling * slower, self._decision * slower
        self._origin = contact + setup.walker.foot_radius * state[0]
        if setup.controller != before.controller:
            record["control"], record["push_off"] = 0.0, 0.0
            self._wait_for_decision()
        self._undisturbed = False

    @property
    def _record(self) -> Any:
        return self._records[0, 0]

    def _begin_stride(self) -> None:
        """Reset the clocks and the energy account."""
        record = self._record
        record["time"] = record["knee_time"] = record["knee_loss"] = record["heel_loss"] = 0.0
        self._on_section, self._undisturbed, self._work, self._sampling = True, True, 0.0, 0.0
        self._wait_for_decision()

    def _end_stride(self) -> None:
        """Measure the stride, and stand on the other leg: the hip stays where it is."""
        record, system = self._record, self.map.system
        body = system.Body(*self.map.walkers.constants[0, 0])
        ahead = float(system.place(body, system.State(*self._dimensionless)))
        self._origin += self.setup.walker.leg_length * (float(record["passed"]) - ahead)
        self.strides, self.last = self.strides + 1, None
        if self._undisturbed:
            length, period = float(record["step_length"]), float(record["time"])
            energy = self._work + float(record["push_work"]) + float(record["gravity_work"])
            self.last = LastStride(length, period, energy / (self._weight * length))
        self._begin_stride()

    def _wait_for_decision(self) -> None:
        """Request an action before the walk continues, without memory of earlier actions."""
        self._decision, self._memory, self._steps = 0.0, None, 0

    def _decide(self) -> None:
        """Apply the controller's actions of the next control step."""
        strides = self.map
        if isinstance(strides, ControlledMap):
            slopes = np.array([self.setup.slope])
            self._memory = strides.act(self._records, slopes, self._memory, self._steps)
        else:
            self._record["control"][0] = strides.actuation.hip_torque
        self._steps += 1
        self._decision = float(self._record["time"]) + strides.hold

    def _sample(self) -> None:
        record = self._record
        free = self.map.system.phases[record["phase"]].stage == Stage.FREE
        self.trail.append(Sample(self.strides, free, self._dimensionless.copy()))
        self._sampling = float(record["time"]) + _SAMPLE
