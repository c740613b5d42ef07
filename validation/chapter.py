"""The page with every figure and table of Garcia (1999), chapter 4, in its order.

Each item has its command, its picture, its data file and its agreement, which is counted from the
rows of the validation page.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from fractions import Fraction
from typing import NamedTuple

from validation.rows import Row, link


class Item(NamedTuple):
    """A figure or table.

    Attributes:
        name: "Figure 4.5" or "Table 4.1".
        shows: What it shows.
        statements: Patterns of "where | what" of its rows, by what they are about.
        apart: What could not be compared, and why.
        pictures: Names of its figures in `passive-walker figures`; none for a table.
        data: Whether a data file is written.
    """

    name: str
    shows: str
    statements: Mapping[str, str]
    apart: str
    pictures: tuple[str, ...] = ()
    data: bool = True


_CURVES = "The curves themselves: the chapter prints no numbers of them."

ITEMS = (
    Item("Figure 4.1", "Parameters and angles of a kneed walker.", {},
         "A sketch has no numbers. A test finds the name of every parameter in the picture.",
         ("4.1",), data=False),
    Item("Figure 4.2", "A stroboscopic photograph of the laboratory's machine.", {},
         "A photograph is not computed. Figure 4.3 has the simulation of this machine, and Table "
         "4.2 its measured walks."),
    Item("Figure 4.3", "Angles of a stable gait over time, and a stroboscopic picture.",
         {"parameters and stability": r"Fig\. 4\.3", "the gait's fixed point": r"4\.10\.1 \|"},
         "The curves, of which the chapter prints the fixed point alone; and the human data of "
         "Winter (1987) beside them, which are no walker's.",
         ("4.3-angles", "4.3-strobe")),
    Item("Figure 4.4", "Coordinates of the foot close to heelstrike.",
         {"the energy that its velocity costs": r"Eq\. 4\.7"},
         "A sketch has no numbers. Here it is drawn from a computed stride, of which the foot's "
         "path is a test of Eq. 4.10: the velocities are equal, but ẋ has the other sign. The "
         "equation's x points up the slope, and the text's down. Losses have the square of ẋ.",
         ("4.4",)),
    Item("Figure 4.5", "Scaling of the steps of two point-foot walkers: stance angle.",
         {"the scaling": r"Fig\. 4\.5", "numbers of its section": r"4\.5\.1 \|"}, _CURVES,
         ("4.5",)),
    Item("Figure 4.6", "Gaits of the laboratory's walker over slope: stance angle.",
         {"the caption's and the section's six points": r"Fig\. 4\.6"}, _CURVES, ("4.6",)),
    Item("Figure 4.7", "Conditions for gaits at arbitrarily small slopes.",
         {"walkers that are to meet them": r"Fig\. 4\.7", "what follows": r"4\.6\.[12] \|"},
         "A sketch has no numbers.", ("4.7",), data=False),
    Item("Figure 4.8", "Gaits between the tuned kneed walker and the laboratory's.",
         {"the section's three points": r"Fig\. 4\.8"},
         f"{_CURVES} Nor does it print how far (b) to (e) are de-tuned.", ("4.8",)),
    Item("Figure 4.9", "Gaits of five tuned walkers over slope: stance angle.",
         {"the section's five points": r"Fig\. 4\.9"}, _CURVES, ("4.9",)),
    Item("Table 4.1", "Parameters of the tuned walkers.", {"the parameters": r"Table 4\.1"},
         "Walker D is the limit of heavy hips, which is here a walker with a hip mass on legs "
         "without mass."),
    Item("Figure 4.10", "Period doubling of the tuned kneed walker.",
         {"the section's numbers": r"4\.7 \|"}, _CURVES, ("4.10",)),
    Item("Figure 4.11", "Figure 4.5 with the speed in place of the stance angle.",
         {"the scaling": r"Fig\. 4\.11"}, _CURVES, ("4.11",)),
    Item("Figure 4.12", "Figure 4.6 with the speed in place of the stance angle.",
         {"where the short step is the faster": r"4\.9 \| slope above"}, _CURVES, ("4.12",)),
    Item("Table 4.2", "Simulation and experiment at three slopes.",
         {"the simulation": r"Table 4\.2 \|.*simulation$",
          "the experiment": r"Table 4\.2 \|.*experiment$",
          "where the machine scuffed": r"Table 4\.2 \| below"},
         "How far one walk of the machine is from another: the chapter prints averages without "
         "their spread."),
    Item("Figure 4.13", "Figure 4.9 with the speed in place of the stance angle.",
         {"which step is the faster": r"4\.9 \|"}, _CURVES, ("4.13",)),
)  # fmt: skip
"""All items, in the order of the chapter."""

_HEAD = """# Chapter 4, item by item

Every figure and table of Garcia (1999), chapter 4, in its order: what computes it, and how far it
agrees. [Validation](validation.md) has each statement beside the computed number, and says which
edition the chapter is.

```sh
passive-walker figures --list
passive-walker figures 4.6 --out lab.pdf --size 8.5 12
```

The first command lists the figures. The second one writes a PDF of 8.5 by 12 cm with embedded
fonts (Type 42), and `lab.csv` beside it. Data files have a row for each gait, sample or stride:
the name of its curve, then the quantities of [`to_csv`](api.md#families-bifurcations-basins).
Angles are in rad, other quantities in SI units; `froude_speed` is over √(g l).

`python -m validation --out docs/validation.md` writes this page too. A printed number agrees if
the computed one rounds to it, or is within the tolerance that its row on the validation page has.
"""


def agreement(rows: Iterable[Row]) -> str:
    """How many statements agree, by how much their numbers differ, and which do not agree."""
    rows = list(rows)
    differ = [row for row in rows if not row.agrees]
    count = f"{len(rows) - len(differ)} of" if differ else "all" if len(rows) > 1 else "the"
    several = f" {len(rows)} statements agree" if len(rows) > 1 else " statement agrees"
    text = count + several if len(rows) > len(differ) else "the statement does not agree"
    if apart := [found for row in rows if row.agrees and (found := _relative(row)) is not None]:
        text += (
            f", {'the number' if len(rows) == 1 else 'numbers'} within {max(max(apart), 0.001):.1%}"
        )
    return text + "".join(
        f"\n  - {row.what}: print {row.printed}, computed {row.computed}" for row in differ
    )


def _relative(row: Row) -> float | None:
    """Difference of a printed and a computed number, relative to the former; None for others."""
    try:
        printed = float(Fraction(row.printed.replace("−", "-")))
        return abs(float(row.computed) / printed - 1.0)
    except (ValueError, ZeroDivisionError):
        return None


def _part(item: Item, rows: Mapping[str, Iterable[Row]]) -> str:
    number = item.name.split()[1]
    lines = [f"## {item.name}\n", f"{item.shows}\n"]
    command = f"passive-walker table {number}"
    for name in item.pictures:
        lines.append(f"![{item.shows}](images/figure-{name}.png)\n")
        command = f"passive-walker figures {' '.join(item.pictures)} --out figures"
    if item.pictures or item.name.startswith("Table"):
        lines.append(f"```sh\n{command}\n```\n")
    if item.name.startswith("Table"):
        lines.append(f"- Data: `{command} --json`")
    if item.pictures and item.data:
        files = ", ".join(f"`figures/figure-{name}.csv`" for name in item.pictures)
        lines.append(f"- Data: {files}")
    for about, pattern in item.statements.items():
        found = {
            title: own
            for title, each in rows.items()
            if (own := [row for row in each if re.match(pattern, f"{row.where} | {row.what}")])
        }
        where = ", ".join(link(title, "validation.md") for title in found)
        said = agreement(row for own in found.values() for row in own)
        lines.append(f"- {about[0].upper()}{about[1:]} ({where}): {said}")
    lines.append(f"- Not compared: {item.apart[0].lower()}{item.apart[1:]}")
    return "\n".join(lines) + "\n"


def render(rows: Mapping[str, Iterable[Row]]) -> str:
    """The page as Markdown.

    Args:
        rows: By the titles of their sections.
    """
    return "\n".join([_HEAD, *(_part(item, rows) for item in ITEMS)])
