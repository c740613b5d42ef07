"""How results are printed, and kept in the pages of `docs/`."""

from __future__ import annotations

import gc
import os
import platform
import time
from collections.abc import Callable, Iterable, Sequence
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

DOCS = Path(__file__).parent.parent / "docs"
PAGE = DOCS / "benchmarks.md"


def machine(*packages: str) -> str:
    """The machine and the versions that a result belongs to, in a line."""
    model = platform.processor() or platform.machine()
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                model = line.split(":")[1].strip()
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
    """Time of one call: the least over some repeats, each of enough calls to be measured.

    Args:
        job: What to call; it is called once beforehand.
        at_least: Time for each repeat.
        repeats: How many repeats.
        most: Time after which no further repeat begins.
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


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A markdown table; floats are shown to three digits."""

    def cell(value: object) -> str:
        if isinstance(value, float):
            if value != value:
                return "—"
            return f"{value:.1e}" if value != 0.0 and abs(value) < 1e-3 else f"{value:,.3g}"
        return f"{value:,}" if isinstance(value, int) else str(value)

    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    lines += ["| " + " | ".join(cell(value) for value in row) + " |" for row in rows]
    return "\n".join(lines)


def keep(name: str, text: str, page: Path = PAGE) -> None:
    """Print a result and put it into a page, between the marks that carry its name."""
    print(f"\n{text}", flush=True)
    first, last = f"<!-- {name} -->", f"<!-- end of {name} -->"
    old = page.read_text(encoding="utf-8") if page.exists() else ""
    if first not in old:
        old += f"\n{first}\n{last}\n"
    before, rest = old.split(first, 1)
    page.write_text(before + f"{first}\n\n{text}\n\n{last}" + rest.split(last, 1)[1], "utf-8")
