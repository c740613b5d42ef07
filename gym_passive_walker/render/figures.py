"""The figures of the source document, computed: one function each, and `draw` for all of them.

Each returns a matplotlib Figure that belongs to nobody; nothing is shown and nothing is global.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gym_passive_walker.gaits.bifurcation import bifurcation_diagram
from gym_passive_walker.gaits.family import GaitFamily, gait_family
from gym_passive_walker.gaits.fixed_point import find_gait, find_gaits
from gym_passive_walker.gaits.gait import Gait, GaitKind
from gym_passive_walker.extras import extra
from gym_passive_walker.render.strobe import phase_portrait, strobe
from gym_passive_walker.walkers import WALKERS, Walker, blend, tune

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's colours, which the colour-blind tell apart.
_COLOURS = {"A": "#0072B2", "B": "#D55E00", "C": "#009E73", "D": "#000000", "E": "#CC79A7"}
_KINDS: tuple[tuple[GaitKind, str], ...] = (("long", "-"), ("short", "--"))
_ANGLE, _SPEED = "stance angle (rad)", "speed / √(g l)"


def _panels(rows: int, columns: int, size: tuple[float, float]) -> tuple[Figure, list[Axes]]:
    with extra("figures"):
        from matplotlib.figure import Figure
    figure = Figure(figsize=size, layout="constrained")
    return figure, list(figure.subplots(rows, columns, squeeze=False).ravel())


def _measure(family: GaitFamily, what: str) -> np.ndarray:
    return family.stance_angle if what == _ANGLE else family.froude_speed


def plot_family(ax: Axes, family: GaitFamily, what: str = _ANGLE, **style: Any) -> None:
    """Draw a family over slope, heavy where it is stable.

    Args:
        ax: Where to draw.
        family: The family.
        what: "stance angle (rad)" or "speed / √(g l)".
        **style: For matplotlib's lines.
    """
    label = style.pop("label", None)
    value = _measure(family, what)
    ax.plot(family.slope, value, linewidth=1.0, label=label, **style)
    heavy = np.where(family.stable, value, np.nan)
    ax.plot(family.slope, heavy, **{"linewidth": 2.8, "solid_capstyle": "butt", **style})
    ax.set_xlabel("slope (rad)")
    ax.set_ylabel(what)


def families(walker: Walker, low: float, high: float, looks: int = 8) -> list[GaitFamily]:
    """Every family of gaits that passes one of some slopes, followed over their range.

    Args:
        walker: The walker.
        low: Lowest slope in rad.
        high: Highest slope in rad.
        looks: At how many slopes gaits are looked for.
    """
    found: list[GaitFamily] = []
    for slope in np.linspace(low, high, looks):
        for gait in find_gaits(walker, float(slope)):
            if not any(_passes(family, gait) for family in found):
                found.append(gait_family(walker, low, high, start=gait))
    return found


def _passes(family: GaitFamily, gait: Gait) -> bool:
    """Whether a family goes through a gait, as nearly as its points lie apart."""
    apart = np.hypot(
        np.log(family.slope / gait.slope), np.log(family.stance_angle / gait.stance_angle)
    )
    return bool(apart.min() < 0.05)


def gait_cycle() -> Figure:
    """Fig. 4.3, upper part: the angles of the laboratory's walker over a stride."""
    gait = find_gait("lab", 0.036)
    return phase_portrait(gait.walker, gait.slope, gait.state)


def gait_strobe() -> Figure:
    """Fig. 4.3, lower part: a strobe picture of the laboratory's walker."""
    gait = find_gait("lab", 0.036)
    return strobe(gait.walker, gait.slope, gait.state)


def transition(what: str = _ANGLE) -> Figure:
    """Figs. 4.5 and 4.11: the short step's change of scaling, for feet of two masses."""
    figure, (ax,) = _panels(1, 1, (6.0, 4.5))
    for name, ratio, colour in (("E", 0.125, "#CC79A7"), ("F", 0.05 / 0.9, "#0072B2")):
        for kind, line in _KINDS:
            family = gait_family(WALKERS[name], 1e-7, 0.2, kind)
            ax.plot(
                family.slope,
                _measure(family, what),
                line,
                color=colour,
                label=f"{name}, {kind} step",
            )
        ax.axvline(ratio**1.5, color=colour, linewidth=0.8, linestyle=":")
    ax.set(xscale="log", yscale="log", xlabel="slope (rad)", ylabel=what)
    ax.set_title("dotted: foot mass / hip mass, to the power 3/2", fontsize="small")
    ax.legend(fontsize="small")
    return figure


def lab_families(what: str = _ANGLE) -> Figure:
    """Figs. 4.6 and 4.12: the laboratory's walker, knees free and locked; heavy where stable."""
    figure, (ax,) = _panels(1, 1, (6.0, 4.5))
    for name, line in (("lab", "-"), ("lab-straight", "--")):
        for i, family in enumerate(families(WALKERS[name], 0.005, 0.1)):
            label = name if i == 0 else None
            plot_family(ax, family, what, linestyle=line, color="#0072B2", label=label)
            slow = slice(0, int(np.argmin(family.slope)) + 1)
            for halt in family.halts:
                at = np.argmin(np.abs(family.slope[slow] - halt))
                ax.plot(halt, _measure(family, what)[at], "o", color="#0072B2", fillstyle="none")
    ax.set_title("o: the stance leg barely passes the vertical", fontsize="small")
    ax.set_xlim(0.0, 0.1)
    ax.legend(fontsize="small")
    return figure


def detuning(fractions: tuple[float, ...] = (0.0, 0.05, 0.3, 0.6, 0.75, 1.0)) -> Figure:
    """Fig. 4.8: families of the tuned kneed walker as it is changed into the laboratory's."""
    figure, axes = _panels(2, 3, (9.0, 5.5))
    tuned, lab = tune(WALKERS["C"]), WALKERS["lab"]
    for ax, fraction in zip(axes, fractions, strict=True):
        for family in families(blend(tuned, lab, fraction), 1e-6, 0.15):
            plot_family(ax, family, color="#0072B2")
        ax.set(xlim=(0.0, 0.15), ylim=(0.0, 0.6), title=f"{fraction:.0%} de-tuned")
    return figure


def tuned_families(what: str = _ANGLE) -> Figure:
    """Figs. 4.9 and 4.13: five walkers that can walk at vanishing slope, linear and logarithmic."""
    figure, axes = _panels(1, 2, (10.0, 4.5))
    for name, colour in _COLOURS.items():
        for kind, line in _KINDS:
            family = gait_family(tune(WALKERS[name]), 1e-5, 0.1, kind)
            for ax in axes:
                label = f"{name}, {kind} step"
                ax.plot(family.slope, _measure(family, what), line, color=colour, label=label)
    for ax in axes:
        ax.set(xlabel="slope (rad)", ylabel=what)
    axes[1].set(xscale="log", yscale="log")
    axes[1].legend(fontsize="x-small", ncols=2)
    return figure


def period_doubling(slopes: int = 500) -> Figure:
    """Fig. 4.10: where walks of the tuned kneed walker settle; thin, its gait of period one."""
    figure, (ax,) = _panels(1, 1, (6.0, 4.5))
    walker = tune(WALKERS["C"])
    diagram = bifurcation_diagram(walker, np.linspace(0.07, 0.098, slopes), settle=500, keep=64)
    family = gait_family(walker, 0.07, 0.1)
    ax.plot(family.slope, family.stance_angle, color="#0072B2", linewidth=0.8)
    ax.plot(diagram.slope, diagram.stance_angle, ".", color="#000000", markersize=0.8)
    ax.set(xlabel="slope (rad)", ylabel=_ANGLE)
    return figure


FIGURES: dict[str, Callable[[], Figure]] = {
    "4.3-angles": gait_cycle,
    "4.3-strobe": gait_strobe,
    "4.5": transition,
    "4.6": lab_families,
    "4.8": detuning,
    "4.9": tuned_families,
    "4.10": period_doubling,
    "4.11": lambda: transition(_SPEED),
    "4.12": lambda: lab_families(_SPEED),
    "4.13": lambda: tuned_families(_SPEED),
}
"""The figures that can be drawn, by their numbers in the source document.

Figs. 4.1, 4.4 and 4.7 are sketches of definitions and Fig. 4.2 is a photograph: nothing to compute.
"""


def draw(name: str, folder: str | Path) -> Path:
    """Draw a figure to a PNG file.

    Args:
        name: One of `FIGURES`.
        folder: Where to write it; made if it is not there.

    Returns:
        The file.

    Raises:
        ValueError: if there is no such figure.
    """
    if name not in FIGURES:
        raise ValueError(f"no figure {name!r}: choose from {', '.join(FIGURES)}")
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"figure-{name}.png"
    FIGURES[name]().savefig(path, dpi=150)
    return path
