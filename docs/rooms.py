"""Draw the rooms of the package from its imports, on docs/architecture.md.

    python docs/rooms.py

The floors are those of the contract "layers" in pyproject.toml, which `lint-imports` checks.
"""

from __future__ import annotations

import argparse
import textwrap
import tomllib
from pathlib import Path

import grimp

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "architecture.md"
PACKAGE = "gym_passive_walker"
BEGIN, END = "from the code:", "| room | what goes in |"


def floors() -> list[list[str]]:
    """Rooms and modules on each floor, from the top."""
    found = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contract = found["tool"]["importlinter"]["contracts"][0]
    return [[each.strip() for each in layer.split("|")] for layer in contract["layers"]]


def drawing() -> str:
    """The floors with what is in each room, and the number of imports between rooms."""
    graph = grimp.build_graph(PACKAGE)
    rooms = [
        room for floor in floors() for room in floor if graph.find_children(f"{PACKAGE}.{room}")
    ]
    rooms = [room for room in rooms if room != "control"]  # a public module
    lines = []
    for room in rooms:
        within = sorted(graph.find_children(f"{PACKAGE}.{room}"))
        names = [each.rpartition(".")[2] + "/" * bool(graph.find_children(each)) for each in within]
        beside = next(floor for floor in floors() if room in floor)
        mark = "| " if room != beside[0] else "  "  # on the floor of the room above
        head = f"{mark}{room + '/':<11}"
        lines += textwrap.wrap(
            " ".join(names), 110, initial_indent=head, subsequent_indent=" " * len(head),
            break_on_hyphens=False,
        )  # fmt: skip
    count = {
        (a, b): sum(
            len(graph.find_modules_directly_imported_by(module) & inside[b]) for module in inside[a]
        )
        for inside in [
            {r: graph.find_descendants(f"{PACKAGE}.{r}") | {f"{PACKAGE}.{r}"} for r in rooms}
        ]
        for a in rooms
        for b in rooms
        if a != b
    }
    table = [f"| imports of | {' | '.join(rooms[1:])} |", "|---" * len(rooms) + "|"]
    for a in rooms[:-1]:
        cells = [str(count.get((a, b), "") or "") for b in rooms[1:]]
        table.append(f"| {a} | {' | '.join(cells)} |")
    return "\n".join(["```text", *lines, "```", "", *table])


def page() -> str:
    """The page with today's drawing."""
    text = PAGE.read_text(encoding="utf-8")
    above, rest = text.split(BEGIN)
    return f"{above}{BEGIN}\n\n{drawing()}\n\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__.partition("\n")[0]).parse_args()
    PAGE.write_text(page(), encoding="utf-8")
