"""Sections 4.6.1, 4.6.2 and 4.8, Figs. 4.7 to 4.9 and 4.13: walkers tuned for vanishing slopes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import gym_passive_walker as gpw
from gym_passive_walker import WALKERS, Walker
from validation.rows import Row, claim, listed, number
from validation.scaling import exponent_crossings
from validation.walks import (
    BOUND,
    KINDS,
    KNEE_MEETS_HEEL,
    TUNED,
    boundary,
    checked,
    exponents,
    family,
    gait,
    numbers_of_gaits,
)

_LOW = 1e-8


def tuned_walkers() -> Iterator[Row]:
    """Sections 4.6.1 and 4.6.2, except de-tuning."""
    errors = gpw.tuning_errors("lab")
    failed = (errors.collinearity, errors.shank_under_knee)
    said = "4.6.1 | the lab walker fails conditions 3 and 4: by how many leg lengths | not 0"
    yield claim(said, listed(failed, ".5f"), min(abs(error) for error in failed) > 1e-3)
    pair = {name: TUNED[name] for name in "AC"}
    counts = set(numbers_of_gaits(pair.values(), np.geomspace(_LOW, 0.04, 10)))
    rounded = [family(name, 1e-6, 0.1).slope.min() for name in pair]
    yield claim(
        "4.6.2 | tuned A and C walk at near-zero slopes: gaits at each of 10 slopes from 1e-8 "
        "to 0.04 | 2",
        listed(sorted(counts)),
        counts == {2},
        remark="The walkers of the table's rounded digits need slopes of "
        f"{rounded[0]:.1e} and {rounded[1]:.1e} at least.",
    )
    doublings = [family(walker, _LOW, 0.3).period_doublings[0] for walker in pair.values()]
    yield claim(
        "4.6.2 | their long steps are stable at small slopes: up to | stable",
        f"A {doublings[0]:.10f}, C {doublings[1]:.10f}",
        abs(doublings[0] - 0.0642752107) < 1e-9 and abs(doublings[1] - 0.0768533651) < 1e-9,
    )
    short = [family(walker, _LOW, 0.3, "short") for walker in pair.values()]
    unstable = min(np.abs(found.multipliers[:, 0]).min() for found in short)
    said = "4.6.2 | their short steps are unstable: least of the largest multipliers | above 1"
    yield claim(said, f"{unstable:.4f}", unstable > 1.0)
    dips = [checked("C", x).clearance.value / WALKERS["C"].leg_length for x in (0.05, 0.08)]
    yield claim(
        "4.6.2 | some reality checks fail: depth of C's foot in the ground at 0.05 and 0.08, "
        "over l | below 0",
        listed(dips, ".2%"),
        abs(dips[0] + 0.00620) < 1e-5 and abs(dips[1] + 0.00953) < 1e-5,
    )
    none = numbers_of_gaits([TUNED["lab"]], (1e-6, 1e-3, 0.02, 0.05))
    begin = family(TUNED["lab"], 0.2, 0.5).folds[0]
    said = (
        "4.6.1 | a design that meets the conditions, its mass near the hip, walks near zero slope: "
        "gaits of the lab walker with w_t, w_s tuned, at 1e-6, 0.001, 0.02, 0.05 | some"
    )
    why = (
        "The conditions are necessary only, as 4.6.1 says. C differs in its gyration radii as "
        "well; on the way from C the long and the short step meet and end at 26 % as the slope "
        f"vanishes. Walks of the tuned lab walker begin at {begin:.5f}."
    )
    yield claim(said, listed(none), sum(none) > 0, expected=False, remark=why)
    yield from _tuned_over_untuned()


def _tuned_over_untuned() -> Iterator[Row]:
    """Rows of section 4.6.2 on step length, speed and period of tuned and untuned walkers."""
    pairs = [
        (gait(TUNED[name], slope), gait(untuned, slope))
        for slope in (0.025, 0.035, 0.045)
        for name, untuned in (("C", "lab"), ("A", "lab-straight"))
    ]
    angles, speeds, periods = (
        [getattr(a, measure) / getattr(b, measure) for a, b in pairs]
        for measure in ("stance_angle", "speed", "step_period")
    )
    said = (
        "4.6.2 | tuned walkers take longer steps than untuned ones: C over lab, A over "
        "lab-straight, at 0.025, 0.035, 0.045 | above 1"
    )
    yield claim(said, listed(angles, ".3f"), min(angles) > 1.0)
    said = "4.6.2 | and are faster: the same of speed | above 1"
    yield claim(said, listed(speeds, ".3f"), min(speeds) > 1.0)
    said = "4.6.2 | as their step periods are about the same: the same of period | about 1"
    yield claim(said, listed(periods, ".3f"), all(abs(period - 1.0) < 0.3 for period in periods))


def de_tuned(fraction: float) -> Walker:
    """The walker between the tuned kneed walker C (0) and the laboratory's walker (1)."""
    return gpw.interpolate(TUNED["C"], "lab", fraction)


def de_tuning() -> Iterator[Row]:
    """Fig. 4.8: gaits of walkers between the tuned kneed walker C and the laboratory's walker."""
    long, short = (
        [family(de_tuned(fraction), 1e-4, 0.12, kind) for fraction in (0.05, 0.2, 0.4)]
        for kind in KINDS
    )
    # Branches begin at their slow end, which is unstable up to the fold.
    for where, what, printed, values, form in (
        ("Fig. 4.8 (1)",
         "slope below which there is no long step, at 5, 20, 40 % de-tuned",
         "moves right",
         [found.folds[0] for found in long], ".6f"),
        ("Fig. 4.8 (1)",
         "an unstable region at very low speeds: v/√(g l) up to which it goes",
         "appears",
         [found.froude_speed[np.argmax(found.stable)] for found in long], ".4f"),
        ("Fig. 4.8 (2)",
         "slope where the short step's curve ends, at 5, 20, 40 %",
         "moves right and up",
         [found.ends[0].value for found in short], ".6f"),
    ):  # fmt: skip
        grows = np.all(np.diff([0.0, *values]) > 0.0)
        yield claim(f"{where} | {what} | {printed}", listed(values, form), grows)
    reasons = [found.ends[0].reason for found in short]
    yield claim(
        f"Fig. 4.8 (2) | how it ends there | {KNEE_MEETS_HEEL}",
        "; ".join(reasons),
        all(reason == KNEE_MEETS_HEEL for reason in reasons),
        expected=False,
        remark="Hardly de-tuned, the curve ends sooner: its heelstrike becomes tangential.",
    )

    def one_curve(fraction: float) -> bool:
        return family(de_tuned(fraction), 0.05, 0.16, "long", 0.1).slope.max() >= 0.15

    apart, together = boundary(0.70, 0.75, one_curve, 5e-4)
    meeting = max(family(de_tuned(together), 0.05, 0.16, "long", 0.1).folds)
    yield claim(
        "Fig. 4.8 (3) | long and short step meet and part again | between (d) and (f)",
        f"at {100.0 * apart:.1f} % and slope {meeting:.4f}",
        0.722 < apart < 0.726 and abs(meeting - 0.099) < 3e-3,
    )
    above = family("lab", 0.1, 0.3).folds[0]
    said = (
        "Fig. 4.8 (3) | gaits of the lab walker at higher slopes, not visible in (f) | presumably"
    )
    yield claim(said, f"from {above:.8f} on", abs(above - 0.16372248) < 1e-7)
    straight = [
        gpw.interpolate(TUNED["A"], "lab-straight", fraction)
        for fraction in (0.0, 0.25, 0.5, 0.75, 1.0)
    ]
    separate = all(
        family(walker, 0.07, 0.3, kind, 0.1).ends[1].reason == BOUND
        for walker in straight
        for kind in KINDS
    )
    said = (
        "Fig. 4.8 (3) | straight legs do not do this: both steps of A reach slope 0.3 at 0, "
        "25, 50, 75, 100 % | does not occur"
    )
    yield claim(said, "does not" if separate else "does", separate)


def observations() -> Iterator[Row]:
    """The observations under Figs. 4.9 and 4.13, and section 4.8."""
    counts = set(numbers_of_gaits([TUNED[name] for name in "ABCDE"], (1e-8, 1e-4, 1e-2, 0.1)))
    said = "Fig. 4.9 (1) | gaits of A to E at 1e-8, 1e-4, 0.01, 0.1 | 2"
    yield claim(said, listed(sorted(counts)), counts == {2})
    powers = {
        (name, kind): exponents(TUNED[name], 1e-7, kind)[0] for name in "ABCDE" for kind in KINDS
    }
    for (name, kind), power in powers.items():
        cube_root = name == "D" or (kind == "long" and name != "C")
        what = f"{name}, {kind} step: power of γ at 1e-7"
        yield number(f"Fig. 4.9 (2–4) | {what} | {'1/3' if cube_root else '1'}", power, within=1e-3)
    long, steep = ([exponents(TUNED[name], 0.03, kind)[0] for name in "ABE"] for kind in KINDS)
    yield claim(
        "Fig. 4.9 (3) | above 0.01 all steps go with γ^(1/3): powers of A, B, E at 0.03, "
        "short; long | 1/3",
        f"{listed(steep, '.3f')}; {listed(long, '.3f')}",
        max(abs(power - 1 / 3) for power in steep + long) < 0.05,
        expected=False,
        remark="Long steps do; short ones only tend to, as far as a log-log plot shows.",
    )
    said = (
        "Fig. 4.9 (4) | slope where C's long step turns to proportion: its power of γ is 2/3 "
        "| 0.00015"
    )
    yield number(said, float(exponent_crossings(family(TUNED["C"], _LOW, 0.3))[0]), digits=4)
    bends = [exponents(TUNED["C"], slope)[0] for slope in (1e-3, 1e-2)]
    said = (
        "Fig. 4.9 (4) | C's long step nearly goes with γ^(1/3) over the figure's slopes: "
        "power at 0.001, 0.01 | about 1/3"
    )
    yield claim(said, listed(bends, ".3f"), abs(bends[-1] - 1 / 3) < 0.05)
    stable = [_stable_up_to(name) for name in "ABCDEF"]
    yield claim(
        "Fig. 4.9 (5), 4.8 | A, B, C, D, E, F: slope up to which the long step is stable, "
        "down to zero | each has one",
        ", ".join(f"{value:.7f}" if value else "none" for value in stable),
        all(stable),
        expected=False,
        remark="E's is unstable at every slope.",
    )
    least = min(powers.values())
    said = "4.6.2 | no step grows slower than γ^(1/3) at small slopes: least power at 1e-7 | 1/3"
    yield claim(said, f"{least:.6f}", least > 1 / 3 - 1e-4)


def _stable_up_to(name: str) -> float:
    """Slope in rad up to which a tuned walker's long step is stable; 0 if unstable throughout."""
    found = family(TUNED[name], _LOW, 0.3)
    return found.period_doublings[0] if found.stable[0] else 0.0
