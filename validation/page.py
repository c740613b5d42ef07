"""The validation page: its sections, their computation, and the page in Markdown."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

from validation import (
    chaos,
    chapter,
    controllers,
    families,
    lab,
    literature,
    parameters,
    placement,
    point_feet,
    simplest,
    tuning,
    wheel,
)
from validation.rows import Row, link


class Section(NamedTuple):
    """A part of the page.

    Attributes:
        title: Heading of the section.
        rows: Function that computes the rows.
        text: Introduction to the rows.
    """

    title: str
    rows: Callable[[], Iterable[Row]]
    text: str = ""


_LAB = (
    Section("The walkers (Table 4.1, Figs. 4.3, 4.5 and 4.7)", parameters.table),
    Section("The laboratory's walker from its parts (4.10.1)", parameters.laboratory),
    Section(
        "Simulation and experiment (4.2, Table 4.2)",
        lab.table,
        "Computed for the walker of Fig. 4.3's caption. The experiment may differ by what the "
        "document's own columns differ by, and 0.01.",
    ),
    Section("The return map (4.3.1)", lab.maps),
    Section("What a machine would feel (4.3.2)", lab.reality),
)
_SIMPLEST = (
    Section("Costs, speeds and collisions (4.3.3, 4.3.4)", simplest.costs),
    Section("The simplest walker (4.4)", simplest.simplest_walker, "Walker D."),
    Section("The simplest walker's way to chaos (4.4)", chaos.simplest_walker, "Walker D."),
    Section(
        "Point feet with mass (4.5.1, Figs. 4.5 and 4.11)",
        point_feet.point_feet,
        "Walkers E and F. A power of γ is the exact tangent d ln θ / d ln γ of the curve of gaits.",
    ),
)
_KNEED = (
    Section(
        "Knees free and locked (4.5.2, Figs. 4.6 and 4.12)",
        families.laboratory,
        "Walkers lab and lab-straight.",
    ),
    Section(
        "Tuned walkers (4.6.1, 4.6.2)",
        tuning.tuned_walkers,
        "Walkers A and C, their tuning made exact.",
    ),
    Section(
        "De-tuning (Fig. 4.8)",
        tuning.de_tuning,
        "From C, exactly tuned, to the laboratory's walker.",
    ),
    Section("Families of tuned walkers (Figs. 4.9 and 4.13, 4.8)", tuning.observations),
    Section("Energy and scaling (4.6.3)", point_feet.scaling),
    Section(
        "The tuned kneed walker's way to chaos (4.7, Fig. 4.10)",
        chaos.kneed_walker,
        "Walker C, exactly tuned.",
    ),
    Section("Which gait is the faster (4.9, Figs. 4.11 to 4.13)", families.speeds),
)
_LITERATURE = (
    Section("Other publications: the simplest walker", literature.simplest_walker),
    Section("Other publications: the simplest walker's way to chaos", literature.chaos),
    Section("Other publications: the compass walker", literature.compass),
    Section("Other publications: walkers A and C", literature.known_gaits),
    Section("Other publications: virtual constraints", literature.virtual_constraints),
    Section("Other publications: wheels and round feet", literature.wheels_and_round_feet),
    Section("Rough ground: the rimless wheel, and point feet", wheel.rough_ground),
    Section("Controllers: push-off (Kuo)", controllers.push_off,
            "The simplest walker on level ground, l = 1 m, g = 9.81 m/s²; P over m √(g l), the "
            "hip spring K per foot mass over g l."),
    Section("Controllers: shaped potentials (Spong, Asano)", controllers.shaped_potentials,
            "The compass walker of Goswami et al., g = 9.8."),
    Section("Controllers: a torque once a stride (Bhounsule)", placement.foot_placement,
            "Walker D at slope 0.009, hip torques of at most 2 per foot mass over g l."),
)  # fmt: skip

SUBJECTS = {
    "The laboratory's walker": _LAB,
    "The simplest walker and point feet": _SIMPLEST,
    "Kneed and tuned walkers": _KNEED,
    "Other publications": _LITERATURE,
}
"""Sections by the heading above them."""

_HEAD = """# Validation

Every number, and every statement with a number in it, of Garcia (1999), chapter 4, beside what this
package computes; then numbers of other publications. Written by

    python -m validation --out docs/validation.md

No parameter was fitted. A printed number is met if the computed one rounds to it, or differs by no
more than what stands in brackets behind the difference. Walkers are those of
`gym_passive_walker.WALKERS`; slopes are in rad, and γ is the slope.

{statements} statements; {agree} agree and {differ} differ. Where one differs, "Agrees" is **no**,
and the remark has the reason. Numbers of sections, figures and tables are those of the chapter,
except beside a publication's name. [Sources](#sources) follow the tables.
[Chapter 4, item by item](chapter4.md) has the figures and tables in their order.
"""

_SOURCES = """## Sources

- The document: M. Garcia, A. Chatterjee, A. Ruina, *Efficiency, speed, and scaling of
  two-dimensional passive-dynamic walking*, Dynamics and Stability of Systems 15 (2000) 75–99, in
  its form as chapter 4 of M. Garcia's thesis (1999).
- M. Garcia, A. Chatterjee, A. Ruina, M. Coleman, *The simplest walking model: stability,
  complexity, and scaling*, J. Biomech. Eng. 120 (1998) 281–288.
- A. Goswami, B. Thuilot, B. Espiau, *A study of the passive gait of a compass-like biped robot:
  symmetry and chaos*, Int. J. Robotics Research 17 (1998) 1282–1301.
- G. W. Howell, J. Baillieul, *Simple controllable walking mechanisms which exhibit bifurcations*,
  IEEE CDC (1998) 3027–3032.
- A. D. Kuo, *Energetics of actively powered locomotion using the simplest walking model*,
  J. Biomech. Eng. 124 (2002) 113–120; his program is github.com/kuo-lab/simplelocomotionmodel.
- M. W. Spong, F. Bullo, *Controlled symmetries and passive walking*, IEEE Trans. Automatic Control
  50 (2005) 1025–1031.
- F. Asano, M. Yamakita, *Virtual gravity and coupling control for robotic gait synthesis*, IEEE
  Trans. Systems, Man, and Cybernetics A 31 (2001) 737–745.
- P. A. Bhounsule, A. Zamani, *A discrete control Lyapunov function for exponential orbital
  stabilization of the simplest walker*, J. Mechanisms Robotics 9 (2017) 051011.
- A. L. Schwab, M. Wisse, *Basin of attraction of the simplest walking model*, ASME Design
  Engineering Technical Conferences (2001) VIB-21363.
- M. J. Coleman, A. Chatterjee, A. Ruina, *Motions of a rimless spoked wheel: a simple 3D system
  with impacts*, Dynamics and Stability of Systems 12 (1997) 139–159.
- P. G. Adamczyk, S. H. Collins, A. D. Kuo, *The advantages of a rolling foot in human walking*,
  J. Experimental Biology 209 (2006) 3953–3963.
- P. A. Bhounsule, passivewalker.m, a program of 2009: github.com/pab47/pab47.github.io.
- J. W. Grizzle, G. Abba, F. Plestan, *Asymptotically stable walking for biped robots: analysis via
  systems with impulse effects*, IEEE Trans. Automatic Control 46 (2001) 51–64.
- R. Tedrake and others, Drake 1.58, `pydrake.examples`: drake.mit.edu.
- Recomputed: by another program than this package, as the remark says.
- K. Byl, R. Tedrake, *Metastable walking machines*, Int. J. Robotics Research 28 (2009) 1040–1064.
- M. J. Feigenbaum, *Quantitative universality for a class of nonlinear transformations*, J. Stat.
  Phys. 19 (1978) 25–52.
"""

_COLUMNS = ("Where", "What", "Print", "Computed", "Difference", "Agrees", "Remark")


def _cells(row: Row) -> tuple[str, ...]:
    return (*row[:5], "yes" if row.agrees else "**no**", row.remark)


def _table(cells: list[tuple[str, ...]], columns: tuple[str, ...]) -> str:
    lines = [columns, ("---",) * len(columns), *cells]
    return "\n".join(
        "| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines
    )


def render(rows: dict[str, list[Row]]) -> str:
    """The page as Markdown.

    Args:
        rows: By the titles of their sections.
    """
    contents, parts = [], []
    for subject, sections in SUBJECTS.items():
        parts.append(f"\n## {subject}\n")
        for section in sections:
            of = rows[section.title]
            differ = sum(not row.agrees for row in of)
            contents.append((link(section.title), str(len(of)), str(differ) if differ else ""))
            parts += [f"### {section.title}\n", *([section.text + "\n"] if section.text else [])]
            parts.append(_table([_cells(row) for row in of], _COLUMNS) + "\n")
    every = [row for of in rows.values() for row in of]
    agree = sum(row.agrees for row in every)
    head = _HEAD.format(statements=len(every), agree=agree, differ=len(every) - agree)
    table = _table(contents, ("Section", "Statements", "Differ"))
    return "\n".join([head, table, *parts, _SOURCES])


def sections() -> list[Section]:
    """The sections of the page, in order."""
    return [section for sections in SUBJECTS.values() for section in sections]


def compute(progress: Callable[[str], None] = lambda title: None) -> dict[str, list[Row]]:
    """Compute the rows.

    Args:
        progress: Function called with each section's title before that section is computed.

    Returns:
        Rows by the titles of their sections.
    """
    rows = {}
    for section in sections():
        progress(section.title)
        rows[section.title] = list(section.rows())
    return rows


def write(path: str | Path, progress: Callable[[str], None] = lambda title: None) -> list[Row]:
    """Compute the page and write it to a file, and `chapter4.md` beside it.

    Returns:
        The rows that are not as expected; an empty list if there are none.
    """
    computed = compute(progress)
    path = Path(path)
    path.write_text(render(computed), encoding="utf-8")
    path.with_name("chapter4.md").write_text(chapter.render(computed), encoding="utf-8")
    return [row for rows in computed.values() for row in rows if not row.sound]
