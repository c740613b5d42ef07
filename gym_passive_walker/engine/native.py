"""LLVM code for expressions, over single numbers or over the lanes of a vector.

A product that only one sum uses becomes an explicit fused multiply-add. The compiler chooses no
contractions, so trajectories are bitwise equal on all CPUs and vector widths.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Collection, Iterable
from typing import Any

import numpy as np

from gym_passive_walker.models.expressions import Expression, Tangents, operands, read

GROUP = 8
"""Lanes of a vector on x86-64: one of 512 bits, or two of 256."""

FEW = GROUP // 2
"""Lanes of a vector for a few walkers."""

_PARAMETERS = "i64 %first, i64 %second, i64 %lane, i64 %tangents, double %x, double %y"
_NUMBERS = ("%x", "%y")
_COMPARED = {"<": "olt", "<=": "ole", ">": "ogt", ">=": "oge"}
_ARITHMETIC = {"mul": "fmul", "div": "fdiv", "add": "fadd", "sub": "fsub"}
_INTRINSICS = {"abs": "fabs", "sqrt": "sqrt"}
_OF_THE_SYSTEM = ("exp", "tanh")  # functions of the C library
_ROUNDING = 2e-15  # bound on rounding errors of numbers about one


class Module:
    """A module of native functions, as LLVM text.

    Args:
        fuses: Whether a product that only one sum uses becomes a fused multiply-add.
        group: Lanes of a vector, a power of two; 1 for code over single numbers.
        still: Names of active fields with derivatives of zero. Their terms are left out, and all
            other operations are rounded as with them.

    Attributes:
        table: Constants of vector code, with their index in the module's table.
    """

    def __init__(
        self, *, fuses: bool = True, group: int = GROUP, still: Collection[str] = ()
    ) -> None:
        self.fuses, self.group, self.still = fuses, group, still
        self.functions: list[str] = []
        self.declared: set[str] = set()
        self.table: dict[str, int] = {}

    def function(
        self, name: str, layouts: tuple[np.dtype, ...], *, active: Collection[str] = ()
    ) -> Function:
        """Begin a new function of the module; see `Function` for the arguments."""
        return Function(self, name, layouts, active=active)

    def __str__(self) -> str:
        entries = ", ".join(f"double {value}" for value in self.table)
        table = f"[{len(self.table)} x double] [{entries}]"
        return "\n".join([f"@table = constant {table}", *self.functions, *sorted(self.declared)])


def _written(value: float) -> str:
    """Return a number in LLVM's hexadecimal notation."""
    return "0x" + struct.pack(">d", value).hex()


class Memory:
    """Memory at one of a native function's addresses: fields to read and write by name.

    Args:
        layout: The fields; each entry of a tile is a row of lanes.
        base: Number of the address, 0 or 1.
        known: All expressions of the function so far.

    Attributes:
        writes: Expressions to write, by field and index.
    """

    def __init__(self, layout: np.dtype, base: int, known: dict) -> None:
        self.layout, self.base, self.known = layout, base, known
        self.writes: dict[tuple[str, int], Expression] = {}

    def __getitem__(self, place: str | tuple) -> Expression:
        """Return a field or an entry of a field: the expression last written, else a read."""
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
        """Return the entries of a field along its first axis, in order."""
        return [self[name, i] for i in range(self.layout[name].shape[0])]

    def argument(self, index: int) -> Expression:
        """Return one of the two numbers that the function takes as arguments, by index."""
        return Expression(self.known, "argument", index)


Code = Callable[..., None]
"""Straight-line code: reads and writes the function's memories, all reads before all writes."""


class Function:
    """A native function under construction: a sequence of straight-line codes.

    Its arguments are two addresses, a lane, the number of tangents behind the values, and two
    numbers.

    Args:
        module: Module of the function.
        name: Name of the function.
        layouts: Layouts of the memory at its addresses.
        active: Names of the fields that have derivatives. Each tangent has the layout of the
            values, and lies behind them. Values are computed once, derivatives in a loop over
            the tangents.
    """

    def __init__(
        self,
        module: Module,
        name: str,
        layouts: tuple[np.dtype, ...],
        *,
        active: Collection[str] = (),
    ) -> None:
        self.module, self.layouts, self.active = module, layouts, active
        # The stack is aligned so that each spilled register lies in one cache line.
        self.lines = [
            f"define void @{name}({_PARAMETERS}) nounwind alignstack({8 * module.group}) {{",
            "b0:",
            "%p0 = inttoptr i64 %first to ptr",
            "%p1 = inttoptr i64 %second to ptr",
            "%shift = shl i64 %lane, 3",
        ]
        self.values, self.block = 0, 0

    def new(self, instruction: str) -> str:
        """Append an instruction, and return the name of its result."""
        self.values += 1
        self.lines.append(f"%v{self.values} = {instruction}")
        return f"%v{self.values}"

    def over_lanes(self, code: Code, group: int | None = None) -> None:
        """Append code over a group of lanes, by default as large as the module's.

        The first memory is a tile, from that group on.
        The second address is the module's table of constants. Memory operands cost nothing;
        separate constants would each need an address to be loaded.
        """
        self._emit(code, group=group or self.module.group)
        self.block += 1  # a block of its own, scheduled separately
        self.lines += [f"br label %b{self.block}", f"b{self.block}:"]

    def once(self, code: Code, *, lane: bool = False) -> None:
        """Append code over single numbers; with `lane`, over one lane of the first memory."""
        self._emit(code, lane=lane)

    def over_rows(self, code: Code) -> None:
        """Append code over single numbers for `lane` rows of two arrays; the function's only code.

        The layouts are those of the arrays' entries. There is at least one row.
        """
        begin, block, *_ = self.lines
        ends = [f"%end{i} = add i64 %at{i}, {x.itemsize}" for i, x in enumerate(self.layouts)]
        self.lines = [
            begin,
            block,
            "br label %row",
            "row:",
            "%at0 = phi i64 [ %first, %b0 ], [ %end0, %row ]",
            "%at1 = phi i64 [ %second, %b0 ], [ %end1, %row ]",
            "%k = phi i64 [ 1, %b0 ], [ %n, %row ]",
            "%p0 = inttoptr i64 %at0 to ptr",
            "%p1 = inttoptr i64 %at1 to ptr",
        ]
        self._emit(code)
        self.lines += [
            *ends,
            "%n = add i64 %k, 1",
            "%m = icmp sle i64 %n, %lane",
            "br i1 %m, label %row, label %last",
            "last:",
        ]

    def end(self) -> None:
        """Finish the function."""
        self.module.functions.append("\n".join([*self.lines, "ret void", "}"]))

    def _emit(self, code: Code, *, group: int = 1, lane: bool = False) -> None:
        known: dict = {}
        memories = [Memory(layout, i, known) for i, layout in enumerate(self.layouts)]
        code(*memories)
        values = {(m.base, *place, 0): x for m in memories for place, x in m.writes.items()}
        reads = [x.args for x in known.values() if x.op == "read" and x.args[1] in self.active]
        tangents = Tangents({read(known, *p): read(known, *p[:3], 1) for p in reads})
        changes: dict[tuple, Expression] = {}
        for (base, name, index, _), x in values.items():
            if name in self.active:
                change = tangents(x)
                changes[base, name, index, 1] = x.number(0.0) if change is None else change
        emit = self._emitter(uses(values.values()), group=group, lane=lane)
        results = {place: emit(x) for place, x in values.items()}
        loop = self._over_tangents(emit, changes) if changes else []
        for place, result in results.items():
            emit.store(place, result)
        self.lines += loop

    def _emitter(self, uses: Counter[Expression], *, group: int, lane: bool) -> Emitter:
        """Return an emitter for the instructions of one code."""
        return Emitter(self, uses, group=group, lane=lane)

    def _over_tangents(self, emit: Emitter, changes: dict[tuple, Expression]) -> list[str]:
        """Return the loop that writes derivatives; invariant expressions are computed before it."""
        block, self.block = self.block, self.block + 1
        number = self.block
        addresses = [
            line
            for base, layout in enumerate(self.layouts)
            for line in (
                f"%o{base}_{number} = mul i64 %k{number}, {layout.itemsize}",
                f"%p{base}_{number} = getelementptr i8, ptr %p{base}, i64 %o{base}_{number}",
            )
        ]
        lines, self.lines = self.lines, []
        emit.enter_tangents(lines, number, uses(changes.values()))
        results = {place: emit(x) for place, x in changes.items()}
        for place, result in results.items():
            emit.store(place, result)
        body, self.lines = self.lines, lines
        return [
            f"br label %loop{number}",
            f"loop{number}:",
            f"%k{number} = phi i64 [ 1, %b{block} ], [ %n{number}, %loop{number} ]",
            *addresses,
            *body,
            f"%n{number} = add i64 %k{number}, 1",
            f"%m{number} = icmp sle i64 %n{number}, %tangents",
            f"br i1 %m{number}, label %loop{number}, label %b{number}",
            f"b{number}:",
        ]


def uses(roots: Iterable[Expression]) -> Counter[Expression]:
    """Count how often each expression is an operand or a root."""
    uses: Counter[Expression] = Counter(roots)
    waiting = list(uses)
    seen = set(waiting)
    while waiting:
        for operand in operands(waiting.pop()):
            uses[operand] += 1
            if operand not in seen:
                seen.add(operand)
                waiting.append(operand)
    return uses


class Emitter:
    """Emits instructions for expressions, each computed once."""

    def __init__(
        self, owner: Function, uses: Counter[Expression], *, group: int, lane: bool
    ) -> None:
        self.owner, self.uses, self.group, self.lane = owner, uses, group, lane
        self.vector = group > 1
        self.number, self.boolean, self.word = (
            f"<{group} x {kind}>" if self.vector else kind for kind in ("double", "i1", "i64")
        )
        self.done: dict[Expression, str] = {}
        self.before_tangents: list[str] | None = None
        self.tangent = 0
        self.varying: dict[Expression, bool] = {}
        self.vanishing: dict[Expression, bool] = {}

    def enter_tangents(self, before: list[str], tangent: int, uses: Counter[Expression]) -> None:
        """Begin a loop over tangents; further instructions belong to the loop.

        Args:
            before: Instructions before the loop; invariant expressions are appended here.
            tangent: Number in the names of the loop's addresses.
            uses: Number of uses of each expression in the loop.
        """
        self.before_tangents, self.tangent, self.uses = before, tangent, uses

    def __call__(self, x: Expression) -> str:
        """Return the name of an expression's value; emit its instructions if necessary."""
        if x.op == "constant":
            return self._constant(x.args[0])
        if self._vanishes(x):
            return self._constant(0.0)
        if x not in self.done:
            if self.before_tangents is None or self._varies(x):
                self.done[x] = self._of(x)
            else:
                inside, self.owner.lines = self.owner.lines, self.before_tangents
                self.done[x] = self._of(x)
                self.owner.lines = inside
        return self.done[x]

    def _varies(self, x: Expression) -> bool:
        """Return whether an expression depends on the direction of the derivative."""
        if x not in self.varying:
            varies = x.args[3] > 0 if x.op == "read" else any(map(self._varies, operands(x)))
            self.varying[x] = varies
        return self.varying[x]

    def _vanishes(self, x: Expression) -> bool:
        """Return whether an expression is zero, as derivatives of `Module.still` fields are."""
        if x not in self.vanishing:
            if x.op == "read":
                vanishes = x.args[3] > 0 and x.args[1] in self.owner.module.still
            elif x.op == "mul":
                vanishes = any(map(self._vanishes, x.args))
            elif x.op == "choose":
                vanishes = all(y.value == 0.0 or self._vanishes(y) for y in x.args[1:])
            else:
                vanishes = x.op in ("neg", "add", "sub") and all(map(self._vanishes, x.args))
            self.vanishing[x] = vanishes
        return self.vanishing[x]

    def _of(self, x: Expression) -> str:
        op, args = x.op, x.args
        if op in ("sin", "cos"):
            return self(args[1])
        if op == "near":
            return self(args[0])
        if op == "rounding":
            return self._constant(_ROUNDING)
        if op == "inverse root":
            return self._inverse_root(self(args[0]), *args[1:])
        if op == "read":
            return self._load(args)
        if op == "argument":
            return self._splat(_NUMBERS[args[0]])
        if op in ("add", "sub"):
            return self._sum(x)
        values = [self(a) for a in args]
        if op in _INTRINSICS:
            return self._call(_INTRINSICS[op], *values)
        if op in _OF_THE_SYSTEM:
            return self._from_library(op, *values)
        if op in ("neg", "flip"):
            return self._negative(*values) if op == "neg" else self._flipped(*values)
        return self.owner.new(self._operation(op, *values))

    def _from_library(self, name: str, value: str) -> str:
        """Emit a call of the C library; over lanes, one for each of them."""
        new, call = self.owner.new, f"call double @{name}(double "
        self.owner.module.declared.add(f"declare double @{name}(double)")
        if not self.vector:
            return new(f"{call}{value})")
        result = "poison"
        for lane in range(self.group):
            number = new(f"extractelement {self.number} {value}, i32 {lane}")
            changed = f"double {new(f'{call}{number})')}, i32 {lane}"
            result = new(f"insertelement {self.number} {result}, {changed}")
        return result

    def _operation(self, op: str, *values: str) -> str:
        """Return the instruction for an operation on values."""
        if op in _ARITHMETIC:
            return f"{_ARITHMETIC[op]} {self.number} {values[0]}, {values[1]}"
        if op in _COMPARED:
            return f"fcmp {_COMPARED[op]} {self.number} {values[0]}, {values[1]}"
        match op:
            case "and" | "or":
                return f"{op} {self.boolean} {values[0]}, {values[1]}"
            case "not":
                return f"xor {self.boolean} {values[0]}, {self._alike('i1', 'true')}"
            case "choose":
                condition, yes, no = values
                return f"select {self.boolean} {condition}, {self.number} {yes}, {self.number} {no}"
        raise ValueError(f"no code for {op!r}")

    def _sum(self, x: Expression) -> str:
        """Emit a sum or difference, fused with a product that nothing else uses."""
        a, b = x.args
        minus = x.op == "sub"
        if self._vanishes(b):
            return self(a)
        if self._vanishes(a):
            return self._negative(self(b)) if minus else self(b)
        if self._fusible(a):
            rest = self._negative(self(b)) if minus else self(b)
            return self._call("fma", self(a.args[0]), self(a.args[1]), rest)
        if self._fusible(b):
            first = self(b.args[0])
            first = self._negative(first) if minus else first
            return self._call("fma", first, self(b.args[1]), self(a))
        return self.owner.new(self._operation(x.op, self(a), self(b)))

    def _fusible(self, x: Expression) -> bool:
        return self.owner.module.fuses and x.op == "mul" and self.uses[x] == 1

    def _negative(self, x: str) -> str:
        return self.owner.new(f"fneg {self.number} {x}")

    def _flipped(self, x: str, last_bit: str) -> str:
        """Emit a number with its sign changed if the last bit of another number is set."""
        new, word = self.owner.new, self.word
        places = self._alike("i64", "63")
        sign = new(f"shl {word} {new(f'bitcast {self.number} {last_bit} to {word}')}, {places}")
        flipped = new(f"xor {word} {new(f'bitcast {self.number} {x} to {word}')}, {sign}")
        return new(f"bitcast {word} {flipped} to {self.number}")

    def _inverse_root(self, x: str, start: int, places: tuple[int, ...]) -> str:
        """Emit the estimate of `expressions.inverse_root`."""
        new, word = self.owner.new, self.word
        bits = new(f"bitcast {self.number} {x} to {word}")
        value = self._alike("i64", str(start))
        for k in places:
            part = new(f"lshr {word} {bits}, {self._alike('i64', str(k))}")
            value = new(f"sub {word} {value}, {part}")
        return new(f"bitcast {word} {value} to {self.number}")

    def _call(self, name: str, *operands: str) -> str:
        full = f"@llvm.{name}.{f'v{self.group}f64' if self.vector else 'f64'}"
        kinds = ", ".join([self.number] * len(operands))
        self.owner.module.declared.add(f"declare {self.number} {full}({kinds})")
        given = ", ".join(f"{self.number} {operand}" for operand in operands)
        return self.owner.new(f"call {self.number} {full}({given})")

    def _constant(self, value: float) -> str:
        if not self.vector:
            return _written(value)
        table = self.owner.module.table
        offset = 8 * table.setdefault(_written(value), len(table))
        address = self.owner.new(f"getelementptr i8, ptr %p1, i64 {offset}")
        return self._splat(self.owner.new(f"load double, ptr {address}, align 8"))

    def _alike(self, kind: str, constant: str) -> str:
        """Return a literal, equal in all lanes; written out, as LLVM 15 has no `splat`."""
        return f"<{', '.join([f'{kind} {constant}'] * self.group)}>" if self.vector else constant

    def _splat(self, value: str) -> str:
        if not self.vector:
            return value
        first = self.owner.new(f"insertelement {self.number} poison, double {value}, i32 0")
        return self.owner.new(
            f"shufflevector {self.number} {first}, {self.number} poison, "
            f"<{self.group} x i32> zeroinitializer"
        )

    def _address(self, place: tuple) -> tuple[str, bool]:
        """Return the address of an entry, and whether the entry is an integer."""
        base, name, index, tangent = place
        layouts = self.owner.layouts
        field, offset = layouts[base].fields[name][:2]  # type: ignore[index]
        of_tile = self.vector or (self.lane and layouts[base] == layouts[0])
        offset += 8 * (field.shape[-1] if of_tile else 1) * index
        origin = f"%p{base}_{self.tangent}" if tangent else f"%p{base}"
        address = self.owner.new(f"getelementptr i8, ptr {origin}, i64 {offset}")
        if of_tile and self.lane:
            address = self.owner.new(f"getelementptr i8, ptr {address}, i64 %shift")
        return address, field.base.kind == "i"

    def _load(self, place: tuple) -> str:
        address, whole = self._address(place)
        if whole:
            return self.owner.new(
                f"sitofp i64 {self.owner.new(f'load i64, ptr {address}')} to double"
            )
        return self.owner.new(f"load {self.number}, ptr {address}, align {self._alignment}")

    def store(self, place: tuple, value: str) -> None:
        """Emit a write to an entry."""
        address, whole = self._address(place)
        if whole:
            whole_value = self.owner.new(f"fptosi double {value} to i64")
            self.owner.lines.append(f"store i64 {whole_value}, ptr {address}")
            return
        self.owner.lines.append(
            f"store {self.number} {value}, ptr {address}, align {self._alignment}"
        )

    @property
    def _alignment(self) -> int:
        return 8 * self.group if self.vector else 8
