"""Numbers from other publications, independent of Garcia (1999) and of this package."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

import gym_passive_walker as gpw
from examples.potential_shaping import COMPASS
from examples.rimless_wheel import RIMLESS_WHEEL, closed_form
from examples.virtual_constraints import BIPED, before_impact
from gym_passive_walker import WALKERS, Gait
from validation.rows import Row, claim, listed, number
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


_EXPANSIONS: dict[Kind, tuple[str, ...]] = {
    "long": ("-0.270837", "-1.045203", "1.062895", "1.579129", "0.4862596736443", "-66.842"),
    "short": ("-0.264561", "-1.090331", "0.866610", "-0.907496", "2", "-33.662"),
}
"""Second coefficients of Garcia et al. 1998, Table 1: θ = Θ₀ γ^(1/3) + Θ₁ γ, the period τ₀ + τ₁
γ^(2/3), and θ̇ = α θ + c₁ γ. Then multipliers, of which one tends to 1."""

_NO_EXPANSION = (
    "With it, θ at 0.009 would be 0.19953, and not the publication's own 0.20031090, which the "
    "computed constant meets. The short step's has all its digits."
)
_LONG_DOUBLE = "Integrated in long double by heyoka.py, another program."
_MPMATH = "Computed by mpmath, another program."


def _expansion(kind: Kind) -> NDArray[np.float64]:
    """Coefficients of quantities of a gait by powers of γ^(2/3): a row for each power, (4, 5).

    The quantities are θ and θ̇ over γ^(1/3), the period, the other multiplier and that near 1.
    """
    slopes, unit = 1e-9 * 8.0 ** np.arange(4), WALKERS["D"].time_unit
    rows = []
    for slope in slopes.tolist():
        walks, step = gait("D", slope, kind), slope ** (1.0 / 3.0)
        pair = sorted(walks.multipliers[:2].real, key=lambda x: abs(x - 1.0))
        angle, rate = walks.stance_angle / step, walks.state[3] * unit / step
        rows.append((angle, rate, walks.step_period / unit, pair[1], pair[0]))
    powers = np.vander(slopes ** (2.0 / 3.0), increasing=True)
    return np.asarray(np.linalg.solve(powers, np.array(rows)), np.float64)


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
        limits, second, *_ = _expansion(kind)
        what = f"{_SIMPLEST} | {kind} step at vanishing slope:"
        yield number(f"{what} θ / γ^(1/3) | {angle}", limits[0], digits=8)
        yield number(
            f"{what} step period / √(l/g) | {period}", limits[2],
            within=1e-7 if period == "π" else None, digits=9,
        )  # fmt: skip
        theta, alpha, c, tau, other, near = _EXPANSIONS[kind]
        ratio, wrong = limits[1] / limits[0], kind == "long"
        yield number(
            f"{what} Θ₁ in θ = Θ₀ γ^(1/3) + Θ₁ γ | {theta}", second[0], digits=7,
            known="-0.1865691" if wrong else "", remark=_NO_EXPANSION if wrong else "",
        )  # fmt: skip
        yield number(f"{what} α in θ̇ √(l/g) = α θ + c₁ γ | {alpha}", ratio, digits=7)
        yield number(f"{what} c₁ | {c}", second[1] - ratio * second[0], digits=7, within=1e-6)
        yield number(f"{what} τ₁ of the period τ₀ + τ₁ γ^(2/3) | {tau}", second[2], digits=7)
        what = f"Recomputed | {kind} step at vanishing slope:"
        yield number(
            f"{what} multiplier that is not 1 | {other}", limits[3], within=1e-11, digits=13,
            remark=_MPMATH,
        )  # fmt: skip
        yield number(
            f"{what} the other is 1 + k γ^(2/3), k | {near}", second[4], digits=6, remark=_MPMATH
        )
    walks = gait("D", 0.004)
    yield number("Schwab, Wisse 2001 | 0.004: θ | 0.1534", walks.stance_angle)
    yield number("Schwab, Wisse 2001 | 0.004: θ̇ √(l/g) | -0.1561", walks.state[3] * unit)


_DOUBLINGS = ("0.0150884379411", "0.0176693748625", "0.0181601195636", "0.0182648118505",
              "0.0182872718200", "0.0182920857308")  # fmt: skip
"""Slopes at which the simplest walker doubles its period, and at which three is a period."""


def chaos() -> Iterator[Row]:
    """The simplest walker's period doublings and gaits of period three, to 13 digits."""
    cascade, said = gpw.doubling_cascade("D", 0.012, 0.02, doublings=6), "Recomputed | slope where"
    for period, slope, printed in zip(cascade.periods, cascade.slopes, _DOUBLINGS, strict=True):
        yield number(
            f"{said} period {period} doubles | {printed}", slope, digits=13, remark=_LONG_DOUBLE
        )
    yield number(f"{said} doublings accumulate | 0.018293398", cascade.limit, digits=10)
    three = gpw.gait_family("D", 0.012, 0.0135, start=gpw.find_gait("D", 0.0125, period=3))
    for what, printed, slope in (
        ("a gait of period three is born", "0.0122808216261", three.folds[0]),
        ("it doubles its period", "0.0126349597800", three.period_doublings[0]),
    ):
        yield number(f"{said} {what} | {printed}", slope, digits=13, remark=_LONG_DOUBLE)
    stable = [each.stable for each in three.at(0.0125)]
    yield claim(
        "Recomputed | gaits of period three at 0.0125: stable ones, unstable ones | 1, 1",
        f"{sum(stable)}, {len(stable) - sum(stable)}", sorted(stable) == [False, True],
    )  # fmt: skip


def compass() -> Iterator[Row]:
    """The compass walker with half its mass in the legs."""
    walks, what = gait(COMPASS, math.radians(3.0)), "m = 5, m_H = 10, a = b = 0.5 at 3°"
    half_angle = math.degrees(walks.stance_angle)
    yield number(
        f"{_COMPASS} | {what}: half the angle between the legs (°) | 15.53", half_angle, within=0.01
    )
    yield number(
        f"{_COMPASS} | {what}: step period with g = 9.8 | 0.7347", walks.step_period, within=1e-4
    )
    yield number(
        f"Recomputed | {what}: half the angle between the legs (°) | 15.528800", half_angle,
        digits=8,
    )  # fmt: skip
    yield number(
        f"Recomputed | {what}: energy over the stance foot, g = 9.8 (J) | 153.0787",
        _energy(walks), digits=7,
    )  # fmt: skip
    cascade = gpw.doubling_cascade(COMPASS, 0.05, 0.1, doublings=4)
    printed = "4.390898", "4.914057", "5.012438", "5.033475"
    for period, slope, degrees in zip(cascade.periods, cascade.slopes, printed, strict=True):
        yield number(
            f"Recomputed | slope where period {period} doubles (°) | {degrees}",
            math.degrees(slope), digits=7,
        )  # fmt: skip
    end = gpw.crisis(COMPASS, 0.0885, 0.093, strides=400, accuracy=1e-6)
    yield number(
        "Recomputed | slope where walking ends (°) | 5.2017", math.degrees(end), within=5e-4,
        remark="Where one of 64 walkers falls within 400 strides.",
    )  # fmt: skip
    earth = COMPASS.with_parameters(gravity=9.81)
    walks = gait(earth, 0.0525)
    rates = walks.state[3:5]
    for name, value, printed in (
        ("stance angle (rad)", walks.stance_angle, "0.271274617980321"),
        ("stance rate after the strike (rad/s)", float(rates[0]), "-1.0928668105801"),
        ("swing rate after the strike (rad/s)", float(rates[1]), "-0.3761345935308"),
        ("step period (s)", walks.step_period, "0.734460621336439"),
    ):
        yield number(
            f"Drake 1.58 | CompassGait at 0.0525, g = 9.81: {name} | {printed}", value,
            within=1e-12, digits=13, remark="Runge-Kutta of fifth order, error 1e-12.",
        )  # fmt: skip


def known_gaits() -> Iterator[Row]:
    """Ends of stability of walker A, and the optimal gait of walker C on level ground."""
    family = gpw.gait_family("A", 1e-4, 0.1)
    yield number(
        "Recomputed | walker A as printed: slope of the fold at which its gaits begin | "
        "0.000103533897517", family.folds[0], within=1e-14, digits=12,
    )  # fmt: skip
    counts = [len(gpw.find_gaits("A", slope)) for slope in (1.03e-4, 1.05e-4)]
    yield claim(
        "Recomputed | its gaits at 1.03e-4 and at 1.05e-4 | 0, 2", listed(counts), counts == [0, 2]
    )
    yield number(
        "Recomputed | slope where its period doubles | 0.06576317542618",
        family.period_doublings[0], within=1e-13, digits=13,
    )  # fmt: skip
    best = gpw.optimal_gait("level", 0.1).dimensionless
    said = "IPOPT (CasADi 3.8) | walker C on level ground at 0.1 √(g l):"
    why = "Of an independent Lagrangian, 0.003183456."
    yield number(f"{said} least cost | 0.00318345", best.motor_cost, digits=7, remark=why)
    yield number(f"{said} step period | 2.84420", best.step_period, digits=6)
    yield number(f"{said} time of kneestrike | 1.54357", best.mean.kneestrike_time, digits=6)


def virtual_constraints() -> Iterator[Row]:
    """A biped of three links of which an angle defines the impact, on level ground."""
    walks = gait(BIPED, 0.0)
    said, why = (
        "Recomputed | three links of Grizzle et al. 2001, torso held at π/6, impacts at π/8:",
        "Hybrid zero dynamics by quadrature, with an impact of five coordinates: another program.",
    )
    for name, value, printed in (
        ("rate before an impact, g = 9.8 (rad/s)", math.sqrt(9.8) * before_impact(walks),
         "1.60525398538"),
        ("momentum kept in an impact", math.sqrt(walks.multipliers[0].real), "0.748641468577"),
    ):  # fmt: skip
        yield number(f"{said} {name} | {printed}", value, within=1e-11, digits=12, remark=why)


def _energy(walks: Gait) -> float:
    """Kinetic and potential energy just after heelstrike; heights are over the stance foot."""
    walker = walks.walker
    (stance, swing, _), rates = walks.state[:3], walks.state[3:5]
    hip = np.array([-math.sin(stance), math.cos(stance)])
    upwards = np.array([-math.sin(walks.slope), math.cos(walks.slope)])
    leg = np.array([math.sin(swing), -math.cos(swing)])
    turned = np.array([[0.0, -1.0], [1.0, 0.0]])
    energy = 0.0
    for mass, place, rate in (
        (walker.hip_mass, hip, rates[0] * turned @ hip),
        (walker.thigh_mass, 0.5 * hip, 0.5 * rates[0] * turned @ hip),
        (walker.thigh_mass, hip + 0.5 * leg, turned @ (rates[0] * hip + 0.5 * rates[1] * leg)),
    ):
        energy += mass * (0.5 * float(rate @ rate) + walker.gravity * float(upwards @ place))
    return energy


def wheels_and_round_feet() -> Iterator[Row]:
    """Rimless wheels in closed form, and what round feet save."""
    walks, unit = gait(RIMLESS_WHEEL.vary(inertia=0.0), 0.08), math.sqrt(9.81)
    wheel = "RimlessWheel, 8 spokes, 0.08, g = 9.81"
    for name, value, printed in (
        ("rate after an impact (rad/s)", -unit * float(walks.state[1]), "1.09546283964766"),
        ("step period (s)", walks.step_period / unit, "1.034549811423279"),
        ("multiplier", float(walks.multipliers[0].real), "0.5"),
    ):
        yield number(f"Drake 1.58 | {wheel}: {name} | {printed}", value, within=1e-12, digits=13)
    worst = 0.0
    for inertia, slope in ((0.0, 0.08), (0.2, 0.06), (0.5, 0.05)):
        each = RIMLESS_WHEEL.vary(inertia=inertia)
        walks, closed = gait(each, slope), closed_form(each.body, slope)
        found = float(walks.state[1]), float(walks.multipliers[0].real)
        worst = max(worst, *np.abs(np.subtract(found, closed)))
    yield number(
        "Coleman et al. 1997 | rate and multiplier of wheels less the closed form | 0", worst,
        within=1e-12, digits=2, remark="Moments of inertia 0, 0.2 and 0.5 over m l².",
    )  # fmt: skip
    for radius in (0.1, 0.3, 0.5):
        yield number(
            f"Adamczyk et al. 2006 | round feet, ρ = {radius}, legs of little mass: loss of a "
            f"small step, over that of point feet | {(1.0 - radius) ** 2:.4g}",
            _loss(radius) / _loss(0.0), within=1e-5, remark="It is (1 − ρ)².",
        )  # fmt: skip
    said = "Bhounsule 2009 | program passivewalker.m"
    foot = gpw.Walker(
        thigh_length=0.5, shank_length=0.5, thigh_mass=1.0, shank_mass=0.0, thigh_com=1.0,
        hip_mass=1000.0, knees=False, gravity=1.0,
    )  # fmt: skip
    yield number(
        f"{said}, point feet, 0.009: stance angle | 0.200161072169750",
        gait(foot, 0.009).stance_angle, within=1e-12, digits=13,
    )  # fmt: skip
    round_foot = gpw.Walker(
        thigh_length=0.6, shank_length=0.6, thigh_mass=0.5, shank_mass=0.0, thigh_com=0.5,
        thigh_gyration=0.2, foot_radius=0.2, hip_mass=1.0, knees=False, gravity=1.0,
    )  # fmt: skip
    yield number(
        f"{said}, round feet, 0.01: stance angle | 0.189472782205104",
        gait(round_foot, 0.01).stance_angle, known="0.18943828", digits=8,
        remark="For the angular momentum of the trailing leg about the hip, which its collision "
        "has to keep, it took 0.04034 where it is 0.04005. The author mended the equation in 2019; "
        "the number stayed in a comment.",
    )  # fmt: skip


def _loss(radius: float) -> float:
    """Energy that a small step loses with feet of a radius, at a rate of 1 of the stance leg.

    Speeds of the hip are equal, as it is one leg length above the contact.
    """
    light, small = 1e-7, 1e-3
    walker = gpw.Walker(
        thigh_length=0.4, shank_length=0.6, thigh_mass=light, shank_mass=0.0, thigh_com=0.2,
        foot_radius=radius, hip_mass=1.0, knees=False, gravity=1.0,
    )  # fmt: skip
    state = [-small, small, small, -1.0, -1.0, -1.0]
    velocity = np.array(gpw.foot_velocity(walker, state))
    return float(0.5 * velocity @ gpw.collision_matrix(walker, small) @ velocity)
