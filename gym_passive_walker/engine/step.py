"""Integration steps of one phase as native code over all lanes, with error and step-size control.

Each sweep takes one Runge-Kutta step in every lane. `classify` then handles the ordinary case for
all lanes at once: it accepts or rejects the step and sets the next step length. Lanes with a
possible event are processed one by one in `event_location`, with the guards that
`one_lane.OneLane.look` evaluates.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial, reduce
from itertools import pairwise
from operator import and_, or_

from gym_passive_walker.engine.equations import Equations, sum_of, weighted
from gym_passive_walker.engine.native import Memory
from gym_passive_walker.engine.sines import near_turn
from gym_passive_walker.models.equations.hybrid import Guard, State, Watch
from gym_passive_walker.models.equations.numbers import sine_cosine
from gym_passive_walker.models.expressions import (
    Expression,
    choose,
    inverse_root,
    larger,
    polynomial,
    rounding,
)

PLAIN, ALERT, UP = 0.0, 1.0, 2.0
"""Verdicts of `classify` on a lane's step: ordinary; a possible event; time limit reached."""

NEAR = 0.05
"""Share of a step before or beyond its end within which the end may be moved onto an impact."""

STRETCH = 1.1
"""Factor by which a step may be lengthened to end on an impact or at the time limit."""

LONGEST_STEP = 1.0
"""Largest step, in sqrt(l/g). A leg swings to and fro in six of these; longer steps could miss both
a heelstrike and the foot's return."""

MOST_STEPS = 20_000
"""Largest number of integration steps in one phase; no gait needs a hundredth of them."""

SAFETY, FASTEST, SLOWEST = 0.75, 3.0, 0.2
"""Safety factor of the next step length, and the largest and smallest factor of its change."""

MUCH = 1.07
"""Growth factor from which a shortened step does not determine the next step length."""

WILD = 1e24
"""Error, over the allowed one, above which the end of a step is meaningless."""

MOST_TURN = 0.1
"""Rotation of a link in a step, in rad, up to which sines and cosines are accurate to about the
last bit; for larger rotations the step's error limits them."""

CLOSEST = 0.05
"""Smallest distance of two stages, over the step's length, in the bound on their rotation."""

OFF_CIRCLE = 30.0
"""Weight, in a step's error, of the distance of sines and cosines from the unit circle beyond
rounding."""


class StepCode(Equations):
    """Native functions of a phase over all lanes."""

    def first(self, tile: Memory) -> None:
        """Evaluate the first stage of newly filled lanes; others have it from the last step."""
        fresh = tile["fresh"] > 0.0
        for i, value in enumerate(self.accelerations(tile, self.state(tile))):
            tile["stage", 0, i] = choose(fresh, value, tile["stage", 0, i])
        tile["fresh"] = 0.0

    def sweep(self) -> list[Callable[[Memory], None]]:
        """Return the codes of one step in every lane, in order."""
        last = self.pair.stages
        stages = [partial(self.stage, index) for index in range(1, last)]
        rest: list[Callable[[Memory], None]] = [self.estimate, partial(self.stage, last)]
        if any(self.pair.error[last:]):  # the estimate needs the accelerations at the end
            rest.reverse()
        return [*stages, self.end, *rest, self.classify]

    def stage(self, index: int, tile: Memory) -> None:
        """Evaluate the accelerations in one stage of the step, or at its end for the last index."""
        state = self._at(index, tile)
        if self.dissipates:
            self._dissipate(tile, state, index)
        for link, value in enumerate(self.accelerations(tile, state)):
            tile["stage", index, link] = value

    def end(self, tile: Memory) -> None:
        """Write the state at the step's end."""
        for link in self.links:
            turn, rate = self._moved_by(self.pair.stages, tile, link)
            tile["new_angle", link], tile["new_rate", link] = tile["angle", link] + turn, rate

    def _moved_by(self, index: int, tile: Memory, link: int) -> tuple[Expression, Expression]:
        """Return the change of a link's angle up to a stage, and its angular velocity there."""
        h, rate, stages = tile["h"], tile["rate", link], range(self.pair.stages)
        weights = self.pair.weights[index]
        rates = [rate, *(tile["stage_rate", j - 1, link] for j in stages[1:])]
        accelerations = [tile["stage", j, link] for j in stages]
        return h * weighted(weights, rates), rate + h * weighted(weights, accelerations)

    def _at(self, index: int, tile: Memory) -> State:
        """Return the state in a stage; sines and cosines are added from an earlier stage."""
        nodes, beside = self.pair.nodes.astype(float), self.pair.neighbours()
        other = beside[index - 1]
        places = self.pair.places()
        mine, its, first = places[index], places[other], places[0]
        apart = max(abs(nodes[index] - nodes[other]), CLOSEST)
        most, angles, rates = MOST_TURN * apart, [], []
        for link in self.links:
            angle = tile["angle", link]
            if index == self.pair.stages:
                turn, rate = tile["new_angle", link] - angle, tile["new_rate", link]
                moved = tile["new_angle", link]
            else:
                turn, rate = self._moved_by(index, tile, link)
                moved = angle + turn
                tile["stage_rate", index - 1, link] = rate
            if index == 1:
                known = sine_cosine(angle)
                tile["sine", first, link], tile["cosine", first, link] = known
            else:
                known = tile["sine", its, link], tile["cosine", its, link]
            moved = near_turn(
                moved, *known, turn - tile["turn", its, link] if other else turn, most
            )
            tile["turn", mine, link] = turn  # stored, so that all uses are rounded alike
            if index in beside:
                tile["sine", mine, link], tile["cosine", mine, link] = sine_cosine(moved)
            angles.append(moved)
            rates.append(rate)
        return self.as_state(angles, rates)

    def _dissipate(self, tile: Memory, state: State, index: int) -> None:
        """Add a stage's part to the mean power of friction, with the weights of the method."""
        weights = self.pair.weights[-1]
        taken = tile["power"]
        if index == 1:
            taken = float(weights[0]) * self.friction(tile, self.state(tile))
        if index < self.pair.stages and weights[index] != 0.0:
            taken = taken + float(weights[index]) * self.friction(tile, state)
        tile["power"] = taken

    def estimate(self, tile: Memory) -> None:
        """Write the error of each lane's step, over the tolerance.

        The estimate is of lower order than the step. The error is relative to the largest angle or
        angular velocity, so that small motions are resolved as well as large ones.
        """
        scale = None
        for field in ("new_angle", "new_rate"):
            for link in self.links:
                size = abs(tile[field, link])
                scale = size if scale is None else larger(scale, size)
        assert scale is not None
        weight = tile["h"] / (scale + 1e-290)
        part = self.pair.error
        errors = [
            abs(weight * weighted(part, [tile["stage", j, link] for j in range(len(part))]))
            for link in self.links
        ]
        # Truncated series of sines and cosines leave the unit circle.
        near_end = self.pair.places()[self.pair.neighbours()[-1]]
        for link in self.links:
            sine, cosine = tile["sine", near_end, link], tile["cosine", near_end, link]
            off = abs(sine * sine + (cosine * cosine - 1.0)) - rounding(sine)
            errors.append(OFF_CIRCLE * larger(weight.number(0.0), off))
        # NaN if an angular velocity is not finite: the estimate does not include the last stage.
        rates = [tile["new_rate", link] for link in self.links]
        errors += [rate - rate for rate in rates]
        tile["error"] = tile.argument(0) * sum_of(errors)

    def classify(self, tile: Memory) -> None:
        """Accept or reject ordinary steps; mark possible events and reached time limits."""
        h, error, event = tile["h"], tile["error"], tile["event"]
        factor = step_growth(error, self.pair.error_order + 1)
        rest = tile["end"] - tile["time"]
        alert = (
            self._fallen(tile)
            | (abs(event) > 0.0)
            | ~(error <= WILD)
            | (h < 1e-12)
            | (tile["steps"] >= MOST_STEPS)
        )
        plain = (error <= 1.0) & ~alert
        up = plain & (h >= rest)
        following, proposed = h * factor, tile["next"]
        following = choose(following < LONGEST_STEP, following, LONGEST_STEP)
        rest = choose(plain, rest - h, rest)
        tile["verdict"] = choose(up, UP, choose(alert, ALERT, PLAIN))
        tile["steps"], tile["growth"] = tile["steps"] + 1.0, factor
        # A step shortened by the time limit does not determine the next step length.
        kept = alert | (up & (following <= proposed) & (factor >= MUCH))
        tile["next"] = choose(kept, proposed, following)
        late = error.number(0.0) if self.phase.strike is None else self._strike_after(tile)
        aims = plain & (late > 0.0) & (late <= STRETCH * following) & (late <= rest)
        usual = choose(STRETCH * following < rest, following, rest)
        tile["h"], tile["ahead"] = choose(alert, h, choose(aims, late, usual)), late
        tile["time"] = tile["time"] + choose(plain, h, 0.0)
        before, after = self.state(tile), self.state(tile, "new_")
        for i in self.controls:
            start, end = self._moved(i, before), self._moved(i, after)
            tile["moved", i] = tile["moved", i] + choose(plain, end - start, 0.0)
            tile["turned", i] = tile["turned", i] + choose(plain, abs(end - start), 0.0)
        if self.dissipates:
            tile["lost"] = tile["lost"] + choose(plain, h * tile["power"], 0.0)
        for link in self.links:
            for old, new in (("angle", "new_angle"), ("rate", "new_rate")):
                tile[old, link] = choose(plain, tile[new, link], tile[old, link])
            end = tile["stage", self.pair.stages, link]
            tile["stage", 0, link] = choose(plain, end, tile["stage", 0, link])

    def _strike_after(self, tile: Memory) -> Expression:
        """Predict the time of the impact after a step's end; 0 if it is not near.

        The quintic through both ends of the step is extrapolated. Newton's method begins on the
        chord over one more step length, and keeps its first slope.
        """
        i, h, powers = self.phase.strike, tile["h"], self._path_of_strike(tile)
        assert i is not None
        g1, slopes = powers[0], [k * power for k, power in enumerate(powers)][1:]
        x = g1 / (g1 - polynomial(powers, g1.number(1.0)))
        slope = polynomial(slopes, x)
        per_slope = 1.0 / slope
        for _ in range(2):
            change = polynomial(powers, x) * per_slope
            x = x - change
        late = h * x
        bends = [0.5 * late * tile["stage", self.pair.stages, link] for link in self.links]
        rates = [tile["new_rate", link] for link in self.links]
        angles = [tile["new_angle", k] + late * (rates[k] + bends[k]) for k in self.links]
        there = self.as_state(angles, rates)
        comes = (g1 > 0.0) & (slope < 0.0) & (abs(change) < 0.1 * x)
        for where in self.wheres(self.phase.guards[i], tile):
            comes &= where(there) > 0.0
        return choose(comes, late, 0.0)

    def _path_of_strike(self, tile: Memory) -> list[Expression]:
        """Return the quintic of the impact's guard through both ends of a step.

        The coefficients are of ascending powers of the time since the step's end, over its length.
        """
        assert self.phase.strike is not None
        (g0, v0, b0), (g1, v1, b1) = self._ends(self.phase.strike, tile)
        rise, turn, bend = g1 - g0 - v1 + 0.5 * b1, v1 - v0 - b1, b1 - b0
        return [
            g1,
            v1,
            0.5 * b1,
            10.0 * rise + 4.0 * turn + 0.5 * bend,
            15.0 * rise + 7.0 * turn + bend,
            6.0 * rise + 3.0 * turn + 0.5 * bend,
        ]

    def _ends(self, number: int, tile: Memory) -> list[tuple[Expression, ...]]:
        """Return a guard at both ends of a step, with derivatives by its share of the step."""
        h, falls, ends = tile["h"], self.guard(number, tile), []
        for prefix, stage in (("", 0), ("new_", self.pair.stages)):
            g, v, b = self.along(falls, self.state(tile, prefix), self.bends(tile, stage))
            ends.append((g, h * v, h * h * b))
        return ends

    def _bounds(self, number: int, tile: Memory) -> list[Expression]:
        """Return Bernstein coefficients of a guard's quintic in a step, from its start to its end.

        The quintic has at most as many zeros as they have changes of sign.
        """
        (g0, v0, b0), (g1, v1, b1) = self._ends(number, tile)
        v0, v1, b0, b1 = 0.2 * v0, 0.2 * v1, 0.05 * b0, 0.05 * b1
        return [g0, g0 + v0, g0 + 2.0 * v0 + b0, g1 - 2.0 * v1 + b1, g1 - v1, g1]

    def _may_count(self, guard: Guard, tile: Memory) -> Expression:
        """Return whether a guard's crossing would count at the step's start, middle or end."""
        before, after = self.state(tile), self.state(tile, "new_")
        if guard.bends:  # or where each holds somewhere, which costs more
            third, every = tile["h"] / 3.0, []
            for where in self.wheres(guard, tile):
                g0, v0, _ = self.along(where, before, [None] * self.system.coordinates)
                g1, v1, _ = self.along(where, after, [None] * self.system.coordinates)
                bounds = [g0, g0 + third * v0, g1 - third * v1, g1]
                every.append(reduce(or_, [bound > 0.0 for bound in bounds]))
            return reduce(and_, every)
        start, middle, end = [], [], []
        for where in self.wheres(guard, tile):
            g0, v0, _ = self.along(where, before, [None] * self.system.coordinates)
            g1, v1, _ = self.along(where, after, [None] * self.system.coordinates)
            start.append(g0 > 0.0)
            middle.append(0.5 * (g0 + g1) + 0.125 * tile["h"] * (v0 - v1) > 0.0)
            end.append(g1 > 0.0)
        first, second, third = (reduce(and_, each) for each in (start, middle, end))
        return first | second | third

    def _fallen(self, tile: Memory) -> Expression:
        """Whether a guard may have fallen, or a control turned what it moves back."""
        none: list[None] = [None] * self.system.coordinates
        before, after = self.state(tile), self.state(tile, "new_")
        first, last = (self.bends(tile, stage) for stage in (0, self.pair.stages))
        alert = None
        for number, guard in enumerate(self.phase.guards):
            falls = self.guard(number, tile)
            g0, v0, _ = self.along(falls, before, none)
            g1, v1, _ = self.along(falls, after, none)
            path = self._bounds(number, tile) if guard.bends else [g0, g1]
            drops = reduce(or_, [(here > 0.0) & (then <= 0.0) for here, then in pairwise(path)])
            if guard.watch == Watch.STRIKE:
                drop = tile["h"] * v1
                down = drops | ((g0 > 0.0) & (drop < 0.0) & (g1 + NEAR * drop <= 0.0))
                if guard.where:  # excludes feet that pass each other at midstance
                    down &= self._may_count(guard, tile) | (v0 > 0.0)
                found = down | ((g0 > 0.0) & (v0 < 0.0) & (v1 > 0.0))
                found |= (g0 <= 0.0) & (g1 <= 0.0) & (v0 > 0.0) & (v1 < 0.0)
            elif guard.watch == Watch.BOUND:
                sway = tile["h"] * larger(abs(v0), abs(v1))
                found = g1 <= choose(v0 * v1 < 0.0, sway, 0.0)
                found = found | drops if guard.bends else found
            else:
                found = drops & (tile.argument(1) > 0.0)
            alert = found if alert is None else alert | found
        assert alert is not None
        for i in self.controls:
            moved = partial(self._moved, i)
            _, v0, b0 = self.along(moved, before, first)
            _, v1, b1 = self.along(moved, after, last)
            # A coordinate that reverses twice slows down first, and speeds up at the end.
            waver = (v0 * b0 < 0.0) & (v1 * b1 > 0.0) & (abs(v0) < tile["h"] * abs(b0))
            alert |= ((v0 * v1 < 0.0) | waver) & (abs(tile["control", i]) > 0.0)
        return alert


def step_growth(error: Expression, order: int) -> Expression:
    """Return the factor to the next step length, from a step's error over the tolerance."""
    factor = SAFETY * inverse_root(error, order)
    factor = choose(factor < FASTEST, factor, FASTEST)
    return choose(factor > SLOWEST, factor, SLOWEST)
