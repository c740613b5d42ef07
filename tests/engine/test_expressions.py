"""Symbolic expressions, their values and their derivatives."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st

from gym_passive_walker.engine import sines  # noqa: F401 - the sine and cosine of expressions
from gym_passive_walker.engine.equations import Equations
from gym_passive_walker.models.equations import kneed
from gym_passive_walker.models.equations.hybrid import State
from gym_passive_walker.models.equations.numbers import sine_cosine
from gym_passive_walker.models.expressions import (
    Expression,
    Tangents,
    choose,
    inverse_root,
    larger,
    read,
    square_root,
)
from gym_passive_walker.models.walkers import WALKERS
from tests.engine.machine import entries, evaluate
from tests.equations import statements  # noqa: F401 - SymPy's sine and cosine


class Kit:
    """Functions that have different names for expressions and for symbols of SymPy."""

    def __init__(self, root, pick, larger, count, equal) -> None:
        self.root, self.pick, self.larger, self.count, self.equal = root, pick, larger, count, equal


OURS = Kit(square_root, choose, larger, lambda c: c, lambda x, y: x == y)
SYMPY = Kit(
    sp.sqrt, lambda c, a, b: sp.Piecewise((a, c), (b, True)), sp.Max,
    lambda c: sp.Piecewise((1, c), (0, True)), sp.Eq,
)  # fmt: skip

OPERATIONS = {
    "x + y": lambda kit, x, y: x + y,
    "x + 2": lambda kit, x, y: x + 2.0,
    "2 + x": lambda kit, x, y: 2.0 + x,
    "x - y": lambda kit, x, y: x - y,
    "y - x": lambda kit, x, y: y - x,
    "2 - x": lambda kit, x, y: 2.0 - x,
    "x * y": lambda kit, x, y: x * y,
    "3 * x": lambda kit, x, y: 3.0 * x,
    "x * x * x": lambda kit, x, y: x * x * x,
    "x / y": lambda kit, x, y: x / y,
    "2 / x": lambda kit, x, y: 2.0 / x,
    "x / 2": lambda kit, x, y: x / 2.0,
    "-x": lambda kit, x, y: -x,
    "(-x) * (-y)": lambda kit, x, y: (-x) * (-y),
    "|x|": lambda kit, x, y: abs(x),
    "|-x|": lambda kit, x, y: abs(-x),
    "|x - y|": lambda kit, x, y: abs(x - y),
    "root of y²+1": lambda kit, x, y: kit.root(y * y + 1.0),
    "sine": lambda kit, x, y: sine_cosine(x)[0],
    "cosine": lambda kit, x, y: sine_cosine(x)[1],
    "sine of x y": lambda kit, x, y: sine_cosine(x * y)[0],
    "cosine of x y": lambda kit, x, y: sine_cosine(x * y)[1],
    "the larger": lambda kit, x, y: kit.larger(x * x, y * x),
    "a choice": lambda kit, x, y: kit.pick(x < y, x * y, x + y),
    "a choice with a number": lambda kit, x, y: kit.pick(x < y, x * y, 2.0),
    "another choice with a number": lambda kit, x, y: kit.pick(x <= y, 2.0, x * y),
    "a choice of numbers": lambda kit, x, y: kit.pick(x >= y, 2.0, 3.0),
    "x to the power -2": lambda kit, x, y: x**-2,
    "x to the power 0": lambda kit, x, y: x**0 * y,
    "x to the power 11": lambda kit, x, y: x**11,
    "a condition as a factor": lambda kit, x, y: x * kit.count(x < y),
    "a number less a condition": lambda kit, x, y: y - kit.count(x < y) * 2.0,
    "the negative of a condition": lambda kit, x, y: -kit.count(x >= y) + x,
    "a choice of equals": lambda kit, x, y: kit.pick(kit.equal(x, x + 1.0), x, y),
    "what does not change": lambda kit, x, y: x * 0.0 + 3.0,
}

NUMBER = st.floats(-2.0, 2.0).filter(lambda x: abs(x) > 1e-2)


def value_of(x: Expression | None, values) -> float:
    """An expression's value; zero for the derivative of a constant."""
    return 0.0 if x is None else float(evaluate(x, values))


@pytest.mark.parametrize("name", OPERATIONS)
@given(at=st.tuples(NUMBER, NUMBER), moves=st.tuples(NUMBER, NUMBER))
def test_every_operation_has_the_value_and_the_derivative_that_sympy_says(name, at, moves):
    if abs(at[0] - at[1]) < 1e-6:
        return  # a kink
    x, y, dx, dy = entries("x", "y", "dx", "dy")
    found = x.number(OPERATIONS[name](OURS, x, y))
    a, b = sp.symbols("a b", real=True)
    stated = sp.sympify(OPERATIONS[name](SYMPY, a, b))
    here = {a: at[0], b: at[1]}
    values = dict(zip((x, y, dx, dy), (*at, *moves), strict=True))
    assert value_of(found, values) == pytest.approx(float(stated.subs(here)), rel=1e-13, abs=1e-14)
    tangent = Tangents({x: dx, y: dy})(found)
    along = stated.diff(a) * moves[0] + stated.diff(b) * moves[1]
    assert value_of(tangent, values) == pytest.approx(float(along.subs(here)), rel=1e-12, abs=1e-13)


@st.composite
def formulas(draw, depth: int = 3):
    """A function of two numbers, smooth except for absolute values and choices."""
    if depth == 0:
        return draw(st.sampled_from([lambda x, y: x, lambda x, y: y]))
    kind = draw(st.integers(0, 9))
    f, g = draw(formulas(depth=depth - 1)), draw(formulas(depth=depth - 1))
    c = draw(st.floats(-2.0, 2.0))
    return [
        lambda x, y: f(x, y) + g(x, y),
        lambda x, y: f(x, y) - g(x, y),
        lambda x, y: f(x, y) * g(x, y),
        lambda x, y: f(x, y) / (1.0 + g(x, y) * g(x, y)),
        lambda x, y: -f(x, y),
        lambda x, y: c * f(x, y) + c,
        lambda x, y: sine_cosine(f(x, y))[0],
        lambda x, y: sine_cosine(g(x, y))[1],
        lambda x, y: square_root(1.0 + f(x, y) * f(x, y)),
        lambda x, y: choose(f(x, y) < g(x, y), f(x, y), abs(g(x, y))),
    ][kind]


@given(formula=formulas(), at=st.tuples(NUMBER, NUMBER), moves=st.tuples(NUMBER, NUMBER))
def test_the_derivative_of_any_formula_is_that_of_a_complex_step(formula, at, moves):
    x, y, dx, dy = entries("x", "y", "dx", "dy")
    found = formula(x, y)
    tangent = Tangents({x: dx, y: dy})(found)
    values = dict(zip((x, y, dx, dy), (*at, *moves), strict=True))
    stepped = {x: at[0] + 1e-200j * moves[0], y: at[1] + 1e-200j * moves[1]}
    expected = np.imag(evaluate(found, stepped)) / 1e-200
    assert value_of(tangent, values) == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("order", [4, 5, 7, 8, 9])
def test_a_rough_inverse_root_is_at_most_a_twelfth_too_large(order):
    (x,) = entries("x")
    rough, numbers = inverse_root(x, order), np.geomspace(1e-3, 1e3, 500)
    found = np.array([value_of(rough, {x: number}) for number in numbers])
    share = found * numbers ** (1.0 / order)
    assert share.min() > 0.99 and share.max() < 1.085
    assert (np.diff(found) < 0.0).all()
    assert value_of(rough, {x: 0.0}) > 1e30


@pytest.mark.parametrize("order", [4, 8])
def test_a_rough_inverse_root_is_exact_for_powers_of_it(order):
    (x,) = entries("x")
    for power in range(-5, 6):
        found = value_of(inverse_root(x, order), {x: 2.0 ** (order * power)})
        assert found == 2.0**-power


def test_a_derivative_has_a_derivative():
    x, dx = entries("x", "dx")
    along = Tangents({x: dx})
    second = along(along(sine_cosine(x * x)[0]))
    a = sp.symbols("a")
    for at in (0.3, -1.2):
        expected = 0.25 * sp.sin(a * a).diff(a, 2).subs(a, at)
        assert value_of(second, {x: at, dx: 0.5}) == pytest.approx(float(expected), rel=1e-13)


def test_what_does_not_move_has_no_derivative():
    x, y, dx = entries("x", "y", "dx")
    along = Tangents({x: dx})
    for still in (
        y,
        y * y + 1.0,
        x.number(3.0),
        x < y,
        sine_cosine(y)[0],
        abs(y),
        choose(x < y, y, 1),
    ):
        assert along(still) is None
    assert along(x) is dx


@pytest.mark.parametrize("bends", [(0.3, -0.4, 0.7), (None, None, None)], ids=["bent", "plain"])
def test_a_function_of_the_state_is_followed_along_the_motion(bends):
    """First and second time derivative of a foot's height; the second one needs accelerations."""
    system, body = kneed.SYSTEM, WALKERS["lab"].body
    known: dict = {}
    angles, rates = ([read(known, kind, i) for i in range(3)] for kind in ("angle", "rate"))
    accelerations = [read(known, "bend", i) if b is not None else None for i, b in enumerate(bends)]
    equations = Equations(system, system.phases[0], ())
    state = equations.as_state(angles, rates)
    value, rate, bend = equations.along(
        lambda state: system.foot_clearance(body, state), state, accelerations
    )
    at, speeds, t = (0.2, -0.4, -0.7), (-1.0, 0.5, 0.8), sp.symbols("t")
    here = dict(zip((*angles, *rates), (*at, *speeds), strict=True))
    here |= {x: b for x, b in zip(accelerations, bends, strict=True) if x is not None}
    moving = [q + v * t + (b or 0.0) * t * t / 2 for q, v, b in zip(at, speeds, bends, strict=True)]
    height = system.foot_clearance(body, State(*moving, 0, 0, 0))
    assert value_of(value, here) == pytest.approx(float(height.subs(t, 0)), rel=1e-13)
    assert value_of(rate, here) == pytest.approx(float(height.diff(t).subs(t, 0)), rel=1e-13)
    if bends[0] is not None:
        assert value_of(bend, here) == pytest.approx(float(height.diff(t, 2).subs(t, 0)), rel=1e-13)


def test_equal_expressions_are_one():
    x, y = entries("x", "y")
    assert x * y + 2.0 is x * y + 2.0
    assert x * y is not y * x
    assert x * 2.0 is not x * 3.0
    assert sine_cosine(x * y)[1] is sine_cosine(x * y)[1]


def test_nothing_costs_nothing():
    (x,) = entries("x")
    assert x + 0.0 is 0.0 + x is x - 0.0 is x
    assert (0.0 * x).value == (x * 0.0).value == 0.0
    assert (x + 0.0 * (x + 1.0)) is x


def test_numbers_are_reckoned_at_once():
    (x,) = entries("x")
    two, three = x.number(2.0), x.number(3)
    for result, value in (
        (two + three, 5.0), (two - three, -1.0), (two * three, 6.0), (three / two, 1.5),
    ):  # fmt: skip
        assert result.op == "constant" and result.value == value
    assert x.value is None
    assert 1.0 * x is x and x * 1.0 is x
    opposite = -x
    assert -opposite is x
    assert abs(-x) is abs(x)
    assert (-x) * (-x) is x * x
    assert choose(x < two, three, 3.0) is three


def test_an_expression_is_neither_true_nor_false():
    x, y = entries("x", "y")
    with pytest.raises(TypeError, match="choose"):
        bool(x < y)
    with pytest.raises(TypeError, match="choose"):
        max(x, y)
