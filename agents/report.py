"""What an evaluation says: a table for people, rows for everything else."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.evaluation import Walks

_QUANTITIES: tuple[tuple[str, Callable[[Walks], NDArray], str], ...] = (
    ("distance / leg length", lambda walks: walks.distance, ".1f"),
    ("strides", lambda walks: walks.strides, ".0f"),
    ("speed / √(g l)", lambda walks: walks.speed, ".3f"),
    ("cost of transport", lambda walks: walks.cost_of_transport, ".4f"),
    ("  of it gravity's", lambda walks: walks.gravity_cost, ".4f"),
    ("return", lambda walks: walks.reward, ".2f"),
)


def table(title: str, columns: dict[str, Walks]) -> str:
    """Agents side by side: medians over the episodes, with their range, and how walks ended.

    Args:
        title: First line.
        columns: The walks of each agent, by its name.
    """
    rows = [["", *columns]]
    for label, quantity, form in _QUANTITIES:
        rows.append([label, *(_spread(quantity(walks), form) for walks in columns.values())])
    for ending, _ in Counter(e for walks in columns.values() for e in walks.endings).most_common():
        counts = (f"{walks.endings.count(ending)} of {len(walks)}" for walks in columns.values())
        rows.append([ending, *counts])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [
        "  ".join(
            cell.rjust(width) if index else cell.ljust(width)
            for index, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    ]
    rule = "─" * len(lines[0])
    return "\n".join([title, rule, lines[0], rule, *lines[1:], rule])


def _spread(values: NDArray, form: str) -> str:
    """Median and range of some numbers."""
    values = values[np.isfinite(values)]
    if not len(values):
        return "–"
    low, middle, high = (f"{np.percentile(values, q):{form}}" for q in (0, 50, 100))
    return middle if low == high else f"{middle} ({low} to {high})"


def write_rows(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write rows as CSV."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
