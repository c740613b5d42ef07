"""A three-link biped under virtual constraints: an impact that an angle defines.

    python -m examples.virtual_constraints

Motors between torso and legs hold the torso at an angle, and let the swing leg mirror the stance
leg. The foot would scuff the ground all the time, so the impact is where the stance leg reaches an
angle. With fast control only the angular momentum about the stance foot is left of the motion,
which gravity alone changes: the hybrid zero dynamics, here given as equations of one coordinate.
Half the square of that momentum stands for the kinetic energy.

References:
    J. W. Grizzle, G. Abba, F. Plestan, "Asymptotically stable walking for biped robots: analysis
    via systems with impulse effects", IEEE Trans. Automatic Control 46 (2001) 51-64.
"""

from __future__ import annotations

import math
import sys
from typing import NamedTuple

import gym_passive_walker as gpw
from gym_passive_walker import console
from gym_passive_walker.math import cos, sin
from gym_passive_walker.modeling import (
    Free,
    Guard,
    HybridSystem,
    Outcome,
    Phase,
    Reset,
    Stage,
    Strike,
    Watch,
)


class Biped(NamedTuple):
    """Parameters; the total mass and the length of a leg are 1.

    Attributes:
        leg: Mass of a leg, at its middle.
        hip: Mass of the hip.
        torso: Mass of the torso.
        height: Distance of the torso's mass from the hip.
        lean: Angle in rad at which the torso is held, forward.
        impact: Angle in rad of the stance leg, forward, at which the swing foot strikes.
    """

    leg: float = 5.0 / 35.0
    hip: float = 15.0 / 35.0
    torso: float = 10.0 / 35.0
    height: float = 0.5
    lean: float = math.pi / 6.0
    impact: float = math.pi / 8.0


class Stance(NamedTuple):
    """The angle of the stance leg in rad, forward, and its rate."""

    stance: float
    stance_rate: float


def inertia(body, angle):
    """Angular momentum about the stance foot per rate of the stance leg."""
    heavy = body.leg + body.hip + body.torso
    return heavy + body.torso * body.height * cos(angle - body.lean)


def moments(body, ground):
    """Moment of gravity about the stance foot: factors of the sine and the cosine, and the rest."""
    by_sine = (body.hip + 2.0 * body.leg + body.torso) * ground.cosine
    by_cosine = (body.hip + body.leg + body.torso) * ground.sine
    tilted = sin(body.lean) * ground.cosine + cos(body.lean) * ground.sine
    return by_sine, by_cosine, body.torso * body.height * tilted


def accelerations(body, state, control, ground):
    """Momentum changes by the moment of gravity."""
    by_sine, by_cosine, rest = moments(body, ground)
    moment = by_sine * sin(state.stance) + by_cosine * cos(state.stance) + rest
    turning = body.torso * body.height * sin(state.stance - body.lean) * state.stance_rate**2
    return ((moment + turning) / inertia(body, state.stance),)


def work(body, angle, ground):
    """Integral over the angle of the moment of gravity times `inertia`."""
    by_sine, by_cosine, rest = moments(body, ground)
    heavy, bent = body.leg + body.hip + body.torso, body.torso * body.height
    straight = -by_sine * cos(angle) + by_cosine * sin(angle) + rest * angle
    twice = 2.0 * angle - body.lean
    turned = by_sine * (0.5 * angle * sin(body.lean) - 0.25 * cos(twice))
    turned = turned + by_cosine * (0.5 * angle * cos(body.lean) + 0.25 * sin(twice))
    return heavy * straight + bent * (turned + rest * sin(angle - body.lean))


def strike(body, state, push_off, ground):
    """Keep the angular momentum about the new foot, which the motors cannot change."""
    apart = 2.0 * state.stance
    heavy = body.leg + body.hip + body.torso
    kept = heavy * cos(apart) + body.torso * body.height * cos(body.lean - state.stance)
    before = inertia(body, state.stance) * state.stance_rate
    after = kept * state.stance_rate
    rate = after / inertia(body, -state.stance)
    new = Stance(-state.stance, rate)
    return Strike(new, 0.5 * (before**2 - after**2))  # type: ignore[arg-type]


EQUATIONS = HybridSystem(
    name="virtual constraints",
    Body=Biped,
    phases=(
        Phase(
            Stage.LOCKED,
            1,
            accelerations,
            guards=(
                Guard(lambda b, s, g: b.impact - s.stance, Outcome.HEELSTRIKE, Watch.STRIKE),
                Guard(lambda b, s, g: s.stance + b.impact + 0.01, Outcome.FELL_BACKWARD),
            ),
            resets={Outcome.HEELSTRIKE: Reset(strike)},
        ),
    ),
    place=lambda b, s: sin(s.stance),
    kinetic_energy=lambda b, s: 0.5 * (inertia(b, s.stance) * s.stance_rate) ** 2,
    potential_gain=lambda b, start, end, ground: (
        work(b, start.stance, ground) - work(b, end.stance, ground)
    ),
    foot_clearance=lambda b, s: 0.0 * s.stance,  # the swing leg mirrors the stance leg
    mass_matrix=lambda b, s: (inertia(b, s.stance) ** 2,),
    travel=lambda s: Free(),  # type: ignore[arg-type, return-value]
    works=Free(),  # type: ignore[arg-type]
    State=Stance,
    Control=Free,
)

BIPED = gpw.System.of(
    EQUATIONS,
    Biped(),
    centre=lambda b, s: (sin(s.stance), cos(s.stance)),
    start=(-math.pi / 8.0, 0.5),
)


def before_impact(gait: gpw.Gait) -> float:
    """Return the angular velocity of the stance leg just before an impact, in sqrt(g/l)."""
    point, period = gait.point.values[0], float(gait.step_period)
    return float(gait.stride_map.before_strike(point, gait.slope, period)[1])


def main() -> None:
    """Print the gait on level ground, with legs of 1 m and g = 9.8 m/s^2."""
    gait, unit = gpw.find_gait(BIPED, 0.0), math.sqrt(9.8)
    print(f"angular velocity before an impact {before_impact(gait) * unit:.8f} rad/s")
    print(f"angular velocity after it         {gait.state[1] * unit:.8f} rad/s")
    print(f"multiplier                        {gait.multipliers[0].real:.8f}")


if __name__ == "__main__":
    sys.exit(console.run(main))
