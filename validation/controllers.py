"""Controllers of other publications: push-off on level ground, and potential shaping."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import root_scalar

import gym_passive_walker as gpw
from examples.potential_shaping import (
    COMPASS,
    PotentialShaping,
    controlled_symmetry,
    virtual_gravity,
)
from gym_passive_walker import WALKERS, Actuation, Gait
from validation.rows import Row, listed, number
from validation.walks import gait

_KUO = "Kuo 2002"
_STIFFNESS, _PUSH_OFF = 2.5127, 0.1877
_G = WALKERS["D"].gravity
# Files of Kuo's program: push-off, stiffness, stance angle, its angular velocity, and tolerance.
_SAVED = {
    "slow": (0.04, 0.0, "0.194588876", "-0.202960578", 1e-7),
    "normal": (0.18770204624718329, 2.5127159062105644, "0.355460653", "-0.505623102", 1e-6),
}


def _pushed(push_off: float, stiffness: float = _STIFFNESS) -> Gait:
    """Gait of the simplest walker on level ground, with legs of 1 m."""
    walker = replace(WALKERS["D"], hip_stiffness=stiffness * _G)
    held = Actuation(push_off=push_off * math.sqrt(_G))
    return gpw.find_gait(gpw.stride_map(walker, 0.0, controller=held))


def _strike(walks: Gait) -> tuple[float, float]:
    """Half the angle between the legs at heelstrike (rad), and the speed just before it."""
    return walks.stance_angle, -float(walks.state[3]) / math.sqrt(walks.walker.gravity)


def _field_at(angle: float, speed: float) -> Gait:
    """Gait with this angle and speed at heelstrike, driven by a torque on the stance leg.

    The torque acts as a virtual gravity. The slope of the virtual gravity makes up for the impact
    loss; the stiffness of the hip spring is chosen so that the step has the required length.
    """
    field = math.atan((speed * math.sin(2.0 * angle)) ** 2 / (4.0 * math.sin(angle)))

    def walks(stiffness: float) -> Gait:
        walker = replace(WALKERS["D"], hip_stiffness=stiffness * _G)
        return gpw.find_gait(*virtual_gravity(walker, field).passive_twin)

    found = root_scalar(lambda k: walks(k).stance_angle - angle, bracket=(0.2, 6.0), xtol=1e-13)
    return walks(found.root)


def push_off() -> Iterator[Row]:
    """Kuo's simplest walker: a push-off before each heelstrike, and a spring between the legs."""
    for name, (push, stiffness, angle, rate, within) in _SAVED.items():
        walks, said = _pushed(push, stiffness), f"{_KUO} | gait {name!r} of his program:"
        why = "As exact as his tolerances make it."
        yield number(
            f"{said} stance angle | {angle}",
            walks.stance_angle,
            within=within,
            digits=9,
            remark=why,
        )
        yield number(
            f"{said} its rate √(l/g) | {rate}", float(walks.state[3]) / math.sqrt(_G),
            within=within, digits=9, remark=why,
        )  # fmt: skip
    normal = _pushed(_PUSH_OFF)
    said = f"{_KUO} | normal gait, P = {_PUSH_OFF}, K = {_STIFFNESS}:"
    yield number(f"{said} speed with l = 1 m (m/s) | 1.25", normal.speed)
    yield number(f"{said} steps a second | 1.8", 1.0 / normal.step_period)
    yield number(
        f"{said} cost of transport | 0.025308", normal.cost_of_transport, digits=8,
        remark="Recomputed from his equations, by another program.",
    )  # fmt: skip
    gaits = [_pushed(push) for push in (0.01, 0.05, 0.1, _PUSH_OFF, 0.25)]
    off = [
        abs(float(walks.controller.push_off) / math.sqrt(_G) - speed * math.tan(half))
        for walks in gaits
        for half, speed in [_strike(walks)]
    ]
    said = f"{_KUO} | push-off that keeps the speed v, the legs 2α apart: P − v tan α | 0"
    yield number(said, max(off), within=1e-12, digits=2, remark="Largest of five gaits.")
    half, speed = _strike(normal)
    driven = _field_at(half, speed)
    ratio = normal.cost_of_transport / math.tan(driven.slope)
    said = f"{_KUO} | its cost over that of a torque on the stance leg, at equal α and v | 0.3235"
    yield number(
        said.replace("0.3235", f"{0.25 / math.cos(half) ** 4:.10f}"), ratio, digits=10,
        within=1e-9, remark="Print has 1/(4 cos⁴ α): a quarter for small steps. The torque's walk "
        f"has a virtual gravity of {math.tan(driven.slope):.6f} and a spring of "
        f"{driven.walker.hip_stiffness / _G:.4f}.",
    )  # fmt: skip
    yield _period_of_small_steps()


def _period_of_small_steps() -> Row:
    """Row on the period of small steps, which the spring sets; the linear equations give it."""
    frequency = math.sqrt(1.0 + _STIFFNESS)

    def closes(half: float) -> float:
        swing = frequency * (3.0 + 2.0 * _STIFFNESS) * math.tanh(half)
        return math.sin(frequency * half) + swing * math.cos(frequency * half)

    quarter = 0.5 * math.pi / frequency
    period = 2.0 * root_scalar(closes, bracket=(1.02 * quarter, 1.9 * quarter)).root
    near, far = (_pushed(push).step_period * math.sqrt(_G) for push in (1e-4, 4e-4))
    return number(
        f"{_KUO} | the spring sets the step period, small steps, K = {_STIFFNESS} | {period:.6f}",
        (4.0 * near - far) / 3.0, digits=8,
        remark="tan(ωT/2) = −ω (3 + 2K) tanh(T/2) with ω² = 1 + K, of the linearized walker.",
    )  # fmt: skip


def _compass(shaping: PotentialShaping, slope: float, start: NDArray) -> tuple[float, NDArray]:
    """Simulate a stride of the compass walker under a law of torques, by SciPy.

    The equations of motion are written out here, independently of the package.

    Returns:
        Duration, and the state just before heelstrike, shape (4,): angles of stance and swing leg
        in rad, and their angular velocities.
    """
    leg, hip, g = 5.0, 10.0, 9.8  # masses of a leg, at half its length, and at the hip; l = 1

    def motion(_time: float, at: NDArray) -> list[float]:
        (a, b), rates = at[:2] - slope, at[2:]
        torques = shaping.torques([at[0], at[1], at[1], at[2], at[3], at[3]], slope)
        coupling, twist = -0.5 * leg * math.cos(a - b), -0.5 * leg * math.sin(a - b)
        mass = [[hip + 1.25 * leg, coupling], [coupling, 0.25 * leg]]
        force = [
            -twist * rates[1] ** 2 + (hip + 1.5 * leg) * g * math.sin(a),
            twist * rates[0] ** 2 - 0.5 * leg * g * math.sin(b),
        ]
        acts = np.array([-torques.hip - torques.ankle, torques.hip])
        return [*rates, *np.linalg.solve(mass, force + acts)]

    def strikes(_time: float, at: NDArray) -> float:
        return float(at[0] + at[1]) if at[0] < -0.05 else 1.0

    strikes.terminal, strikes.direction = True, -1.0  # type: ignore[attr-defined]
    walked = solve_ivp(
        motion, (0.0, 2.0), start[[0, 1, 3, 4]], "DOP853", rtol=1e-13, atol=1e-14, max_step=0.01,
        events=strikes,
    )  # fmt: skip
    return float(walked.t_events[0][0]), walked.y_events[0][0]


def _apart(shaping: PotentialShaping, slope: float, walks: Gait) -> float:
    """Largest difference between the closed loop on a slope and a gait.

    Compared are the duration, the angles and the foot velocity just before heelstrike.
    """
    time, ends = _compass(shaping, slope, walks.state)
    exact = gpw.foot_velocity(walks), walks.stance_angle
    foot, half = exact
    stance, swing, stance_rate, swing_rate = ends
    # Both angular velocities move the landing foot (Eq. 4.10); the impact depends on nothing else.
    along = -math.cos(half) * (stance_rate - swing_rate)
    down = math.sin(half) * (stance_rate + swing_rate)
    return max(
        abs(time - walks.step_period), abs(stance + half), abs(swing - half),
        abs(along - foot.tangential), abs(down - foot.normal),
    )  # fmt: skip


def shaped_potentials() -> Iterator[Row]:
    """Controlled symmetry and virtual gravity of the compass walker."""
    own = math.radians(3.0)
    shaping, walks = controlled_symmetry(COMPASS, own), gait(COMPASS, own)
    slopes = [math.radians(x) for x in (-10.0, -3.0, 0.0, 8.0)]
    where = "at −10°, −3°, 0°, 8°"
    off = max(_apart(shaping, slope, walks) for slope in slopes)
    why = "Closed loop, integrated by SciPy: largest difference in time, angle, velocity of a foot."
    said = f"Spong, Bullo 2005 | the gait of 3° under their torques {where}: difference | 0"
    yield number(said, off, within=1e-12, digits=2, remark=why)
    paid = [shaping.cost(walks, slope) for slope in slopes]
    errors = [
        abs(cost.net - math.sin(own) + math.sin(slope))
        for cost, slope in zip(paid, slopes, strict=True)
    ]
    yield number(
        f"Spong, Bullo 2005 | net work over weight × distance {where}, less sin 3° − sin γ | 0",
        max(errors), within=1e-12, digits=2,
        remark=f"Absolute work: {listed((cost.absolute for cost in paid), '.4f')}.",
    )  # fmt: skip
    angles = (0.02, own, 0.08)
    offs, costs, periods = [], [], []
    for angle in angles:
        law = virtual_gravity(COMPASS, angle)
        level = gpw.find_gait(*law.passive_twin)
        offs.append(_apart(law, 0.0, level))
        costs.append(law.cost(level, 0.0))
        periods.append(level.step_period / gait(COMPASS, angle).step_period)
    virtual = "virtual slopes 0.02, 3°, 0.08 on level ground"
    said = f"Asano, Yamakita 2001 | {virtual}: closed loop less its passive twin | 0"
    yield number(said, max(offs), within=1e-12, digits=2, remark=why)
    error = max(
        abs(period - math.sqrt(math.cos(angle)))
        for period, angle in zip(periods, angles, strict=True)
    )
    said = f"Asano, Yamakita 2001 | {virtual}: period over that of the slope, less √cos φ | 0"
    yield number(said, error, within=1e-12, digits=2)
    error = max(abs(cost.net - math.tan(angle)) for cost, angle in zip(costs, angles, strict=True))
    said = f"Asano, Yamakita 2001 | {virtual}: net cost of transport less tan φ | 0"
    why = f"Absolute work: {listed((cost.absolute for cost in costs), '.4f')}."
    yield number(said, error, within=1e-12, digits=2, remark=why)
