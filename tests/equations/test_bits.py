"""What the bits of walks depend on is computed alike on every CPU."""

from __future__ import annotations

import ast
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gym_passive_walker.models.equations.numbers import inverse_sine, natural_logarithm, power_of_e

PACKAGE = Path(__file__).parents[2] / "gym_passive_walker"
# NumPy computes these by other code with AVX-512; not so sin, cos, tanh, sqrt and hypot.
OTHER_BITS = {
    "exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "arcsin", "arccos", "arctan",
    "arctan2",
    "tan", "sinh", "cosh", "arcsinh", "arccosh", "arctanh", "cbrt", "power", "float_power",
}  # fmt: skip
ROOMS = ("models", "engine", "gaits/section.py", "gaits/find", "gaits/scenes", "envs")
EXCEPT = {
    ("gaits/find/nearest.py", "log"): "for a sentence of advice",
    ("models/equations/numbers.py", "arcsin"): "of complex numbers, which carry derivatives",
    ("engine/own/mechanics.py", "exp"): "in the check of a statement by numbers",
    ("envs/policies/network.py", "exp"): "a policy's action and its noise",
    ("envs/policies/network.py", "expm1"): "a policy's action",
}


def test_walks_take_no_function_of_numpy_that_has_other_bits_with_avx_512():
    found = {
        (path.relative_to(PACKAGE).as_posix(), node.attr)
        for room in ROOMS
        for path in ([PACKAGE / room] if room.endswith(".py") else (PACKAGE / room).rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == "np"
        and node.attr in OTHER_BITS
    }
    assert found == EXCEPT.keys()


START = """
import gymnasium
from examples.torso import TORSO
import gym_passive_walker as gpw

for of in ({"walker": "C", "slope": 0.0123}, {"system": TORSO, "slope": 0.03}):
    env = gymnasium.make("PassiveWalker-v0", **of)
    env.reset(seed=1)
    print(env.unwrapped.state.tolist())
"""


def test_a_start_that_is_searched_does_not_depend_on_the_code_of_a_library():
    """OpenBLAS has other code for each of these CPUs, and solves to other last bits."""
    found = {
        subprocess.run(
            [sys.executable, "-c", START], cwd=PACKAGE.parent, capture_output=True, text=True,
            check=True, env={**os.environ, "OPENBLAS_CORETYPE": cpu},
        ).stdout
        for cpu in ("Haswell", "Nehalem", "Zen")
    }  # fmt: skip
    assert len(found) == 1


@pytest.mark.parametrize(
    ("ours", "theirs", "low", "high"),
    [
        (inverse_sine, math.asin, -1.0, 1.0),
        (natural_logarithm, math.log, 1e-9, 1e9),
        (power_of_e, math.exp, -30.0, 30.0),
    ],
)
@pytest.mark.parametrize("shape", [(), (7,), (2, 3)])
def test_functions_are_those_of_the_c_library(ours, theirs, low, high, shape):
    x = np.random.default_rng(0).uniform(low, high, shape)
    expected = [theirs(each) for each in np.ravel(x)]
    assert np.ravel(ours(x)).tolist() == expected and np.shape(ours(x)) == shape


def test_an_arcsine_carries_derivatives_and_has_none_beyond_one():
    assert inverse_sine(0.5 + 1e-100j).imag == pytest.approx(1e-100 / math.sqrt(0.75), rel=1e-14)
    assert math.isnan(inverse_sine(1.5)) and inverse_sine(-1.0) == -math.pi / 2
    assert math.isnan(natural_logarithm(0.0)) and math.isnan(power_of_e(math.nan))
