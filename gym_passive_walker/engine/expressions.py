"""Symbolic expressions, traced through plain Python functions.

A function of numbers, called with `Expression`s, returns the expression of its result. Equal
expressions are one object, so common subexpressions are computed once. `Tangents` differentiates
expressions exactly, and `native` compiles them to machine code.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from gym_passive_walker.physics.numbers import larger, sine_cosine

_FOLDED: dict[str, Callable[[float, float], float]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
}


class Expression:
    """An operation on other expressions, a constant, or an entry that is read.

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
        """Return a number as an expression of the same code."""
        return x if isinstance(x, Expression) else self._with("constant", float(x))

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
        return self.args[0] if self.op == "neg" else self._with("neg", self)

    def __pow__(self, power: Any) -> Expression:
        if power == 0.5:
            return square_root(self)
        if power not in range(1, 9):
            return NotImplemented
        half = self ** (power // 2) if power > 1 else self.number(1.0)
        return half * half * self if power % 2 else half * half

    def __abs__(self) -> Expression:
        return self._with("abs", self.args[0] if self.op == "neg" else self)

    def __lt__(self, other: Any) -> Expression:
        return self._binary("<", self, other)

    def __le__(self, other: Any) -> Expression:
        return self._binary("<=", self, other)

    def __gt__(self, other: Any) -> Expression:
        return self._binary(">", self, other)

    def __ge__(self, other: Any) -> Expression:
        return self._binary(">=", self, other)

    def __and__(self, other: Expression) -> Expression:
        return self._with("and", self, other)

    def __or__(self, other: Expression) -> Expression:
        return self._with("or", self, other)

    def __invert__(self) -> Expression:
        return self._with("not", self)

    def __bool__(self) -> bool:
        raise TypeError(
            "an expression is neither true nor false yet: use choose() or gpw.math.where(), & and |"
        )


def read(known: dict, *place: Any) -> Expression:
    """Return the value of a place in memory when the code begins."""
    return Expression(known, "read", *place)


def choose(condition: Expression, yes: Any, no: Any) -> Expression:
    """Return `yes` where the condition holds, else `no`."""
    yes, no = condition.number(yes), condition.number(no)
    return yes if yes is no else condition._with("choose", condition, yes, no)


@larger.register
def _(a: Expression, b: Any) -> Expression:
    return choose(a > b, a, b)


def square_root(x: Expression) -> Expression:
    """Return the square root."""
    return x._with("sqrt", x)


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
_CONSTANT |= {"<", "<=", ">", ">=", "and", "or", "not"}
