"""Sections 4.3.3, 4.3.4 and 4.4: what walking costs, and the simplest walker."""

from __future__ import annotations

import math
from dataclasses import asdict, replace

import numpy as np

from gym_passive_walker.gaits.bifurcation import bifurcation_diagram, crisis_slope
from gym_passive_walker.gaits.doubling import doubling_cascade
from gym_passive_walker.gaits.family import gait_family
from gym_passive_walker.gaits.fixed_point import find_gait, find_gaits
from gym_passive_walker.gaits.gait import Gait, GaitKind
from gym_passive_walker.gaits.measures import collision_matrix, measures
from gym_passive_walker.validation.rows import Row, claim, exponents, family, gait, number
from gym_passive_walker.walkers import WALKERS, Walker

_KINDS: tuple[GaitKind, GaitKind] = ("long", "short")


def sliding(walker: Walker | str, slope: float, kind: GaitKind) -> float:
    """Tangential over normal velocity of the landing foot."""
    velocity = measures(gait(walker, slope, kind)).foot_velocity
    return abs(float(velocity.tangential / velocity.normal))


def _examples() -> list[Gait]:
    slopes = (("A", 0.03), ("B", 0.01), ("C", 0.05), ("D", 0.009), ("E", 0.02), ("lab", 0.045))
    return [gait(name, slope, kind) for name, slope in slopes for kind in _KINDS]


def _loss_by_matrix(walks: Gait) -> float:
    velocity = np.array(measures(walks).foot_velocity)
    matrix = collision_matrix(walks.walker, float(walks.stride.state[0]))
    return float(0.5 * velocity @ matrix @ velocity)


def costs() -> list[Row]:
    """Sections 4.3.3 and 4.3.4."""
    examples = _examples()
    worst = max(abs(walks.cost_of_transport / math.sin(walks.slope) - 1.0) for walks in examples)
    loss = max(abs(_loss_by_matrix(walks) / walks.heelstrike_loss - 1.0) for walks in examples)
    lab = WALKERS["lab"]
    lengths = ("length", "offset", "gyration", "com", "radius")
    tall = replace(
        lab,
        **{
            name: 100.0 * value
            for name, value in asdict(lab).items()
            if name.rpartition("_")[2] in lengths
        },
    )
    tall = replace(tall, thigh_mass=0.1 * lab.thigh_mass, shank_mass=0.1 * lab.shank_mass)
    small, big = gait(lab, 0.036), gait(tall, 0.036)
    power = (big.collision_loss / big.step_period) / (small.collision_loss / small.step_period)
    examined = "Long and short gaits of A, B, C, D, E and lab."
    return [
        claim(
            "Eq. 4.4",
            "cost of transport along the path",
            "sin γ",
            f"within {max(worst, 1e-12):.0e} of it",
            worst < 1e-11,
            remark=examined,
        ),
        number(
            "Eq. 4.5",
            "sin γ and tan γ are the inefficiency γ: tan γ / sin γ at Table 4.2's 0.052",
            "1",
            1.0 / math.cos(0.052),
            within=2e-3,
        ),
        number(
            "4.3.3",
            "speed of a walker 100 times taller with a tenth of the mass",
            "10",
            big.speed / small.speed,
            within=1e-10,
            digits=12,
        ),
        number("4.3.3", "its power", "1", power, within=1e-10, digits=12),
        number(
            "Eq. 4.6",
            "its v/√(g l), over the small one's",
            "1",
            big.froude_speed / small.froude_speed,
            within=1e-10,
            digits=12,
        ),
        claim(
            "Eq. 4.7",
            "energy lost at heelstrike is ½ vᵀM v, M symmetric and positive semidefinite",
            "equal",
            f"within {max(loss, 1e-12):.0e}",
            loss < 1e-9,
            remark=examined,
        ),
    ]


def simplest_walker() -> list[Row]:
    """Section 4.4, but for chaos."""
    where = "4.4"
    counts = {len(find_gaits("D", slope)) for slope in np.geomspace(1e-8, 0.1, 12)}
    short, long = family("D", 1e-8, 0.3, "short"), family("D", 1e-8, 0.3)
    least = np.abs(short.multipliers[:, 0]).min()
    matrix = collision_matrix("D", 0.0)
    unit = WALKERS["D"].time_unit
    rows = [
        claim(
            where,
            "gaits at each of 12 slopes from 1e-8 to 0.1",
            "2",
            ", ".join(str(count) for count in sorted(counts)),
            counts == {2},
        ),
        number(
            where,
            "slope below which the long step is stable",
            "0.015",
            long.period_doublings[0],
            known="0.0150884379",
            digits=11,
        ),
        claim(
            where,
            "the short step is unstable at all slopes: least of its largest multipliers",
            "above 1",
            f"{least:.4f}",
            bool(least > 1.0),
        ),
        claim(
            where,
            "long step: foot's tangential over normal velocity at 0.001, 1e-5, 1e-7",
            "tends to 0",
            ", ".join(f"{sliding('D', slope, 'long'):.1e}" for slope in (1e-3, 1e-5, 1e-7)),
            sliding("D", 1e-7, "long") < 1e-4,
        ),
        claim(
            where,
            "short step: the same",
            "not 0",
            ", ".join(f"{sliding('D', slope, 'short'):.3g}" for slope in (1e-3, 1e-5, 1e-7)),
            sliding("D", 1e-7, "short") > 1.0,
        ),
        claim(
            where,
            "M(0), tangential first, in units of the hip's mass",
            "singular: only normal velocity costs",
            f"diag({abs(matrix[0, 0]):g}, {matrix[1, 1]:g})",
            bool(abs(matrix[0, 0]) < 1e-15 and abs(matrix[1, 1] - 1.0) < 1e-15),
        ),
        claim(
            where,
            "step periods over √(l/g) at 1e-8, long and short step",
            "different constants, not 0",
            ", ".join(f"{gait('D', 1e-8, k).step_period / unit:.5f}" for k in _KINDS),
            gait("D", 1e-8).step_period > 1.1 * gait("D", 1e-8, "short").step_period > unit,
        ),
    ]
    for kind in _KINDS:
        angle, speed = exponents("D", 1e-7, kind)
        of = f"{kind} step: power of"
        rows += [
            number(where, f"{of} γ of the stance angle", "1/3", angle, within=1e-3),
            number(where, f"{of} γ of the speed", "1/3", speed, within=1e-3),
            number(
                "Eq. 4.8",
                f"{of} v of the power",
                "4",
                1.0 + 1.0 / speed,
                within=0.01,
                remark="The power is m g v γ, so its exponent is 1 and 1 over the speed's.",
            ),
        ]
    return rows


def chaos() -> list[Row]:
    """Section 4.4: the period-doubling route, and the gait of period three."""
    where = "4.4"
    cascade = doubling_cascade("D", 0.012, 0.02, doublings=6)
    crisis = crisis_slope("D", 0.0185, 0.02, strides=1000, accuracy=1e-6)
    three = gait_family("D", 0.012, 0.0135, start=find_gait("D", 0.0125, period=3))
    beyond = bifurcation_diagram("D", [0.0195, 0.02])
    return [
        number(
            where,
            "period doubling begins at slope",
            "0.015",
            cascade.slopes[0],
            known="0.0150884379",
            digits=11,
        ),
        number(
            where,
            "chaotic walking ends at slope",
            "0.019",
            crisis,
            digits=5,
            remark="Where one of 64 walkers falls within 1000 strides.",
        ),
        claim(
            where,
            "slopes at which gaits of period 1, 2, 4, … double",
            "0.015 to 0.019",
            ", ".join(f"{slope:.9f}" for slope in cascade.slopes),
            0.0145 < cascade.slopes[0] and cascade.limit < 0.0195,
            remark=f"They accumulate at {cascade.limit:.8f}.",
        ),
        number(
            "Feigenbaum 1978",
            "last ratio of their distances",
            "4.66920",
            cascade.ratios[-1],
            within=0.005,
            remark="The ratios are " + ", ".join(f"{ratio:.4f}" for ratio in cascade.ratios) + ".",
        ),
        claim(
            where,
            "walks left at slopes 0.0195 and 0.02",
            "0",
            str(int(beyond.walks.sum())),
            not beyond.walks.any(),
        ),
        claim(
            "Howell, Baillieul 1998",
            "a stable gait of period three near slope 0.0125, which doubles to period six",
            "near 0.0125",
            f"{three.folds[0]:.9f} to {three.period_doublings[-1]:.9f}",
            three.folds[0] < 0.0125 < three.period_doublings[-1] < 0.013,
            remark="Born in a fold at the first slope, doubled at the second.",
        ),
    ]
