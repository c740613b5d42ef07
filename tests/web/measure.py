"""Measure what docs/web.md states of pages: sizes, first frame, frames, strides.

    python -m tests.web.measure  # requires Node.js and Chromium

Sizes are those of Node's Brotli at its highest quality, one KB is 1,000 bytes. Chromium is headless
and draws without a GPU.
"""

from __future__ import annotations

import json
import platform
import shutil
import statistics
import subprocess
import tempfile
from pathlib import Path

import gym_passive_walker as gpw
from gym_passive_walker.devices.web.build import MODULES, build
from gym_passive_walker.engine.run import new_records
from tests.web.browser import Browser, Chromium, served
from tests.web.test_package import COMPRESSED
from tests.web.test_page import FRAMES, PAGE, READY
from tests.web.test_walks import _job, _near

OPENINGS = 5
STRIDES = 300


def sizes(folder: Path) -> list[tuple[str, str, str]]:
    """Compressed sizes of the modules."""
    names = [f"{kind}.wasm" for kind in MODULES]
    command = ["node", "--input-type=module", "-e", COMPRESSED, *(str(folder / n) for n in names)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found = zip(names, json.loads(done.stdout), strict=True)
    return [(f"`{name}`, Brotli", f"{size / 1e3:.1f} KB", "60 KB") for name, size in found]


def page(browser: Browser, address: str) -> list[tuple[str, str, str]]:
    """First frame, frames in a second, time of a stride."""
    firsts, frames = [], []
    for _ in range(OPENINGS):
        browser.open("about:blank")
        browser.open(address)
        firsts.append(browser.run(READY))
        frames.append(browser.run(FRAMES))
    walker = gpw.WALKERS["lab"]
    job = json.dumps(_job(walker, "lab", new_records(_near(walker, 0.03, STRIDES), 0.03)))
    time = browser.run(f"""(async () => {{
        const {{ run }} = await import("./jobs.mjs");
        return (await run(await import("./passive-walker.js"), {job})).time;
    }})()""")
    return [
        ("first frame, from the start of navigation", f"{statistics.median(firsts):.0f} ms", "1 s"),
        ("frames per second while a slider moves", f"{statistics.median(frames):.0f}", "30"),
        ("a stride of `lab`, tolerance 10⁻⁸", f"{time / 1e3:.2f} ms", ""),
    ]


def main() -> None:
    """Print the table."""
    programs = Chromium.programs()
    if programs is None or shutil.which("node") is None:
        raise SystemExit("this needs Node.js and Chromium")
    with tempfile.TemporaryDirectory() as folder:
        made = build(Path(folder, "page"))
        (made / "index.html").write_text(PAGE)
        shutil.copy(Path(__file__).parent / "jobs.mjs", made)
        rows, browser = sizes(made), Chromium(programs, Path(folder, "profile"))
        try:
            with served(made) as address:
                rows += page(browser, address)
        finally:
            browser.close()
    print("| quantity | measured | limit |\n|---|---|---|")
    for row in rows:
        print(f"| {' | '.join(row)} |")
    print(f"\n{browser.version}, {platform.machine()}, gym_passive_walker {gpw.__version__}")


if __name__ == "__main__":
    main()
