"""Numbers in short, and texts with numbers, for files that tests compare with."""

import math
import re
from typing import Any

import numpy as np


def told(values: Any) -> str:
    """Numbers, in short: those of a few, else the number, means, squares and slopes of many."""
    rows = np.asarray(np.ma.filled(np.ma.asarray(values, float), np.nan))
    shape = "x".join(str(n) for n in rows.shape)
    rows = rows.reshape(-1, rows.shape[-1] if rows.ndim > 1 and rows.shape[-1] < 4 else 1)
    start = ""
    if rows.size > 12:
        weights = np.linspace(-1.0, 1.0, len(rows))[:, None]
        start = f"({shape}, {int(np.isnan(rows).sum())} nan) "
        rows = np.array([np.nanmean(x, axis=0) for x in (rows, rows**2, weights * rows)])
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
