"""An independent derivation of a stated system: SymPy's Lagrange, and impacts in more coordinates.

Nothing here uses the package's differentiation. Equations of motion are d/dt dT/dv - dT/dq = Q by
SymPy. An impact is solved with the position of the stance foot free, by the impulse of the contact
as a Lagrange multiplier. SciPy integrates.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import sympy
from scipy.integrate import solve_ivp

from gym_passive_walker.models.equations.numbers import sine_cosine


@sine_cosine.register(sympy.Basic)
def _(x):
    return sympy.sin(x), sympy.cos(x)


# NumPy asks objects for their own methods.
sympy.Expr.exp, sympy.Expr.tanh = (lambda x: sympy.exp(x)), (lambda x: sympy.tanh(x))


class Independent:
    """A system's motion and impacts.

    Args:
        system: A `gpw.System` with functions of a module `math` that has SymPy's sine and cosine.
    """

    def __init__(self, system, slope):
        self.system, self.count = system, system.coordinates
        q = sympy.symbols(f"q:{self.count}")
        v = sympy.symbols(f"v:{self.count}")
        x0, y0 = sympy.symbols("x0 y0")
        state, body = system.State(*q, *v), system.body
        links = [(m, x0 + x, y0 + y, i, a) for m, x, y, i, a in system.links(body, state)]
        extended = [*q, x0, y0]
        ways = []
        weights = []
        for mass, x, y, inertia, angle in links:
            for weight, place in ((mass, x), (mass, y), (inertia, angle)):
                if weight:
                    ways.append([sympy.diff(place, each) for each in extended])
                    weights.append(weight)
        rates = [sum(a * b for a, b in zip(way, v, strict=False)) for way in ways]
        kinetic = sum(w * rate**2 for w, rate in zip(weights, rates, strict=True)) / 2
        potential: Any = sum(
            m * (math.cos(slope) * y - math.sin(slope) * x) for m, x, y, _, _ in links
        )
        potential = sympy.sympify(potential).subs({x0: 0, y0: 0})
        if system.potential:
            potential = potential + system.potential(body, state)
        self.springs = system.potential(body, state) if system.potential else sympy.Integer(0)
        momenta = [sympy.diff(kinetic, each) for each in v]
        forces = [sympy.diff(kinetic - potential, each) for each in q]
        if system.dissipation:
            friction = [sympy.diff(system.dissipation(body, state), each) for each in v]
            forces = [a - b for a, b in zip(forces, friction, strict=True)]
        if system.forces:
            feedback = system.forces(body, state)
            forces = [a + b for a, b in zip(forces, feedback, strict=True)]
        mass = sympy.Matrix(self.count, self.count, lambda i, j: sympy.diff(momenta[i], v[j]))
        drift = [sum(sympy.diff(p, a) * b for a, b in zip(q, v, strict=True)) for p in momenta]
        rest = sympy.Matrix([a - b for a, b in zip(forces, drift, strict=True)])
        args = [*q, *v]
        made = lambda x: sympy.lambdify(args, x, "numpy", cse=True)  # noqa: E731
        self._mass, self._rest = made(mass), made(rest)
        self._energy = made([kinetic, potential])
        foot = [x0 + system.landing(body, state)[0], y0 + system.landing(body, state)[1]]
        self._ways, self.weights = made(sympy.Matrix(ways)), np.array(weights, dtype=float)
        contact = sympy.Matrix([[sympy.diff(place, each) for each in extended] for place in foot])
        self._contact = made(contact)
        new = system.relabel(body, state)
        self._new = made(list(new))
        self._by = made(sympy.Matrix([[sympy.diff(each, x) for x in q] for each in new]))
        self._foot = made([place.subs({x0: 0, y0: 0}) for place in foot])
        self._counts = [made(function(body, state)) for function in system.counts]
        moved = [sympy.sympify(each) for each in system.travel(state)]
        torques = [[sympy.diff(each, x) for each in moved] for x in q]
        self._torques = made(sympy.Matrix(self.count, len(moved), lambda i, j: torques[i][j]))

    def accelerations(self, state, control=()):
        """Solve the equations of motion under torques."""
        forces = np.ravel(self._rest(*state)).astype(float)
        if len(control):
            forces = forces + np.array(self._torques(*state), dtype=float) @ control
        return np.linalg.solve(self._mass(*state), forces)

    def energies(self, state):
        """Kinetic and potential energy, springs included."""
        return np.array(self._energy(*state), dtype=float)

    def _struck(self, state):
        """Mass matrix and rates before a heelstrike; rates after it, and the contact's impulse."""
        ways, contact = self._ways(*state), np.array(self._contact(*state), dtype=float)
        mass = ways.T @ (self.weights[:, None] * ways)
        before = np.concatenate([state[self.count :], [0.0, 0.0]])
        size = self.count + 2
        whole = np.block([[mass, contact.T], [contact, np.zeros((2, 2))]])
        found = np.linalg.solve(whole, np.concatenate([mass @ before, [0.0, 0.0]]))
        return mass, before, found[:size], -found[size:]

    def impulse(self, state):
        """Impulse of the contact at a heelstrike, along the ground and up from it."""
        return self._struck(state)[3]

    def strike(self, state):
        """The state after a heelstrike, and the energy lost."""
        mass, before, after, _ = self._struck(state)
        lost = 0.5 * (before @ mass @ before - after @ mass @ after)
        rates = np.array(self._by(*state), dtype=float) @ after[: self.count]
        return np.concatenate([np.array(self._new(*state), dtype=float), rates]), lost

    def stride(self, state, control=(), duration=20.0):
        """The state after the next heelstrike, and when it comes; or at a time before it."""

        def foot(_, y):
            return self._foot(*y)[1] if all(f(*y) > 0.0 for f in self._counts) else 1.0

        foot.terminal, foot.direction = True, -1.0
        walk = solve_ivp(
            lambda _, y: np.concatenate([y[self.count :], self.accelerations(y, control)]),
            (0.0, duration), np.array(state, dtype=float), method="DOP853", rtol=1e-12, atol=1e-13,
            events=foot, max_step=0.02,
        )  # fmt: skip
        if not len(walk.t_events[0]):
            return walk.y[:, -1], duration
        return self.strike(walk.y_events[0][0])[0], walk.t_events[0][0]
