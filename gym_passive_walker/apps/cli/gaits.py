"""Commands about gaits; each adds its arguments to a parser and returns the function to run."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from gym_passive_walker._tools.arguments import KEPT, one_slope, whole
from gym_passive_walker.apps.cli.arguments import (
    add_kind,
    add_motors,
    add_slope,
    add_slopes,
    add_walker,
    chosen_map,
    gait_of,
    shown_in,
    walker_of,
)
from gym_passive_walker.apps.cli.report import Report, listing, record, table
from gym_passive_walker.gaits.branches.bifurcation import bifurcation_diagram
from gym_passive_walker.gaits.branches.family import gait_family
from gym_passive_walker.gaits.find.fixed_point import find_gait, find_gaits
from gym_passive_walker.gaits.look.reality import reality_check
from gym_passive_walker.gaits.robust.basin import FELL, UNSETTLED, basin_of_attraction
from gym_passive_walker.models.walkers import ABOUT, WALKERS, describe, tuning_errors

_GAIT = ("kind", "period", "stance_angle", "state", "step_period", "step_length", "speed")
_GAIT += ("froude_speed", "cost_of_transport", "multipliers", "stable")
_FAMILY = ("slope", "stance_angle", "step_period", "step_length", "speed", "froude_speed")


def walkers(command: ArgumentParser) -> Callable[[Namespace], Report]:
    """List the walkers that come with the package, with a description of each.

    passive-walker walkers
    """

    def run(_: Namespace) -> Report:
        rows, data = [], []
        for name, walker in WALKERS.items():
            sizes = record(walker, ("leg_length", "total_mass", "foot_radius"))
            errors = tuning_errors(walker)
            off = max(abs(errors.collinearity), abs(errors.shank_under_knee))
            about = {"about": ABOUT[name]}
            rows.append({"name": name, **sizes, "off tuning (legs)": off, **about})
            data.append({"name": name, **sizes, "tuning_errors": errors, **about})
        return Report(table(rows), data)

    return run


def gait(command: ArgumentParser) -> Callable[[Namespace], Report]:
    """Find every gait of a walker at a slope, with its measures and its stability.

    passive-walker gait lab 0.036
    passive-walker gait C 0.09 --period 2
    passive-walker gait D 0.0 --push-off 0.05 --dimensionless
    passive-walker gait C 0.0 --controller level-ppo
    passive-walker gait mine.json 0.02 --tune
    """
    add_walker(command)
    add_slope(command)
    add_motors(command)
    command.add_argument("--period", type=int, default=1, help="period of the gait in strides (1)")

    def run(arguments: Namespace) -> Report:
        walker, slope, period = walker_of(arguments), arguments.slope, arguments.period
        strides = chosen_map(arguments, slope)
        # If there is none, `find_gait` raises an error with the reason; a policy has one gait.
        found = [] if strides.controlled else find_gaits(strides, period=period)
        gaits = found or [find_gait(strides, period=period)]
        shown = [shown_in(arguments, gait) for gait in gaits]
        records = [record(gait, _GAIT) for gait, _ in shown]
        under = f" under {strides.controller_name}" if strides.controlled else ""
        texts = [
            listing(
                f"{gait['kind']}-step gait of {describe(walker)}{under} at slope {slope:g} rad, "
                f"period {gait['period']}",
                {name: gait[name] for name in _GAIT[2:]},
                units,
            )
            for gait, (_, units) in zip(records, shown, strict=True)
        ]
        return Report("\n\n".join(texts), records)

    return run


def family(command: ArgumentParser) -> Callable[[Namespace], Report]:
    """Continue a branch of gaits over slopes, through folds, to its ends and their reasons.

    passive-walker family lab 0.005 0.1
    passive-walker family C 0.01 0.1 --kind short --json
    passive-walker family D -0.005 0.005 --push-off 0.05
    """
    add_walker(command)
    add_slopes(command)
    add_kind(command)
    add_motors(command)

    def run(arguments: Namespace) -> Report:
        walker = walker_of(arguments)
        found = gait_family(chosen_map(arguments), arguments.low, arguments.high, arguments.kind)
        view, units = shown_in(arguments, found)
        columns: dict[str, Any] = record(view, _FAMILY)
        shown = columns | {"multiplier": np.abs(found.multipliers[:, 0]), "stable": found.stable}
        columns |= record(found, ("multipliers", "stable"))
        marks = record(found, ("folds", "period_doublings", "neimark_sackers", "halts"))
        facts: dict[str, Any] = {f"{name} (rad)": values for name, values in marks.items()}
        for side, end in zip(("first", "last"), found.ends, strict=True):
            facts[f"{side} end"] = f"{end.value:.8g} rad: {end.reason}"
        title = f"{len(found)} {arguments.kind}-step gaits of {describe(walker)}"
        text = f"{table(_rows(shown), units)}\n\n{listing(title, facts)}"
        return Report(text, {"gaits": columns, **marks, "ends": found.ends})

    return run


def bifurcation(command: ArgumentParser) -> Callable[[Namespace], Report]:
    """Compute a bifurcation diagram: the long-term behaviour of walks over a range of slopes.

    passive-walker bifurcation C 0.07 0.098 --slopes 15
    passive-walker bifurcation C 0.0 0.06 --controller rolling-ppo
    """
    add_walker(command)
    add_slopes(command)
    add_kind(command)
    add_motors(command)
    add = command.add_argument
    add("--slopes", type=int, default=50, metavar="N", help="number of slopes (%(default)s)")
    add("--n-transient", type=int, default=500, metavar="N", help="transient strides (%(default)s)")
    add("--n-recorded", type=int, default=64, metavar="N", help="recorded strides (%(default)s)")

    def run(arguments: Namespace) -> Report:
        count = whole(arguments.slopes, "--slopes", 1, KEPT)
        low, high = one_slope(arguments.low, "LOW"), one_slope(arguments.high, "HIGH")
        slopes, strides = np.linspace(low, high, count), chosen_map(arguments)
        if strides.passive and slopes.min() <= 0.0:
            raise ValueError("LOW and HIGH must be slopes above 0: only motors walk uphill")
        found = bifurcation_diagram(
            strides, slopes, kind=arguments.kind,
            n_transient=arguments.n_transient, n_recorded=arguments.n_recorded,
        )  # fmt: skip
        angles = found.stance_angle
        rows = _rows(
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
        data = record(found, ("slope", "period", "walks", "stance_angle"))
        return Report(table(rows), data)

    return run


def basin(command: ArgumentParser) -> Callable[[Namespace], Report]:
    """Count the initial states on a slice through a gait that lead to each gait, or to a fall.

    passive-walker basin lab 0.036 --resolution 100
    """
    add_walker(command)
    add_slope(command)
    add_motors(command)
    add = command.add_argument
    add(
        "--resolution", type=int, default=100, metavar="N", help="points of each axis (%(default)s)"
    )
    add(
        "--strides",
        type=int,
        default=300,
        metavar="N",
        help="largest number of strides (%(default)s)",
    )

    def run(arguments: Namespace) -> Report:
        found = basin_of_attraction(
            chosen_map(arguments, arguments.slope), resolution=arguments.resolution,
            strides=arguments.strides,
        )  # fmt: skip
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
        return Report(f"{title}\n{table(rows)}", data)

    return run


def check(command: ArgumentParser) -> Callable[[Namespace], Report]:
    """Check a gait's feasibility: scuffing, knee lock, contact, friction, hyperextension.

    passive-walker check lab 0.036
    passive-walker check C 0.03 --friction 0.5
    """
    add_walker(command)
    add_slope(command)
    add_kind(command)
    add_motors(command, push_off=False)
    add = command.add_argument
    add("--friction", type=float, default=0.8, help="coefficient of friction (%(default)s)")

    def run(arguments: Namespace) -> Report:
        gait = gait_of(arguments)
        found = reality_check(gait, friction=arguments.friction)
        return Report(str(found), {"holds": found.holds, "passed": found.passed, "found": found})

    return run


def _rows(columns: dict[str, Any]) -> list[dict[str, Any]]:
    """Convert the columns of a table to its rows."""
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
