"""What the bits of walks depend on is computed alike on every CPU."""

from __future__ import annotations

import ast
import math
from pathlib import Path

import numpy as np
import pytest

from gym_passive_walker.models.equations.numbers import inverse_sine

PACKAGE = Path(__file__).parents[2] / "gym_passive_walker"
# NumPy computes these by other code with AVX-512; not so sin, cos, tanh, sqrt and hypot.
OTHER_BITS = {
    "exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "arcsin", "arccos", "arctan",
    "arctan2",
    "tan", "sinh", "cosh", "arcsinh", "arccosh", "arctanh", "cbrt", "power", "float_power",
}  # fmt: skip
ROOMS = ("models", "engine", "gaits/scenes", "envs")
EXCEPT = {
    ("models/equations/numbers.py", "arcsin"): "of complex numbers, which carry derivatives",
    ("engine/own/mechanics.py", "exp"): "in the check of a statement by numbers",
    ("envs/policies/network.py", "exp"): "a policy's action and its noise",
    ("envs/policies/network.py", "expm1"): "a policy's action",
}


def test_walks_take_no_function_of_numpy_that_has_other_bits_with_avx_512():
    found = {
        (path.relative_to(PACKAGE).as_posix(), node.attr)
        for room in ROOMS
        for path in (PACKAGE / room).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == "np"
        and node.attr in OTHER_BITS
    }
    assert found == EXCEPT.keys()


@pytest.mark.parametrize("shape", [(), (7,), (2, 3)])
def test_arcsines_are_those_of_the_c_library(shape):
    x = np.random.default_rng(0).uniform(-1.0, 1.0, shape)
    expected = [math.asin(each) for each in np.ravel(x)]
    assert np.ravel(inverse_sine(x)).tolist() == expected and np.shape(inverse_sine(x)) == shape


def test_an_arcsine_carries_derivatives_and_has_none_beyond_one():
    assert inverse_sine(0.5 + 1e-100j).imag == pytest.approx(1e-100 / math.sqrt(0.75), rel=1e-14)
    assert math.isnan(inverse_sine(1.5)) and inverse_sine(-1.0) == -math.pi / 2
