"""A row of the validation page: what the source says, what is computed, and whether they agree.

A row is made from a statement as it stands on the page, "where | what | print", and from what is
computed. Every row is judged. A number in print is met if the computed one rounds to it, or lies
within what the row allows; a statement is met if it holds. Where the document does not hold, the
row says so, with a sentence why, and the computed value must be the one on record.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from decimal import Decimal
from fractions import Fraction
from typing import NamedTuple

import numpy as np


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


def listed(values: Iterable[float], form: str = "") -> str:
    """Numbers, each in a format, with commas between them."""
    return ", ".join(format(value, form) for value in values)


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
        statement: Where it is printed, what it is, and the number as printed; "1/3" and "π" are
            understood.
        computed: The computed number.
        within: Difference allowed; half a unit in the printed number's last digit if None, which
            a fraction or π has not.
        known: The computed number on record, to a unit in its last digit; needed where print and
            computation differ.
        digits: How many digits are shown.
        remark: A sentence where they differ.
    """
    where, what, printed = statement.split(" | ")
    value = math.pi if printed == "π" else float(Fraction(_plain(printed)))
    if within is None:
        within = 0.5 * _unit(_plain(printed)) * (1.0 + 1e-9)  # and rounding's own
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
        statement: Where it is printed, what it is about, and what is said.
        computed: What is found.
        holds: Whether what is said holds of what is found.
        expected: Whether it is known to hold.
        remark: A sentence where it does not.
    """
    where, what, printed = statement.split(" | ")
    holds = bool(holds)
    return Row(where, what, printed, computed, "", holds, holds == expected, remark)
