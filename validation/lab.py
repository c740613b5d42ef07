"""The laboratory's walker: Table 4.2, and sections 4.2, 4.3.1 and 4.3.2 (feasibility)."""

from __future__ import annotations

from collections.abc import Iterator

import gym_passive_walker as gpw
from validation.rows import Row, claim, listed, number
from validation.walks import TUNED, checked, gait, numbers_of_gaits

_SLOPES = (0.034, 0.045, 0.052)
# Table 4.2: at each slope the printed simulation and experiment, and the recorded computed value.
_TABLE = {
    "step period (s)": ("step_period", "0.77 0.78 0.7658", "0.72 0.77 0.7186", "0.68 0.77 0.6780"),
    "step length (m)": ("step_length", "0.38 0.37 0.3750", "0.44 0.45 0.4413", "0.46 0.46 0.4669"),
    "step velocity (m/s)": ("speed", "0.49 0.47 0.4897", "0.61 0.58 0.6141", "0.68 0.60 0.6887"),
    "nondimensional velocity": (
        "froude_speed", "0.17 0.17 0.1737", "0.22 0.21 0.2179", "0.24 0.21 0.2443",
    ),
    "stance angle (rad)": (
        "stance_angle", "0.24 0.23 0.2342", "0.27 0.28 0.2764", "0.29 0.29 0.2927",
    ),
}  # fmt: skip


def table() -> Iterator[Row]:
    """Table 4.2, both columns."""
    weighed = gpw.lab_walker_from_parts()
    for i, slope in enumerate(_SLOPES):
        for what, (measure, *columns) in _TABLE.items():
            simulation, experiment, known = columns[i].split()
            value = getattr(gait("lab", slope), measure)
            said = f"Table 4.2 | {what} at {slope}, simulation | {simulation}"
            row = number(said, value, known=known, digits=4)
            why = (
                "Less than one unit in the last printed digit; the walker of the appendix's parts "
                f"has {getattr(gait(weighed, slope), measure):.4f}."
            )
            yield row if row.agrees else row._replace(remark=why)
            said = f"Table 4.2 | {what} at {slope}, experiment | {experiment}"
            apart = abs(float(simulation) - float(experiment))
            yield number(said, value, within=apart + 0.01, digits=4)
    walks = gait("lab", 0.034)
    off = max(abs(walks.step_period / 0.78 - 1.0), abs(walks.step_length / 0.37 - 1.0))
    said = (
        "4.2 | step period and length against the machine's at Fig. 4.3's slope | within about 5 %"
    )
    why = "Taken at 0.034, Table 4.2's slope nearest to Fig. 4.3's 0.036."
    yield claim(said, f"within {off:.1%}", off < 0.05, remark=why)
    shallow = gait(TUNED["C"], 1e-8)
    yield claim(
        "4.2 | slope that McGeer's walks need at least, and this page's | 0.005, and none",
        f"C walks stably at 0.005 and at {shallow.slope:g}",
        gait(TUNED["C"], 0.005).stable and shallow.stable,
    )


def maps() -> Iterator[Row]:
    """Section 4.3.1: the return map and its Floquet multipliers."""
    walks = gait("lab", 0.036)
    sizes = [abs(value) for value in walks.multipliers]
    said = "4.3.1 | least of a kneed walker's four multipliers (McGeer printed −0.001) | exactly 0"
    why = f"The lab walker at 0.036; the moduli of the others are {listed(sizes[:-1], '.4g')}."
    yield claim(
        said, "0 to rounding" if sizes[-1] < 1e-12 else "not 0", sizes[-1] < 1e-12, remark=why
    )
    largest = f"largest multiplier {sizes[0]:.4g}"
    yield claim("Fig. 4.3 | the gait at 0.036 is stable | stable", largest, walks.stable)
    counts = numbers_of_gaits(["lab"], (0.015, 0.03, 0.045))
    said = "4.3.1 | gaits at a slope | 0, 1 or 2"
    why = "The lab walker at 0.015, 0.03 and 0.045."
    yield claim(said, listed(counts), counts == [0, 1, 2], remark=why)


def reality() -> Iterator[Row]:
    """Section 4.3.2: feasibility constraints on the ground contact and the knees."""
    here = checked("lab", 0.036)
    legs = (("A", 0.02), ("B", 0.02), ("E", 0.02), ("lab-straight", 0.036))
    straight = [checked(name, slope).clearance.value for name, slope in legs]
    said = "4.3.2 (1) | straight legs scuff: least clearance of A, B, E, and lab-straight | below 0"
    yield claim(said, listed(straight, ".4f"), max(straight) < 0.0)
    said = "4.3.2 (1) | knees may avoid it: clearance of the lab walker at 0.036 (m) | above 0"
    yield claim(said, f"{here.clearance.value:.4g}", here.clearance.value > 0.0)
    tabled = [checked("lab", slope) for slope in _SLOPES]
    clearance = tabled[0].clearance.value
    yield claim(
        "Table 4.2 | below slopes of about 0.035 the machine scuffed: the model's clearance "
        "at 0.034 (m) | 0 or below",
        f"{clearance:.4g}",
        clearance <= 0.0,
        expected=False,
        remark="An observation of the machine, which needs more room than the centimetre by which "
        "a rigid walker clears a flat ramp.",
    )
    unlocking = here.stance_knee_at_kneestrike.value
    said = (
        "4.3.2 (2) | impulse on the stance knee at Fig. 4.3's kneestrike (N·m·s); below 0 it "
        "unlocks | slight, unlocking"
    )
    yield claim(said, f"{unlocking:.4f}", abs(unlocking + 0.02375) < 1e-5)
    said = (
        "4.3.2 (2) | torques just after kneestrike press the stance knee again: its least in "
        "the stride (N·m) | above 0"
    )
    yield claim(said, f"{here.stance_knee_torque.value:.4g}", here.stance_knee_torque.value > 0.0)
    pull = min(check.least_normal_force.value for check in tabled)
    said = (
        "4.3.2 (3) | no contact tension: least normal force over weight in Table 4.2's gaits "
        "| above 0"
    )
    yield claim(said, f"{pull / gait('lab', 0.036).stride.weight:.4f}", pull > 0.0)
    speeds = [gait("lab", slope).froude_speed for slope in _SLOPES]
    said = "4.3.2 (3) | v/√(g l) of Table 4.2's gaits against tension's v ≈ √(g l) | well below 1"
    yield claim(said, f"{min(speeds):.3f} to {max(speeds):.3f}", max(speeds) < 0.3)
    needed = max(
        needs.value
        for check in tabled
        for needs in (
            check.stance_friction,
            check.kneestrike_impulse.needed_friction,
            check.heelstrike_impulse.needed_friction,
        )
    )
    said = (
        "4.3.2 (3) | friction that Table 4.2's gaits need at most, impulses included | within 0.8"
    )
    yield claim(said, f"{needed:.3f}", needed < 0.8)
    bent = checked(TUNED["C"], 1e-3, "short").knee_flexion.value
    said = (
        "4.3.2 (4) | near zero slope new swing knees hyperextend a little: C's short step at "
        "0.001 (rad) | below 0, small"
    )
    yield claim(said, f"{bent:.3g}", -0.05 < bent < 0.0)
