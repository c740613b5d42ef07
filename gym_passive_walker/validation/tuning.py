"""Sections 4.6.1, 4.6.2 and 4.8, Figs. 4.7, 4.9 and 4.13: walkers tuned for vanishing slopes."""

from __future__ import annotations

import numpy as np

from gym_passive_walker.gaits.fixed_point import find_gaits
from gym_passive_walker.gaits.gait import GaitKind
from gym_passive_walker.gaits.reality import reality_check
from gym_passive_walker.gaits.scaling import exponent_crossings
from gym_passive_walker.validation.rows import Row, claim, exponents, family, gait, number, tuned
from gym_passive_walker.walkers import WALKERS, tune, tuning_errors

_KINDS: tuple[GaitKind, GaitKind] = ("long", "short")
_LOW = 1e-8


def tuned_walkers() -> list[Row]:
    """Sections 4.6.1 and 4.6.2, but for de-tuning."""
    counts = {
        len(find_gaits(tuned(name), slope))
        for name in "AC"
        for slope in np.geomspace(_LOW, 0.04, 10)
    }
    errors = tuning_errors(WALKERS["lab"])
    table = {name: family(name, 1e-6, 0.1) for name in "AC"}
    doublings = {name: family(tuned(name), _LOW, 0.3).period_doublings[0] for name in "AC"}
    unstable = min(
        np.abs(family(tuned(name), _LOW, 0.3, "short").multipliers[:, 0]).min() for name in "AC"
    )
    both = {
        slope: [gait(tuned("C"), slope), gait("lab", slope), gait(tuned("A"), slope),
                gait("lab-straight", slope)]
        for slope in (0.025, 0.035, 0.045)
    }  # fmt: skip
    pairs = [pair for four in both.values() for pair in (four[:2], four[2:])]
    dips = [
        reality_check("C", slope, gait("C", slope).state).clearance.value / WALKERS["C"].leg_length
        for slope in (0.05, 0.08)
    ]
    steep = family(tune(WALKERS["lab"]), 0.2, 0.5)
    none = [len(find_gaits(tune(WALKERS["lab"]), slope)) for slope in (1e-6, 1e-3, 0.02, 0.05)]
    return [
        claim(
            "4.6.1",
            "the lab walker fails conditions 3 and 4: by how many leg lengths",
            "not 0",
            f"{errors.collinearity:.5f}, {errors.shank_under_knee:.5f}",
            min(abs(errors.collinearity), abs(errors.shank_under_knee)) > 1e-3,
        ),
        claim(
            "4.6.2",
            "tuned A and C walk at near-zero slopes: gaits at each of 10 slopes from 1e-8 to 0.04",
            "2",
            ", ".join(str(count) for count in sorted(counts)),
            counts == {2},
            remark="The walkers of the table's rounded digits need slopes of "
            f"{min(table['A'].slope):.1e} and {min(table['C'].slope):.1e} at least.",
        ),
        claim(
            "4.6.2",
            "their long steps are stable at small slopes: up to",
            "stable",
            f"A {doublings['A']:.10f}, C {doublings['C']:.10f}",
            abs(doublings["A"] - 0.0642752107) < 1e-9 and abs(doublings["C"] - 0.0768533651) < 1e-9,
        ),
        claim(
            "4.6.2",
            "their short steps are unstable: least of the largest multipliers",
            "above 1",
            f"{unstable:.4f}",
            bool(unstable > 1.0),
        ),
        claim(
            "4.6.2",
            "some reality checks fail: depth of C's foot in the ground at 0.05 and 0.08, over l",
            "below 0",
            ", ".join(f"{dip:.2%}" for dip in dips),
            abs(dips[0] + 0.00620) < 1e-5 and abs(dips[1] + 0.00953) < 1e-5,
        ),
        claim(
            "4.6.1",
            "a design that meets the conditions, its mass near the hip, walks near zero slope: "
            "gaits of the lab walker with w_t, w_s tuned, at 1e-6, 0.001, 0.02, 0.05",
            "some",
            ", ".join(str(count) for count in none),
            sum(none) > 0,
            expected=False,
            remark="The conditions are necessary only, as 4.6.1 says. C differs in its gyration "
            "radii as well; on the way from C the long and the short step meet and end at 26 % as "
            f"the slope vanishes. Walks of the tuned lab walker begin at {steep.folds[0]:.5f}.",
        ),
        claim(
            "4.6.2",
            "tuned walkers take longer steps than untuned ones: C over lab, A over lab-straight, "
            "at 0.025, 0.035, 0.045",
            "above 1",
            ", ".join(f"{a.stance_angle / b.stance_angle:.3f}" for a, b in pairs),
            all(a.stance_angle > b.stance_angle for a, b in pairs),
        ),
        claim(
            "4.6.2",
            "and are faster: the same of speed",
            "above 1",
            ", ".join(f"{a.speed / b.speed:.3f}" for a, b in pairs),
            all(a.speed > b.speed for a, b in pairs),
        ),
        claim(
            "4.6.2",
            "as their step periods are about the same: the same of period",
            "about 1",
            ", ".join(f"{a.step_period / b.step_period:.3f}" for a, b in pairs),
            all(abs(a.step_period / b.step_period - 1.0) < 0.3 for a, b in pairs),
        ),
    ]


def observations() -> list[Row]:
    """The observations under Figs. 4.9 and 4.13, and section 4.8."""
    counts = {
        len(find_gaits(tuned(name), slope)) for name in "ABCDE" for slope in (1e-8, 1e-4, 1e-2, 0.1)
    }
    rows = [
        claim(
            "Fig. 4.9 (1)",
            "gaits of A to E at 1e-8, 1e-4, 0.01, 0.1",
            "2",
            ", ".join(str(count) for count in sorted(counts)),
            counts == {2},
        )
    ]
    powers = {
        (name, kind, slope): exponents(tuned(name), slope, kind)[0]
        for name in "ABCDE"
        for kind in _KINDS
        for slope in (1e-7, 0.03)
    }
    for name in "ABCDE":
        for kind in _KINDS:
            cube_root = name == "D" or (kind == "long" and name != "C")
            rows.append(
                number(
                    "Fig. 4.9 (2–4)",
                    f"{name}, {kind} step: power of γ at 1e-7",
                    "1/3" if cube_root else "1",
                    powers[name, kind, 1e-7],
                    within=1e-3,
                )
            )
    steep = [powers[name, "short", 0.03] for name in "ABE"]
    long = [powers[name, "long", 0.03] for name in "ABE"]
    turn = float(exponent_crossings(family(tuned("C"), _LOW, 0.3))[0])
    stable = {name: _stable_up_to(name) for name in "ABCDEF"}
    rows += [
        claim(
            "Fig. 4.9 (3)",
            "above 0.01 all steps go with γ^(1/3): powers of A, B, E at 0.03, short; long",
            "1/3",
            f"{_list(steep)}; {_list(long)}",
            max(abs(power - 1 / 3) for power in steep + long) < 0.05,
            expected=False,
            remark="Long steps do; short ones only tend to, as far as a log-log plot shows.",
        ),
        number(
            "Fig. 4.9 (4)",
            "slope where C's long step turns to proportion: its power of γ is 2/3",
            "0.00015",
            turn,
            digits=4,
        ),
        claim(
            "Fig. 4.9 (4)",
            "C's long step nearly goes with γ^(1/3) over the figure's slopes: power at 0.001, 0.01",
            "about 1/3",
            _list([exponents(tuned("C"), slope, "long")[0] for slope in (1e-3, 1e-2)]),
            abs(exponents(tuned("C"), 1e-2, "long")[0] - 1 / 3) < 0.05,
        ),
        claim(
            "Fig. 4.9 (5), 4.8",
            "A, B, C, D, E, F: slope up to which the long step is stable, down to zero",
            "each has one",
            ", ".join(f"{value:.7f}" if value else "none" for value in stable.values()),
            all(stable.values()),
            expected=False,
            remark="E's is unstable at every slope.",
        ),
        claim(
            "4.6.2",
            "no step grows slower than γ^(1/3) at small slopes: least power at 1e-7",
            "1/3",
            f"{min(powers[key] for key in powers if key[2] == 1e-7):.6f}",
            min(powers[key] for key in powers if key[2] == 1e-7) > 1 / 3 - 1e-4,
        ),
    ]
    return rows


def _list(values: list[float]) -> str:
    return ", ".join(f"{value:.3f}" for value in values)


def _stable_up_to(name: str) -> float:
    """Where a tuned walker's long step, stable from vanishing slopes on, ceases to be; 0 if not."""
    found = family(tuned(name), _LOW, 0.3)
    return found.period_doublings[0] if found.stable[0] else 0.0
