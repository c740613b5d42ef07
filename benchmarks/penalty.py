"""Benefit of exact events: the straight-legged walker on a penalty contact, in MuJoCo.

The walker is that of the "straight" problem, in the engine's units (leg length, total mass,
sqrt(l/g)). A general engine does not locate impacts: a landing is detected at a time step, and a
collision is a stiff spring and damper that acts over some steps.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from benchmarks.engine import again, new_batch
from benchmarks.problem import WALKS, Problem, problem
from benchmarks.report import seconds, table
from gym_passive_walker import WALKERS, Gait, find_gait, stride, stride_jacobian
from gym_passive_walker.gaits.gait import multipliers_of

TRIED = {"implicitfast": (1e-2, 3e-3, 1e-3, 3e-4, 1e-4), "RK4": (1e-2, 1e-3)}
TOLERANCE = 1e-8
STRIDES, SETTLED = 40, 20  # the largest multiplier is 0.3: a transient decays in twenty strides
SPREAD, SAMPLES = 0.01, 60  # with a larger spread, the fit would be affected by nonlinearity

# Columns of a walker's recorded data at an instant.
STANCE, SWING, STANCE_RATE, SWING_RATE, CLEARANCE, TIME = range(6)


class Contact:
    """The walker in MuJoCo, by x and z of the hip, first leg's angle and angle between the legs."""

    def __init__(self, p: Problem, time_step: float, integrator: str) -> None:
        """Build the model; the time step is in units of sqrt(l/g)."""
        import mujoco

        # A leg hangs from the hip at the origin; "across" is backwards, and x points forward.
        body, self.step = p.body, mujoco.mj_step
        self._radius, self._leg = body.foot_radius, body.leg
        across, along = body.leg_com_across, body.leg_com_along - body.leg
        spin = f"{body.leg_spin} " * 3
        leg = f"""
          <joint axis="0 -1 0"/>
          <inertial pos="{-across} 0 {along}" mass="{body.leg_mass}" diaginertia="{spin}"/>
          <geom type="sphere" size="{self._radius}" pos="0 0 {-self._leg}" conaffinity="0"/>"""
        hip = max(0.0, 1.0 - 2.0 * body.leg_mass)
        # A time constant of two steps is the stiffest contact that MuJoCo permits. Softer or more
        # damped contacts were tried, and changed no error beyond its scatter.
        self.model = mujoco.MjModel.from_xml_string(f"""
          <mujoco>
            <option timestep="{time_step}" integrator="{integrator}" cone="elliptic" impratio="10"
              tolerance="1e-12" gravity="{math.sin(p.slope)} 0 {-math.cos(p.slope)}"/>
            <default><geom friction="5 0 0" solref="{2.0 * time_step} 1"/></default>
            <worldbody>
              <geom type="plane" size="1 1 1" contype="0"/>
              <body>
                <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>{leg}
                <body>{leg}</body>
                <body><inertial pos="0 0 0" mass="{hip}" diaginertia="0 0 0"/></body>
              </body>
            </worldbody>
          </mujoco>""")
        self.data = mujoco.MjData(self.model)

    def place(self, state: NDArray) -> None:
        """Set the state, (4,): stance and swing angle, then angular velocities.

        The walker rolls on its first leg.
        """
        angle, swing, rate, swing_rate = state
        sine, cosine = self._leg * math.sin(angle), self._leg * math.cos(angle)
        self.data.time = 0.0
        self.data.qpos[:] = 0.0, self._radius + cosine, angle, swing - angle
        self.data.qvel[:] = -(self._radius + cosine) * rate, -sine * rate, rate, swing_rate - rate
        self.data.qacc_warmstart[:] = 0.0
        self._lean_on(0)

    def walk(self, state: NDArray, strides: int) -> tuple[NDArray, NDArray]:
        """Simulate from a state to the mid-stance after `strides` heelstrikes, or to a fall.

        Returns:
            Data just before each heelstrike, and at each mid-stance, where the stance leg passes
            the normal of the ground; both of shape (n, 6).
        """
        self.place(state)
        strikes: list[NDArray] = []
        middles: list[NDArray] = []
        stance, landing, old = 0, False, self._seen(0)
        while len(strikes) < strides or not middles or middles[-1][TIME] < strikes[-1][TIME]:
            self.step(self.model, self.data)
            new = self._seen(stance)
            # A stride takes three time units; more than ten per stride is a failure.
            if not (abs(new[STANCE]) < 1.0 and new[TIME] < 10.0 * (strides + 1)):
                break
            if old[STANCE] > 0.0 >= new[STANCE]:
                middles.append(_between(old, new, STANCE))
            # Straight legs scuff in mid-swing: contact of the swing foot is enabled only once the
            # foot is above the ground in front. At its landing, contact of the trailing foot is
            # disabled, so that it gives no impulse.
            ahead = new[STANCE] < 0.0 and new[SWING] > new[STANCE]
            if not landing and ahead and new[CLEARANCE] > 0.0:
                landing = True
                self.model.geom_contype[1:] = 1
            elif landing and new[CLEARANCE] <= 0.0:
                strikes.append(_between(old, new, CLEARANCE))
                stance, landing = 1 - stance, False
                self._lean_on(stance)
                new = self._seen(stance)
            old = new
        return np.reshape(strikes, (-1, 6)), np.reshape(middles, (-1, 6))

    def _lean_on(self, stance: int) -> None:
        """Enable ground contact of this leg's foot only."""
        self.model.geom_contype[1:] = stance == 0, stance == 1

    def _seen(self, stance: int) -> NDArray:
        _, height, angle, between = self.data.qpos
        rate, rate_between = self.data.qvel[2:]
        legs = (angle, rate), (angle + between, rate + rate_between)
        (a, u), (b, v) = legs[stance], legs[1 - stance]
        clearance = height - self._leg * math.cos(b) - self._radius
        return np.array([a, b, u, v, clearance, self.data.time])


def _between(old: NDArray, new: NDArray, column: int) -> NDArray:
    """Data at the instant at which a column crosses zero, interpolated within a time step."""
    return old + old[column] / (old[column] - new[column]) * (new - old)


def _multipliers(contact: Contact, middle: NDArray) -> NDArray:
    """Floquet multipliers of the map from mid-stance to mid-stance.

    The position of a landing within its time step scatters single strides. So the derivative is a
    linear fit through many strides, from initial states around the fixed point.
    """
    random = np.random.default_rng(1)
    moves = SPREAD * random.uniform(-1.0, 1.0, (SAMPLES // 2, 3))
    moves = np.concatenate([moves, -moves])
    ends = []
    for move in moves:
        _, middles = contact.walk(np.array([0.0, *(middle + move)]), 1)
        if not len(middles):
            return np.array([math.nan])
        ends.append(middles[0][SWING : SWING_RATE + 1])
    design = np.column_stack([np.ones(len(moves)), moves])
    derivative = np.linalg.lstsq(design, np.array(ends), rcond=None)[0][1:].T
    return multipliers_of(derivative)


def _result(
    gait: Gait, periods: NDArray, angles: NDArray, multipliers: NDArray, took: float
) -> list[float]:
    """Columns of the table: errors of settled strides relative to the gait, and microseconds."""
    period, angle = periods[-SETTLED:] / gait.step_period, angles[-SETTLED:] / gait.stance_angle
    gap = np.abs(multipliers / gait.multipliers[0] - 1.0).min()
    means = abs(period.mean() - 1.0), abs(angle.mean() - 1.0)
    return [STRIDES, means[0], period.std(), means[1], angle.std(), gap, took * 1e6]


def _penalty(p: Problem, gait: Gait, time_step: float, integrator: str) -> list[float]:
    """Row of the table for MuJoCo."""
    unit = gait.walker.time_unit
    contact = Contact(p, time_step, integrator)
    start = gait.state[[0, 1, 3, 4]] * [1.0, 1.0, unit, unit]
    strikes, middles = contact.walk(start, STRIDES)
    if len(middles) <= STRIDES:
        return [len(strikes), *[math.nan] * 6]
    periods = np.diff(strikes[:, TIME], prepend=0.0) * unit
    middle = middles[-SETTLED:, SWING : SWING_RATE + 1].mean(axis=0)
    multipliers = _multipliers(contact, middle)
    # Time the swing up to just before heelstrike in one call of C, without the cost of Python.
    steps = int(0.95 * gait.step_period / unit / time_step)

    def swing() -> None:
        contact.place(start)
        contact.step(contact.model, contact.data, steps)

    took = seconds(swing, repeats=3) / 0.95
    return _result(gait, periods, -strikes[:, STANCE], multipliers, took)


def _exact(p: Problem, gait: Gait) -> list[float]:
    """Row of the table for the engine, at a coarse tolerance."""
    state, taken = gait.state, []
    for _ in range(STRIDES):
        taken.append(stride(gait.walker, gait.slope, state, tolerance=TOLERANCE))
        state = taken[-1].state
    periods, angles = np.array([(t.duration, t.state[0]) for t in taken]).T
    derivative = stride_jacobian(gait.walker, gait.slope, state, tolerance=TOLERANCE)
    took = seconds(again(p, new_batch(p, 1), TOLERANCE))
    return _result(gait, periods, angles, multipliers_of(derivative), took)


def report() -> str:
    """The table and its explanation, as Markdown."""
    p = problem("straight")
    walker, slope = WALKS["straight"]
    gait = find_gait(WALKERS[walker], slope)
    rows = [
        (f"MuJoCo, {integrator}", f"{time_step:.0e}", _penalty(p, gait, time_step, integrator))
        for integrator, time_steps in TRIED.items()
        for time_step in time_steps
    ]
    rows.append(("this engine, alone", f"tolerance {TOLERANCE:.0e}", _exact(p, gait)))
    cells = []
    for name, setting, (strides, *errors, took) in rows:
        walked = f"{strides}, then it fell" if math.isnan(took) else strides
        shown = ("—" if math.isnan(e) else f"{e:.0e}" for e in errors)
        cells.append((name, setting, walked, *shown, took))
    heads = [
        "method", "time step", "strides", "step period", "± a stride", "stance angle",
        "± a stride", "multipliers", "µs a stride",
    ]  # fmt: skip
    return f"""{table(heads, cells)}

Walker {walker} at slope {slope} on a penalty contact. The columns are relative errors of the mean
of the last {SETTLED} of {STRIDES} strides, and the scatter from stride to stride; times are in
√(l/g). Both models have straight legs and rolling feet. The swing foot meets the ground only after
it has been above it in front, and the trailing foot is released at the landing of the other one.
MuJoCo's contact is as stiff as its time step permits. A landing may occur at any time within a time
step, so strides scatter. Multipliers are therefore a linear fit through {SAMPLES} strides, from up
to {SPREAD} around the fixed point at mid-stance. This width gives MuJoCo's smallest errors. Of
MuJoCo's integrators, implicitfast is the more accurate one. RK4 takes more time, and its step
period does not converge on a contact this stiff."""
