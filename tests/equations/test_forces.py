"""Forces against those of the same walker as loose bodies held together by constraints.

Each segment has its own position and angle. Joints, stops and the rolling foot are constraints with
multipliers: the forces to compare. Geometry is read from Fig. 4.1 independently.
"""

from dataclasses import replace

import numpy as np
import pytest

from gym_passive_walker import WALKERS, lab_walker_from_parts
from gym_passive_walker.gaits.look.forces import forces, struck
from gym_passive_walker.models.equations.hybrid import Stage

THIGH, SHANK, SWING_THIGH, SWING_SHANK, HIP = range(5)  # bodies; x downhill, y up, angle each
WEIGHTED = lab_walker_from_parts()
KNEED = {
    "lab": WALKERS["lab"],
    "C": WALKERS["C"],
    "weighted": WEIGHTED,
    "heavy": replace(WEIGHTED, thigh_offset=0.03, hip_mass=4.0, gravity=1.6),
}
STRAIGHT = {name: WALKERS[name] for name in ("lab-straight", "A", "B", "E")}
STRAIGHT["weighted-straight"] = replace(WEIGHTED, knees=False)
WITH_MASS = KNEED | STRAIGHT


def turned(vector, angle):
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine], [sine, cosine]]) @ vector


class Bodies:
    """A walker in maximal coordinates: mass matrix and constraints at a configuration."""

    def __init__(self, walker, angles, *, swing_locked):
        thigh_line, shank_line = walker.foot_angle, -walker.shank_angle
        down = np.array([-np.sin(thigh_line), -np.cos(thigh_line)])
        back = np.array([-np.cos(thigh_line), np.sin(thigh_line)])
        thigh_com = walker.thigh_com * down + walker.thigh_offset * back
        thigh_knee = walker.thigh_length * down
        down = np.array([-np.sin(shank_line), -np.cos(shank_line)])
        back = np.array([-np.cos(shank_line), np.sin(shank_line)])
        shank_com = walker.shank_com * down + walker.shank_offset * back
        foot = (walker.shank_length - walker.foot_radius) * down
        self.angle = np.array([angles[0], angles[0], angles[1], angles[2], 0.0])
        masses = [walker.thigh_mass, walker.shank_mass] * 2 + [walker.hip_mass]
        gyrations = [walker.thigh_gyration, walker.shank_gyration] * 2 + [0.0]
        self.mass = np.array([[m, m, m * r**2] for m, r in zip(masses, gyrations, strict=True)])
        self.mass[HIP, 2] = 1.0  # a point has no angle: any inertia will do
        self.rows, self.turns, self.names = [], [], {}
        # The foot rolls: its centre moves back by R for each radian that the leg turns backwards.
        self._point("contact", [(1.0, SHANK, foot - shank_com)])
        self.rows[0][SHANK, 2] += walker.foot_radius
        self._pin(THIGH, thigh_knee - thigh_com, SHANK, -shank_com)
        self._lock("stance knee", THIGH, SHANK)
        self._pin(THIGH, -thigh_com, SWING_THIGH, -thigh_com)
        self._pin(THIGH, -thigh_com, HIP, np.zeros(2))
        self._pin(SWING_THIGH, thigh_knee - thigh_com, SWING_SHANK, -shank_com)
        if swing_locked:
            self._lock("swing knee", SWING_THIGH, SWING_SHANK)
        self.jacobian = np.array(self.rows).reshape(len(self.rows), -1)

    def _point(self, name, parts):
        """Hold a sum of points, each fixed to a body, in place."""
        self.names[name] = len(self.rows)
        for axis in (0, 1):
            row, square = np.zeros((5, 3)), np.zeros(5)
            for sign, body, arm in parts:
                arm = turned(arm, self.angle[body])
                row[body, axis] += sign
                row[body, 2] += sign * np.array([-arm[1], arm[0]])[axis]
                square[body] += sign * arm[axis]
            self.rows.append(row)
            self.turns.append(square)

    def _pin(self, a, arm_a, b, arm_b):
        self._point(f"pin {a} {b}", [(1.0, a, arm_a), (-1.0, b, arm_b)])

    def _lock(self, name, thigh, shank):
        """Hold a knee straight: the multiplier is the torque that keeps the shank from it."""
        self.names[name] = len(self.rows)
        row = np.zeros((5, 3))
        row[thigh, 2], row[shank, 2] = 1.0, -1.0
        self.rows.append(row)
        self.turns.append(np.zeros(5))

    def solve(self, force, right):
        """Changes of velocity (5, 3) and multipliers for given forces and constraints' values."""
        mass, j = np.diag(self.mass.ravel()), self.jacobian
        system = np.block([[mass, -j.T], [j, np.zeros((len(j), len(j)))]])
        solution = np.linalg.solve(system, np.concatenate([force.ravel(), right]))
        multipliers = {name: solution[15 + row :] for name, row in self.names.items()}
        return solution[:15].reshape(5, 3), multipliers

    def accelerate(self, walker, slope, rates, torque):
        """Accelerations and multipliers under gravity and a hip torque."""
        omega = np.array([rates[0], rates[0], rates[1], rates[2], 0.0])
        force = self.mass * walker.gravity * np.array([np.sin(slope), -np.cos(slope), 0.0])
        force[THIGH, 2] -= torque
        force[SWING_THIGH, 2] += torque
        return self.solve(force, np.array(self.turns) @ omega**2)

    def velocities(self, rates, foot=(0.0, 0.0)):
        """Velocities (5, 3) at these rates, while the point of contact moves at `foot`."""
        omega = [rates[0], rates[0], rates[1], rates[2], 0.0]
        rows = [row for name, row in self.names.items() if "knee" not in name]
        rows = self.jacobian[[i for row in rows for i in (row, row + 1)]].reshape(-1, 5, 3)
        right = -rows[:, :, 2] @ np.array(omega)
        right[:2] += foot
        linear = np.linalg.solve(rows[:, :, :2].reshape(10, 10), right).reshape(5, 2)
        return np.column_stack([linear, omega])

    def collide(self, before):
        """Velocities after constraints come into force at once, and the impulses."""
        jump, multipliers = self.solve(np.zeros((5, 3)), -self.jacobian @ before.ravel())
        return before + jump, multipliers


def random_states(count, straight, seed):
    rng = np.random.default_rng(seed)
    states = np.column_stack([rng.uniform(-0.5, 0.5, (count, 3)), rng.normal(0.0, 2.0, (count, 3))])
    if straight:
        states[:, [2, 5]] = states[:, [1, 4]]
    return states


@pytest.mark.parametrize(
    ("name", "phase"),
    [(name, Stage.FREE) for name in KNEED] + [(name, Stage.LOCKED) for name in WITH_MASS],
)
def test_forces_are_those_that_hold_loose_bodies_together(name, phase):
    walker, slope, torque = WITH_MASS[name], 0.05, 0.3
    states = random_states(20, phase == Stage.LOCKED, seed=1)
    found = forces(walker, slope, states, np.full(20, phase), (torque, 0.0))
    for i, state in enumerate(states):
        bodies = Bodies(walker, state[:3], swing_locked=phase == Stage.LOCKED)
        motion, multipliers = bodies.accelerate(walker, slope, state[3:], torque)
        expected = motion[[THIGH, SWING_THIGH, SWING_SHANK], 2]
        np.testing.assert_allclose(found.accelerations[i], expected, rtol=1e-9, atol=1e-9)
        scale = walker.total_mass * walker.gravity
        contact, expected = [found.tangential[i], found.normal[i]], multipliers["contact"][:2]
        np.testing.assert_allclose(contact, expected, rtol=1e-9, atol=1e-10 * scale)
        if walker.knees:
            stance = multipliers["stance knee"][0]
            swing = multipliers["swing knee"][0] if phase == Stage.LOCKED else 0.0
            knees = [found.stance_knee[i], found.swing_knee[i]]
            np.testing.assert_allclose(knees, [stance, swing], rtol=1e-9, atol=1e-10 * scale)
        else:
            assert np.isnan(found.stance_knee[i]) and np.isnan(found.swing_knee[i])


def test_the_simplest_walker_stands_on_the_force_along_its_leg():
    walker, slope = WALKERS["D"], 0.05
    states = random_states(10, True, seed=2)
    found = forces(walker, slope, states, np.full(10, Stage.SIMPLEST), (0.7, 0.0))
    stance, rate = states[:, 0], states[:, 3]
    along = walker.gravity * np.cos(stance - slope) - walker.leg_length * rate**2
    np.testing.assert_allclose(found.normal, along * np.cos(stance), rtol=1e-12)
    np.testing.assert_allclose(found.tangential, -along * np.sin(stance), rtol=1e-12, atol=1e-14)


def test_an_ankle_torque_turns_the_simplest_walker_s_hip():
    """Newton's law of its mass, in the walker's own units: the ground's force accelerates it."""
    walker, slope, torque = replace(WALKERS["D"], hip_mass=3.0), 0.05, 0.9
    states = random_states(10, True, seed=2)
    phases = np.full(10, Stage.SIMPLEST)
    found = forces(walker, slope, states, phases, (0.0, torque))
    sine, cosine, length = np.sin(states[:, 0]), np.cos(states[:, 0]), walker.leg_length
    rate, turn = states[:, 3], found.accelerations[:, 0]
    gravity = walker.gravity * length * np.sin(states[:, 0] - slope)
    moment = gravity - torque / walker.hip_mass
    np.testing.assert_allclose(length**2 * turn, moment, rtol=1e-12)
    downhill = length * (rate**2 * sine - turn * cosine)
    up = -length * (rate**2 * cosine + turn * sine)
    weight = walker.hip_mass * walker.gravity
    forced = found.tangential + weight * np.sin(slope), found.normal - weight * np.cos(slope)
    np.testing.assert_allclose(forced[0], walker.hip_mass * downhill, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(forced[1], walker.hip_mass * up, rtol=1e-10, atol=1e-12)


def impulses(walker, angles, jumps, foot_jump=(0.0, 0.0)):
    """Of the ground downhill and up, and on the stops of both knees, in the walker's own units."""
    units, (x, y) = walker.units, foot_jump
    foot = -x / units.speed, y / units.speed
    back, up, *knees = struck(walker.body, angles, jumps * units.time, foot)
    given = [-back * units.force, up * units.force, *(knee * units.energy for knee in knees)]
    return units.time * np.array(given)


@pytest.mark.parametrize("name", KNEED)
def test_kneestrike_impulses_are_those_that_stop_the_shank(name):
    walker = KNEED[name]
    for state in random_states(10, True, seed=3):
        bodies = Bodies(walker, state[:3], swing_locked=True)
        rates = state[3:] + np.array([0.0, 0.0, 1.5])
        after, multipliers = bodies.collide(bodies.velocities(rates))
        jump = after[[THIGH, SWING_THIGH, SWING_SHANK], 2] - rates
        found = impulses(walker, state[:3], jump)
        knees = [multipliers["stance knee"][0], multipliers["swing knee"][0]]
        np.testing.assert_allclose(
            found, [*multipliers["contact"][:2], *knees], rtol=1e-9, atol=1e-10
        )
        assert found[3] > 0.0


@pytest.mark.parametrize("name", WITH_MASS)
def test_heelstrike_impulses_are_those_that_stop_the_foot(name):
    walker = WITH_MASS[name]
    rng = np.random.default_rng(4)
    for angle in rng.uniform(0.01, 0.5, 10):
        angles = np.array([angle, -angle, -angle])
        bodies = Bodies(walker, angles, swing_locked=not walker.knees)
        stance_rate, swing_rate, *foot = rng.normal(0.0, 2.0, 4)
        rates = np.array([stance_rate, swing_rate, swing_rate])
        after, multipliers = bodies.collide(bodies.velocities(rates, foot))
        jump = after[[THIGH, SWING_THIGH, SWING_SHANK], 2] - rates
        found = impulses(walker, angles, jump, -np.array(foot))
        np.testing.assert_allclose(found[:2], multipliers["contact"][:2], rtol=1e-9, atol=1e-10)
        if walker.knees:
            expected = [multipliers["stance knee"][0], 0.0]
            np.testing.assert_allclose(found[2:], expected, rtol=1e-9, atol=1e-10)
