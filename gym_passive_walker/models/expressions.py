"""Symbolic expressions, traced through plain Python functions.

A function of numbers, called with `Expression`s, returns the expression of its result. Equal
expressions are one object, so common subexpressions are computed once. `Tangents` differentiates
expressions exactly, and `native` compiles them to machine code.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from gym_passive_walker.models.equations.numbers import larger, sine_cosine

_FOLDED: dict[str, Callable[[float, float], float]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
}


CONDITIONS = ("<", "<=", ">", ">=", "and", "or", "not")
"""Operations that give conditions. In arithmetic a condition counts as 1.0 or 0.0."""

_MOST = 64  # largest power that is written as products


class Expression:
    """An operation on other expressions, a constant, or an entry that is read.

    An operator without compiled form raises a `TypeError`. Equality is an operation too, so
    expressions are found in mappings by their identity.

    Attributes:
        op: "constant", "read", or the name of an operation.
        args: Operands of an operation, the value of a constant, or the place of a read.
        known: All expressions so far of one piece of code, by operation and operands.
    """

    __slots__ = ("args", "known", "op")

    def __new__(cls, known: dict, op: str, *args: Any) -> Expression:
        """Return the expression; equal operations on equal operands give the same object."""
        key = (op, *[id(a) if isinstance(a, Expression) else repr(a) for a in args])
        self = known.get(key)
        if self is None:
            self = known[key] = super().__new__(cls)
            self.op, self.args, self.known = op, args, known
        return self

    def _with(self, op: str, *others: Any) -> Expression:
        return Expression(self.known, op, *others)

    def number(self, x: Any) -> Expression:
        """Return a number or a condition as a number of the same code.

        Raises:
            TypeError: if it is neither.
        """
        if isinstance(x, Expression):
            return x._with("choose", x, *map(x.number, (1.0, 0.0))) if x.is_condition else x
        if not hasattr(x, "__float__") or getattr(x, "ndim", 0):
            raise TypeError(f"{type(x).__name__} is no number")
        return self._with("constant", float(x))

    @property
    def is_condition(self) -> bool:
        """Whether this is a condition, neither true nor false until the code runs."""
        return self.op in CONDITIONS

    def _binary(self, op: str, a: Any, b: Any) -> Expression:
        a, b = self.number(a), self.number(b)
        x, y = a.value, b.value
        if x is not None and y is not None and op in _FOLDED:
            return self.number(_FOLDED[op](x, y))
        if op == "mul":
            if a.op == b.op == "neg":
                a, b = a.args[0], b.args[0]
                x, y = a.value, b.value
            if 1.0 in (x, y):
                return b if x == 1.0 else a
            if 0.0 in (x, y):
                return self.number(0.0)
        elif op == "div" and x == 0.0:
            return a
        elif op in ("add", "sub") and y == 0.0:
            return a
        elif op == "add" and x == 0.0:
            return b
        return self._with(op, a, b)

    @property
    def value(self) -> float | None:
        """Value of a constant; None for other expressions."""
        return self.args[0] if self.op == "constant" else None

    def __add__(self, other: Any) -> Expression:
        return self._binary("add", self, other)

    def __radd__(self, other: Any) -> Expression:
        return self._binary("add", other, self)

    def __sub__(self, other: Any) -> Expression:
        return self._binary("sub", self, other)

    def __rsub__(self, other: Any) -> Expression:
        return self._binary("sub", other, self)

    def __mul__(self, other: Any) -> Expression:
        return self._binary("mul", self, other)

    def __rmul__(self, other: Any) -> Expression:
        return self._binary("mul", other, self)

    def __truediv__(self, other: Any) -> Expression:
        return self._binary("div", self, other)

    def __rtruediv__(self, other: Any) -> Expression:
        return self._binary("div", other, self)

    def __neg__(self) -> Expression:
        return self.args[0] if self.op == "neg" else self.applied("neg")

    def __pos__(self) -> Expression:
        return self.number(self)

    def __pow__(self, power: Any, modulo: None = None) -> Expression:
        power = power.value if isinstance(power, Expression) else power
        if not isinstance(power, int | float | np.integer | np.floating) or modulo is not None:
            raise _refusal("** with another power than a number")
        if power == 0.5:
            return square_root(self)
        if power % 1 != 0 or abs(power) > _MOST:
            raise TypeError(f"** takes 0.5 or a whole number up to {_MOST} here; see gpw.math.exp")
        if power < 0:
            return 1.0 / self**-power
        half = self ** (power // 2) if power > 1 else self.number(1.0)
        return half * half * self if power % 2 else half * half

    def __abs__(self) -> Expression:
        return self.args[0].applied("abs") if self.op == "neg" else self.applied("abs")

    def applied(self, function: str) -> Expression:
        """Return a function of this number, by the name of its operation."""
        return self._with(function, self.number(self))

    def __lt__(self, other: Any) -> Expression:
        return self._binary("<", self, other)

    def __le__(self, other: Any) -> Expression:
        return self._binary("<=", self, other)

    def __gt__(self, other: Any) -> Expression:
        return self._binary(">", self, other)

    def __ge__(self, other: Any) -> Expression:
        return self._binary(">=", self, other)

    def __eq__(self, other: Any) -> Expression:  # type: ignore[override]
        return (self <= other) & (self >= other)

    def __ne__(self, other: Any) -> Expression:  # type: ignore[override]
        return ~(self == other)

    __hash__ = object.__hash__

    def _logical(self, op: str, other: Any) -> Expression:
        """Return an operation on conditions; plain booleans are conditions too."""
        if isinstance(other, bool | np.bool_):
            other = self.number(1.0) <= float(other)
        if not (self.is_condition and getattr(other, "is_condition", False)):
            raise TypeError("&, | and ^ take conditions such as x > 0, not numbers")
        return self._with(op, self, other)

    def __and__(self, other: Any) -> Expression:
        return self._logical("and", other)

    def __or__(self, other: Any) -> Expression:
        return self._logical("or", other)

    def __xor__(self, other: Any) -> Expression:
        return (self | other) & ~(self & other)

    __rand__, __ror__, __rxor__ = __and__, __or__, __xor__

    def __invert__(self) -> Expression:
        if not self.is_condition:
            raise TypeError("~ takes a condition such as x > 0, not a number")
        return self._with("not", self)

    def __bool__(self) -> bool:
        raise TypeError(
            "`if`, `and`, `or`, `not`, `min` and `max` need a number that is known already: use "
            "choose() or gpw.math.where(), &, | and ~, or gpw.math.minimum()"
        )

    def __array_ufunc__(self, function: Any, method: str, *given: Any, **options: Any) -> Any:
        """Apply an operator on numbers and arrays of NumPy, entry by entry."""
        if method != "__call__" or options or function.__name__ not in _OPERATORS:
            raise _refusal(f"np.{function.__name__}")
        entries = np.frompyfunc(_OPERATORS[function.__name__], function.nin, 1)
        return entries(*(np.asarray(x).astype(object) for x in given))


def _refusal(what: str) -> TypeError:
    return TypeError(f"{what} has no compiled form; see gpw.math for what has")


def _refused(what: str) -> Callable[..., Any]:
    """Return a method for an operator that is refused."""

    def method(self: Expression, *others: Any) -> Any:
        raise _refusal(what)

    return method


REFUSED = {
    "//": ("floordiv", "rfloordiv"), "%": ("mod", "rmod"), "divmod()": ("divmod", "rdivmod"),
    "@": ("matmul", "rmatmul"), "<<": ("lshift", "rlshift"), ">>": ("rshift", "rrshift"),
    "** with a base that is known": ("rpow",), "round()": ("round",), "int()": ("int", "trunc"),
    "math.floor()": ("floor",), "math.ceil()": ("ceil",), "an index": ("index",),
    "float(), as math.sin() and others take it,": ("float",), "complex()": ("complex",),
}  # fmt: skip
"""Operators of Python that have no compiled form, with their methods."""

for _what, _methods in REFUSED.items():
    for _method in _methods:
        setattr(Expression, f"__{_method}__", _refused(_what))

_OPERATORS: dict[str, Callable[..., Any]] = {
    "add": operator.add, "subtract": operator.sub, "multiply": operator.mul,
    "divide": operator.truediv, "power": operator.pow, "negative": operator.neg,
    "positive": operator.pos, "absolute": abs, "square": lambda x: x * x,
    "less": operator.lt, "less_equal": operator.le, "greater": operator.gt,
    "greater_equal": operator.ge, "equal": operator.eq, "not_equal": operator.ne,
    "bitwise_and": operator.and_, "bitwise_or": operator.or_, "bitwise_xor": operator.xor,
    "invert": operator.invert,
}  # fmt: skip
"""Operators by the names of NumPy's functions."""


def read(known: dict, *place: Any) -> Expression:
    """Return the value of a place in memory when the code begins."""
    return Expression(known, "read", *place)


def choose(condition: Expression, yes: Any, no: Any) -> Expression:
    """Return `yes` where the condition holds, else `no`; a number is a condition if not zero."""
    condition = condition if condition.is_condition else condition != 0.0
    if all(isinstance(x, bool | np.bool_) or getattr(x, "is_condition", False) for x in (yes, no)):
        return (condition & yes) | (~condition & no)
    yes, no = condition.number(yes), condition.number(no)
    return yes if yes is no else condition._with("choose", condition, yes, no)


@larger.register
def _(a: Expression, b: Any) -> Expression:
    return choose(a > b, a, b)


def square_root(x: Expression) -> Expression:
    """Return the square root."""
    return x.applied("sqrt")


_ONE, _PLACES = 0x3FF0000000000000, 10


def inverse_root(x: Expression, order: int) -> Expression:
    """Return an estimate of x^(-1/order) for x > 0, at most a twelfth too large; exact for 1.

    The bits of a number approximate its logarithm, with a linear interpolation of the fraction.
    Shifts approximate the division of these bits by the order.

    References:
        J. F. Blinn, "Floating-point tricks", IEEE Computer Graphics and Applications 17 (1997)
        80-84.
    """
    places, rest = [], 1.0
    for place in range(1, _PLACES + 1):
        if rest * 2.0**place >= order:
            places.append(place)
            rest -= order / 2.0**place
    # The shifted bits are subtracted from this constant.
    start = _ONE + sum(_ONE >> place for place in places)
    return x._with("inverse root", x, start, tuple(places))


def rounding(x: Expression) -> Expression:
    """Return a bound on the rounding error of a few operations on numbers about one."""
    return x._with("rounding")


def polynomial(powers: Sequence[Any], x: Expression) -> Any:
    """Evaluate a polynomial from its coefficients, in ascending powers, by Horner's method."""
    value: Any = powers[-1]
    for power in reversed(powers[:-1]):
        value = power + x * value
    return value


def operands(x: Expression) -> tuple[Expression, ...]:
    """Return the expressions that the code of an expression uses."""
    if x.op in ("sin", "cos"):
        return x.args[1:]
    if x.op == "near":
        return x.args[:1]
    return tuple(a for a in x.args if isinstance(a, Expression))


class Tangents:
    """Directional derivatives of expressions with respect to the entries that they read.

    Args:
        seeds: Derivatives of the entries; those of all other entries are zero.
    """

    def __init__(self, seeds: Mapping[Expression, Expression]) -> None:
        self._done: dict[Expression, Expression | None] = dict(seeds)

    def __call__(self, x: Expression) -> Expression | None:
        """Return the derivative; None if it is identically zero."""
        if x not in self._done:
            if x.op in ("sin", "cos"):
                sine, cosine = sine_cosine(x.args[0])
                change = self(x.args[0])
                self._done[x] = _times(change, cosine if x.op == "sin" else -sine)
            elif x.op in _RULES:
                self._done[x] = _RULES[x.op](x, *map(self, operands(x)))
            elif x.op in _CONSTANT:
                self._done[x] = None
            else:
                raise NotImplementedError(f"{x.op!r} has no derivative here")
        return self._done[x]


def _sum(a: Expression | None, b: Expression | None) -> Expression | None:
    return b if a is None else a if b is None else a + b


def _difference(a: Expression | None, b: Expression | None) -> Expression | None:
    return a if b is None else -b if a is None else a - b


def _times(a: Expression | None, b: Expression) -> Expression | None:
    return None if a is None else a * b


def _choice(x: Expression, _: None, yes: Any, no: Any) -> Expression | None:
    if yes is no is None:
        return None
    return choose(x.args[0], 0.0 if yes is None else yes, 0.0 if no is None else no)


_RULES: dict[str, Callable[..., Expression | None]] = {
    "near": lambda x, a, *_: a,
    "add": lambda x, a, b: _sum(a, b),
    "sub": lambda x, a, b: _difference(a, b),
    "mul": lambda x, a, b: _sum(_times(a, x.args[1]), _times(b, x.args[0])),
    # (a / b)' = (a' - (a / b) b') / b
    "div": lambda x, a, b: _times(_difference(a, _times(b, x)), 1.0 / x.args[1]),
    "neg": lambda x, a: None if a is None else -a,
    "abs": lambda x, a: None if a is None else choose(x.args[0] < 0.0, -a, a),
    "sqrt": lambda x, a: _times(a, 0.5 / x),
    "exp": lambda x, a: _times(a, x),
    "tanh": lambda x, a: _times(a, 1.0 - x * x),
    "choose": _choice,
}
_CONSTANT = frozenset({"constant", "read", "argument", "rounding", "inverse root"})
_CONSTANT |= {*CONDITIONS}
