"""The figures of Garcia (1999), chapter 4, recomputed: tables, a drawing of them, a caption.

Each drawing is a matplotlib Figure that pyplot does not know; nothing is shown. `draw` writes one
of them to a file, and its tables beside it.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gym_passive_walker._tools.arguments import near
from gym_passive_walker._tools.extras import need
from gym_passive_walker._tools.files import prepare, replacing
from gym_passive_walker._tools.shown import picture
from gym_passive_walker.gaits.branches.bifurcation import bifurcation_diagram
from gym_passive_walker.gaits.branches.doubling import doubling_cascade
from gym_passive_walker.gaits.branches.family import GaitFamily, gait_family
from gym_passive_walker.gaits.find.fixed_point import find_gait, find_gaits
from gym_passive_walker.gaits.gait import Gait, GaitKind
from gym_passive_walker.gaits.look.trajectory import simulate
from gym_passive_walker.models.walkers import WALKERS, Walker, interpolate, name_of, tune
from gym_passive_walker.pictures.axes import (
    ANGLE,
    BLACK,
    BLUE,
    GREY,
    OWN,
    SKY_BLUE,
    SLOPE,
    VERMILION,
    figure_of,
    legend,
    legend_below,
    panels,
    picture_path,
    resize,
    save,
    series,
)
from gym_passive_walker.pictures.diagram import (
    approach,
    heelstrike_diagram,
    standing_diagram,
    walker_diagram,
)
from gym_passive_walker.pictures.plots import PLOTTED, draw_family, family_key
from gym_passive_walker.pictures.portrait import both
from gym_passive_walker.pictures.strobe import strobe

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Tables = Mapping[str, Any]
"""Tables that a figure shows, by the names of their curves."""

_ANGLE, _SPEED = "stance_angle", "froude_speed"
_WIDTHS: tuple[tuple[GaitKind, float], ...] = (("long", 1.8), ("short", 0.9))


def families(walker: Walker, low: float, high: float, looks: int = 8) -> list[GaitFamily]:
    """Every branch of periodic gaits that passes one of `looks` slopes, continued over the range.

    Args:
        walker: The walker.
        low: Lowest slope in rad.
        high: Highest slope in rad.
        looks: Number of slopes, evenly spaced, at which gaits are searched for.
    """
    found: list[GaitFamily] = []
    for slope in np.linspace(low, high, looks):
        for gait in find_gaits(walker, float(slope)):
            if not any(_passes(family, gait) for family in found):
                found.append(gait_family(walker, low, high, start=gait))
    return found


def _passes(family: GaitFamily, gait: Gait) -> bool:
    """Whether a branch passes through a gait, within the distance of its points."""
    apart = np.hypot(
        np.log(family.slope / gait.slope), np.log(family.stance_angle / gait.stance_angle)
    )
    return bool(apart.min() < 0.05)


def _named(name: str, found: Iterable[GaitFamily]) -> Tables:
    return {f"{name}, branch {i}": family for i, family in enumerate(found, 1)}


def _steps(walkers: Mapping[str, Walker], low: float, high: float) -> Tables:
    return {
        f"{name}, {kind} step": gait_family(walker, low, high, kind)
        for name, walker in walkers.items()
        for kind, _ in _WIDTHS
    }


def _walk(strides: int, samples: int) -> Tables:
    return {"lab": simulate(find_gait("lab", 0.036), strides=strides, samples=samples)}


def point_feet() -> Tables:
    """Branches of gaits of the point-foot walkers E and F."""
    return _steps({name: WALKERS[name] for name in "EF"}, 1e-7, 0.2)


def transition(tables: Tables, by: str = _ANGLE) -> Figure:
    """Figs. 4.5 and 4.11: transition of the short step's scaling, for two foot masses."""
    figure, (ax,) = panels(size=(5.8, 5.2))
    # E and F have the same long steps: E is drawn broad and pale under F.
    for name, ratio, colour, width in (("E", 0.125, SKY_BLUE, 4.0), ("F", 0.05 / 0.9, BLACK, 1.2)):
        dashes: tuple[tuple[GaitKind, Any], ...] = (("long", "-"), ("short", (0, (4, 1.5))))
        for kind, dash in dashes:
            label = f"{name}, {kind} step"
            family = tables[label]
            style = {"color": colour, "linestyle": dash, "linewidth": width}
            ax.plot(family.slope, family.columns()[by], label=label, dash_capstyle="butt", **style)
        ax.axvline(
            ratio**1.5, color=colour, linewidth=0.4 * width, linestyle=":",
            label=f"{name}, (foot mass / hip mass)$^{{3/2}}$",
        )  # fmt: skip
    ax.set(xscale="log", yscale="log", xlabel=SLOPE, ylabel=PLOTTED[by])
    legend(ax)
    return figure


def laboratory() -> Tables:
    """Branches of gaits of the laboratory's walker with knees free and locked."""
    both = {name: families(WALKERS[name], 0.005, 0.1) for name in ("lab", "lab-straight")}
    return {label: x for name, found in both.items() for label, x in _named(name, found).items()}


def lab_families(tables: Tables, by: str = _ANGLE) -> Figure:
    """Figs. 4.6 and 4.12: gaits of the laboratory's walker with knees free and locked."""
    figure, (ax,) = panels(size=(6.0, 5.8))
    for name, colour, dash, said in (
        ("lab", BLUE, "-", "knees free"), ("lab-straight", VERMILION, (0, (5, 1.5)), "knees locked")
    ):  # fmt: skip
        own = [family for label, family in tables.items() if label.startswith(f"{name},")]
        for i, family in enumerate(own):
            label = "" if i else f"walker {name}: {said}"
            draw_family(ax, family, by, label, color=colour, linestyle=dash)
    ax.set_xlim(0.0, 0.1)
    family_key(ax, *tables.values())
    legend(ax, columns=2)
    return figure


def detuned(fractions: tuple[float, ...] = (0.0, 0.05, 0.3, 0.6, 0.75, 1.0)) -> Tables:
    """Branches of gaits between the tuned kneed walker C and the laboratory's walker."""
    tuned, lab = tune(WALKERS["C"]), WALKERS["lab"]
    found: dict[str, Any] = {}
    for fraction in fractions:
        walker = interpolate(tuned, lab, fraction)
        found |= _named(f"{fraction:.0%} of the way", families(walker, 1e-6, 0.15))
    return found


def detuning(tables: Tables) -> Figure:
    """Fig. 4.8: branches of gaits between the tuned kneed walker C and the laboratory's walker."""
    figure, axes = panels(2, 3, (9.2, 6.4), sharex=True, sharey=True)
    titles = dict.fromkeys(label.partition(",")[0] for label in tables)
    for ax, title in zip(axes, titles, strict=True):
        for label, family in tables.items():
            if label.startswith(f"{title},"):
                draw_family(ax, family)
        name = {"0%": " (C, tuned)", "100%": " (lab)"}.get(title.split()[0], "")
        ax.set_title(title + name, fontsize="small")
        ax.set(xlim=(0.0, 0.15), ylim=(0.0, 0.6), xlabel="", ylabel="")
    for ax in axes[3:]:
        ax.set_xlabel(SLOPE)
    for ax in axes[::3]:
        ax.set_ylabel(ANGLE)
    family_key(axes[0], *tables.values())
    legend_below(figure, axes[0], columns=3)
    return figure


def tuned() -> Tables:
    """Branches of gaits of the walkers A to E, tuned."""
    return _steps({name: tune(WALKERS[name]) for name in "ABCDE"}, 1e-5, 0.1)


def tuned_families(tables: Tables, by: str = _ANGLE) -> Figure:
    """Figs. 4.9 and 4.13: five walkers with gaits at vanishing slope, on linear and log axes."""
    figure, axes = panels(1, 2, (9.6, 5.4))
    for index, name in enumerate("ABCDE"):
        for kind, width in _WIDTHS:
            label = f"{name}, {kind} step"
            family = tables[label]
            value = family.columns()[by]
            style = {**series(index), "linewidth": width, "markersize": 4.5}
            style["fillstyle"] = "full" if kind == "long" else "none"
            for ax, spaced in zip(axes, (np.asarray, np.log), strict=True):
                # Markers at equal distances along the axis, shifted a little for each walker.
                where = spaced(family.slope)
                at = np.linspace(where.min(), where.max(), 9)[1:] - index * np.ptp(where) / 50.0
                marked = sorted({int(np.argmin(np.abs(where - x))) for x in at})
                ax.plot(family.slope, value, label=label, markevery=marked, **style)
    for ax in axes:
        ax.set(xlabel=SLOPE, ylabel=PLOTTED[by])
    axes[1].set(xscale="log", yscale="log")
    legend_below(figure, axes[1])
    return figure


def doublings(slopes: int = 1200) -> Tables:
    """Settled walks of the tuned kneed walker, its gait of period one, and its doublings."""
    walker = tune(WALKERS["C"])
    return {
        "settled walks": bifurcation_diagram(
            walker, np.linspace(0.07, 0.098, slopes), n_transient=500, n_recorded=100
        ),
        "gait of period 1": gait_family(walker, 0.07, 0.098),
        "period doublings": doubling_cascade(walker, 0.07, 0.098, doublings=3),
    }


def period_doubling(tables: Tables) -> Figure:
    """Fig. 4.10: bifurcation diagram of the tuned kneed walker, and its gait of period one."""
    diagram, family, cascade = tables.values()
    ax: Any = picture(diagram, OWN)
    draw_family(ax, family, label="gait of period 1")
    for period, slope in zip(cascade.periods, cascade.slopes, strict=True):
        ax.axvline(slope, color=GREY, linewidth=0.6, linestyle=":")
        ax.annotate(
            f"→ {2 * period}", (slope, 1.0), (0, 2), xycoords=("data", "axes fraction"),
            textcoords="offset points", ha="center", fontsize="x-small",
        )  # fmt: skip
    ax.set_title(f"walker {name_of(diagram.walker)}", fontsize="medium", pad=14.0)
    ax.plot([], [], ".", color="black", label="stance angles after transients")
    ax.plot([], [], ":", color=GREY, label="period doublings to 2, 4, 8")
    family_key(ax, family)
    legend(ax)
    return figure_of(ax)


class Plate(NamedTuple):
    """A figure that can be drawn.

    Attributes:
        tables: Function without arguments that computes the tables; none for a sketch.
        draw: Function that draws them.
        caption: Description of the figure that is complete without the page around it.
    """

    tables: Callable[[], Tables]
    draw: Callable[[Tables], Figure]
    caption: str


_STABLE = (
    "Heavy lines are stable gaits, light ones unstable; where a family ends, a marker gives the "
    "reason."
)
_LAB_SAYS = (
    "of the gaits of the laboratory's walker over slope, with its knees free and locked. "
    + _STABLE
    + " Hollow squares: gaits with a stance leg that stops for an instant in mid-stride."
)
_TUNED_SAYS = (
    "of the walkers A to E, tuned so that they can walk at vanishing slope, over slope, on linear "
    "and on logarithmic axes. Heavy lines with full markers are long-step gaits, light ones with "
    "hollow markers short-step gaits."
)
_TRANSITION_SAYS = (
    "of the point-foot walkers E and F over slope. Long steps are as the cube root of the slope "
    "for both; short steps change their scaling about where the slope is the ratio of foot mass to "
    "hip mass to the power 3/2 (dotted)."
)

FIGURES: dict[str, Plate] = {
    "4.1": Plate(
        dict,
        lambda _: walker_diagram(),
        "A kneed walker with the name of each parameter. Angles are measured from the ground's "
        "normal to a leg's line, which runs from the foot's centre to the hip when the knee is "
        "straight; they are positive when the upper end lies uphill. Black discs are masses, "
        "dashed circles radii of gyration. The right leg swings.",
    ),
    "4.3-angles": Plate(
        partial(_walk, 2, 400),
        lambda tables: figure_of(both(tables["lab"], OWN)),
        "Two strides of the laboratory's kneed walker at a slope of 0.036 rad. Left: angles of "
        "both legs' thighs and shanks over time, in units of √(l/g). Right: angular velocities "
        "over angles, by role; dotted lines connect the states before and after an impact.",
    ),
    "4.3-strobe": Plate(
        partial(_walk, 3, 7),
        lambda tables: figure_of(strobe(find_gait("lab", 0.036), strides=3, ax=OWN)),
        "Three strides of the laboratory's kneed walker down a slope of 0.036 rad. Seven postures "
        "of each stride, evenly spaced in time, heavy at heelstrike; stance legs are pale between. "
        "Diamonds: the knee at kneestrike. Marks on the ground count leg lengths l.",
    ),
    "4.4": Plate(
        lambda: {"contact point of the foot": approach()},
        lambda tables: heelstrike_diagram(*tables.values()),
        "The foot close to heelstrike, of the laboratory's walker with locked knees at a slope of "
        "0.05 rad. The coordinates x, down the slope, and y, normal to it, lead from the point of "
        "the ground where the foot will land to the point of the foot that will touch it. Dotted: "
        "the path of this point up to heelstrike, where the walker is pale. The angle θ* is the "
        "stance angle at heelstrike; the chapter's l is the distance from hip to foot centre.",
    ),
    "4.5": Plate(point_feet, transition, "Stance angle just after heelstrike " + _TRANSITION_SAYS),
    "4.6": Plate(laboratory, lab_families, "Stance angle just after heelstrike " + _LAB_SAYS),
    "4.7": Plate(
        dict,
        lambda _: standing_diagram(),
        "Conditions for gaits at arbitrarily small slopes: a tuned walker can stand on level "
        "ground with parallel legs and its hip above the contact point. (a) Straight legs: the "
        "centre of mass of the body is on the line from the contact point through the foot's "
        "centre to the hip. (b) Knees: the centre of mass of the shank is also below the knee.",
    ),
    "4.8": Plate(
        detuned,
        detuning,
        "Stance angle over slope as the tuned kneed walker C is changed, all parameters in "
        "proportion, into the laboratory's walker. " + _STABLE,
    ),
    "4.9": Plate(tuned, tuned_families, "Stance angle just after heelstrike " + _TUNED_SAYS),
    "4.10": Plate(
        doublings,
        period_doubling,
        "The period-doubling route to chaos of the tuned kneed walker C. Black: stance angles of "
        "100 successive strides, after 500 transient strides, at each of 1200 slopes. "
        "Blue: the gait of period one, heavy where it is stable. Dotted: period doublings to 2, 4 "
        "and 8. Dashed: the crisis, beyond which all walks end in a fall.",
    ),
    "4.11": Plate(
        point_feet, partial(transition, by=_SPEED), "Mean speed over √(g l) " + _TRANSITION_SAYS
    ),
    "4.12": Plate(
        laboratory, partial(lab_families, by=_SPEED), "Mean speed over √(g l) " + _LAB_SAYS
    ),
    "4.13": Plate(
        tuned, partial(tuned_families, by=_SPEED), "Mean speed over √(g l) " + _TUNED_SAYS
    ),
}
"""The figures that can be drawn, by their numbers in Garcia (1999), chapter 4.

Fig. 4.2 is a photograph.
"""


def draw(
    name: str, path: str | PathLike[str], size: tuple[float, float] | None = None
) -> list[Path]:
    """Draw a figure to a file, with its caption in the file's metadata.

    The tables that it shows are written to a CSV file of the same name beside it. The first column
    has the name of the curve; a quantity that a table does not have is empty.

    Args:
        name: One of `FIGURES`.
        path: The file; its suffix selects the format. Its folder is created if needed.
        size: Width and height in cm; the figure's own if None.

    Returns:
        Paths of the files.

    Raises:
        ValueError: if the figure or the format is unknown.
        OSError: if a file cannot be written.
    """
    if name not in FIGURES:
        raise ValueError(
            f"no figure {name!r}{near(name, FIGURES)}: choose from {', '.join(FIGURES)}"
        )
    need("matplotlib", "figures")
    path, plate = picture_path(path), FIGURES[name]
    beside = prepare(path.with_suffix(".csv"))
    tables = plate.tables()
    figure = plate.draw(tables)
    if size is not None:
        resize(figure, size)
    save(figure, path, plate.caption)
    if not tables:
        return [path]
    columns = {curve: table.columns() for curve, table in tables.items()}
    names = ["curve", *dict.fromkeys(each for found in columns.values() for each in found)]
    with replacing(beside) as aside, aside.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, names)
        writer.writeheader()
        for curve, found in columns.items():
            for row in zip(*(values.tolist() for values in found.values()), strict=True):
                writer.writerow({"curve": curve, **dict(zip(found, row, strict=True))})
    return [path, beside]
