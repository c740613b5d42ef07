"""The laboratory's walker: Table 4.2, and sections 4.2, 4.3.1 and 4.3.2 on what a walk takes."""

from __future__ import annotations

from gym_passive_walker.gaits.fixed_point import find_gaits
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.gaits.reality import reality_check
from gym_passive_walker.validation.rows import Row, claim, gait, number, tuned
from gym_passive_walker.walkers import lab_walker_from_parts

_CAPTION, _PARTS = "lab", lab_walker_from_parts()

_MEASURES = {
    "step period (s)": lambda gait: gait.step_period,
    "step length (m)": lambda gait: gait.step_length,
    "step velocity (m/s)": lambda gait: gait.speed,
    "nondimensional velocity": lambda gait: gait.froude_speed,
    "stance angle (rad)": lambda gait: gait.stance_angle,
}
# Slope: simulation and experiment as printed, and the computed number on record.
_TABLE = {
    0.034: (
        ("0.77", "0.78", "0.7658"),
        ("0.38", "0.37", "0.3750"),
        ("0.49", "0.47", "0.4897"),
        ("0.17", "0.17", "0.1737"),
        ("0.24", "0.23", "0.2342"),
    ),
    0.045: (
        ("0.72", "0.77", "0.7186"),
        ("0.44", "0.45", "0.4413"),
        ("0.61", "0.58", "0.6141"),
        ("0.22", "0.21", "0.2179"),
        ("0.27", "0.28", "0.2764"),
    ),
    0.052: (
        ("0.68", "0.77", "0.6780"),
        ("0.46", "0.46", "0.4669"),
        ("0.68", "0.60", "0.6887"),
        ("0.24", "0.21", "0.2443"),
        ("0.29", "0.29", "0.2927"),
    ),
}


def table() -> list[Row]:
    """Table 4.2, both columns."""
    rows = []
    for slope, lines in _TABLE.items():
        walks, weighed = gait(_CAPTION, slope), gait(_PARTS, slope)
        for (what, measure), (simulation, experiment, known) in zip(
            _MEASURES.items(), lines, strict=True
        ):
            value = measure(walks)
            row = number("Table 4.2", f"{what} at {slope}, simulation", simulation, value)
            remark = (
                ""
                if row.agrees
                else "Less than one unit in the last printed digit; the walker of the appendix's "
                f"parts has {measure(weighed):.4f}."
            )
            rows.append(
                number(row.where, row.what, simulation, value, known=known, digits=4, remark=remark)
            )
            rows.append(
                number(
                    "Table 4.2",
                    f"{what} at {slope}, experiment",
                    experiment,
                    value,
                    within=abs(float(simulation) - float(experiment)) + 0.01,
                    digits=4,
                )
            )
    walks = gait(_CAPTION, 0.034)
    off = max(abs(walks.step_period / 0.78 - 1.0), abs(walks.step_length / 0.37 - 1.0))
    rows += [
        claim(
            "4.2",
            "step period and length against the machine's at Fig. 4.3's slope",
            "within about 5 %",
            f"within {off:.1%}",
            off < 0.05,
            remark="Taken at 0.034, Table 4.2's slope nearest to Fig. 4.3's 0.036.",
        ),
        claim(
            "4.2",
            "slope that McGeer's walks need at least, and this page's",
            "0.005, and none",
            f"C walks stably at 0.005 and at {gait(tuned('C'), 1e-8).slope:g}",
            gait(tuned("C"), 0.005).stable and gait(tuned("C"), 1e-8).stable,
        ),
    ]
    return rows


def maps() -> list[Row]:
    """Section 4.3.1."""
    walks = gait(_CAPTION, 0.036)
    counts = [len(find_gaits(_CAPTION, slope)) for slope in (0.015, 0.03, 0.045)]
    sizes = ", ".join(f"{abs(value):.4g}" for value in walks.multipliers[:-1])
    return [
        claim(
            "4.3.1",
            "least of a kneed walker's four multipliers (McGeer printed −0.001)",
            "exactly 0",
            "0 to rounding" if abs(walks.multipliers[-1]) < 1e-12 else "not 0",
            abs(walks.multipliers[-1]) < 1e-12,
            remark=f"The lab walker at 0.036; the moduli of the others are {sizes}.",
        ),
        claim("Fig. 4.3", "the gait at 0.036 is stable", "stable", _stability(walks), walks.stable),
        claim(
            "4.3.1",
            "gaits at a slope",
            "0, 1 or 2",
            ", ".join(str(count) for count in counts),
            counts == [0, 1, 2],
            remark="The lab walker at 0.015, 0.03 and 0.045.",
        ),
    ]


def _stability(walks: Gait) -> str:
    return f"largest multiplier {abs(walks.multipliers[0]):.4g}"


def reality() -> list[Row]:
    """Section 4.3.2: what the model takes of ground and knees."""
    walks = gait(_CAPTION, 0.036)
    here = reality_check(_CAPTION, 0.036, walks.state)
    straight = {
        name: reality_check(name, slope, gait(name, slope).state).clearance.value
        for name, slope in (("A", 0.02), ("B", 0.02), ("E", 0.02), ("lab-straight", 0.036))
    }
    steep = {
        slope: reality_check(_CAPTION, slope, gait(_CAPTION, slope).state)
        for slope in (0.034, 0.045, 0.052)
    }
    needed = max(
        friction
        for check in steep.values()
        for friction in (
            check.stance_friction.value,
            check.kneestrike_impulse.friction.value,
            check.heelstrike_impulse.friction.value,
        )
    )
    pull = min(check.least_normal_force.value for check in steep.values())
    speeds = [gait(_CAPTION, slope).froude_speed for slope in steep]
    flexed = tuned("C")
    bent = reality_check(flexed, 1e-3, gait(flexed, 1e-3, "short").state).knee_flexion.value
    weight = walks.stride.weight
    unlocking = here.stance_knee_at_kneestrike.value
    return [
        claim(
            "4.3.2 (1)",
            "straight legs scuff: least clearance of A, B, E, and lab-straight",
            "below 0",
            ", ".join(f"{value:.4f}" for value in straight.values()),
            max(straight.values()) < 0.0,
        ),
        claim(
            "4.3.2 (1)",
            "knees may avoid it: clearance of the lab walker at 0.036 (m)",
            "above 0",
            f"{here.clearance.value:.4g}",
            here.clearance.value > 0.0,
        ),
        claim(
            "Table 4.2",
            "below slopes of about 0.035 the machine scuffed: the model's clearance at 0.034 (m)",
            "0 or below",
            f"{steep[0.034].clearance.value:.4g}",
            steep[0.034].clearance.value <= 0.0,
            expected=False,
            remark="An observation of the machine, which needs more room than the centimetre by "
            "which a rigid walker clears a flat ramp.",
        ),
        claim(
            "4.3.2 (2)",
            "impulse on the stance knee at Fig. 4.3's kneestrike (N·m·s); below 0 it unlocks",
            "slight, unlocking",
            f"{unlocking:.4f}",
            abs(unlocking + 0.02375) < 1e-5,
        ),
        claim(
            "4.3.2 (2)",
            "torques just after kneestrike press the stance knee again: its least in the stride "
            "(N·m)",
            "above 0",
            f"{here.stance_knee_torque.value:.4g}",
            here.stance_knee_torque.value > 0.0,
        ),
        claim(
            "4.3.2 (3)",
            "no contact tension: least normal force over weight in Table 4.2's gaits",
            "above 0",
            f"{pull / weight:.4f}",
            pull > 0.0,
        ),
        claim(
            "4.3.2 (3)",
            "v/√(g l) of Table 4.2's gaits against tension's v ≈ √(g l)",
            "well below 1",
            f"{min(speeds):.3f} to {max(speeds):.3f}",
            max(speeds) < 0.3,
        ),
        claim(
            "4.3.2 (3)",
            "friction that Table 4.2's gaits need at most, impulses included",
            "within 0.8",
            f"{needed:.3f}",
            needed < 0.8,
        ),
        claim(
            "4.3.2 (4)",
            "near zero slope new swing knees hyperextend a little: C's short step at 0.001 (rad)",
            "below 0, small",
            f"{bent:.3g}",
            -0.05 < bent < 0.0,
        ),
    ]
