"""Newton's method from many guesses, by equations of which all is known."""

from __future__ import annotations

import numpy as np

from gym_passive_walker.gaits.find.newton import newton


def test_it_ends_where_only_rounding_is_left():
    asked = []

    def equations(points):
        asked.append(len(points))
        noise = 1e-13 * 0.9 ** len(asked)
        return points - 0.5 + noise, np.ones((len(points), 1, 1))

    found = newton(equations, np.array([[0.4], [0.7]]), accuracy=1e-18)
    np.testing.assert_allclose(found.points, 0.5, rtol=0.0, atol=1e-12)
    assert len(asked) <= 4


def test_it_goes_on_to_a_double_root_as_near_as_rounding_allows():
    found = newton(
        lambda x: (x**2, 2.0 * x[:, :, None]), np.array([[0.3]]), accuracy=1e-30, iterations=60
    )
    assert found.sizes[0] <= 1e-30
