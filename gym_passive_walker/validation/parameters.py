"""The walkers themselves: Table 4.1, the captions of Figs. 4.3 and 4.5, and appendix 4.10.1."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gym_passive_walker.gaits.fixed_point import find_gait
from gym_passive_walker.physics.stride import stride
from gym_passive_walker.validation.rows import Row, claim, gait, number
from gym_passive_walker.walkers import (
    WALKERS,
    Part,
    combine,
    lab_walker_from_parts,
    tuning_errors,
)

# As printed: A, B, C, D, E of Table 4.1, and the laboratory's walker of Fig. 4.3's caption.
_PRINTED = {
    "thigh_length": ("l_t", "0.35", "0.5", "0.35", "0.5", "0.5", "0.35"),
    "thigh_offset": ("w_t", "-0.023", "0", "-0.023", "0", "0", "0"),
    "thigh_mass": ("m_t", "2.345", "0.4", "2.345", "∞", "0.4", "2.345"),
    "thigh_gyration": ("r_t", "0.1882", "0", "0.1882", "0", "0", "0.099"),
    "thigh_com": ("c_t", "0.084", "0", "0.084", "0", "0", "0.091"),
    "shank_length": ("l_s", "0.46", "0.5", "0.46", "0.5", "0.5", "0.46"),
    "shank_offset": ("w_s", "0.022", "0", "0.022", "0", "0", "0.025"),
    "shank_mass": ("m_s", "1.013", "0.1", "1.013", "1", "0.1", "1.013"),
    "shank_gyration": ("r_s", "0.1226", "0", "0.1226", "0", "0", "0.197"),
    "shank_com": ("c_s", "0.17", "0.5", "0.17", "0.5", "0.5", "0.17"),
    "foot_radius": ("R", "0.2", "0.2", "0.2", "0", "0", "0.2"),
    "foot_angle": ("ε_T", "0.097", "0", "0.097", "0", "0", "0.097"),
}
_OF_LEGS_MASS = ("thigh_mass", "shank_mass", "shank_com")


def table() -> list[Row]:
    """Table 4.1 and the walkers of the captions."""
    rows = []
    for name, (symbol, *printed) in _PRINTED.items():
        of_mass = name in _OF_LEGS_MASS
        values = [getattr(WALKERS[walker], name) for walker in "ABCDE"]
        pairs = [
            (value, float(text))
            for walker, value, text in zip("ABCDE", values, printed, strict=False)
            if not (walker == "D" and of_mass)
        ]
        rows.append(
            claim(
                "Table 4.1",
                f"{symbol} of A, B, C, D, E",
                ", ".join(printed[:5]),
                ", ".join(f"{value:g}" for value in values),
                all(value == text for value, text in pairs),
                remark="D is the limit m_t/m_s → ∞: a hip mass on legs without mass."
                if of_mass
                else "",
            )
        )
    point_foot = replace(WALKERS["E"], thigh_mass=0.5, shank_mass=1e-6)
    off = gait(point_foot, 0.009).stance_angle / gait("D", 0.009).stance_angle - 1.0
    rows += [
        number(
            "Table 4.1",
            "D as a limit: stance angle at slope 0.009 with m_t/m_s = 5·10⁵, relative to D's",
            "0",
            off,
            within=1e-5,
            digits=2,
        ),
        claim(
            "Fig. 4.5",
            "F: foot mass, hip mass",
            "0.05, 0.9",
            f"{WALKERS['F'].shank_mass:g}, {2.0 * WALKERS['F'].thigh_mass:g}",
            (WALKERS["F"].shank_mass, 2.0 * WALKERS["F"].thigh_mass) == (0.05, 0.9),
        ),
    ]
    worst = {name: max(abs(error) for error in tuning_errors(WALKERS[name])) for name in "ABCDE"}
    rows.append(
        claim(
            "Fig. 4.7",
            "A to E are tuned: largest violation of the conditions, in leg lengths",
            "0, 0, 0, 0, 0",
            ", ".join(f"{value:.1e}" for value in worst.values()),
            max(worst.values()) < 1e-15,
            expected=False,
            remark="A and C are printed to two digits, which meet the conditions only roughly. "
            "Where this page says that they are tuned, `tune` has moved w_t to −0.022886 and "
            "w_s to 0.022354, both of which round to the printed digits.",
        )
    )
    return rows


def laboratory() -> list[Row]:
    """The laboratory's walker from its weighed parts, and the appendix's fixed point."""
    walker = lab_walker_from_parts()
    # The document lumps half the hip's mass into each thigh; here it is kept apart.
    hip = Part(mass=0.5 * walker.hip_mass, com=0.0)
    thigh = Part(
        walker.thigh_mass,
        walker.thigh_com,
        walker.thigh_offset,
        walker.thigh_mass * walker.thigh_gyration**2,
    )
    whole = combine([thigh, hip])
    lumped = replace(
        walker,
        thigh_mass=whole.mass,
        thigh_com=whole.com,
        thigh_gyration=(whole.inertia / whole.mass) ** 0.5,
        hip_mass=0.0,
    )
    rows = [
        number(
            "Fig. 4.3, 4.10.1",
            f"{symbol} of the laboratory's walker, from the script's parts",
            printed[-1],
            getattr(lumped, name),
            within=5e-7 if printed[-1] == "0" else None,
        )
        for name, (symbol, *printed) in _PRINTED.items()
    ]
    captions = [getattr(WALKERS["lab"], name) == float(p[-1]) for name, p in _PRINTED.items()]
    rows += [
        claim(
            "Fig. 4.3",
            "walker `lab` has the caption's parameters and g = 9.81",
            "12 and g",
            f"{sum(captions)} and g",
            all(captions) and WALKERS["lab"].gravity == 9.81,
        ),
        number(
            "4.10.1",
            "η_k: angle between thigh and shank lines, ε_T + ε_F",
            "0.228",
            walker.foot_angle + walker.shank_angle,
            digits=10,
        ),
    ]
    found = find_gait(walker, 0.036)
    relative = np.diff(found.state[3:], prepend=0.0)
    why = (
        "The printed point misses itself by 3·10⁻⁵ after one stride, so this is how far its own "
        "search was taken."
    )
    rows.append(
        number(
            "4.10.1",
            "fixed point at slope 0.036: θ₁",
            "0.24395121657117",
            found.stance_angle,
            within=5e-6,
            digits=12,
            remark=why,
        )
    )
    printed = ("-1.04911493167539", "0.74757611863057", "-1.18161338996657")
    rows += [
        number(
            "4.10.1",
            f"the same: {name}, of each link relative to the one before",
            text,
            float(value),
            within=5e-5,
            digits=12,
            remark=why,
        )
        for name, text, value in zip(("θ̇₁", "θ̇₂", "θ̇₃"), printed, relative, strict=True)
    ]
    moved = np.abs(stride(walker, 0.0495, found.state).state - found.state).max()
    rows.append(
        claim(
            "4.10.1",
            "the script sets the slope 0.0495, its fixed point is commented as that of 0.036: "
            "largest change of the point in a stride at 0.0495",
            "slope of the comment",
            f"{moved:.2g}",
            moved > 0.01,
            remark="So the comment is right and the script's slope is another run's.",
        )
    )
    return rows
