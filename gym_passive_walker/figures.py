"""The figures of the source document, computed: one function each, and `draw` for all of them.

Each returns a matplotlib Figure that belongs to nobody; nothing is shown and nothing is global.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gym_passive_walker.gaits.family import GaitFamily, gait_family
from gym_passive_walker.gaits.fixed_point import find_gait
from gym_passive_walker.gaits.gait import GaitKind, GaitNotFound
from gym_passive_walker.render.extras import extra
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


def families(walker: Walker, low: float, high: float) -> list[GaitFamily]:
    """Every family of gaits met from the long and the short gaits of a range of slopes."""
    found: list[GaitFamily] = []
    for bottom in (low, 0.5 * (low + high)):
        for kind, _ in _KINDS:
            try:
                family = gait_family(walker, bottom, high, kind)
            except GaitNotFound:
                continue
            middle = len(family) // 2
            known = any(
                np.min(
                    np.hypot(
                        np.log(other.slope / family.slope[middle]),
                        np.log(other.stance_angle / family.stance_angle[middle]),
                    )
                )
                < 0.05
                for other in found
            )
            if not known:
                found.append(family)
    return found


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
    ax.set_xlim(0.0, 0.1)
    ax.legend(fontsize="small")
    return figure


def detuning(fractions: tuple[float, ...] = (0.0, 0.05, 0.2, 0.4, 0.6, 1.0)) -> Figure:
    """Fig. 4.8: families of the tuned kneed walker as it is changed into the laboratory's."""
    figure, axes = _panels(2, 3, (9.0, 5.5))
    tuned, lab = tune(WALKERS["C"]), WALKERS["lab"]
    for ax, fraction in zip(axes, fractions, strict=True):
        for family in families(blend(tuned, lab, fraction), 2e-4, 0.15):
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


FIGURES: dict[str, Callable[[], Figure]] = {
    "4.3-angles": gait_cycle,
    "4.3-strobe": gait_strobe,
    "4.5": transition,
    "4.6": lab_families,
    "4.8": detuning,
    "4.9": tuned_families,
    "4.11": lambda: transition(_SPEED),
    "4.12": lambda: lab_families(_SPEED),
    "4.13": lambda: tuned_families(_SPEED),
}
"""The figures that can be drawn, by their numbers in the source document."""


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
