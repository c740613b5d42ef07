"""Traced code as Python source over plain numbers, for GPU compilers and simulators.

The operations, their order and their fused products are those of `engine.native`, which writes
machine code for CPUs. If each operation rounds correctly, trajectories are bitwise equal.
`gpu.primitives` reads and writes memory.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection

import numpy as np

from gym_passive_walker.engine.native import Code, Emitter, Function, Module
from gym_passive_walker.models.expressions import Expression

_SIGNS = {"mul": "*", "div": "/", "add": "+", "sub": "-", "and": "&", "or": "|"}


class Source(Module):
    """A module of functions as Python source.

    The signature of each function is ``name(first, second, x, y)``, with two addresses and two
    numbers. The function `call` in the source selects one by its number, which replaces an address.

    Args:
        before: Source that this one continues, with its functions first.
        kind: Prefix of the functions' names.
        fuses: Whether a product that only a sum uses is fused with the sum.

    Attributes:
        names: Names of the functions that `call` selects.
        parts: Names of functions that each contain a part of another one, called in one place.
    """

    def __init__(self, before: Source | None = None, kind: str = "", *, fuses: bool = True) -> None:
        super().__init__(fuses=fuses, group=1)
        self.kind = kind
        self.names: list[str] = []
        self.parts: list[str] = []
        if before is not None:
            self.functions, self.names, self.parts = before.functions, before.names, before.parts

    def function(
        self, name: str, layouts: tuple[np.dtype, ...], *, active: Collection[str] = ()
    ) -> Function:
        """Return a new function; tangents are not supported, so `active` must be empty."""
        return _Function(self, self.kind + name, layouts)

    def get_function_address(self, name: str) -> int:
        """Return the number of a function, from 1 on."""
        return 1 + self.names.index(self.kind + name)

    def get_global_value_address(self, name: str) -> int:
        """Return 0: constants are part of the text."""
        return 0

    def __str__(self) -> str:
        """Return the source of all functions, and of `call`, which calls them by number."""
        functions = "".join(f"{function}\n\n" for function in self.functions)
        cases = "".join(
            f"    if function == {i}:\n        return {name}(first, second, x, y)\n"
            for i, name in enumerate(self.names, 1)
        )
        # Without lanes and tangents, which are constants, `dispatch` is compiled only once.
        head = "def dispatch(function, first, second, x, y):\n    apart()\n"
        call = "\n\ndef call(function, first, second, lane, tangents, x, y):\n"
        return f"{functions}{head}{cases}{call}    dispatch(function, first, second, x, y)\n"


class _Function(Function):
    """A function under construction."""

    module: Source

    def __init__(self, module: Source, name: str, layouts: tuple[np.dtype, ...]) -> None:
        self.module, self.name, self.layouts = module, name, layouts
        self.active: Collection[str] = ()
        self.lines: list[str] = []
        self.values = self.block = 0

    def new(self, instruction: str) -> str:
        """Append an instruction, and return the name of its result."""
        self.values += 1
        self.lines.append(f"v{self.values} = {instruction}")
        return f"v{self.values}"

    def over_lanes(self, code: Code, group: int | None = None) -> None:
        """Write code for the one walker of a tile as a separate function, which compiles faster."""
        part = f"{self.name}_{len(self.lines) + 1}"
        lines, self.lines = self.lines, []
        self._emit(code)
        self.module.functions.append(self._text(part))
        self.module.parts.append(part)
        self.lines = [*lines, f"{part}(first, second, x, y)"]

    def over_rows(self, code: Code) -> None:
        """Write code for the one walker of a thread."""
        self._emit(code)

    def end(self) -> None:
        """Close the function."""
        self.module.functions.append(self._text(self.name))
        self.module.names.append(self.name)

    def _text(self, name: str) -> str:
        return "\n    ".join([f"def {name}(first, second, x, y):", *self.lines, "return"])

    def _emitter(self, uses: Counter[Expression], *, group: int, lane: bool) -> Emitter:
        return _Emitter(self, uses, group=1, lane=False)


class _Emitter(Emitter):
    """Writes expressions as lines of Python; each is computed once."""

    def _operation(self, op: str, *values: str) -> str:
        if op == "choose":
            return f"select({', '.join(values)})"
        if op == "not":
            return f"not {values[0]}"
        return f"{values[0]} {_SIGNS.get(op, op)} {values[1]}"

    def _negative(self, x: str) -> str:
        return self.owner.new(f"-{x}")

    def _flipped(self, x: str, last_bit: str) -> str:
        return self.owner.new(f"flip({x}, {last_bit})")

    def _inverse_root(self, x: str, start: int, places: tuple[int, ...]) -> str:
        bits = self.owner.new(f"bits({x})")
        shifted = "".join(f" - ({bits} >> {place})" for place in places)
        return self.owner.new(f"of_bits({start}{shifted})")

    def _call(self, name: str, *operands: str) -> str:
        return self.owner.new(f"{name}({', '.join(operands)})")

    def _from_library(self, name: str, value: str) -> str:
        return self._call(name, value)

    def _constant(self, value: float) -> str:
        return f"({value!r})"

    def _splat(self, value: str) -> str:
        return value.removeprefix("%")

    def _load(self, place: tuple) -> str:
        address, word, whole = self._word(place)
        return self.owner.new(f"get{whole}({address}, {word})")

    def store(self, place: tuple, value: str) -> None:
        """Write an entry."""
        address, word, whole = self._word(place)
        self.owner.lines.append(f"put{whole}({address}, {word}, {value})")

    def _word(self, place: tuple) -> tuple[str, int, str]:
        """Return the address name, the offset in words and the suffix for integers of an entry."""
        base, name, index, _ = place
        field, offset = self.owner.layouts[base].fields[name][:2]  # type: ignore[index]
        whole = "_whole" if field.base.kind == "i" else ""
        return ("first", "second")[base], offset // 8 + index, whole
