"""Native functions of one lane of a tile: load and unload a walker, examine and accept a step.

`beyond` extrapolates a step for a short time, along the polynomial through the accelerations of its
last stages.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from gym_passive_walker.engine.equations import Equations, places_of, sum_of
from gym_passive_walker.engine.native import Memory
from gym_passive_walker.engine.step import STRETCH
from gym_passive_walker.models.equations.hybrid import Guard, Phase, State, System
from gym_passive_walker.models.expressions import (
    Expression,
    choose,
    larger,
    polynomial,
    square_root,
)

LAST_STAGES = 5
"""Number of a step's last stages through which the extrapolating polynomial passes."""

LEAST, SHORT = 1e-6, 1e-3
"""Share of a step by which its end may always be moved, as the error is below rounding; and the
length as which a shorter step counts then: the last step to an event may be as short as rounding.
"""


class OneLane(Equations):
    """A phase's native functions of one lane."""

    @property
    def _onward(self) -> dict[int, list[float]]:
        return self.pair.onward(LAST_STAGES)

    def load_constants(self, tile: Memory, body: Memory) -> None:
        """Copy a walker's constants to a lane."""
        fields = self.system.Body._fields  # type: ignore[attr-defined]
        for i, name in enumerate(self.names):
            tile["body", i] = body["body", fields.index(name)]

    def load(self, tile: Memory, record: Memory) -> None:
        """Copy a walker from its record to a lane.

        The first argument is the length of the first step of a record without a proposed one.
        """
        state = record.entries("state")
        for i in range(self.system.coordinates):
            tile["angle", i], tile["rate", i] = state[i], state[len(state) // 2 + i]
        for field, there in (("ground", self.grounds), ("control", self.controls)):
            for i in there:
                tile[field, i] = record[field, i]
        for i in range(record.layout["control"].shape[0]):
            if i not in self.controls:
                tile["control", i] = 0.0  # read even if the control is absent
            tile["moved", i] = tile["turned", i] = 0.0
        tile["lost"] = 0.0
        step, rest = record["step"], record["end"] - record["time"]
        following = choose(step > 0.0, step, tile.argument(0))
        tile["time"], tile["end"], tile["next"] = record["time"], record["end"], following
        tile["h"] = choose(STRETCH * following < rest, following, rest)
        tile["event"], tile["steps"], tile["fresh"] = 0.0, 0.0, 1.0

    def move(self, tile: Memory, source: Memory) -> None:
        """Move a walker from one lane to another."""
        for name in tile.layout.fields or ():
            for index in np.ndindex(*tile.layout[name].shape[:-1]):
                tile[(name, *index)] = source[(name, *index)]

    def unload(self, tile: Memory, record: Memory) -> None:
        """Copy a walker from its lane to its record.

        The first argument is positive if the time limit was reached. Results are then extrapolated
        to the time limit, so that they have derivatives with respect to it.
        """
        up, state = tile.argument(0) > 0.0, self.state(tile)
        late = tile["end"] - tile["time"]
        bends = [tile["stage", 0, link] for link in self.links]
        moved = self.as_state(list(state[self.rates]), bends)
        for i, value, change in zip(places_of(self.system, record), state, moved, strict=True):
            record["state", i] = choose(up, value + late * change, value)
        for i in self.controls:
            rate = self.along(partial(self._moved, i), state, [None] * self.system.coordinates)[1]
            for name, change in (("moved", late * rate), ("turned", late * abs(rate))):
                whole = record[name, i] + tile[name, i]
                record[name, i] = choose(up, whole + change, whole)
        if self.dissipates:
            whole = record["friction_loss"] + tile["lost"]
            more = late * self.friction(tile, state)
            record["friction_loss"] = choose(up, whole + more, whole)
        record["time"] = choose(up, tile["end"], tile["time"])
        record["step"], record["steps"] = tile["next"], record["steps"] + tile["steps"]

    def accept(self, tile: Memory, history: Memory) -> None:
        """Accept a step: its end becomes the next start.

        The first argument is the event that ends the step, from 1 on, or 0. The end moves onto the
        event, by the time in the second argument and one more Newton step. The Newton step also
        gives the derivatives of the event's time. For a negative event the end does not move by
        Newton's method. The final state decides whether the event counts.
        """
        event, late = tile.argument(0), tile.argument(1)
        number, n = abs(event), self.system.coordinates
        start, (end, bends) = self.state(tile), self.beyond(tile, late)
        value, rate = event.number(0.0), event.number(1.0)
        for i in reversed(range(len(self.phase.guards))):
            g, v, _ = self.along(self.guard(i, tile), end, [None] * self.system.coordinates)
            value, rate = choose(number < i + 1.5, g, value), choose(number < i + 1.5, v, rate)
        rest = -value / rate
        # Newton's method fails where the guard's rate is small: limit the step to `late`.
        most = abs(late) + LEAST * larger(tile["h"], SHORT)
        rest = choose((event > 0.5) & (abs(rest) <= most), rest, 0.0)
        late = late + rest
        half = 0.5 * rest
        end = self.as_state(
            [end[k] + rest * (end[n + k] + half * bends[k]) for k in self.links],
            [end[n + k] + rest * bends[k] for k in self.links],
        )
        counted: Expression = event.number(1.0)
        for i, guard in reversed(list(enumerate(self.phase.guards))):
            counts = self._counts(guard, tile, end)
            counted = choose(number < i + 1.5, counts, counted)
        history["counted"] = counted
        for link in self.links:
            tile["angle", link], tile["rate", link] = end[link], end[n + link]
            tile["stage", 0, link] = bends[link]
        for k in self.controls:
            i = len(self.phase.guards) + k
            before, after = self._moved(k, start), self._moved(k, end)
            fraction = history["turning", k]
            middle = choose(fraction < 0.0, before, quintic_at(history, i, tile["h"], fraction))
            tile["moved", k] = tile["moved", k] + (after - before)
            tile["turned", k] = tile["turned", k] + (abs(middle - before) + abs(after - middle))
        if self.dissipates:
            middle, last = self.beyond(tile, 0.5 * late)[0], self.state(tile, "new_")
            weighted = ((1.0, last), (4.0, middle), (1.0, end))
            more = sum_of([weight * self.friction(tile, x) for weight, x in weighted])
            tile["lost"] = tile["lost"] + (tile["h"] * tile["power"] + late / 6.0 * more)
        tile["time"] = tile["time"] + (tile["h"] + late)
        tile["event"] = 0.0

    def beyond(self, tile: Memory, late: Expression) -> tuple[State, list[Expression]]:
        """Extrapolate the state and the accelerations by the time `late` from a step's end.

        The extrapolation follows the polynomial through the accelerations of the last stages.
        """
        x, angles, rates, bends = late / larger(tile["h"], 1e-300), [], [], []
        for link in self.links:
            powers = [
                sum_of([w[k] * tile["stage", j, link] for j, w in self._onward.items() if w[k]])
                for k in range(LAST_STAGES)
            ]
            rate = [1.0 / (k + 1.0) * power for k, power in enumerate(powers)]
            angle = [1.0 / ((k + 1.0) * (k + 2.0)) * power for k, power in enumerate(powers)]
            start = tile["new_rate", link]
            angles.append(tile["new_angle", link] + late * (start + late * polynomial(angle, x)))
            rates.append(start + late * polynomial(rate, x))
            bends.append(polynomial(powers, x))
        return self.as_state(angles, rates), bends

    def predict_strike(self, tile: Memory, history: Memory) -> None:
        """Predict the time of the phase's impact, from a step's end, and the error of `beyond`.

        The first argument is the tolerance.
        """
        if self.phase.strike is None:
            return
        guard = self.phase.guards[self.phase.strike]
        falls, end = self.guard(self.phase.strike, tile), self.state(tile, "new_")
        n = self.system.coordinates
        bends = self.bends(tile, self.pair.stages)
        value, rate, bend = self.along(falls, end, bends)
        square = rate * rate - 2.0 * value * bend
        late = 2.0 * value / (square_root(larger(square, 0.0)) - rate)  # root of a parabola
        # Error from the polynomial's last power; 1.5 allows for x in the distances to other nodes.
        x, scale, apart = late / larger(tile["h"], 1e-300), late.number(0.0), late.number(0.0)
        for link in self.links:
            power = sum_of([w[-1] * tile["stage", j, link] for j, w in self._onward.items()])
            apart = larger(abs(power), apart)
            for size in (end[link], end[n + link]):
                scale = larger(abs(size), scale)
        part = 0.75 * abs(np.prod([self.pair.nodes[j] - 1.0 for j in list(self._onward)[1:-1]]))
        error = float(part) * tile["h"] * (x * x) * apart
        there = self.as_state(
            [end[k] + late * (end[n + k] + 0.5 * late * bends[k]) for k in self.links],
            [end[n + k] + late * bends[k] for k in self.links],
        )
        falls = (rate < 0.0) & (square > 0.25 * (rate * rate))  # crosses, not only touches
        history["late"] = late
        history["comes"] = choose(falls, self._counts(guard, tile, there), 0.0)
        history["doubt"] = error / (tile.argument(0) * scale + 1e-290)

    def look(self, tile: Memory, history: Memory) -> None:
        """Evaluate guards, their conditions and the controls' coordinates at a step's two ends."""
        guards = len(self.phase.guards)
        functions: dict[int, Callable[[State], Expression]] = {
            **{i: self.guard(i, tile) for i in range(guards)},
            **{guards + i: partial(self._moved, i) for i in self.controls},
        }
        for i, guard in enumerate(self.phase.guards):
            functions |= dict(
                enumerate(self.wheres(guard, tile), first_where(self.system, self.phase, i))
            )
        for when, prefix, stage in (("before", "", 0), ("after", "new_", self.pair.stages)):
            state = self.state(tile, prefix)
            bends = self.bends(tile, stage)
            for i, function in functions.items():
                value, rate, bend = self.along(function, state, bends)
                history[when, i], history[f"rate_{when}", i] = value, rate
                history[f"bend_{when}", i] = bend

    def _counts(self, guard: Guard, tile: Memory, state: State) -> Expression:
        """Return whether a guard's crossing counts in a state: 1 or 0."""
        counts = tile["h"].number(1.0)
        for where in self.wheres(guard, tile):
            counts = choose(where(state) > 0.0, counts, 0.0)
        return counts


def first_where(system: System, phase: Phase, number: int) -> int:
    """The row of a `HISTORY` in which stands what a guard counts by, the first of it."""
    sooner = sum(len(guard.where) for guard in phase.guards[:number])
    return len(phase.guards) + len(system.Control._fields) + sooner  # type: ignore[attr-defined]


def quintic_at(history: Memory, i: int, h: Expression, x: Expression) -> Expression:
    """Evaluate the quintic of row i of a history at the fraction x of a step of length h."""
    g0, v0, a0 = (
        history["before", i],
        history["rate_before", i] * h,
        history["bend_before", i] * h * h,
    )
    v1, a1 = history["rate_after", i] * h, history["bend_after", i] * h * h
    rise, turn, bend = history["after", i] - g0 - v0 - 0.5 * a0, v1 - v0 - a0, a1 - a0
    cubic = 10.0 * rise - 4.0 * turn + 0.5 * bend
    high = -15.0 * rise + 7.0 * turn - bend + x * (6.0 * rise - 3.0 * turn + 0.5 * bend)
    return g0 + x * (v0 + x * (0.5 * a0 + x * (cubic + x * high)))
