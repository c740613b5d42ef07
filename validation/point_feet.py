"""Sections 4.5.1 and 4.6.3, Figs. 4.5 and 4.11: point feet with mass, and scaling of steps."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import gym_passive_walker as gpw
from gym_passive_walker import WALKERS
from validation.rows import Row, claim, listed, number
from validation.scaling import exponent_crossings, transition_slope
from validation.walks import KINDS, TUNED, exponents, family, gait, sliding

_SHARE = {"E": 0.1 / 0.8, "F": 0.05 / 0.9}
_LOW, _SMALL = 1e-8, 1e-7


def point_feet() -> Iterator[Row]:
    """Section 4.5.1 and Figs. 4.5 and 4.11: point feet with mass."""
    least = max(abs(gait(name, 0.01, kind).multipliers[-1]) for name in "EF" for kind in KINDS)
    said = "4.5.1 | the return map is two-dimensional: third multiplier of E and F | 0"
    yield claim(said, "0 to rounding" if least < 1e-12 else f"{least:.2g}", least < 1e-12)
    yield number("4.5.1 | ρ of E, foot mass over hip mass | 0.125", _SHARE["E"])
    yield number("4.5.1 | ρ of F | 0.0556", _SHARE["F"])
    yield number("4.5.1 | ρ^(3/2) of E | 0.044", _SHARE["E"] ** 1.5)
    yield number("4.5.1 | ρ^(3/2) of F | 0.013", _SHARE["F"] ** 1.5)
    for name in "EF":
        yield from _laws(name)
    for name, stable in (("E", False), ("F", True)):
        largest = abs(gait(name, _LOW).multipliers[0])
        doubled = family(name, _LOW, 0.3).period_doublings
        yield claim(
            f"4.5.1 | {name}: the long step is stable, by its largest multiplier at slope 1e-8 | "
            "stable",
            f"{largest:.4f}",
            largest < 1.0,
            expected=stable,
            remark=f"It doubles its period at {doubled[0]:.7f}."
            if doubled
            else "E's long step is unstable at every slope: a multiplier tends to −1.0866 as the "
            "slope vanishes, so that it has doubled its period.",
        )
    yield from _transition()


def _laws(name: str) -> Iterator[Row]:
    """Rows on one walker's scaling exponents: with slope, and of the power with speed."""
    allowed = {"E": 0.12, "F": 0.06}[name]
    long, short = (exponents(name, _SMALL, kind) for kind in KINDS)
    steep = exponents(name, 0.1, "short")
    yield number(f"4.5.1 | {name}, long step: power of γ at 1e-7 | 1/3", long[0], within=1e-3)
    yield number(f"4.5.1 | {name}, short step: power of γ at 1e-7 | 1", short[0], within=1e-3)
    said = f"Fig. 4.5 | {name}, short step: power of γ well above ρ^(3/2), here at 0.1 | 1/3"
    why = (
        f"0.1 is {0.1 / _SHARE[name] ** 1.5:.1f} times ρ^(3/2); steeper steps are no longer small."
    )
    yield number(said, steep[0], within=allowed, remark=why)
    same = f"{name}, short step: the same"
    yield number(f"Fig. 4.11 | {same} of the speed | 1/3", steep[1], within=allowed)
    power_of_speed = [1.0 + 1.0 / speed for _, speed in (long, short)]
    what = f"{name}, long step: power of v of the power"
    yield number(f"4.5.1 | {what} | 4", power_of_speed[0], within=0.01)
    yield number(f"4.5.1 | {same} below the transition | 2", power_of_speed[1], within=0.01)
    slides = [sliding(name, 1e-5, kind) for kind in KINDS]
    said = (
        f"4.5.1 | {name}: foot's tangential over normal velocity at 1e-5, long and short "
        "step | essentially 0, significant"
    )
    yield claim(said, f"{slides[0]:.1e}, {slides[1]:.3g}", slides[0] < 1e-3 and slides[1] > 10.0)


def _transition() -> Iterator[Row]:
    """Rows on the slope at which the short step changes from one power law to another."""
    slopes = {name: transition_slope(name) for name in "EF"}
    factors = [slopes[name] / _SHARE[name] ** 1.5 for name in "EF"]
    half = [exponent_crossings(family(name, _LOW, 0.3, "short"))[0] for name in "EF"]
    yield claim(
        "Fig. 4.5 | where the linear law of E, and of F, meets the simplest walker's cube "
        "root | proportional to 0.044, 0.013",
        listed(slopes.values(), ".6f"),
        all(0.1 < factor < 0.2 for factor in factors),
        remark=f"Factors {factors[0]:.4f} and {factors[1]:.4f}; the document gives the law without "
        f"one. The power of the slope is halfway, 2/3, at {half[0]:.6f} and {half[1]:.6f}.",
    )
    total = (WALKERS["E"].shank_mass / WALKERS["F"].shank_mass) ** 1.5
    said = "Fig. 4.5 | ratio of these slopes: said to be that of ρ^(3/2) | 3.375"
    why = (
        "The law is asymptotic in ρ, and these feet are not light: with ρ as a share of the total "
        f"mass, as in 4.6.3, it would be {total:.3f}."
    )
    yield number(said, slopes["E"] / slopes["F"], known="3.6914", remark=why)
    near = [
        gait(name, slope).stance_angle / gait("D", slope).stance_angle
        for name in "EF"
        for slope in (1e-4, 1e-3, 1e-2, 5e-2)
    ]
    said = (
        "Fig. 4.5 | long steps of E and F, over the simplest walker's, from 1e-4 to 0.05 | "
        "more or less the same"
    )
    yield claim(said, f"{min(near):.3f} to {max(near):.3f}", min(near) > 0.9 and max(near) < 1.0)


def scaling() -> Iterator[Row]:
    """Section 4.6.3: energy and scaling."""
    matrices = {
        name: gpw.collision_matrix(TUNED[name], 0.0) / WALKERS[name].total_mass for name in "ABCDEF"
    }
    coupling = max(abs(matrix[0, 1]) for matrix in matrices.values())
    said = "4.6.1 | M(0) of tuned walkers A to F, off the diagonal over the total mass | 0"
    yield claim(said, f"{coupling:.0e}", coupling < 1e-15)
    lab = gpw.collision_matrix("lab", 0.0)[0, 1] / WALKERS["lab"].total_mass
    yield claim("4.6.1 | the same of the lab walker | not 0", f"{lab:.4f}", abs(lab) > 1e-3)
    off = max(abs(matrix[1, 1] - 1.0) for matrix in matrices.values())
    said = "4.6.3 | M(0) of tuned walkers A to F: normal entry over the total mass | 1"
    why = (
        "In the order (tangential, normal) of Eq. 4.7. The document's text gives the total mass to "
        "M₁₁ and diag[1 ρ], and its losses ½(ẏ² + ρẋ²): its index 1 means the normal there."
    )
    yield claim(said, f"1 within {off:.0e}", off < 1e-14, remark=why)
    other = {name: matrix[0, 0] for name, matrix in matrices.items()}
    said = "4.6.3 | the other entry, of A to F | smaller"
    yield claim(
        said, listed((abs(entry) for entry in other.values()), ".4g"), max(other.values()) < 1.0
    )
    yield claim(
        "4.6.3 | the other entry of E and F is the foot mass 0.1, 0.05 | 0.1, 0.05",
        listed((other["E"], other["F"]), ".12g"),
        abs(other["E"] - 0.1) < 1e-14 and abs(other["F"] - 0.05) < 1e-14,
        remark="Not just asymptotically: the hip's mass lies on the line of the legs.",
    )
    change = max(
        abs(gait(walker, 1e-4, k).step_period / gait(walker, 1e-7, k).step_period - 1.0)
        for walker in (TUNED[name] for name in "ABCDEF")
        for k in KINDS
    )
    said = (
        "4.6.3 | step periods are about constant at small slopes: largest change from 1e-7 to "
        "1e-4 | about constant"
    )
    yield claim(said, f"{change:.1%}", change < 0.05, remark="Both gaits of A to F.")
    kneed = [gait(TUNED["C"], slope) for slope in (0.05, 1e-2, 1e-4, 1e-7)]
    shares = [walks.kneestrike_loss / walks.collision_loss for walks in kneed]
    said = (
        "4.6.3 | C: the knee collision's share of the loss, at 0.05, 0.01, 1e-4, 1e-7 | "
        "dominates eventually"
    )
    yield claim(said, listed(shares, ".3f"), np.all(np.diff(shares) > 0.0) and shares[-1] > 0.5)
