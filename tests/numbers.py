"""Results in short, and the work for them, for files that tests compare with."""

import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy

from gym_passive_walker.gaits.flow import Flow

NO_RESULTS = {
    "walker", "stride_map", "axis", "walk", "body", "controller", "scene", "motion",
    "period_response", "_map", "simulator",
}  # fmt: skip
"""Fields of results that were given, or are made of others; the last one's digits are few."""
_PINS = (Path(__file__).parents[1] / "constraints.txt").read_text("utf-8").splitlines()
_PINNED = {f"numpy=={np.__version__}", f"scipy=={scipy.__version__}"} <= {*_PINS}
WORK = ("calls of the engine", "walkers in them")


def told(values: Any) -> str:
    """Numbers, in short: those of a few, else the number, means, squares and slopes of many."""
    rows = np.asarray(np.ma.filled(np.ma.asarray(values, float), np.nan))
    shape = "x".join(str(n) for n in rows.shape)
    rows = rows.reshape(-1, rows.shape[-1] if rows.ndim > 1 and rows.shape[-1] < 4 else 1)
    start = ""
    if rows.size > 12:
        weights = np.linspace(-1.0, 1.0, len(rows))[:, None]
        start = f"({shape}, {int(np.isnan(rows).sum())} nan, {int(np.isinf(rows).sum())} inf) "
        rows = np.where(np.isinf(rows), np.nan, rows)
        with np.errstate(invalid="ignore"):  # there may be no number
            count = np.sum(~np.isnan(rows), axis=0)
            rows = np.array([np.nansum(x, axis=0) / count
                             for x in (rows, rows**2, weights * rows)])  # fmt: skip
    each = rows.ravel().tolist()
    return start + " ".join("nan" if math.isnan(x) else f"{x + 0.0:.6g}" for x in each)


_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def alike(one: str, other: str, rel_tol: float, abs_tol: float) -> bool:
    """Whether two texts differ in no more than the rounding of their numbers."""
    if _NUMBER.sub("#", one) != _NUMBER.sub("#", other):
        return False
    pairs = zip(_NUMBER.findall(one), _NUMBER.findall(other), strict=True)
    near = {"rel_tol": rel_tol, "abs_tol": abs_tol}
    return all(x == y or math.isclose(float(x), float(y), **near) for x, y in pairs)


def numbers_in(found: Any, path: str = "", depth: int = 0) -> Iterator[tuple[str, str]]:
    """The numbers of a result, in short, and its words, by the names of its fields."""
    if hasattr(found, "detach") and hasattr(found, "numpy"):
        found = found.detach().numpy()
    if isinstance(found, str | Enum):
        yield path, getattr(found, "name", found)
    elif isinstance(found, Mapping):
        for key, each in found.items():
            yield from numbers_in(each, f"{path}[{key}]", depth)
    elif isinstance(found, np.ndarray | float | int | complex):
        values = np.asarray(found)
        if values.dtype.kind == "c":
            values = np.sort(np.abs(values))
        if values.dtype.kind in "bif":
            yield path, told(values)
    elif isinstance(found, list | tuple) and not hasattr(found, "_fields"):
        for i, each in enumerate(found[:3]):
            yield from numbers_in(each, f"{path}[{i}]", depth)
    elif (is_dataclass(found) or hasattr(found, "_fields")) and depth < 2:
        names = getattr(found, "_fields", None) or [field.name for field in fields(found)]
        for name in names:
            if "error" not in name and name not in NO_RESULTS:
                yield from numbers_in(getattr(found, name), f"{path}.{name}".lstrip("."), depth + 1)


@contextmanager
def work() -> Iterator[dict[str, str]]:
    """Count the calls of the engine, and the walkers that they integrate, by the names of WORK."""
    counts, found, integrate = [0, 0], {}, Flow.integrate

    def counted(self: Flow, *given: Any) -> Flow:
        counts[0] += 1
        counts[1] += len(self.records)
        return integrate(self, *given)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Flow, "integrate", counted)
        yield found
    found |= dict(zip(WORK, map(str, counts), strict=True))


def compare(kept: Mapping[str, str], found: Mapping[str, str]) -> None:
    """Check that results and the work for them are those of a file."""
    assert kept.keys() == found.keys()
    for field, before in kept.items():
        if field in WORK and not _PINNED:
            continue  # other versions may search otherwise
        # Rounding, which depends on the CPU, moves the end of some searches.
        near = (0.1, 8.0) if field in WORK else (1e-5, 5e-6)
        assert alike(before, found[field], *near), f"{field}: {before}, now {found[field]}"
