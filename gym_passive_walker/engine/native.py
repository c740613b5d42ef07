"""Machine code for expressions, over single numbers or over the lanes of a vector.

A product that only a sum needs is rounded together with it, by a fused instruction that is asked
for by name: nothing is left to a compiler's taste, so every processor, with vectors of any width,
computes the same walk to the last bit.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable
from typing import Any

import numpy as np
from llvmlite import ir

from gym_passive_walker.engine.expressions import Expression, Tangents, read

GROUP = 8
"""Lanes of a vector: one of 512 bits, or two of 256."""

_DOUBLE, _WORD, _POINTER = ir.DoubleType(), ir.IntType(64), ir.PointerType()
_VECTOR = ir.VectorType(_DOUBLE, GROUP)
_SIGNATURE = ir.FunctionType(ir.VoidType(), [_WORD, _WORD, _WORD, _DOUBLE, _DOUBLE])


class Memory:
    """What stands at one of a native function's addresses: fields by name, read and written.

    Args:
        layout: The fields; of a tile, each entry is a row of lanes.
        base: Which address, 0 or 1.
        known: Expressions made so far.

    Attributes:
        writes: What is to be written where.
    """

    def __init__(self, layout: np.dtype, base: int, known: dict) -> None:
        self.layout, self.base, self.known = layout, base, known
        self.writes: dict[tuple[str, int], Expression] = {}

    def __getitem__(self, place: str | tuple) -> Expression:
        """A field, or the entry of a field: as it is, or as it will be if it has been written."""
        name, index = self._place(place)
        if (name, index) in self.writes:
            return self.writes[name, index]
        return read(self.known, self.base, name, index, 0)

    def __setitem__(self, place: str | tuple, value: Any) -> None:
        if not isinstance(value, Expression):
            value = Expression(self.known, "constant", float(value))
        self.writes[self._place(place)] = value

    def _place(self, place: str | tuple) -> tuple[str, int]:
        name, *index = place if isinstance(place, tuple) else (place,)
        shape = self.layout[name].shape[: len(index)]
        return name, int(np.ravel_multi_index(index, shape)) if index else 0

    def entries(self, name: str) -> list[Expression]:
        """The first entries of a field, in order."""
        return [self[name, i] for i in range(self.layout[name].shape[0])]

    def argument(self, index: int) -> Expression:
        """One of the two numbers that the function is called with."""
        return Expression(self.known, "argument", index)


Code = Callable[..., None]
"""Straight-line code: reads and writes the function's memories, all reads before all writes."""


class Function:
    """A native function under construction: straight-line codes, one after the other.

    It is called with two addresses, a whole number and two numbers.

    Args:
        module: Where it belongs.
        name: Its name.
        layouts: What stands at its addresses.
        planes: How many tangents stand behind the values, each laid out as they are.
        active: Names of the fields that have tangents.
        table: The constants of the module's vectors, and where in its table they stand.
    """

    def __init__(
        self,
        module: ir.Module,
        name: str,
        layouts: tuple[np.dtype, ...],
        *,
        planes: int = 0,
        active: Collection[str] = (),
        table: dict[tuple[float, int], int] | None = None,
    ) -> None:
        self.table = {} if table is None else table
        self.function = ir.Function(module, _SIGNATURE, name)
        self.function.attributes.add("nounwind")
        # What finds no room in registers waits on the stack: in one line of the cache each.
        self.function.attributes.alignstack = 8 * GROUP
        self.builder = ir.IRBuilder(self.function.append_basic_block())
        self.layouts, self.planes, self.active = layouts, planes, active
        self.addresses = [
            self.builder.inttoptr(argument, _POINTER) for argument in self.function.args[:2]
        ]

    def over_lanes(self, code: Code) -> None:
        """Run code over a group of lanes; the first memory is a tile, from that group on.

        Constants are read from the module's table, at the second address: as operands in memory
        they cost nothing, where each by itself would need its address spelled out.
        """
        self._emit(code, [ir.Constant(_WORD, 0), None], _VECTOR)
        following = self.function.append_basic_block()  # schedule each code by itself
        self.builder.branch(following)
        self.builder.position_at_end(following)

    def once(self, code: Code, *, lane: bool = False) -> None:
        """Run code over single numbers; in a tile, of the lane that the whole number says."""
        shift = self.builder.mul(self.function.args[2], ir.Constant(_WORD, 8)) if lane else None
        self._emit(code, [shift, None], _DOUBLE)

    def end(self) -> None:
        """Close the function."""
        self.builder.ret_void()

    def _emit(self, code: Code, shifts: list[ir.Value | None], kind: ir.Type) -> None:
        known: dict = {}
        memories = [Memory(layout, i, known) for i, layout in enumerate(self.layouts)]
        code(*memories)
        stores = {(m.base, *place, 0): value for m in memories for place, value in m.writes.items()}
        reads = [x.args for x in known.values() if x.op == "read" and x.args[1] in self.active]
        for plane in range(1, self.planes + 1):
            tangents = Tangents({read(known, *p): read(known, *p[:3], plane) for p in reads})
            for memory in memories:
                for (name, index), value in memory.writes.items():
                    if name in self.active:
                        change = tangents(value)
                        stores[memory.base, name, index, plane] = (
                            value.number(0.0) if change is None else change
                        )
        emit = _Emitter(self, shifts, kind, uses(stores.values()))
        values = {place: emit(value) for place, value in stores.items()}
        for place, value in values.items():
            emit.store(place, value)


def uses(roots: Iterable[Expression]) -> Counter[Expression]:
    """How often each expression is an operand, or written."""
    uses: Counter[Expression] = Counter(roots)
    waiting = list(uses)
    seen = set(waiting)
    while waiting:
        for operand in _operands(waiting.pop()):
            uses[operand] += 1
            if operand not in seen:
                seen.add(operand)
                waiting.append(operand)
    return uses


def _operands(x: Expression) -> tuple[Expression, ...]:
    """What an expression is computed from."""
    if x.op in ("sin", "cos"):
        return x.args[1:]
    return tuple(a for a in x.args if isinstance(a, Expression))


class _Emitter:
    """Instructions for expressions, each computed once."""

    def __init__(
        self,
        owner: Function,
        shifts: list[ir.Value | None],
        kind: ir.Type,
        uses: Counter[Expression],
    ) -> None:
        self.owner, self.builder = owner, owner.builder
        self.kind, self.shifts, self.uses = kind, shifts, uses
        self.vector = kind is _VECTOR
        self.done: dict[Expression, ir.Value] = {}
        self.taken: Counter[float] = Counter()

    def __call__(self, x: Expression) -> ir.Value:
        if x.op == "constant":
            return self._constant(x.args[0])
        if x not in self.done:
            self.done[x] = self._of(x)
        return self.done[x]

    def _of(self, x: Expression) -> ir.Value:
        builder = self.builder
        match x.op:
            case "argument":
                return self._splat(self.owner.function.args[3 + x.args[0]])
            case "read":
                return self._load(x.args)
            case "sin" | "cos":
                return self(x.args[1])
            case "add" | "sub":
                return self._sum(x)
            case "mul" | "div":
                return getattr(builder, "f" + x.op)(self(x.args[0]), self(x.args[1]))
            case "neg":
                return builder.fneg(self(x.args[0]))
            case "flip":
                return self._flipped(self(x.args[0]), self(x.args[1]))
            case "abs" | "sqrt":
                return self._call({"abs": "fabs"}.get(x.op, x.op), self(x.args[0]))
            case "<" | "<=" | ">" | ">=":
                return builder.fcmp_ordered(x.op, self(x.args[0]), self(x.args[1]))
            case "and":
                return builder.and_(self(x.args[0]), self(x.args[1]))
            case "or":
                return builder.or_(self(x.args[0]), self(x.args[1]))
            case "not":
                return builder.not_(self(x.args[0]))
            case "choose":
                return builder.select(*map(self, x.args))
        raise ValueError(f"no code for {x.op!r}")

    def _sum(self, x: Expression) -> ir.Value:
        """A sum or difference, fused with a product that nothing else needs."""
        a, b = x.args
        minus = x.op == "sub"
        if self._fusible(a):
            rest = self.builder.fneg(self(b)) if minus else self(b)
            return self._call("fma", self(a.args[0]), self(a.args[1]), rest)
        if self._fusible(b):
            first = self(b.args[0])
            first = self.builder.fneg(first) if minus else first
            return self._call("fma", first, self(b.args[1]), self(a))
        return (self.builder.fsub if minus else self.builder.fadd)(self(a), self(b))

    def _fusible(self, x: Expression) -> bool:
        return x.op == "mul" and self.uses[x] == 1

    def _flipped(self, x: ir.Value, last_bit: ir.Value) -> ir.Value:
        """A number with its sign changed if another number's last bit is set."""
        word = ir.VectorType(_WORD, GROUP) if self.vector else _WORD
        places = ir.Constant(word, [63] * GROUP if self.vector else 63)
        sign = self.builder.shl(self.builder.bitcast(last_bit, word), places)
        return self.builder.bitcast(
            self.builder.xor(self.builder.bitcast(x, word), sign), self.kind
        )

    def _call(self, name: str, *operands: ir.Value) -> ir.Value:
        module, kind = self.owner.function.module, self.kind
        full = f"llvm.{name}.{'v8f64' if self.vector else 'f64'}"
        function = module.globals.get(full) or ir.Function(
            module, ir.FunctionType(kind, [kind] * len(operands)), full
        )
        return self.builder.call(function, operands)

    def _constant(self, value: float) -> ir.Value:
        if not self.vector:
            return ir.Constant(self.kind, value)
        table = self.owner.table
        self.taken[value] += 1
        offset = 8 * table.setdefault((value, self.taken[value]), len(table))
        address = self.builder.gep(
            self.owner.addresses[1], [ir.Constant(_WORD, offset)], source_etype=ir.IntType(8)
        )
        return self._splat(self.builder.load(address, align=8, typ=_DOUBLE))

    def _splat(self, value: ir.Value) -> ir.Value:
        if not self.vector:
            return value
        word = ir.IntType(32)
        blank = ir.Constant(_VECTOR, ir.Undefined)
        first = self.builder.insert_element(blank, value, ir.Constant(word, 0))
        everywhere = ir.Constant(ir.VectorType(word, GROUP), [0] * GROUP)
        return self.builder.shuffle_vector(first, blank, everywhere)

    def _address(self, place: tuple) -> tuple[ir.Value, bool]:
        """Where an entry stands, and whether it is a whole number."""
        base, name, index, plane = place
        layout = self.owner.layouts[base]
        field, offset = layout.fields[name]  # type: ignore[index]
        row = 8 * field.shape[-1] if self.vector or self.shifts[base] is not None else 8
        offset += row * index + plane * layout.itemsize
        byte = ir.IntType(8)
        address = self.builder.gep(
            self.owner.addresses[base], [ir.Constant(_WORD, offset)], source_etype=byte
        )
        if self.shifts[base] is not None:
            address = self.builder.gep(address, [self.shifts[base]], source_etype=byte)
        return address, field.base.kind == "i"

    def _load(self, place: tuple) -> ir.Value:
        address, whole = self._address(place)
        if whole:
            return self.builder.sitofp(self.builder.load(address, typ=_WORD), _DOUBLE)
        return self.builder.load(address, align=8 * GROUP if self.vector else 8, typ=self.kind)

    def store(self, place: tuple, value: ir.Value) -> None:
        """Write an entry."""
        address, whole = self._address(place)
        if whole:
            value = self.builder.fptosi(value, _WORD)
        self.builder.store(value, address, align=8 * GROUP if self.vector else 8)


def write_table(module: ir.Module, table: dict[tuple[float, int], int]) -> None:
    """Put the constants of a module's vectors into it, under the name "table"."""
    kind = ir.ArrayType(_DOUBLE, len(table))
    variable = ir.GlobalVariable(module, kind, "table")
    variable.global_constant = True
    variable.initializer = ir.Constant(kind, [value for value, _ in table])
