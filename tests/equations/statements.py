"""The package's models of one walker, in the walker's own units.

The models are plain functions of dimensionless numbers; here they take the arguments of the
oracles.
"""

from __future__ import annotations

from types import ModuleType

import numpy as np
import sympy as sp

from gym_passive_walker import Outcome, Walker
from gym_passive_walker.models.equations import kneed, legs, simplest, straight
from gym_passive_walker.models.equations.hybrid import Control, Ground, State
from gym_passive_walker.models.equations.numbers import sine_cosine
from gym_passive_walker.models.equations.systems import SYSTEMS

sine_cosine.register(sp.Basic, lambda x: (sp.sin(x), sp.cos(x)))

KINDS = {name: system for name, system in SYSTEMS.items() if not name.startswith("own-")}
"""The package's own systems."""

PHASES = [(name, index) for name, system in KINDS.items() for index in range(len(system.phases))]
"""Every phase of every system."""


def ground(slope) -> Ground:
    """A slope in rad."""
    return Ground(np.sin(slope), np.cos(slope))


def dimensionless(walker: Walker, state) -> np.ndarray:
    """A state with its rates in units of sqrt(g/l)."""
    return walker.units.to_dimensionless(np.asarray(state, dtype=float))


def equations(walker: Walker, *, locked: bool) -> ModuleType:
    """The module with the equations of a walker's free or straight swing leg."""
    if walker.massless_legs:
        return simplest
    return straight if locked else kneed


def accelerations(walker: Walker, slope: float, state, torque: float, *, locked: bool):
    """Angular accelerations of the model at a state [angles, rates]."""
    units, s = walker.units, State(*dimensionless(walker, state))
    phase = walker.equations().phases[-1 if locked else 0]
    found = phase.accelerations(walker.body, s, Control(torque / units.torque), ground(slope))
    assert len(found) == phase.links
    return np.array(found)[[0, 1, -1]] * units.rate**2


def kinetic_energy(walker: Walker, state, *, locked: bool) -> float:
    """The kinetic energy in the model of a walker with massive legs."""
    energy = equations(walker, locked=locked).kinetic_energy
    return energy(walker.body, State(*dimensionless(walker, state))) * walker.units.energy


def foot_clearance(walker: Walker, angles, *, locked: bool) -> float:
    """Height of the swing foot over the ground in the model."""
    clearance = equations(walker, locked=locked).foot_clearance
    return clearance(walker.body, State(*angles, 0.0, 0.0, 0.0)) * walker.leg_length


def struck(walker: Walker, phase: int, outcome: Outcome, before: State):
    """State after an impact, and the energy lost, from a state in the walker's own units."""
    units, reset = walker.units, walker.equations().phases[phase].resets[outcome]
    after, loss, _ = reset.strike(walker.body, State(*dimensionless(walker, before)))
    return State(*units.to_own(np.array(after))), loss * units.energy


def kneestrike(walker: Walker, stance: float, swing: float, rates):
    """Angular velocities of the model after kneestrike, and the energy lost."""
    before = State(stance, swing, swing, *rates)
    after, loss = struck(walker, 0, Outcome.KNEESTRIKE, before)
    assert after[:3] == (stance, swing, swing)
    return np.array(after[3:]), loss


def heelstrike(walker: Walker, stance: float, rates):
    """Angular velocities of the model after heelstrike, legs exchanged, and the energy lost."""
    before = legs.straight(stance, -stance, rates[0], rates[1])
    after, loss = struck(walker, -1, Outcome.HEELSTRIKE, before)
    assert after[:3] == (-stance, stance, stance)
    return np.array(after[3:]), loss


def pushed(walker: Walker, state, impulse: complex, *, locked: bool) -> np.ndarray:
    """Angular velocities of the model after an impulse on the hip, forward plus i times up."""
    units, s = walker.units, State(*dimensionless(walker, state))
    part = impulse / (units.force * units.time)
    phase = walker.equations().phases[-1 if locked else 0]
    jumps = phase.push(walker.body, s, -part.real, part.imag)
    assert len(jumps) == phase.links
    return np.array(state[3:]) + np.array(jumps)[[0, 1, -1]] * units.rate
