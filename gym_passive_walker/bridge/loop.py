"""The loop that MuJoCo needs to walk: latches, contact filters, and steps that end on impacts.

MuJoCo has soft contacts and no impacts. A stride of a passive walker is reproduced if

- the swing foot meets the ground only where it leads and comes down, as straight legs scuff;
- the trailing knee is free before the heelstrike, and the swing knee is latched from its stop on;
- the step before an impact ends on it, and the impact takes one implicit step: a foot that is
  found below the ground is pushed out, which is a bounce at any timestep;
- what is observed at a heelstrike is the state after it.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.extras import extra
from gym_passive_walker.bridge.mjcf import SOFTNESS, mjcf
from gym_passive_walker.bridge.rigid import coordinates, tree_of_walker
from gym_passive_walker.models.equations.bodies import StraightBody, body_from
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.equations.legs import NARROWEST
from gym_passive_walker.models.walkers import Walker

_OVERSHOOT = 1e-3  # share of a timestep's way by which a foot lands below the ground, to touch it
_LEAST = 1e-6  # shortest step, in timesteps


def library() -> Any:
    """Return MuJoCo.

    Raises:
        ImportError: if it is not installed, or MUJOCO_GL names a library that is not.
    """
    try:
        with extra("mujoco"):
            return import_module("mujoco")
    except AttributeError as error:  # of PyOpenGL, which found no such library
        raise ImportError(
            f"MuJoCo cannot load the OpenGL of MUJOCO_GL={os.environ.get('MUJOCO_GL', '')}: "
            f"install its library, or choose another one ({error})"
        ) from None


class Loop:
    """A walker in MuJoCo, in SI units.

    Args:
        walker: The walker.
        timestep: Largest step in s.
        softness: Time constant of contacts and latches in timesteps; None is MuJoCo's own.
        friction: Coefficient of friction of foot and ground.
        scuff: Whether a locked swing leg below the ground ends a walk.

    Attributes:
        model: MuJoCo's model.
        data: MuJoCo's data.
        stance: Number of the stance leg: 0 left, 1 right.
        locked: Whether the swing knee is locked.
        time: Time of the stride in s.
        ended: Duration of the stride that a heelstrike has ended, and time of its kneestrike, in s.
        kneestrike_time: Time of the kneestrike in the stride in s; 0 before it.
        moved: Change of the hip's angle in rad since `advance` began.
        turned: Length of the way of that angle in rad.
        lost: Energy in J that friction of the hip has taken since then.
    """

    def __init__(
        self,
        walker: Walker,
        timestep: float,
        *,
        softness: float | None = SOFTNESS,
        friction: float = 0.8,
        scuff: bool = False,
    ) -> None:
        mujoco = library()
        self.walker, self.timestep, self.scuff = walker, timestep, scuff
        tree = tree_of_walker(walker)
        text = mjcf(tree, 0.0, timestep, softness=softness, friction=friction)
        self.model = mujoco.MjModel.from_xml_string(self.changed(text))
        self.data = mujoco.MjData(self.model)
        self.model.geom_sameframe[self.model.geom("ground").id] = 0  # else its tilt is not read
        self._mujoco = mujoco
        self._kneed = bool(walker.knees)
        self._leg = body_from(walker, StraightBody).leg * walker.leg_length
        self._feet = [self.model.geom(name).id for name in tree.feet]
        self._radius = [float(self.model.geom_size[foot, 0]) for foot in self._feet]
        self._integrators = mujoco.mjtIntegrator.mjINT_RK4, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self._rates: NDArray[np.float64] | None = None  # after an impact that is still to come
        self.ended = 0.0, 0.0
        self.reset(np.zeros(6), 0.0)

    def changed(self, text: str) -> str:
        """Return the MJCF of the model; it stays as it is."""
        return text

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_mujoco": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state | {"_mujoco": library()})

    def reset(
        self, state: Sequence[float] | NDArray, slope: float, *, stance: int = 0, place: float = 0.0
    ) -> None:
        """Begin a stride.

        Args:
            state: State just after a heelstrike, angles in rad and rates in rad/s, (6,).
            slope: Slope in rad, positive downhill.
            stance: Number of the stance leg.
            place: Contact point along the ground in m.
        """
        self.slope, self._sine, self._cosine = slope, math.sin(slope), math.cos(slope)
        self.model.geom("ground").quat[:] = math.cos(0.5 * slope), 0.0, math.sin(0.5 * slope), 0.0
        self._mujoco.mj_resetData(self.model, self.data)
        given = tuple(map(float, state))
        positions, velocities = coordinates(self.walker, slope, given, stance=stance, place=place)
        self.data.qpos[:], self.data.qvel[:] = positions, velocities
        self._rates = None
        self._begin_stride(stance)
        if self._kneed:
            self._latch(stance, True)

    def _begin_stride(self, stance: int) -> None:
        """Exchange the legs."""
        self.stance, self.time, self.kneestrike_time = stance, 0.0, 0.0
        self.locked, self._clear = not self._kneed, False
        self.filter_contacts()

    def filter_contacts(self) -> None:
        """Let the stance foot touch the ground, and the swing foot pass through it."""
        for leg, foot in enumerate(self._feet):
            self.model.geom_conaffinity[foot] = int(leg == self.stance)

    def release_before_impact(self) -> None:
        """Free the knee of the leg that leaves the ground, unless it is held in the impact."""
        if self.walker.knees is True:
            self._latch(1 - self.stance, False)

    def _latch(self, leg: int, on: bool) -> None:
        self.data.eq_active[leg] = on

    def _angles(self, numbers: list[float], offset: float) -> tuple[float, ...]:
        """Stance leg, thigh and shank from coordinates of the hinges."""
        if self._kneed:
            _, _, pitch, left_knee, hip, right_knee = numbers
        else:
            (_, _, pitch, hip), left_knee, right_knee = numbers, 0.0, 0.0
        left = pitch + offset
        right = left + hip
        if self.stance == 0:
            return left, right, right + right_knee
        return right, left, left + left_knee

    @property
    def state(self) -> NDArray[np.float64]:
        """Angles in rad and rates in rad/s, (6,); just after an impact, those after it."""
        rates = self.data.qvel if self._rates is None else self._rates
        angles = self._angles(self.data.qpos.tolist(), self.slope)
        return np.array([*angles, *self._angles(rates.tolist(), 0.0)])

    @property
    def hip(self) -> float:
        """Position of the hip along the ground in m."""
        x, z = self.data.qpos[:2].tolist()
        return x * self._cosine - z * self._sine

    @property
    def depth(self) -> float:
        """Depth of the stance foot below the ground in m; negative above it."""
        return -self._height(self.stance, self.state[0])

    @property
    def centre_height(self) -> float:
        """Height of the centre of mass in m."""
        self._mujoco.mj_kinematics(self.model, self.data)
        self._mujoco.mj_comPos(self.model, self.data)
        return float(self.data.subtree_com[1, 2])

    def foot_along(self, leg: int) -> float:
        """Position of the centre of a straight leg's foot along the ground in m."""
        angle = self.state[0 if leg == self.stance else 1]
        return self.hip + self._leg * math.sin(angle)

    def get_state(self) -> NDArray[np.float64]:
        """Return the numbers that determine what follows."""
        data = self.data
        rates = data.qvel if self._rates is None else self._rates
        kept = self.stance, self.locked, self._clear, self._rates is not None, self.slope
        kept += self.time, self.kneestrike_time, *self.ended, data.time
        arrays = data.qpos, data.qvel, rates, data.qacc_warmstart, data.eq_active
        return np.concatenate([kept, *arrays], dtype=float)

    def set_state(self, numbers: NDArray[np.float64]) -> None:
        """Restore the numbers of `get_state`."""
        data, n = self.data, self.model.nv
        stance, locked, clear, striking, slope = numbers[:5].tolist()
        self.reset(np.zeros(6), slope, stance=int(stance))
        self.time, self.kneestrike_time, *ended, data.time = numbers[5:10].tolist()
        self.ended = ended[0], ended[1]
        parts = np.split(numbers[10:], np.cumsum([n, n, n, n]))
        data.qpos[:], data.qvel[:], rates, data.qacc_warmstart[:], data.eq_active[:] = parts
        self.locked, self._clear = bool(locked), bool(clear)
        self._rates = rates if striking else None

    def _height(self, leg: int, angle: float) -> float:
        """Height of the foot of a straight leg over the ground."""
        x, z = self.data.qpos[:2].tolist()
        hip = x * self._sine + z * self._cosine
        return hip - self._leg * math.cos(angle) - self._radius[leg]

    def advance(self, torque: float, end: float) -> Outcome:
        """Hold a hip torque until a time of the stride, or until the stride ends.

        Args:
            torque: In N m, positive when it opens the legs.
            end: Time of the stride in s.

        Returns:
            RUNNING, HEELSTRIKE, or the outcome of a fall.
        """
        data = self.data
        self.moved = self.turned = self.lost = 0.0
        data.ctrl[0] = torque if self.stance == 0 else -torque
        if self._rates is not None:  # the impact itself
            self._rates = None
            self._impact()
            if self.walker.knees == "held":
                self._latch(1 - self.stance, False)
        if self._kneed and not self.locked:
            outcome = self._swing_freely(end)
            if outcome or not self.locked:
                return outcome
        return self._swing_locked(end)

    def _swing_freely(self, end: float) -> Outcome:
        """Advance with a free swing knee, to its kneestrike or to the end."""
        data, offset, knee = self.data, self.slope, 5 if self.stance == 0 else 3
        while (step := self._left(end)) > 0.0:
            angle, rate = data.qpos[knee].item(), data.qvel[knee].item()
            strikes = rate > 0.0 and angle + rate * step >= 0.0
            self._take(max(-angle / rate, _LEAST * self.timestep) if strikes else step)
            angles = self._angles(data.qpos.tolist(), offset)
            if fall := _fall(angles):
                return fall
            if strikes:
                return self._lock(angles)
        return Outcome.RUNNING

    def _lock(self, angles: tuple[float, ...]) -> Outcome:
        """Latch the swing knee, and let its impact pass."""
        stance, thigh, _ = angles
        self.locked, self.kneestrike_time = True, self.time
        self._latch(1 - self.stance, True)
        height, rate = self._swing_foot(angles)
        if self.scuff and height < 0.0:
            return Outcome.STUBBED_TOE
        if stance < 0.0 and thigh > stance and height <= 0.0 and rate <= 0.0:
            return Outcome.KNEE_NOT_LOCKED
        self._impact()
        return Outcome.RUNNING

    def _swing_locked(self, end: float) -> Outcome:
        """Advance with a straight swing leg, to its heelstrike or to the end."""
        data, offset, clear = self.data, self.slope, self._clear
        while (step := self._left(end)) > 0.0:
            angles = self._angles(data.qpos.tolist(), offset)
            if fall := _fall(angles):
                return fall
            stance, thigh, _ = angles
            height, rate = self._swing_foot(angles)
            if stance < 0.0 and thigh - stance > NARROWEST:
                clear = clear or height > 0.0
                below = min(rate, 0.0) * _OVERSHOOT * self.timestep
                if height <= 0.5 * below and clear:
                    return self._strike()
                if clear and height + rate * step < below:
                    step = min(step, max((below - height) / rate, _LEAST * self.timestep))
            else:
                clear = False
                if self.scuff and height < 0.0:
                    return Outcome.STUBBED_TOE
            self._clear = clear
            self._take(step)
        return Outcome.RUNNING

    def _swing_foot(self, angles: tuple[float, ...]) -> tuple[float, float]:
        """Height of a straight swing leg's foot over the ground, and its rate."""
        rates, height = self.data.qvel.tolist(), self._height(1 - self.stance, angles[1])
        up = rates[0] * self._sine + rates[1] * self._cosine
        turning = self._angles(rates, 0.0)[1]
        return height, up + self._leg * math.sin(angles[1]) * turning

    def _left(self, end: float) -> float:
        """The next step: no longer than the timestep; 0 at the end."""
        left = end - self.time
        return 0.0 if left < _LEAST * self.timestep else min(left, self.timestep)

    def _take(self, step: float) -> None:
        """Step MuJoCo, and add the way of the hip's angle."""
        hip, data = 4 if self._kneed else 3, self.data
        before = data.qpos[hip].item()
        self.model.opt.timestep = step
        self._mujoco.mj_step(self.model, data)
        self.time += step
        moved = data.qpos[hip].item() - before
        self.turned += abs(moved)
        self.moved += moved if self.stance == 0 else -moved
        self.lost += self.walker.hip_friction * moved * moved / step

    def _impact(self) -> None:
        """Let an impact pass, in an implicit step."""
        explicit, implicit = self._integrators
        self.model.opt.integrator = implicit
        self._take(self.timestep)
        self.model.opt.integrator = explicit

    def _strike(self) -> Outcome:
        """Exchange the legs at a heelstrike, and look what the rates will be after it."""
        self.ended = self.time, self.kneestrike_time
        self._begin_stride(1 - self.stance)
        self.release_before_impact()
        self._rates = self._rates_after_impact()
        return Outcome.HEELSTRIKE

    def _rates_after_impact(self) -> NDArray[np.float64]:
        """Rates just after an impact: those after a step and after two, extrapolated."""
        data, model = self.data, self.model
        explicit, implicit = self._integrators
        before = data.qpos.copy(), data.qvel.copy(), data.qacc_warmstart.copy(), data.time
        data.ctrl[0] = 0.0
        model.opt.integrator, model.opt.timestep = implicit, self.timestep
        self._mujoco.mj_step(model, data)
        once = data.qvel.copy()
        self._mujoco.mj_step(model, data)
        rates = 2.0 * once - data.qvel
        model.opt.integrator = explicit
        data.qpos[:], data.qvel[:], data.qacc_warmstart[:], data.time = before
        return rates


def _fall(angles: tuple[float, ...]) -> Outcome:
    """The outcome of a walker that has fallen, else RUNNING."""
    stance, thigh, shank = angles
    if abs(stance) >= 0.5 * math.pi:
        return Outcome.FELL_FORWARD if stance < 0.0 else Outcome.FELL_BACKWARD
    if max(abs(thigh), abs(shank)) >= math.pi:
        return Outcome.SWING_OVERROTATION
    return Outcome.RUNNING
