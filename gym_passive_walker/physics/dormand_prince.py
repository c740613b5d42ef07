"""The Runge-Kutta pair of Dormand and Prince of order 8(5,3), for second-order equations.

The equations of motion give accelerations, angle'' = f(angle, rate). A Runge-Kutta method with
matrix A then needs no stages for the angles: with K the stage accelerations,

    rate_i = rate + h sum_j A_ij K_j,    angle_i = angle + h c_i rate + h^2 sum_j (A A)_ij K_j,

which is the same method, with half the numbers to keep and one reading of each for both sums.

References:
    E. Hairer, S. P. Norsett, G. Wanner, "Solving Ordinary Differential Equations I", 2nd ed.,
    Springer (1993), section II.5 and the code DOP853.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gym_passive_walker.physics.lanes import get, inlined

STAGES = 12
ORDER = 8

_A = np.zeros((STAGES, STAGES))
_A[1, :1] = [0.05260015195876773]
_A[2, :2] = [0.0197250569845379, 0.0591751709536137]
_A[3, :3] = [0.02958758547680685, 0.0, 0.08876275643042054]
_A[4, :4] = [0.2413651341592667, 0.0, -0.8845494793282861, 0.924834003261792]
_A[5, :5] = [0.037037037037037035, 0.0, 0.0, 0.17082860872947386, 0.12546768756682242]
_A[6, :6] = [0.037109375, 0.0, 0.0, 0.17025221101954405, 0.06021653898045596, -0.017578125]
_A[7, :7] = [
    0.03709200011850479,
    0.0,
    0.0,
    0.17038392571223998,
    0.10726203044637328,
    -0.015319437748624402,
    0.008273789163814023,
]
_A[8, :8] = [
    0.6241109587160757,
    0.0,
    0.0,
    -3.3608926294469414,
    -0.868219346841726,
    27.59209969944671,
    20.154067550477894,
    -43.48988418106996,
]
_A[9, :9] = [
    0.47766253643826434,
    0.0,
    0.0,
    -2.4881146199716677,
    -0.590290826836843,
    21.230051448181193,
    15.279233632882423,
    -33.28821096898486,
    -0.020331201708508627,
]
_A[10, :10] = [
    -0.9371424300859873,
    0.0,
    0.0,
    5.186372428844064,
    1.0914373489967295,
    -8.149787010746927,
    -18.52006565999696,
    22.739487099350505,
    2.4936055526796523,
    -3.0467644718982196,
]
_A[11, :11] = [
    2.273310147516538,
    0.0,
    0.0,
    -10.53449546673725,
    -2.0008720582248625,
    -17.9589318631188,
    27.94888452941996,
    -2.8589982771350235,
    -8.87285693353063,
    12.360567175794303,
    0.6433927460157636,
]
_B = np.array(
    [
        0.054293734116568765,
        0.0,
        0.0,
        0.0,
        0.0,
        4.450312892752409,
        1.8915178993145003,
        -5.801203960010585,
        0.3111643669578199,
        -0.1521609496625161,
        0.20136540080403034,
        0.04471061572777259,
    ]
)
# Differences to the embedded formulas of order 5 and 3.
_E5 = np.array(
    [
        0.01312004499419488,
        0.0,
        0.0,
        0.0,
        0.0,
        -1.2251564463762044,
        -0.4957589496572502,
        1.6643771824549864,
        -0.35032884874997366,
        0.3341791187130175,
        0.08192320648511571,
        -0.022355307863886294,
    ]
)
_E3 = np.array(
    [
        -0.18980075407240762,
        0.0,
        0.0,
        0.0,
        0.0,
        4.450312892752409,
        1.8915178993145003,
        -5.801203960010585,
        -0.4226823213237919,
        -0.1521609496625161,
        0.20136540080403034,
        0.02265179219836082,
    ]
)


def _constants(rows: np.ndarray) -> tuple[tuple[float, ...], ...]:
    """As nested tuples, which the compiler folds into its instructions."""
    return tuple(tuple(float(value) for value in row) for row in np.atleast_2d(rows))


_ALL = np.vstack([_A, _B])  # the thirteenth row is the step itself
RATE = _constants(_ALL)
ANGLE = _constants(_ALL @ _A)
NODE = tuple(float(value) for value in _ALL.sum(axis=1))
RATE_ERROR = _constants(np.vstack([_E5, _E3]))
ANGLE_ERROR = _constants(np.vstack([_E5, _E3]) @ _A)


# Each stage takes a tile, a lane, the row k of a coordinate's first stage acceleration (its next
# ones lie three rows apart), the step length, and the coordinate's angle and rate at the start of
# the step. It returns its angle and rate at the stage; the last one is the end of the step.


@inlined
def _stage_1(tile, lane, k, h, angle, rate):
    a = RATE[1]
    k1 = get(tile, k + 0, lane)
    new_rate = a[0] * k1
    shift = 0.0 * k1
    return angle + h * (NODE[1] * rate + h * shift), rate + h * new_rate


@inlined
def _stage_2(tile, lane, k, h, angle, rate):
    a, b = RATE[2], ANGLE[2]
    k1 = get(tile, k + 0, lane)
    k2 = get(tile, k + 3, lane)
    new_rate = a[0] * k1 + a[1] * k2
    shift = b[0] * k1
    return angle + h * (NODE[2] * rate + h * shift), rate + h * new_rate


@inlined
def _stage_3(tile, lane, k, h, angle, rate):
    a, b = RATE[3], ANGLE[3]
    k1 = get(tile, k + 0, lane)
    k2 = get(tile, k + 3, lane)
    k3 = get(tile, k + 6, lane)
    new_rate = a[0] * k1 + a[2] * k3
    shift = b[0] * k1 + b[1] * k2
    return angle + h * (NODE[3] * rate + h * shift), rate + h * new_rate


@inlined
def _stage_4(tile, lane, k, h, angle, rate):
    a, b = RATE[4], ANGLE[4]
    k1 = get(tile, k + 0, lane)
    k2 = get(tile, k + 3, lane)
    k3 = get(tile, k + 6, lane)
    k4 = get(tile, k + 9, lane)
    new_rate = a[0] * k1 + a[2] * k3 + a[3] * k4
    shift = b[0] * k1 + b[1] * k2 + b[2] * k3
    return angle + h * (NODE[4] * rate + h * shift), rate + h * new_rate


@inlined
def _stage_5(tile, lane, k, h, angle, rate):
    a, b = RATE[5], ANGLE[5]
    k1 = get(tile, k + 0, lane)
    k3 = get(tile, k + 6, lane)
    k4 = get(tile, k + 9, lane)
    k5 = get(tile, k + 12, lane)
    new_rate = a[0] * k1 + a[3] * k4 + a[4] * k5
    shift = b[0] * k1 + b[2] * k3 + b[3] * k4
    return angle + h * (NODE[5] * rate + h * shift), rate + h * new_rate


@inlined
def _stage_6(tile, lane, k, h, angle, rate):
    a, b = RATE[6], ANGLE[6]
    k1 = get(tile, k + 0, lane)
    k3 = get(tile, k + 6, lane)
    k4 = get(tile, k + 9, lane)
    k5 = get(tile, k + 12, lane)
    k6 = get(tile, k + 15, lane)
    new_rate = a[0] * k1 + a[3] * k4 + a[4] * k5 + a[5] * k6
    shift = b[0] * k1 + b[2] * k3 + b[3] * k4 + b[4] * k5
    return angle + h * (NODE[6] * rate + h * shift), rate + h * new_rate


@inlined
def _stage_7(tile, lane, k, h, angle, rate):
    a, b = RATE[7], ANGLE[7]
    k1 = get(tile, k + 0, lane)
    k3 = get(tile, k + 6, lane)
    k4 = get(tile, k + 9, lane)
    k5 = get(tile, k + 12, lane)
    k6 = get(tile, k + 15, lane)
    k7 = get(tile, k + 18, lane)
    new_rate = a[0] * k1 + a[3] * k4 + a[4] * k5 + a[5] * k6 + a[6] * k7
    shift = b[0] * k1 + b[2] * k3 + b[3] * k4 + b[4] * k5 + b[5] * k6
    return angle + h * (NODE[7] * rate + h * shift), rate + h * new_rate


@inlined
def _stage_8(tile, lane, k, h, angle, rate):
    a, b = RATE[8], ANGLE[8]
    k1 = get(tile, k + 0, lane)
    k3 = get(tile, k + 6, lane)
    k4 = get(tile, k + 9, lane)
    k5 = get(tile, k + 12, lane)
    k6 = get(tile, k + 15, lane)
    k7 = get(tile, k + 18, lane)
    k8 = get(tile, k + 21, lane)
    new_rate = a[0] * k1 + a[3] * k4 + a[4] * k5 + a[5] * k6 + a[6] * k7 + a[7] * k8
    shift = b[0] * k1 + b[2] * k3 + b[3] * k4 + b[4] * k5 + b[5] * k6 + b[6] * k7
    return angle + h * (NODE[8] * rate + h * shift), rate + h * new_rate


@inlined
def _stage_9(tile, lane, k, h, angle, rate):
    a, b = RATE[9], ANGLE[9]
    k1 = get(tile, k + 0, lane)
    k3 = get(tile, k + 6, lane)
    k4 = get(tile, k + 9, lane)
    k5 = get(tile, k + 12, lane)
    k6 = get(tile, k + 15, lane)
    k7 = get(tile, k + 18, lane)
    k8 = get(tile, k + 21, lane)
    k9 = get(tile, k + 24, lane)
    new_rate = a[0] * k1 + a[3] * k4 + a[4] * k5 + a[5] * k6 + a[6] * k7 + a[7] * k8 + a[8] * k9
    shift = b[0] * k1 + b[2] * k3 + b[3] * k4 + b[4] * k5 + b[5] * k6 + b[6] * k7 + b[7] * k8
    return angle + h * (NODE[9] * rate + h * shift), rate + h * new_rate


@inlined
def _stage_10(tile, lane, k, h, angle, rate):
    a, b = RATE[10], ANGLE[10]
    k1 = get(tile, k + 0, lane)
    k3 = get(tile, k + 6, lane)
    k4 = get(tile, k + 9, lane)
    k5 = get(tile, k + 12, lane)
    k6 = get(tile, k + 15, lane)
    k7 = get(tile, k + 18, lane)
    k8 = get(tile, k + 21, lane)
    k9 = get(tile, k + 24, lane)
    k10 = get(tile, k + 27, lane)
    new_rate = (
        a[0] * k1
        + a[3] * k4
        + a[4] * k5
        + a[5] * k6
        + a[6] * k7
        + a[7] * k8
        + a[8] * k9
        + a[9] * k10
    )
    shift = (
        b[0] * k1
        + b[2] * k3
        + b[3] * k4
        + b[4] * k5
        + b[5] * k6
        + b[6] * k7
        + b[7] * k8
        + b[8] * k9
    )
    return angle + h * (NODE[10] * rate + h * shift), rate + h * new_rate


@inlined
def _stage_11(tile, lane, k, h, angle, rate):
    a, b = RATE[11], ANGLE[11]
    k1 = get(tile, k + 0, lane)
    k3 = get(tile, k + 6, lane)
    k4 = get(tile, k + 9, lane)
    k5 = get(tile, k + 12, lane)
    k6 = get(tile, k + 15, lane)
    k7 = get(tile, k + 18, lane)
    k8 = get(tile, k + 21, lane)
    k9 = get(tile, k + 24, lane)
    k10 = get(tile, k + 27, lane)
    k11 = get(tile, k + 30, lane)
    new_rate = (
        a[0] * k1
        + a[3] * k4
        + a[4] * k5
        + a[5] * k6
        + a[6] * k7
        + a[7] * k8
        + a[8] * k9
        + a[9] * k10
        + a[10] * k11
    )
    shift = (
        b[0] * k1
        + b[2] * k3
        + b[3] * k4
        + b[4] * k5
        + b[5] * k6
        + b[6] * k7
        + b[7] * k8
        + b[8] * k9
        + b[9] * k10
    )
    return angle + h * (NODE[11] * rate + h * shift), rate + h * new_rate


@inlined
def _stage_12(tile, lane, k, h, angle, rate):
    a, b = RATE[12], ANGLE[12]
    k1 = get(tile, k + 0, lane)
    k6 = get(tile, k + 15, lane)
    k7 = get(tile, k + 18, lane)
    k8 = get(tile, k + 21, lane)
    k9 = get(tile, k + 24, lane)
    k10 = get(tile, k + 27, lane)
    k11 = get(tile, k + 30, lane)
    k12 = get(tile, k + 33, lane)
    new_rate = (
        a[0] * k1
        + a[5] * k6
        + a[6] * k7
        + a[7] * k8
        + a[8] * k9
        + a[9] * k10
        + a[10] * k11
        + a[11] * k12
    )
    shift = b[0] * k1 + b[5] * k6 + b[6] * k7 + b[7] * k8 + b[8] * k9 + b[9] * k10 + b[10] * k11
    return angle + h * (NODE[12] * rate + h * shift), rate + h * new_rate


STAGE: tuple[Any, ...] = (
    None,
    _stage_1,
    _stage_2,
    _stage_3,
    _stage_4,
    _stage_5,
    _stage_6,
    _stage_7,
    _stage_8,
    _stage_9,
    _stage_10,
    _stage_11,
    _stage_12,
)


@inlined
def error(tile, lane, k, h, weight):
    """Squared error estimates of one coordinate, of order 5 and 3.

    Args:
        tile: The tile.
        lane: The walker's lane.
        k: Row of the coordinate's first stage acceleration.
        h: Step length, real.
        weight: Factor on the estimates before squaring: h over the error allowed.
    """
    a5, a3 = RATE_ERROR
    b5, b3 = ANGLE_ERROR
    k1 = get(tile, k + 0, lane).real
    k4 = get(tile, k + 9, lane).real
    k5 = get(tile, k + 12, lane).real
    k6 = get(tile, k + 15, lane).real
    k7 = get(tile, k + 18, lane).real
    k8 = get(tile, k + 21, lane).real
    k9 = get(tile, k + 24, lane).real
    k10 = get(tile, k + 27, lane).real
    k11 = get(tile, k + 30, lane).real
    k12 = get(tile, k + 33, lane).real
    rate5 = (
        a5[0] * k1
        + a5[5] * k6
        + a5[6] * k7
        + a5[7] * k8
        + a5[8] * k9
        + a5[9] * k10
        + a5[10] * k11
        + a5[11] * k12
    )
    rate3 = (
        a3[0] * k1
        + a3[5] * k6
        + a3[6] * k7
        + a3[7] * k8
        + a3[8] * k9
        + a3[9] * k10
        + a3[10] * k11
        + a3[11] * k12
    )
    angle5 = (
        b5[0] * k1
        + b5[3] * k4
        + b5[4] * k5
        + b5[5] * k6
        + b5[6] * k7
        + b5[7] * k8
        + b5[8] * k9
        + b5[9] * k10
        + b5[10] * k11
    )
    angle3 = (
        b3[0] * k1
        + b3[3] * k4
        + b3[4] * k5
        + b3[5] * k6
        + b3[6] * k7
        + b3[7] * k8
        + b3[8] * k9
        + b3[9] * k10
        + b3[10] * k11
    )
    rate5, rate3 = weight * rate5, weight * rate3
    angle5, angle3 = weight * h * angle5, weight * h * angle3
    return rate5 * rate5 + angle5 * angle5, rate3 * rate3 + angle3 * angle3
