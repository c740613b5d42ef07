"""A row of the validation page: what the source says, what is computed, and whether they agree.

Every row is judged. A number in print is met if the computed one rounds to it, or lies within what
the row allows; a statement is met if it holds. Where the document does not hold, the row says so,
with a sentence why, and the computed value must be the one on record.
"""

from __future__ import annotations

import math
from decimal import Decimal
from functools import lru_cache
from typing import NamedTuple

from gym_passive_walker.gaits.family import GaitFamily, gait_family
from gym_passive_walker.gaits.fixed_point import find_gait
from gym_passive_walker.gaits.gait import Gait, GaitKind
from gym_passive_walker.gaits.scaling import local_exponents
from gym_passive_walker.walkers import WALKERS, Walker, tune


class Row(NamedTuple):
    """A statement and its check.

    Attributes:
        where: Section, figure or table; or another publication.
        what: What is stated.
        printed: What the source has.
        computed: What is computed.
        difference: Computed less printed, and what is allowed; empty where nothing is subtracted.
        agrees: Whether they agree.
        sound: Whether the row is as it is known to be: in agreement, or, where print is known to
            differ, at the computed value on record.
        remark: A sentence where they differ, or on how they are meant.
    """

    where: str
    what: str
    printed: str
    computed: str
    difference: str
    agrees: bool
    sound: bool
    remark: str


def _unit(text: str) -> float:
    """One unit in the last digit of a number as it is written."""
    return 10.0 ** int(Decimal(text).as_tuple().exponent)


def _plain(text: str) -> str:
    return text.replace("−", "-")


def number(
    where: str,
    what: str,
    printed: str,
    computed: float,
    *,
    within: float | None = None,
    known: str = "",
    digits: int = 6,
    remark: str = "",
) -> Row:
    """A row that compares two numbers.

    Args:
        where: Where it is printed.
        what: What it is.
        printed: The number as printed; "1/3" and "π" are understood.
        computed: The computed number.
        within: Difference allowed; half a unit in the printed number's last digit if None, which
            a fraction or π has not.
        known: The computed number on record, to a unit in its last digit; needed where print and
            computation differ.
        digits: How many digits are shown.
        remark: A sentence where they differ.
    """
    if printed == "π":
        value = math.pi
    elif "/" in printed:
        above, below = printed.split("/")
        value = float(above) / float(below)
    else:
        value = float(_plain(printed))
    if within is None:
        within = 0.5 * _unit(_plain(printed)) * (1.0 + 1e-9)  # and rounding's own
    difference = computed - value
    agrees = abs(difference) <= within
    sound = abs(computed - float(known)) <= _unit(known) if known else agrees
    shown = f"{difference:+.1e} (±{within:.2g})"
    return Row(where, what, printed, f"{computed:.{digits}g}", shown, agrees, sound, remark)


def claim(
    where: str,
    what: str,
    printed: str,
    computed: str,
    holds: bool,
    *,
    expected: bool = True,
    remark: str = "",
) -> Row:
    """A row on a statement that holds or does not.

    Args:
        where: Where it is printed.
        what: What it is about.
        printed: What is said.
        computed: What is found.
        holds: Whether what is said holds of what is found.
        expected: Whether it is known to hold.
        remark: A sentence where it does not.
    """
    return Row(where, what, printed, computed, "", bool(holds), bool(holds) == expected, remark)


@lru_cache(maxsize=512)
def gait(walker: Walker | str, slope: float, kind: GaitKind = "long") -> Gait:
    """A gait, found once however many rows ask for it."""
    return find_gait(walker, slope, kind)


@lru_cache(maxsize=64)
def family(
    walker: Walker | str,
    low: float,
    high: float,
    kind: GaitKind = "long",
    resolution: float = 0.05,
) -> GaitFamily:
    """A family, followed once however many rows ask for it."""
    return gait_family(walker, low, high, kind, resolution=resolution)


def tuned(name: str) -> Walker:
    """A walker of the source with its tuning made exact, as the table's rounded digits are not."""
    return tune(WALKERS[name])


def exponents(walker: Walker | str, slope: float, kind: GaitKind) -> tuple[float, float]:
    """Exact local exponents of stance angle and speed with slope, of the gait at a slope."""
    local = local_exponents(family(walker, slope, 1.01 * slope, kind))
    return float(local.stance_angle[0]), float(local.speed[0])
