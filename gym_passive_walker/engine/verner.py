"""Coefficients of Verner's Runge-Kutta method of order 9, with fifteen stages.

Of the pairs that `benchmarks/integrators.py` compares, it is the fastest for errors from 1e-8 to
rounding.

References:
    J. H. Verner, "Numerically optimal Runge-Kutta pairs with interpolants", Numerical Algorithms
    53 (2010) 383-396: the "most efficient" pair of order 9(8).
"""

from __future__ import annotations

import numpy as np

from gym_passive_walker.engine.runge_kutta import Pair

_MATRIX = (
    (),
    (0.03462,),
    (-0.038933543885728734, 0.13595789452450918),
    (0.03638413148954267, 0.0, 0.109152394468628),
    (2.02576391439397, 0.0, -7.638023836496292, 6.173259922102322),
    (0.05112275589406061, 0.0, 0.0, 0.17708237945550215, 0.0008027762409222502),
    (0.13160063579752163, 0.0, 0.0, -0.29572762526696367, 0.08781378035642952, 0.6213052975225275),
    (0.07166666666666667, 0.0, 0.0, 0.0, 0.0, 0.33055335789153195, 0.24277997544180138),
    (0.071806640625, 0.0, 0.0, 0.0, 0.0, 0.3294380283228177, 0.11651900292718229, -0.034013671875),
    (
        0.04836757646340647,
        0.0,
        0.0,
        0.0,
        0.0,
        0.03928989925676164,
        0.10547409458903446,
        -0.021438652846483126,
        -0.10412291746271944,
    ),
    (
        -0.026645614872014785,
        0.0,
        0.0,
        0.0,
        0.0,
        0.03333333333333333,
        -0.1631072244872467,
        0.033960816841277615,
        0.1572319413814626,
        0.21522674780318796,
    ),
    (
        0.036890092487086225,
        0.0,
        0.0,
        0.0,
        0.0,
        -0.1465181576725543,
        0.22425777681720244,
        0.022944057170660725,
        -0.003585005290572876,
        0.08669223316444385,
        0.43838406519683376,
    ),
    (
        -0.48660122151133406,
        0.0,
        0.0,
        0.0,
        0.0,
        -6.304602650282853,
        -0.2812456182894726,
        -2.6790192362198493,
        0.5188156639241576,
        1.3653531876033418,
        5.8850910885039465,
        2.8028087862720628,
    ),
    (
        0.41853674577534716,
        0.0,
        0.0,
        0.0,
        0.0,
        6.724547581906459,
        -0.4254442801646118,
        3.3432791530012658,
        0.6170816631175378,
        -0.9299661239399328,
        -6.099948804751011,
        -3.002206187889399,
        0.2553202529443446,
    ),
    (
        -0.7793740861228846,
        0.0,
        0.0,
        0.0,
        0.0,
        -13.937342538107776,
        1.2520488533793572,
        -14.69150040801687,
        -0.4947050585331417,
        2.2429749091462368,
        13.367893803828643,
        14.396650486650687,
        -0.79758133317768,
        0.4409353709534278,
    ),
)
"""Row i: weights of the earlier stages in stage i."""

_WEIGHTS = (
    0.014611976858423152,
    0.0,
    0.0,
    0.0,
    0.0,
    0.0,
    0.0,
    -0.3915211862331339,
    0.23109325002895065,
    0.12747667699928525,
    0.2246434176204158,
    0.5684352689748513,
    0.058258715572158275,
    0.13643174034822156,
    0.030570139830827976,
)

_TELLING = (0, 7, 8, 9, 10, 11, 12, 13)
"""Stages of high order, the accelerations of which lie on one smooth curve."""

_SCALE = 6e-5
"""Scale of the estimate: errors of strides at a tolerance equal those with Verner's estimate."""


def _divided_difference() -> list[float]:
    """Return the weights of the seventh divided difference of accelerations, the error estimate.

    Of all combinations of stages before the last, only this one contributes nothing to the order
    conditions up to the seventh. A method with these weights added would be of order 7. Verner's
    own estimate, of order 8, needs one more stage.
    """
    nodes = {stage: sum(map(np.longdouble, _MATRIX[stage])) for stage in _TELLING}
    weights = [0.0] * len(_WEIGHTS)
    for stage, node in nodes.items():
        others = [node - other for at, other in nodes.items() if at != stage]
        weights[stage] = float(_SCALE / np.prod(np.array(others, np.longdouble)))
    return weights


VERNER = Pair.from_tableau(_MATRIX, _WEIGHTS, _divided_difference(), order=9, error_order=7)
