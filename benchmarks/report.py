"""Measure times, name the machine, and draw and print results."""

from __future__ import annotations

import argparse
import gc
import os
import platform
import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from benchmarks.tables import DOCS


def machine(*packages: str) -> str:
    """A line with the machine and the package versions of a result."""
    model = platform.processor() or platform.machine()
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                # Marks of registration, and a last word that says nothing of the model.
                model = re.sub(r"\(R\)| Proc\w+", "", line.split(":")[1]).strip()
            if line.startswith("flags"):
                model += " with AVX-512" if "avx512f" in line else " without AVX-512"
                break
    except OSError:
        pass
    known = []
    for name in ("numpy", "numba", *packages):
        try:
            known.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            known.append(f"{name} absent")
    return (
        f"{date.today()}, {model}, {os.cpu_count()} cores, {platform.system()}, "
        f"Python {platform.python_version()}, {', '.join(known)}"
    )


def seconds(
    job: Callable[[], object], *, at_least: float = 0.2, repeats: int = 5, most: float = 10.0
) -> float:
    """Seconds of one call: the least over some repeats, each with many calls.

    Args:
        job: Function to call; it is called beforehand too.
        at_least: Least duration of a repeat in seconds.
        repeats: Number of repeats.
        most: Time in seconds after which no further repeat begins.
    """
    job()
    began = time.perf_counter()
    job()
    calls = max(1, round(at_least / max(time.perf_counter() - began, 1e-9)))
    best, collecting = float("inf"), gc.isenabled()
    gc.disable()
    try:
        for _ in range(repeats):
            start = time.perf_counter()
            for _ in range(calls):
                job()
            best = min(best, (time.perf_counter() - start) / calls)
            if time.perf_counter() - began > most:
                break
    finally:
        if collecting:
            gc.enable()
    return best


def timed(job: Callable[[], object], calls: int = 20) -> float:
    """Mean seconds of some calls."""
    start = time.perf_counter()
    for _ in range(calls):
        job()
    return (time.perf_counter() - start) / calls


def in_turns(measure: Sequence[Callable[[], float]], most: float = 15.0) -> list[float]:
    """Least result of each function; they take turns, so that other load delays all alike.

    Args:
        measure: Functions that return seconds.
        most: Time in seconds after which no further turn begins.
    """
    least, collecting, began = [float("inf")] * len(measure), gc.isenabled(), time.perf_counter()
    gc.disable()
    try:
        while time.perf_counter() - began < most:
            least = [min(before, each()) for before, each in zip(least, measure, strict=True)]
    finally:
        if collecting:
            gc.enable()
    return least


def command(
    description: str | None, parts: Mapping[str, Callable[[], object]] | None = None
) -> None:
    """Parse the command line of a script, and run the requested parts.

    Args:
        description: Text of `--help`.
        parts: The script's parts by name; all run if none is named.
    """
    from gym_passive_walker._tools import (
        console,  # imported here: some scripts load the package later
    )

    console.print_in_any_encoding()
    shape = argparse.RawTextHelpFormatter
    parser = argparse.ArgumentParser(description=description, formatter_class=shape)
    if parts is None:
        parser.parse_args()
        return

    def part(name: str) -> str:
        if name not in parts:
            raise argparse.ArgumentTypeError(f"no part {name!r}: choose from {', '.join(parts)}")
        return name

    parser.add_argument(
        "parts", nargs="*", type=part, help=f"of {', '.join(parts)}; all if none is given"
    )
    for name in parser.parse_args().parts or parts:
        parts[name]()


def plot(
    name: str,
    curves: Mapping[str, tuple[Sequence[float], Sequence[float]]],
    axes_names: tuple[str, str],
    *,
    title: str = "",
    falling: bool = False,
) -> None:
    """Draw curves over two logarithmic axes to `docs/images`; the engine's own are heavy.

    Args:
        name: Name of the picture.
        curves: Horizontal and vertical values, by label.
        axes_names: Labels of the horizontal and the vertical axis.
        title: Title of the picture.
        falling: Whether the horizontal axis runs from large to small.
    """
    from gym_passive_walker.pictures.axes import HEAVY, LIGHT, legend, panels, save, series

    figure, (axes,) = panels(size=(7.0, 5.6))
    for index, (label, (across, up)) in enumerate(curves.items()):
        width = HEAVY if label.startswith("this engine") else LIGHT
        style = {**series(index), "linewidth": width, "zorder": 1 + width}
        axes.loglog(across, up, label=label, **style)
    axes.set(xlabel=axes_names[0], ylabel=axes_names[1])
    axes.set_title(title, fontsize="medium")
    if falling:
        axes.invert_xaxis()
    legend(axes)
    save(figure, DOCS / "images" / f"{name}.png")


def spread(values: Sequence[float], form: str) -> str:
    """Median of values, and their range if there are several."""
    low, middle, high = (format(x, form) for x in np.percentile(values, [0.0, 50.0, 100.0]))
    return middle if len(values) == 1 else f"{middle} ({low} to {high})"


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table; floats are shown to three digits."""

    def cell(value: object) -> str:
        if isinstance(value, float):
            if value != value:
                return "—"
            return f"{value:.1e}" if value != 0.0 and abs(value) < 1e-3 else f"{value:,.3g}"
        return f"{value:,}" if isinstance(value, int) else str(value)

    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    lines += ["| " + " | ".join(cell(value) for value in row) + " |" for row in rows]
    return "\n".join(lines)
