"""What a stride took and gave: gravity's work, kinetic energy, and the way made."""

from __future__ import annotations

import numpy as np

from gym_passive_walker.physics import compass, kneed, simplest
from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics import record as R
from gym_passive_walker.physics.lanes import inlined, kernel, sine_cosine


@inlined
def gravity_work(kind, c, start, end, sin_slope, cos_slope):
    """Work of gravity / (m g l) between two configurations over the same contact."""
    if kind == 0:  # Kind.KNEED
        gain = kneed.potential_gain(
            c, start[0], start[1], start[2], end[0], end[1], end[2], sin_slope, cos_slope
        )
    elif kind == 1:  # Kind.COMPASS
        gain = compass.potential_gain(c, start[0], start[1], end[0], end[1], sin_slope, cos_slope)
    else:
        gain = simplest.potential_gain(start[0], end[0], sin_slope, cos_slope)
    return -gain


@inlined
def kinetic_energy(kind, c, state):
    """Kinetic energy / (m g l) of a state (angles, rates)."""
    if kind == 0:  # Kind.KNEED
        return kneed.kinetic_energy(c, state[0], state[1], state[2], state[3], state[4], state[5])
    if kind == 1:  # Kind.COMPASS
        return compass.kinetic_energy(c, state[0], state[1], state[3], state[4])
    return simplest.kinetic_energy(state[3])


@inlined
def advance_of_contact(c, start, end):
    """Step length / l between two heelstrikes, by the stance angles just after them."""
    sine, _ = sine_cosine(end)
    return 2.0 * c[K.LEG] * sine + c[K.FOOT_RADIUS] * (start + end)


@kernel
def ledgers(kind, constants, starts, records, gravity, length):
    """Gravity's work and step length of each record since its start."""
    for i in range(len(records)):
        c = constants[i if len(constants) > 1 else 0]
        record = records[i]
        end = record[R.ANGLES : R.ANGLES + 3].copy()
        length[i] = np.nan
        if record[R.OUTCOME].real == 1.0:  # Outcome.HEELSTRIKE: before the legs changed roles
            length[i] = advance_of_contact(c, starts[i, 0], end[0])
            end[:] = -end
        gravity[i] = gravity_work(kind, c, starts[i], end, record[R.SIN_SLOPE], record[R.COS_SLOPE])


@kernel
def kinetic_energies(kind, constants, states, energy):
    """Kinetic energy of each state."""
    for i in range(len(states)):
        energy[i] = kinetic_energy(kind, constants[i if len(constants) > 1 else 0], states[i])
