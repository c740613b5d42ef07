"""Compare with every number of Garcia (1999), chapter 4, and write the validation page."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from gym_passive_walker import console
from validation import page


def main(words: Sequence[str] | None = None) -> int:
    """Write the page; returns 0 if every row is as expected, else 1."""
    return console.run(lambda: _write(words))


def _write(words: Sequence[str] | None) -> int:
    parser = argparse.ArgumentParser(prog="python -m validation", description=__doc__)
    parser.add_argument("--out", default="validation.md", help="Markdown file to write")
    path = parser.parse_args(words).out
    count = iter(range(1, len(page.sections()) + 1))

    def progress(title: str) -> None:
        print(f"{next(count):>3} of {len(page.sections())}  {title}", flush=True)

    unsound = page.write(path, progress)
    for row in unsound:
        print(f"not as known: {row.where}, {row.what}: {row.computed}", file=sys.stderr)
    print(path)
    return 1 if unsound else 0


if __name__ == "__main__":
    sys.exit(main())
