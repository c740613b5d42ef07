"""Numbers from other publications, which neither the document nor this package has a hand in."""

from __future__ import annotations

import math

from gym_passive_walker.validation.rows import Row, gait, number
from gym_passive_walker.walkers import WALKERS, Walker

_SIMPLEST = "Garcia et al. 1998"
_COMPASS = "Goswami et al. 1998"
_KINDS = ("long", "short")

_POINTS = {"long": ("0.20031090", "-0.19983247"), "short": ("0.19393737", "-0.20386693")}
_MULTIPLIERS = {"long": ("-0.190", "0.558"), "short": ("4.00", "0.459")}
_CONSTANTS = {"long": ("0.970956", "3.812092"), "short": ("0.943976", "π")}


def _limit(values: tuple[float, float]) -> float:
    """What a quantity at slopes 1e-9 and 8e-9 tends to as the slope vanishes.

    Corrections go with slope^(2/3), the square of the step, here in the ratio 1 : 4.
    """
    return (4.0 * values[0] - values[1]) / 3.0


def simplest_walker() -> list[Row]:
    """The simplest walker at slope 0.009 and at vanishing slope."""
    unit = WALKERS["D"].time_unit
    rows = []
    for kind in _KINDS:
        walks = gait("D", 0.009, kind)
        first, second = walks.multipliers[:2]
        pair = (first.real, abs(first.imag)) if first.imag else (first.real, second.real)
        names = ("real part", "imaginary part") if first.imag else ("first", "second")
        what = f"{kind} step at 0.009"
        angle, rate = _POINTS[kind]
        rows += [
            number(_SIMPLEST, f"{what}: θ", angle, walks.stance_angle, digits=11),
            number(_SIMPLEST, f"{what}: θ̇ √(l/g)", rate, walks.state[3] * unit, digits=11),
        ]
        for name, printed, value in zip(names, _MULTIPLIERS[kind], pair, strict=True):
            cut = printed == "0.459"
            rows.append(
                number(
                    _SIMPLEST,
                    f"{what}: multipliers, {name}",
                    printed,
                    float(value),
                    known="0.459590" if cut else "",
                    remark="Print is cut after three digits, not rounded." if cut else "",
                )
            )
    for kind in _KINDS:
        few = [gait("D", slope, kind) for slope in (1e-9, 8e-9)]
        angle, period = _CONSTANTS[kind]
        rows += [
            number(
                _SIMPLEST,
                f"{kind} step at vanishing slope: θ / γ^(1/3)",
                angle,
                _limit((few[0].stance_angle / 1e-3, few[1].stance_angle / 2e-3)),
                digits=8,
            ),
            number(
                _SIMPLEST,
                f"{kind} step at vanishing slope: step period / √(l/g)",
                period,
                _limit((few[0].step_period / unit, few[1].step_period / unit)),
                within=1e-7 if period == "π" else None,
                digits=9,
            ),
        ]
    return rows


def compass() -> list[Row]:
    """The compass walker with half its mass in the legs, at three degrees."""
    walker = Walker(
        thigh_length=0.5,
        thigh_mass=5.0,
        thigh_com=0.5,
        shank_length=0.5,
        shank_mass=0.0,
        hip_mass=10.0,
        knees=False,
        gravity=9.8,
    )
    walks = gait(walker, math.radians(3.0))
    what = "m = 5, m_H = 10, a = b = 0.5 at 3°"
    return [
        number(
            _COMPASS,
            f"{what}: half the angle between the legs (°)",
            "15.53",
            math.degrees(walks.stance_angle),
            within=0.01,
        ),
        number(_COMPASS, f"{what}: step period with g = 9.8", "0.7347", walks.step_period,
               within=1e-4),
    ]  # fmt: skip
