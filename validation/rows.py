"""Rows of the validation page: a printed statement, the computed value, and their agreement.

A row is made from a statement in the form "where | what | print" and from a computed value. A
printed number agrees if the computed one rounds to it, or lies within the row's tolerance. A
statement agrees if it holds. Where print and computation differ, the row has a remark with the
reason, and the computed value must equal the recorded one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from decimal import Decimal
from fractions import Fraction
from typing import NamedTuple

import numpy as np


class Row(NamedTuple):
    """A statement and its check.

    Attributes:
        where: Section, figure or table; or another publication.
        what: Description of the quantity or statement.
        printed: Printed value.
        computed: Computed value.
        difference: Computed less printed, and the tolerance; empty for a statement.
        agrees: Whether print and computation agree.
        sound: Whether the row is as expected: in agreement, or, where print is known to differ,
            equal to the recorded computed value.
        remark: Reason for a difference, or an explanation.
    """

    where: str
    what: str
    printed: str
    computed: str
    difference: str
    agrees: bool
    sound: bool
    remark: str


def listed(values: Iterable[float], form: str = "") -> str:
    """Numbers in a format, separated by commas."""
    return ", ".join(format(value, form) for value in values)


def link(title: str, page: str = "") -> str:
    """A link to the section of a page with this title."""
    anchor = re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")
    return f"[{title}]({page}#{anchor})"


def _unit(text: str) -> float:
    """One unit in the last digit of a number as it is written."""
    return 10.0 ** int(Decimal(text).as_tuple().exponent)


def _plain(text: str) -> str:
    return text.replace("−", "-")


def number(
    statement: str, computed: float, *, within: float | None = None, known: str = "",
    digits: int = 6, remark: str = "",
) -> Row:  # fmt: skip
    """A row that compares two numbers.

    Args:
        statement: "where | what | print"; a printed number may be a fraction such as "1/3", or "π".
        computed: The computed number.
        within: Tolerance; half a unit in the printed number's last digit if None. A fraction or π
            requires a value.
        known: The recorded computed number, to a unit in its last digit; required if print and
            computation differ.
        digits: Number of digits shown.
        remark: Reason for a difference, or an explanation.
    """
    where, what, printed = statement.split(" | ")
    value = math.pi if printed == "π" else float(Fraction(_plain(printed)))
    if within is None:
        within = 0.5 * _unit(_plain(printed)) * (1.0 + 1e-9)  # allows for floating-point error
    difference = computed - value
    agrees = abs(difference) <= within
    sound = abs(computed - float(known)) <= _unit(known) if known else agrees
    shown = f"{difference:+.1e} (±{within:.2g})"
    return Row(where, what, printed, f"{computed:.{digits}g}", shown, agrees, sound, remark)


def claim(
    statement: str, computed: str, holds: bool | np.bool, *, expected: bool = True, remark: str = ""
) -> Row:
    """A row on a statement that holds or does not.

    Args:
        statement: "where | what | print".
        computed: Computed value, as text.
        holds: Whether the statement holds for the computed value.
        expected: Whether the statement is known to hold.
        remark: Reason if it does not hold, or an explanation.
    """
    where, what, printed = statement.split(" | ")
    holds = bool(holds)
    return Row(where, what, printed, computed, "", holds, holds == expected, remark)
