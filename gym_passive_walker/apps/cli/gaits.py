"""Commands about gaits."""

from __future__ import annotations

from collections import Counter
from typing import Annotated, Any

import numpy as np

from gym_passive_walker._tools.arguments import KEPT, one_slope, whole
from gym_passive_walker.apps.cli.arguments import High, Kind, Low, Machine, Slope, Strides
from gym_passive_walker.apps.cli.report import Report, listing, record, table_rows
from gym_passive_walker.apps.cli.report import table as tabulated
from gym_passive_walker.gaits.branches.bifurcation import bifurcation_diagram
from gym_passive_walker.gaits.branches.family import gait_family
from gym_passive_walker.gaits.find.fixed_point import find_gait, find_gaits
from gym_passive_walker.gaits.look.reality import reality_check
from gym_passive_walker.gaits.robust.basin import FELL, UNSETTLED, basin_of_attraction
from gym_passive_walker.models.units import KINDS
from gym_passive_walker.models.walkers import ABOUT, PARAMETERS, WALKERS, tuning_errors

_GAIT = ("kind", "period", "stance_angle", "state", "step_period", "step_length", "speed")
_GAIT += ("froude_speed", "cost_of_transport", "multipliers", "stable")
_FAMILY = ("slope", "stance_angle", "step_period", "step_length", "speed", "froude_speed")


def walkers() -> Report:
    """List the walkers that come with the package, with a description of each.

    passive-walker walkers
    """
    rows, data = [], []
    for name, walker in WALKERS.items():
        sizes = record(walker, ("leg_length", "total_mass", "foot_radius"))
        errors = tuning_errors(walker)
        off = max(abs(errors.collinearity), abs(errors.shank_under_knee))
        about = {"about": ABOUT[name]}
        rows.append({"name": name, **sizes, "off tuning (legs)": off, **about})
        data.append({"name": name, **sizes, "tuning_errors": errors, **about})
    return Report(tabulated(rows), data)


def table(number: Annotated[str, "number of a table: 4.1 or 4.2"]) -> Report:
    """Recompute a table of Garcia (1999), chapter 4.

    passive-walker table 4.1
    passive-walker table 4.2 --json
    """
    if number == "4.1":
        shape = [name for name in PARAMETERS if KINDS[name] in ("length", "mass", "angle")]
        rows = [
            {"parameter": name, **{who: getattr(WALKERS[who], name) for who in "ABCDE"}}
            for name in shape
        ]
    elif number == "4.2":
        measures = ("slope", "step_period", "step_length", "speed", "froude_speed", "stance_angle")
        gaits = [find_gait("lab", slope) for slope in (0.034, 0.045, 0.052)]
        rows = [record(gait, measures) for gait in gaits]
    else:
        raise ValueError(f"no table {number!r}: choose from 4.1, 4.2")
    return Report(tabulated(rows), rows)


def gait(
    machine: Machine, slope: Slope, *, period: Annotated[int, "period of the gait in strides"] = 1
) -> Report:
    """Find every gait of a walker at a slope, with its measures and its stability.

    passive-walker gait lab 0.036
    passive-walker gait C 0.09 --period 2
    passive-walker gait D 0.0 --push-off 0.05 --dimensionless
    passive-walker gait C 0.0 --controller level-ppo
    passive-walker gait mine.json 0.02 --tune
    """
    strides = machine.map(slope)
    # If there is none, `find_gait` raises an error with the reason; a policy has one gait.
    found = [] if strides.controlled else find_gaits(strides, period=period)
    gaits = found or [find_gait(strides, period=period)]
    shown = [machine.shown(gait) for gait in gaits]
    records = [record(gait, _GAIT) for gait, _ in shown]
    under = f" under {strides.controller_name}" if strides.controlled else ""
    texts = [
        listing(
            f"{gait['kind']}-step gait of {machine.title}{under} at slope {slope:g} rad, "
            f"period {gait['period']}",
            {name: gait[name] for name in _GAIT[2:]},
            units,
        )
        for gait, (_, units) in zip(records, shown, strict=True)
    ]
    return Report("\n\n".join(texts), records)


def family(machine: Machine, low: Low, high: High, *, kind: Kind = "long") -> Report:
    """Continue a branch of gaits over slopes, through folds, to its ends and their reasons.

    passive-walker family lab 0.005 0.1
    passive-walker family C 0.01 0.1 --kind short --json
    passive-walker family D -0.005 0.005 --push-off 0.05
    """
    found = gait_family(machine.map(), low, high, kind)
    view, units = machine.shown(found)
    columns: dict[str, Any] = record(view, _FAMILY)
    shown = columns | {"multiplier": np.abs(found.multipliers[:, 0]), "stable": found.stable}
    columns |= record(found, ("multipliers", "stable"))
    marks = record(found, ("folds", "period_doublings", "neimark_sackers", "halts"))
    facts: dict[str, Any] = {f"{name} (rad)": values for name, values in marks.items()}
    for side, end in zip(("first", "last"), found.ends, strict=True):
        facts[f"{side} end"] = f"{end.value:.8g} rad: {end.reason}"
    title = f"{len(found)} {kind}-step gaits of {machine.title}"
    text = f"{tabulated(table_rows(shown), units)}\n\n{listing(title, facts)}"
    return Report(text, {"gaits": columns, **marks, "ends": found.ends})


def bifurcation(
    machine: Machine,
    low: Low,
    high: High,
    *,
    kind: Kind = "long",
    slopes: Annotated[int, "number of slopes"] = 50,
    n_transient: Annotated[int, "transient strides"] = 500,
    n_recorded: Annotated[int, "recorded strides"] = 64,
) -> Report:
    """Compute a bifurcation diagram: the long-term behaviour of walks over a range of slopes.

    passive-walker bifurcation C 0.07 0.098 --slopes 15
    passive-walker bifurcation C 0.0 0.06 --controller rolling-ppo
    """
    count = whole(slopes, "--slopes", 1, KEPT)
    chosen = np.linspace(one_slope(low, "LOW"), one_slope(high, "HIGH"), count)
    strides = machine.map()
    if strides.passive and chosen.min() <= 0.0:
        raise ValueError("LOW and HIGH must be slopes above 0: only motors walk uphill")
    found = bifurcation_diagram(
        strides, chosen, kind=kind, n_transient=n_transient, n_recorded=n_recorded
    )
    angles = found.stance_angle
    rows = table_rows(
        {
            "slope": found.slope,
            "least stance angle (rad)": angles.min(axis=1),
            "greatest stance angle (rad)": angles.max(axis=1),
            "settles on": [
                "a fall" if not on else f"period {n}" if n else "no period up to 32"
                for on, n in zip(found.walks, found.period, strict=True)
            ],
        }
    )
    return Report(tabulated(rows), record(found, ("slope", "period", "walks", "stance_angle")))


def basin(
    machine: Machine,
    slope: Slope,
    *,
    resolution: Annotated[int, "points of each axis"] = 100,
    strides: Strides = 300,
) -> Report:
    """Count the initial states on a slice through a gait that lead to each gait, or to a fall.

    passive-walker basin lab 0.036 --resolution 100
    """
    found = basin_of_attraction(machine.map(slope), resolution=resolution, strides=strides)
    names = {FELL: "a fall", UNSETTLED: "no gait yet"}
    for i, gait in enumerate(found.gaits):
        names[i] = f"the {gait.kind}-step gait, {gait.stance_angle:.6g} rad"
        names[i] += f", period {gait.period}" * (gait.period > 1)
    counts = Counter(found.settled.ravel().tolist())
    rows = [
        {"leads to": names[index], "starts": count, "share": count / found.settled.size}
        for index, count in counts.most_common()
    ]
    angle, rate = found.stance_angle, found.stance_rate
    title = f"stance angles {angle[0]:.4g} to {angle[-1]:.4g} rad, stance rates {rate[0]:.4g} "
    title += f"to {rate[-1]:.4g} {'rad/s' if 'units' in found.walker.supports else '√(g/l)'}"
    data = record(found, ("slope", "stance_angle", "stance_rate", "settled", "strides"))
    data["gaits"] = [record(gait, _GAIT) for gait in found.gaits]
    return Report(f"{title}\n{tabulated(rows)}", data)


def check(
    machine: Machine,
    slope: Slope,
    *,
    kind: Kind = "long",
    friction: Annotated[float, "coefficient of friction"] = 0.8,
) -> Report:
    """Check a gait's feasibility: scuffing, knee lock, contact, friction, hyperextension.

    passive-walker check lab 0.036
    passive-walker check C 0.03 --friction 0.5
    passive-walker check D 0.0 --push-off 0.05 --dimensionless
    """
    found = reality_check(machine.gait(slope, kind), friction=friction)
    return Report(str(found), {"holds": found.holds, "passed": found.passed, "found": found})
