"""Numbers from other publications, independent of Garcia (1999) and of this package."""

from __future__ import annotations

import math
from collections.abc import Iterator

from examples.potential_shaping import COMPASS
from gym_passive_walker import WALKERS
from validation.rows import Row, number
from validation.walks import Kind, gait

_SIMPLEST = "Garcia et al. 1998"
_COMPASS = "Goswami et al. 1998"

_CUT = "0.459"  # printed truncated, not rounded
_AT_0009: dict[Kind, dict[str, str]] = {
    "long": {
        "θ": "0.20031090",
        "θ̇ √(l/g)": "-0.19983247",
        "multipliers, real part": "-0.190",
        "multipliers, imaginary part": "0.558",
    },
    "short": {
        "θ": "0.19393737",
        "θ̇ √(l/g)": "-0.20386693",
        "multipliers, first": "4.00",
        "multipliers, second": _CUT,
    },
}
_VANISHING: dict[Kind, tuple[str, str]] = {
    "long": ("0.970956", "3.812092"),
    "short": ("0.943976", "π"),
}


def _limit(near: float, far: float) -> float:
    """Limit of a quantity as the slope vanishes, from its values at slopes 1e-9 and 8e-9.

    Corrections are proportional to slope^(2/3), the square of the step; their ratio is 1 : 4.
    """
    return (4.0 * near - far) / 3.0


def simplest_walker() -> Iterator[Row]:
    """The simplest walker at slope 0.009 and at vanishing slope."""
    unit = WALKERS["D"].time_unit
    for kind, published in _AT_0009.items():
        walks = gait("D", 0.009, kind)
        first, second = walks.multipliers[:2]
        computed = {
            "θ": walks.stance_angle,
            "θ̇ √(l/g)": walks.state[3] * unit,
            "multipliers, real part": first.real,
            "multipliers, imaginary part": abs(first.imag),
            "multipliers, first": first.real,
            "multipliers, second": second.real,
        }
        for name, printed in published.items():
            yield number(
                f"{_SIMPLEST} | {kind} step at 0.009: {name} | {printed}",
                float(computed[name]),
                known="0.459590" if printed == _CUT else "",
                digits=6 if "multipliers" in name else 11,
                remark="Print is cut after three digits, not rounded." if printed == _CUT else "",
            )
    for kind, (angle, period) in _VANISHING.items():
        near, far = gait("D", 1e-9, kind), gait("D", 8e-9, kind)
        what = f"{kind} step at vanishing slope"
        said = f"{_SIMPLEST} | {what}: θ / γ^(1/3) | {angle}"
        yield number(said, _limit(near.stance_angle / 1e-3, far.stance_angle / 2e-3), digits=8)
        yield number(
            f"{_SIMPLEST} | {what}: step period / √(l/g) | {period}",
            _limit(near.step_period / unit, far.step_period / unit),
            within=1e-7 if period == "π" else None,
            digits=9,
        )


def compass() -> Iterator[Row]:
    """The compass walker with half its mass in the legs, at three degrees."""
    walks, what = gait(COMPASS, math.radians(3.0)), "m = 5, m_H = 10, a = b = 0.5 at 3°"
    half_angle = math.degrees(walks.stance_angle)
    yield number(
        f"{_COMPASS} | {what}: half the angle between the legs (°) | 15.53", half_angle, within=0.01
    )
    yield number(
        f"{_COMPASS} | {what}: step period with g = 9.8 | 0.7347", walks.step_period, within=1e-4
    )
