"""Numbers in comments beside calls of `print` on a page, and what these calls print."""

from __future__ import annotations

import ast
import builtins
import io
import re
import sys
import tokenize
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

_SHOWN = re.compile(
    r"(below )?(?<![\w.])(-?\d+(?:,\d{3})*(?:\.\d+)?(?:e[-+]?\d+)?)(?!\d| % interval)( %)?"
)
_PRINTED = re.compile(r"(?<![\w.])-?\d+(?:\.\d*)?(?:e[-+]?\d+)?")


class Printed:
    """Stands in for `print` in the code of a page, and keeps the text of each of its lines."""

    def __init__(self) -> None:
        self.texts: dict[int, str] = defaultdict(str)

    def __call__(self, *values: Any, sep: str = " ", end: str = "\n") -> None:
        """Print, and keep the text."""
        self.texts[sys._getframe(1).f_lineno] += sep.join(map(str, values)) + end
        builtins.print(*values, sep=sep, end=end)

    def run(self, code: str, name: str) -> None:
        """Execute the code of a page, and check the numbers that its comments show."""
        exec(compile(code, name, "exec"), {"__name__": "__main__", "print": self})
        assert not (said := list(wrong(code, self.texts))), "\n".join(said)


def beside(code: str) -> dict[int, str]:
    """Comments at the end of calls of `print`, by the line at which the call begins."""
    tokens = tokenize.generate_tokens(io.StringIO(code).readline)
    comments = {t.start[0]: t.string for t in tokens if t.type == tokenize.COMMENT}
    calls = [
        node for node in ast.walk(ast.parse(code))
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "print"
    ]  # fmt: skip
    return {call.lineno: comments[call.end_lineno] for call in calls if call.end_lineno in comments}


def wrong(code: str, texts: dict[int, str]) -> Iterator[str]:
    """Sentences on numbers that comments show, and that are not printed to all their digits."""
    for line, comment in beside(code).items():
        printed = [float(x) for x in _PRINTED.findall(texts.get(line, ""))]
        for below, number, percent in _SHOWN.findall(comment):
            value = float(number.replace(",", ""))
            if below:
                right = bool(printed) and all(x < value for x in printed)
            else:
                half = 0.501 * 10.0 ** -len(number.partition(".")[2])
                scales = (1.0, 100.0) if percent else (1.0,)
                right = any(abs(s * x - value) <= half for s in scales for x in printed)
            if not right and line in texts:
                yield f"{comment}: {below}{number} is not printed, but {texts[line].strip()}"
