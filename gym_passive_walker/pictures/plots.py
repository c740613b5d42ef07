"""The `plot` methods of gaits, branches, walks and other results."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.shown import picture
from gym_passive_walker.gaits.branches import continuation
from gym_passive_walker.gaits.branches.bifurcation import BifurcationDiagram
from gym_passive_walker.gaits.branches.doubling import Cascade
from gym_passive_walker.gaits.branches.family import GaitFamily
from gym_passive_walker.gaits.branches.locus import BifurcationLocus
from gym_passive_walker.gaits.control.optimum import OptimalGait
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.gaits.look.reality import RealityCheck
from gym_passive_walker.gaits.look.series import SERIES
from gym_passive_walker.gaits.look.trajectory import Trajectory, simulate
from gym_passive_walker.gaits.measures import UNIT_OF
from gym_passive_walker.gaits.robust.basin import UNSETTLED, Basin, basin_of_attraction
from gym_passive_walker.gaits.stride import Stride
from gym_passive_walker.models.units import KINDS, UNITS
from gym_passive_walker.models.walkers import describe, name_of
from gym_passive_walker.pictures.axes import (
    ANGLE,
    BLACK,
    BLUE,
    GREEN,
    GREY,
    HEAVY,
    LIGHT,
    ORANGE,
    PURPLE,
    SKY_BLUE,
    SLOPE,
    SPEED,
    VERMILION,
    axes_for,
    broken,
    given,
    legend,
    panels,
    series,
)
from gym_passive_walker.pictures.portrait import (
    TIME,
    angles_over_time,
    both,
    impacts,
    parts_of,
    portrait_of,
)
from gym_passive_walker.pictures.strobe import strobe

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PLOTTED = {
    "stance_angle": ANGLE,
    "froude_speed": SPEED,
    "largest_multiplier": "modulus of the largest multiplier",
}
"""Quantities that a branch of gaits can be drawn by, and their axis labels."""

_CELLS, _STRIDES = 61, 100  # resolution and strides of the basin of a controlled gait

_NO_TORQUE = 1e-6  # range of torques / (m g l) below which they are drawn as none
_OPTIMAL: dict[str, Any] = {"color": BLACK, "linestyle": "--"}  # of a single torque

_OWN_UNITS = {"energy": "torque", "friction": "torque and time", "gravity": "acceleration"}
"""Units of parameters that are not named as the kinds of `models.units.KINDS`."""

_PLANES = {"path": "centre of mass", "hodograph": "velocity"}
_LABELS = {"forces": "force of the ground", "torques": "torque", "clearance": "height"}
"""Labels of quantities over time, by what a walk is drawn by."""

_ENDS = {
    continuation.KNEE_MEETS_HEEL: "X",
    continuation.TANGENTIAL: "v",
    continuation.STANCE_STOPS: "s",
    continuation.VANISHED: "o",
    continuation.LOST: "x",
}
"""A marker for each reason for which a branch ends, except the end of the requested range."""


def draw_family(
    ax: Axes, family: GaitFamily, by: str = "stance_angle", label: str = "", **style: Any
) -> None:
    """Draw a branch of gaits: heavy where stable, light where unstable, a marker at each end.

    Args:
        ax: Axes to draw on.
        family: The branch of gaits.
        by: Quantity of the vertical axis, one of `PLOTTED`: "stance_angle", "froude_speed" or
            "largest_multiplier".
        label: Label in the legend.
        **style: Keywords of matplotlib's lines.

    Raises:
        ValueError: if `by` is not one of `PLOTTED`.
    """
    if by not in PLOTTED:
        raise ValueError(f"a family is drawn by {', '.join(PLOTTED)}, not by {by!r}")
    value = family.stance_angle if by == "stance_angle" else family.columns()[by]
    style = {"color": BLUE, "solid_capstyle": "butt", **style}
    ax.plot(family.value, value, label=label or None, **{"linewidth": LIGHT, **style})
    to_minus_one = np.abs(family.multipliers + 1.0).min(axis=1)
    doublings = [_place(family, x, -to_minus_one) for x in family.period_doublings]
    to_circle = np.abs(np.abs(family.multipliers) - 1.0)
    to_circle = np.where(family.multipliers.imag == 0.0, np.inf, to_circle).min(axis=1)
    circles = [_place(family, x, -to_circle) for x in family.neimark_sackers]
    halts = [_place(family, x, family.step_period) for x in family.halts]
    along = np.arange(len(family))
    # The heavy line continues from the last stable gait to the bifurcation.
    fine = np.sort(np.concatenate([along, doublings, circles]))
    heavy = np.isin(fine, np.concatenate([along[family.stable], doublings, circles]))
    curve = np.interp(fine, along, family.value), np.interp(fine, along, value)
    ax.plot(curve[0], np.where(heavy, curve[1], np.nan), **{"linewidth": HEAVY, **style})
    point = {"linestyle": "", "color": style["color"], "zorder": 3, "markersize": 6.0}
    for end, at in zip(family.ends, (0, -1), strict=True):
        reason = end.reason.split(";")[0]
        if reason in _ENDS:
            ax.plot(family.value[at], value[at], _ENDS[reason], **point)
    marks = (_ENDS[continuation.STANCE_STOPS], halts), ("d", doublings), ("h", circles)
    for marker, places in marks:
        where = np.interp(places, along, family.value), np.interp(places, along, value)
        ax.plot(*where, marker, fillstyle="none", **point)
    ax.set(xlabel=varied_label(family.parameter), ylabel=PLOTTED[by])


def varied_label(parameter: str) -> str:
    """Axis label of the parameter of a branch, with the walker's own unit."""
    if parameter in ("slope", "foot_angle"):
        return SLOPE if parameter == "slope" else "foot angle (rad)"
    words, kind = parameter.replace("_", " "), KINDS.get(parameter, "")
    return words + f" (in the walker's unit of {_OWN_UNITS.get(kind, kind)})" * bool(kind)


def _place(family: GaitFamily, value: float, likely: NDArray) -> float:
    """Fractional index along a branch at which its parameter has a value.

    Args:
        family: The branch, of n gaits, which may pass the value more than once.
        value: Value of the branch's parameter.
        likely: Score of each gait, shape (n,); of several places, that of the highest is returned.
    """
    here, there = family.value[:-1], family.value[1:]
    passed = np.flatnonzero((here - value) * (there - value) <= 0.0)
    if not len(passed):
        return float(np.argmin(np.abs(family.value - value)))
    at = passed[np.argmax(np.maximum(likely[passed], likely[passed + 1]))]
    return float(at + (value - here[at]) / (there[at] - here[at] or 1.0))


def family_key(ax: Axes, *families: GaitFamily) -> None:
    """Add legend entries for the line widths and markers that occur in some branches."""

    def enter(label: str, **style: Any) -> None:
        ax.plot([], [], color=GREY, label=label, **style)

    stable = np.concatenate([family.stable for family in families])
    if stable.any():
        enter("heavy: stable", linewidth=HEAVY)
    if not stable.all():
        enter("light: unstable", linewidth=LIGHT)
    reasons = {end.reason.split(";")[0] for family in families for end in family.ends}
    for reason in [reason for reason in _ENDS if reason in reasons]:
        enter(f"end: {reason}", linestyle="", marker=_ENDS[reason])
    hollow = {"linestyle": "", "fillstyle": "none"}
    if any(family.halts for family in families):
        enter(continuation.STANCE_STOPS, marker=_ENDS[continuation.STANCE_STOPS], **hollow)
    if any(family.period_doublings for family in families):
        enter("period doubling", marker="d", **hollow)
    if any(family.neimark_sackers for family in families):
        enter("Neimark-Sacker bifurcation", marker="h", **hollow)


@picture.register(GaitFamily)
def _family(family: GaitFamily, ax: Axes | None = None, by: str = "stance_angle", **style) -> Axes:
    """Draw one of `PLOTTED` over the branch's parameter, with options of matplotlib's lines."""
    ax = axes_for(ax, (5.6, 4.6))
    draw_family(ax, family, by, **style)
    family_key(ax, family)
    period = f", period {family.period}" if family.period > 1 else ""
    ax.set_title(f"gaits of walker {name_of(family.walker)}{period}", fontsize="medium")
    legend(ax, columns=2)
    return ax


@picture.register(BifurcationDiagram)
def _diagram(diagram: BifurcationDiagram, ax: Axes | None = None, **style: Any) -> Axes:
    """Draw settled walks' stance angles over what varies, with options of matplotlib's lines."""
    ax = axes_for(ax, (6.4, 4.6))
    dots = {"color": BLACK, "markersize": 0.7, "markeredgewidth": 0.0, "rasterized": True}
    ax.plot(diagram.value, diagram.stance_angle, ".", **{**dots, **style})
    ax.set(xlabel=varied_label(diagram.parameter), ylabel=ANGLE)
    ax.set_title(f"bifurcation diagram of walker {name_of(diagram.walker)}", fontsize="medium")
    last = diagram.value[diagram.walks].max() if diagram.walks.any() else np.nan
    if last < diagram.value.max():
        ax.axvline(last, color=GREY, linewidth=0.8, linestyle="--")
        unit = " rad" * (diagram.parameter == "slope")
        ax.annotate(
            f"beyond {last:.5g}{unit}\nall simulated walks end in a fall",
            (last, 0.03), (-4, 0), xycoords=("data", "axes fraction"),
            textcoords="offset points", ha="right", fontsize="small", color=GREY,
        )  # fmt: skip
    return ax


@picture.register(Cascade)
def _cascade(cascade: Cascade, ax: Axes | None = None, **style: Any) -> Axes:
    """Draw how the doublings approach their limit, with options of matplotlib's lines."""
    ax = axes_for(ax)
    gaps, unit = cascade.limit - np.array(cascade.values), " rad" * (cascade.parameter == "slope")
    ax.semilogy(cascade.periods, gaps, **{**series(0), **style})
    ax.set_xscale("log", base=2)
    ax.set(
        xlabel="period before the doubling (strides)",
        ylabel=f"limit minus {varied_label(cascade.parameter)}",
    )
    ax.set_title(
        f"period doublings of walker {name_of(cascade.walker)}, limit {cascade.limit:.6g}{unit}",
        fontsize="medium",
    )
    return ax


_LOCI = {"fold": BLUE, "period doubling": VERMILION, "Neimark-Sacker": GREEN}
_SPECIAL = {"cusp": "^", "fold-flip": "s", "1:1": "o", "1:2": "D", "1:3": "v", "1:4": "p"}


@picture.register(BifurcationLocus)
def _locus(locus: BifurcationLocus, ax: Axes | None = None, **style: Any) -> Axes:
    """Draw a locus, heavy where it bounds stable gaits, with options of matplotlib's lines.

    On axes with other loci, each kind of bifurcation and of special point has one entry in the
    legend.
    """
    ax = axes_for(ax)
    known = ax.get_legend_handles_labels()[1]
    style = {"color": _LOCI[locus.bifurcation], "solid_capstyle": "butt", **style}
    label = str(style.pop("label", locus.bifurcation))
    x, y = locus.values.T
    ax.plot(x, y, label=None if label in known else label, **{"linewidth": LIGHT, **style})
    heavy = np.where(locus.bounds_stable_gaits, y, np.nan)
    ax.plot(x, heavy, **{"linewidth": HEAVY, **style})
    for kind in dict.fromkeys(kind for kind, _ in locus.special):
        places = np.array([values for other, values in locus.special if other == kind])
        named = kind if kind[0] != "1" else f"{kind} resonance"
        ax.plot(
            *places.T, _SPECIAL[kind], color=BLACK, fillstyle="none", markersize=6.0, zorder=3,
            label=None if named in known else named,
        )  # fmt: skip
    ax.set(xlabel=varied_label(locus.parameters[0]), ylabel=varied_label(locus.parameters[1]))
    legend(ax)
    return ax


@picture.register(Basin)
def _basin(basin: Basin, ax: Axes | None = None) -> Axes:
    """Draw the cells by the gait that walks from them converge to; cells of falls are light."""
    from matplotlib.colors import BoundaryNorm, ListedColormap

    ax = axes_for(ax, (5.6, 4.8))
    settled, rates = basin.settled.astype(int), basin.stance_rate * basin.walker.units.time
    # The shades differ in brightness, so that they stay distinct when printed in grey.
    shades = ["#f2f2f2", "#8c8c8c", BLUE, SKY_BLUE, GREEN, VERMILION]
    kinds = [(-1, "falls"), (UNSETTLED, "walks, without convergence")]
    kinds += [(i, f"converges to {_gait_in_words(gait)}") for i, gait in enumerate(basin.gaits)]
    code = np.zeros(settled.shape)
    for index, (kind, _) in enumerate(kinds):
        code[settled == kind] = index
    colours = [shades[min(i, len(shades) - 1)] for i in range(len(kinds))]
    norm = BoundaryNorm(np.arange(len(kinds) + 1) - 0.5, len(kinds))
    mesh = {"cmap": ListedColormap(colours), "norm": norm, "rasterized": True, "shading": "nearest"}
    ax.pcolormesh(basin.stance_angle, rates, code, **mesh)
    for i, (kind, label) in enumerate(kinds):
        if np.any(settled == kind):
            swatch = {"color": colours[i], "markeredgecolor": GREY, "markersize": 9.0}
            ax.plot([], [], "s", linestyle="", label=label, **swatch)
    for gait in basin.gaits:
        rate = gait.state[len(gait.state) // 2] * basin.walker.units.time
        star = {"color": "white", "markeredgecolor": BLACK, "markersize": 11.0}
        ax.plot(gait.stance_angle, rate, "*", linestyle="", label="stable gait", **star)
    ax.set(xlabel=ANGLE, ylabel="stance angular velocity dθ/dt / √(g/l)")
    ax.set_title(
        f"basin of attraction, walker {name_of(basin.walker)}, slope {basin.slope:.4g} rad",
        fontsize="medium",
    )
    legend(ax, columns=2)
    return ax


def _gait_in_words(gait: Gait) -> str:
    return f"the {gait.kind}-step gait" + (f" of period {gait.period}" if gait.period > 1 else "")


@picture.register(RealityCheck)
def _reality(check: RealityCheck, ax: Axes | None = None) -> Axes:
    """Draw each reading of the check, and whether it satisfies its constraint."""
    ax = axes_for(ax, (7.6, 5.2))
    readings = [reading for reading in check.readings if not np.isnan(reading.extreme.value)]
    passed = check.passed
    rows = -np.arange(len(readings))
    values = np.array([reading.extreme.value / reading.unit for reading in readings])
    items = np.array([reading.item for reading in readings])
    wrong = (values < 0.0) | ((items == "friction") & (values > check.friction))
    fails = wrong & ~np.array([passed[item] for item in items])
    for label, which, marker, colour in (
        ("satisfied", ~fails, "o", BLUE), ("violated", fails, "X", VERMILION)
    ):  # fmt: skip
        if which.any():
            ax.hlines(rows[which], 0.0, values[which], color=colour, linewidth=1.0)
            ax.plot(values[which], rows[which], marker, color=colour, linestyle="", label=label)
    friction = items == "friction"
    ax.vlines(
        check.friction, rows[friction].min() - 0.4, rows[friction].max() + 0.4,
        color=BLACK, linestyle=":", label=f"available friction, {check.friction:g}",
    )  # fmt: skip
    ax.axvline(0.0, color=BLACK, linewidth=0.8)
    names = [f"{r.item}: {r.quantity.strip()}" + f" / ({r.unit_name})" * bool(r.unit_name)
             for r in readings]  # fmt: skip
    ax.set_yticks(rows, names, fontsize="small")
    ax.set_xscale("symlog", linthresh=0.01)
    ax.set(xlabel="value (linear below 0.01)", xlim=(None, 2.0 * max(1.0, values.max())))
    ax.set_title(
        f"feasibility of walker {name_of(check.walker)}, slope {check.slope:.4g} rad",
        fontsize="medium",
        loc="right",
    )
    legend(ax)
    return ax


@picture.register(Stride)
def _stride(strides: Stride, ax: Axes | None = None) -> Axes:
    """Draw the energy balance of each stride, in the walker's own units."""
    ax = axes_for(ax)
    usual = [("gravity's work", BLUE, "", strides.gravity_work),
             ("hip's work", SKY_BLUE, "//", strides.hip_work),
             ("lost at kneestrike", ORANGE, "..", -strides.kneestrike_loss),
             ("lost at heelstrike", VERMILION, "xx", -strides.heelstrike_loss)]  # fmt: skip
    others = [("ankle's work", GREEN, "\\\\", strides.ankle_work),
              ("push-off's work", PURPLE, "||", strides.push_off_work),
              ("springs' work", GREY, "--", strides.spring_work),
              ("lost to friction", GREY, "++", -strides.friction_loss)]  # fmt: skip
    edges = np.arange(np.size(strides.outcome) + 1) - 0.5
    above, below = np.zeros((2, np.size(strides.outcome)))
    for label, colour, hatch, each in usual + [part for part in others if np.any(part[-1])]:
        values = np.ravel(each)
        under = np.where(values >= 0.0, above, below)
        style = {"color": colour, "hatch": hatch, "edgecolor": BLACK, "linewidth": 0.5}
        ax.stairs(under + values, edges, baseline=under, fill=True, label=label, **style)
        above, below = above + np.maximum(values, 0.0), below + np.minimum(values, 0.0)
    ax.axhline(0.0, color=BLACK, linewidth=0.8)
    ax.set(xlabel="stride", ylabel="energy (in the walker's own units)")
    if len(edges) == 2:
        ax.set_xticks([0], [""])
    legend(ax, columns=4)
    return ax


@picture.register(Trajectory)
def _trajectory(walk: Trajectory, ax: Axes | None = None, of: str = "angles") -> Axes | NDArray:
    """Draw both legs' angles over time, and without `ax` the phase portrait beside them.

    `of` draws other quantities: "forces", "torques", "path", "hodograph", "energy", "power" or
    "clearance".
    """
    if of != "angles":
        return _over_time(walk, ax, of)
    if not given(ax):
        return both(walk, ax)
    angles_over_time(ax, walk)
    legend(ax)
    return ax


def _over_time(walk: Trajectory, ax: Axes | None, of: str) -> Axes:
    """Draw quantities of a walk over time, or one over another, dimensionless."""
    found = walk.series()
    powers = [name for name in found if name.endswith("_power")]
    names = {group: [name for name in each if name in found] for group, each in SERIES.items()}
    names["power"] = powers
    known = ["angles", *(group for group in names if names[group])]
    if of not in known:
        raise ValueError(f"a walk of {describe(walk.walker)} is drawn by {', '.join(known)}, "
                         f"not by {of!r}")  # fmt: skip
    ax = axes_for(ax)
    kinds = {name: UNIT_OF.get(name, "power") for name in names[of]}
    units = {name: UNITS[kind][1](walk.walker, walk.units) for name, kind in kinds.items()}
    values = {name: found[name] / units[name] for name in names[of]}
    symbol = UNITS[kinds[names[of][0]]][0]
    if of in _PLANES:
        x, y = (broken(values[name], walk.struck) for name in names[of])
        ax.plot(x, y, color=BLUE, linewidth=1.5)
        for after in walk.struck:
            jump = slice(after - 1, after + 1)
            ends = (values[name][jump] for name in names[of])
            ax.plot(*ends, ":", color=BLACK, linewidth=0.9, label="impact")
        ax.plot(x[0], y[0], "o", color=BLUE, markersize=5.0, label="start of the walk")
        ax.set(xlabel=f"{_PLANES[of]} along the slope / {symbol}",
               ylabel=f"{_PLANES[of]} away from the slope / {symbol}")  # fmt: skip
    else:
        times = broken(walk.times / walk.units.time, walk.struck)
        moving = [name for name in names[of] if np.any(found[name])] or names[of]
        for (label, colour, dash), name in zip(parts_of(moving), moving, strict=True):
            style = {"color": colour, "linestyle": dash, "linewidth": 1.5}
            ax.plot(times, broken(values[name], walk.struck), label=label, **style)
        impacts(ax, walk)
        ax.axhline(0.0, color=GREY, linewidth=0.4)
        ax.set(xlabel=TIME, ylabel=f"{_LABELS.get(of, of)} / {symbol}")
    ax.set_title(f"walker {name_of(walk.walker)}, slope {walk.slope:.4g} rad", fontsize="medium")
    legend(ax, columns=2)
    return ax


@picture.register(Gait)
def _gait(gait: Gait, ax: Axes | None = None, optimum: Any = None) -> Axes | NDArray:
    """Draw a gait's phase portrait, and without `ax` its Floquet multipliers and two more panels.

    The two panels are angles over time and a stroboscopic picture. Under a controller, they are
    the torques, beside those of `optimum` if given, and the basin of attraction.
    """
    count = max(2, len(gait.cycle.duration))
    walk = simulate(gait, strides=count, samples=400)
    if given(ax):
        portrait_of(ax, walk)
        legend(ax)
        return ax
    figure, axes = panels(2, 2, (9.2, 8.0), ax)
    first, portrait, third, circle = axes
    portrait_of(portrait, walk)
    legend(portrait, columns=2)
    multipliers(circle, gait.multipliers)
    if gait.stride_map.controlled:
        _torques(first, walk, gait, optimum)
        basin_of_attraction(gait.stride_map, resolution=_CELLS, strides=_STRIDES).plot(ax=third)
        third.set_title("")
    else:
        angles_over_time(first, walk)
        legend(first, columns=2)
        strobe(gait, strides=count, ax=third)
        third.set_title("")
    name = gait.stride_map.controller_name
    figure.suptitle(
        f"walker {name_of(gait.walker)}{f' under {name}' if name else ''}, slope {gait.slope:.4g} "
        f"rad: {_gait_in_words(gait)}, {'stable' if gait.stable else 'unstable'}",
        fontsize="medium",
    )
    return np.array(axes)


def _torques(ax: Axes, walk: Trajectory, gait: Gait, optimum: Any) -> None:
    """Draw the torques that act over the first stride, beside those of an optimal gait."""
    walker, first = walk.walker, walk.stride_index == 0
    times, held = walk.times[first] / walk.units.time, walk.torques[first] / walker.control_units
    best = np.zeros((len(walker.controls), 1))
    if optimum is not None:
        best = np.array([*optimum.held.values()])[: len(walker.controls)]
        period = optimum.dimensionless.step_period
        edges = np.minimum(min(gait.stride_map.hold, period) * np.arange(best.shape[1] + 1), period)
        said = f"optimal at speed {optimum.dimensionless.speed:.3f} √(g l)"
    own = "actuation" not in walker.supports
    acts = np.any(held, axis=0) | np.any(best, axis=1) | own
    acting = np.flatnonzero(acts) if acts.any() else np.arange(1)
    several = own or acting.tolist() != [0]
    parts = parts_of([walker.controls[j] for j in acting])
    for j, (part, colour, dash) in zip(acting, parts, strict=True):
        label = part if several else gait.stride_map.controller_name
        ax.step(times, held[:, j], where="pre", color=colour, linestyle=dash, label=label)
        if optimum is not None:
            style = {"color": colour, "linestyle": (0, (3, 1))} if several else _OPTIMAL
            steps = np.append(best[j], best[j, -1])
            ax.step(edges, steps, where="post", label=f"{part}, " * several + said, **style)
    ax.axhline(0.0, color=GREY, linewidth=0.4)
    if np.ptp(ax.get_ylim()) < _NO_TORQUE:  # no picture of rounding
        ax.set_ylim(-_NO_TORQUE, _NO_TORQUE)
    torque = "torque τ / (m g l)" if several else "hip torque τ / (m g l)"
    ax.set(xlabel=TIME, ylabel="control" if own else torque)
    legend(ax, columns=2)


@picture.register(OptimalGait)
def _controls(gait: OptimalGait, ax: Axes | None = None, **style: Any) -> Axes:
    """Draw the torques that work in each control step, with options of matplotlib's stairs."""
    ax = axes_for(ax)
    torques = {name: held for name, held in gait.held.items() if name != "push_off"}
    working = {name: held for name, held in torques.items() if np.any(held)} or torques
    for (label, colour, dash), held in zip(parts_of([*working]), working.values(), strict=True):
        lines = {"color": colour, "linestyle": dash, "label": label, "baseline": None}
        ax.stairs(held, **{**lines, **style})
    ax.axhline(0.0, color=GREY, linewidth=0.4)
    unit = "torque τ / (m g l)" if "units" in gait.walker.supports else "control"
    ax.set(xlabel="control step", ylabel=unit)
    ax.set_title(
        f"optimal gait of walker {name_of(gait.walker)} at speed {gait.froude_speed:.4g} √(g l)",
        fontsize="medium",
    )
    legend(ax, columns=2)
    return ax


def multipliers(ax: Axes, values: NDArray) -> None:
    """Draw Floquet multipliers in the complex plane; stable ones lie inside the unit circle."""
    turn = 2.0 * np.pi * np.linspace(0.0, 1.0, 200)
    ax.plot(np.cos(turn), np.sin(turn), color=GREY, linewidth=1.0)
    inside = np.abs(values) < 1.0
    for which, marker, colour, label in (
        (inside, "o", BLUE, "stable"), (~inside, "X", VERMILION, "unstable")
    ):  # fmt: skip
        if which.any():
            there = np.real(values[which]), np.imag(values[which])
            ax.plot(*there, marker, color=colour, linestyle="", label=label)
    for axis in (ax.axhline, ax.axvline):
        axis(0.0, color=GREY, linewidth=0.4)
    ax.set(aspect="equal", xlabel="real part", ylabel="imaginary part")
    ax.set_title("Floquet multipliers and unit circle", fontsize="small")
    legend(ax)
