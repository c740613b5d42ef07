"""Sections 4.5.1 and 4.6.3, Figs. 4.5 and 4.11: point feet with mass, and how steps scale."""

from __future__ import annotations

import numpy as np

from gym_passive_walker.gaits.measures import collision_matrix
from gym_passive_walker.gaits.scaling import exponent_crossings, transition_slope
from gym_passive_walker.validation.rows import Row, claim, exponents, family, gait, number, tuned
from gym_passive_walker.validation.simplest import sliding
from gym_passive_walker.walkers import WALKERS

_SHARE = {"E": 0.1 / 0.8, "F": 0.05 / 0.9}
_LOW, _SMALL = 1e-8, 1e-7


def point_feet() -> list[Row]:
    """Section 4.5.1 and Figs. 4.5 and 4.11."""
    where = "4.5.1"
    least = max(
        abs(gait(name, 0.01, kind).multipliers[-1]) for name in "EF" for kind in ("long", "short")
    )
    rows = [
        claim(
            where,
            "the return map is two-dimensional: third multiplier of E and F",
            "0",
            "0 to rounding" if least < 1e-12 else f"{least:.2g}",
            bool(least < 1e-12),
        ),
        number(where, "ρ of E, foot mass over hip mass", "0.125", _SHARE["E"]),
        number(where, "ρ of F", "0.0556", _SHARE["F"]),
        number(where, "ρ^(3/2) of E", "0.044", _SHARE["E"] ** 1.5),
        number(where, "ρ^(3/2) of F", "0.013", _SHARE["F"] ** 1.5),
    ]
    for name in "EF":
        rows += _laws(name)
    for name, stable in (("E", False), ("F", True)):
        largest = abs(gait(name, _LOW).multipliers[0])
        doubled = family(name, _LOW, 0.3).period_doublings
        rows.append(
            claim(
                where,
                f"{name}: the long step is stable, by its largest multiplier at slope 1e-8",
                "stable",
                f"{largest:.4f}",
                bool(largest < 1.0),
                expected=stable,
                remark=f"It doubles its period at {doubled[0]:.7f}."
                if doubled
                else "E's long step is unstable at every slope: a multiplier tends to −1.0866 as "
                "the slope vanishes, so that it has doubled its period.",
            )
        )
    return rows + _transition()


def _laws(name: str) -> list[Row]:
    """Powers of the slope, and of the speed in the power, of one walker."""
    where = "4.5.1"
    long, short, steep = (
        exponents(name, _SMALL, "long"),
        exponents(name, _SMALL, "short"),
        exponents(name, 0.1, "short"),
    )
    allowed = {"E": 0.12, "F": 0.06}[name]
    return [
        number(where, f"{name}, long step: power of γ at 1e-7", "1/3", long[0], within=1e-3),
        number(where, f"{name}, short step: power of γ at 1e-7", "1", short[0], within=1e-3),
        number(
            "Fig. 4.5",
            f"{name}, short step: power of γ well above ρ^(3/2), here at 0.1",
            "1/3",
            steep[0],
            within=allowed,
            remark=f"0.1 is {0.1 / _SHARE[name] ** 1.5:.1f} times ρ^(3/2); steeper steps are no "
            "longer small.",
        ),
        number(
            "Fig. 4.11",
            f"{name}, short step: the same of the speed",
            "1/3",
            steep[1],
            within=allowed,
        ),
        number(
            where,
            f"{name}, long step: power of v of the power",
            "4",
            1.0 + 1.0 / long[1],
            within=0.01,
        ),
        number(
            where,
            f"{name}, short step: the same below the transition",
            "2",
            1.0 + 1.0 / short[1],
            within=0.01,
        ),
        claim(
            where,
            f"{name}: foot's tangential over normal velocity at 1e-5, long and short step",
            "essentially 0, significant",
            f"{sliding(name, 1e-5, 'long'):.1e}, {sliding(name, 1e-5, 'short'):.3g}",
            sliding(name, 1e-5, "long") < 1e-3 and sliding(name, 1e-5, "short") > 10.0,
        ),
    ]


def _transition() -> list[Row]:
    """Where the short step's laws give way to each other."""
    slopes = {name: transition_slope(name) for name in "EF"}
    half = {name: float(exponent_crossings(family(name, _LOW, 0.3, "short"))[0]) for name in "EF"}
    ratio = slopes["E"] / slopes["F"]
    total = (WALKERS["E"].shank_mass / WALKERS["F"].shank_mass) ** 1.5
    near = [
        gait(name, slope).stance_angle / gait("D", slope).stance_angle
        for name in "EF"
        for slope in (1e-4, 1e-3, 1e-2, 5e-2)
    ]
    return [
        claim(
            "Fig. 4.5",
            "where the linear law of E, and of F, meets the simplest walker's cube root",
            "proportional to 0.044, 0.013",
            f"{slopes['E']:.6f}, {slopes['F']:.6f}",
            all(0.1 < slopes[name] / _SHARE[name] ** 1.5 < 0.2 for name in "EF"),
            remark=f"Factors {slopes['E'] / _SHARE['E'] ** 1.5:.4f} and "
            f"{slopes['F'] / _SHARE['F'] ** 1.5:.4f}; the document gives the law without one. The "
            f"power of the slope is halfway, 2/3, at {half['E']:.6f} and {half['F']:.6f}.",
        ),
        number(
            "Fig. 4.5",
            "ratio of these slopes: said to be that of ρ^(3/2)",
            "3.375",
            ratio,
            known="3.6914",
            remark="The law is asymptotic in ρ, and these feet are not light: with ρ as a share of "
            f"the total mass, as in 4.6.3, it would be {total:.3f}.",
        ),
        claim(
            "Fig. 4.5",
            "long steps of E and F, over the simplest walker's, from 1e-4 to 0.05",
            "more or less the same",
            f"{min(near):.3f} to {max(near):.3f}",
            min(near) > 0.9 and max(near) < 1.0,
        ),
    ]


def scaling() -> list[Row]:
    """Section 4.6.3."""
    rows = []
    matrices = {
        name: collision_matrix(tuned(name), 0.0) / WALKERS[name].total_mass for name in "ABCDEF"
    }
    lab = collision_matrix("lab", 0.0) / WALKERS["lab"].total_mass
    order = (
        "In the order (tangential, normal) of Eq. 4.7. The document's text gives the total mass "
        "to M₁₁ and diag[1 ρ], and its losses ½(ẏ² + ρẋ²): its index 1 means the normal there."
    )
    rows += [
        claim(
            "4.6.1",
            "M(0) of tuned walkers A to F, off the diagonal over the total mass",
            "0",
            f"{max(abs(matrix[0, 1]) for matrix in matrices.values()):.0e}",
            all(abs(matrix[0, 1]) < 1e-15 for matrix in matrices.values()),
        ),
        claim(
            "4.6.1",
            "the same of the lab walker",
            "not 0",
            f"{lab[0, 1]:.4f}",
            bool(abs(lab[0, 1]) > 1e-3),
        ),
        claim(
            "4.6.3",
            "M(0) of tuned walkers A to F: normal entry over the total mass",
            "1",
            f"1 within {max(abs(m[1, 1] - 1.0) for m in matrices.values()):.0e}",
            all(abs(m[1, 1] - 1.0) < 1e-14 for m in matrices.values()),
            remark=order,
        ),
        claim(
            "4.6.3",
            "the other entry, of A to F",
            "smaller",
            ", ".join(f"{abs(matrix[0, 0]):.4g}" for matrix in matrices.values()),
            all(matrix[0, 0] < 1.0 for matrix in matrices.values()),
        ),
        claim(
            "4.6.3",
            "the other entry of E and F is the foot mass 0.1, 0.05",
            "0.1, 0.05",
            f"{matrices['E'][0, 0]:.12g}, {matrices['F'][0, 0]:.12g}",
            bool(
                abs(matrices["E"][0, 0] - 0.1) < 1e-14 and abs(matrices["F"][0, 0] - 0.05) < 1e-14
            ),
            remark="Not just asymptotically: the hip's mass lies on the line of the legs.",
        ),
    ]
    low, high = 1e-7, 1e-4
    change = max(
        abs(gait(tuned(n), high, k).step_period / gait(tuned(n), low, k).step_period - 1.0)
        for n in "ABCDEF"
        for k in ("long", "short")
    )  # fmt: skip
    share = {
        slope: gait(tuned("C"), slope).kneestrike_loss / gait(tuned("C"), slope).collision_loss
        for slope in (0.05, 1e-2, 1e-4, 1e-7)
    }
    rows += [
        claim(
            "4.6.3",
            "step periods are about constant at small slopes: largest change from 1e-7 to 1e-4",
            "about constant",
            f"{change:.1%}",
            change < 0.05,
            remark="Both gaits of A to F.",
        ),
        claim(
            "4.6.3",
            "C: the knee collision's share of the loss, at 0.05, 0.01, 1e-4, 1e-7",
            "dominates eventually",
            ", ".join(f"{value:.3f}" for value in share.values()),
            bool(np.all(np.diff(list(share.values())) > 0.0) and share[1e-7] > 0.5),
        ),
    ]
    return rows
