"""A compass walker that holds its torso upright: gaits that leave a limit cycle for a torus.

    python -m examples.driven_torso

A torque between the torso and the stance leg holds the torso at an angle, by a spring and a damper
of its own. With little damping a complex pair of Floquet multipliers crosses the unit circle, a
Neimark-Sacker bifurcation: strides settle on a closed curve around the gait instead of on the gait.

References:
    H. Gritli and others, Nonlinear Dynamics, doi 10.1007/s11071-015-2458-6: such a bifurcation of
    a torso-driven compass walker.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import NamedTuple

import numpy as np

import gym_passive_walker as gpw
from examples.torso import TORSO
from gym_passive_walker import console

SLOPE = 0.03


class Body(NamedTuple):
    """Masses, and how the torso is held; legs have the length 1 and their mass in the middle."""

    hip: float = 0.7
    leg: float = 0.1
    torso: float = 0.1
    height: float = 0.3
    stiffness: float = 2.0
    damping: float = 0.02
    target: float = 0.0


def forces(body, state):
    """The torque on the torso, and its reaction on the stance leg."""
    torque = -body.stiffness * (state.torso - body.target) - body.damping * state.torso_rate
    return -torque, 0.0, torque


DRIVEN_TORSO = replace(
    TORSO, name="driven torso", body=Body(), potential=None, dissipation=None, forces=forces
)


def width(damping: float, strides: int = 4000) -> float:
    """Range of stance angles over many strides, after as many have settled near the gait."""
    walker = DRIVEN_TORSO.vary(damping=damping)
    stride_map = gpw.stride_map(walker, SLOPE)
    points = stride_map.points_at(gpw.find_gait(stride_map).state) + 1e-4
    points = stride_map.apply(points, strides=strides).ends
    angles = []
    for _ in range(300):
        points = stride_map.apply(points).ends
        angles.append(points[0, 0])
    return float(np.ptp(angles))


def main() -> None:
    """Print the branch of gaits, and how wide the closed curve is beyond the bifurcation."""
    branch = gpw.parameter_family(DRIVEN_TORSO, "damping", 2e-4, 2.0, slope=SLOPE)
    print(branch)
    (at,) = branch.neimark_sackers
    for damping in (0.0012, 0.0011, 0.001, 0.0009):
        print(f"damping {damping:.4f}: stance angles within {width(damping):.4f} rad")
    print(f"a torus is born at {at:.6f}")


if __name__ == "__main__":
    sys.exit(console.run(main))
