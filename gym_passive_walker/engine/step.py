"""One phase of a system as native code: a step in every lane, its error, and what came of it.

Each sweep makes one Runge-Kutta step in every lane. What happens then is decided in two parts:
`judge` settles the ordinary case for all lanes at once (accept or reject, next step length); lanes
where something may have happened are looked at one by one in `landing`, by the numbers that `look`
gives of the phase's guards.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from gym_passive_walker.engine.expressions import (
    Expression,
    Tangents,
    choose,
    larger,
    square_root,
)
from gym_passive_walker.engine.layout import PAIR
from gym_passive_walker.engine.native import Memory
from gym_passive_walker.engine.runge_kutta import Pair
from gym_passive_walker.physics.hybrid import Control, Ground, Phase, State, System, Watch

PLAIN, ALERT, UP = 0.0, 1.0, 2.0
"""What `judge` makes of a lane's step: nothing of note; something may have happened; time is up."""

LONGEST_STEP = 1.0
"""A leg swings to and fro within six of these: longer steps, however exact, could jump over both a
heelstrike and the foot's return."""

MOST_STEPS = 20_000
"""Integration steps a walker may take in one phase; no gait needs a hundredth of them."""

SAFETY, FASTEST, SLOWEST = 0.85, 6.0, 0.2
"""The next step is this share of what the error allows, and changes by these factors at most."""

ROOTS = 10
"""Square roots of which other roots are made: an exponent is right to a thousandth."""


class Equations:
    """A phase's functions over a tile.

    Args:
        system: The system.
        phase: Its phase.
        body: The constants that the phase uses: names, in the order of the tile's rows.
        pair: The method that steps are made with.
    """

    def __init__(
        self, system: System, phase: Phase, body: tuple[str, ...], pair: Pair = PAIR
    ) -> None:
        self.system, self.phase, self.names, self.pair = system, phase, body, pair

    @property
    def links(self) -> range:
        """Indices of the angles that move by themselves."""
        return range(self.phase.links)

    def body(self, tile: Memory) -> Any:
        """The walker's constants; those that the phase does not use are NaN."""
        rows = {name: tile["body", i] for i, name in enumerate(self.names)}
        unused = dict.fromkeys(self.system.Body._fields, float("nan"))  # type: ignore[attr-defined]
        return without_absent(self.system, self.system.Body(**unused | rows))

    @property
    def controls(self) -> list[int]:
        """Indices of the controls that there may be."""
        names = enumerate(Control._fields)
        return [i for i, name in names if name not in self.system.absent]

    @property
    def grounds(self) -> list[int]:
        """Indices of the parts of the ground that there may be."""
        names = enumerate(Ground._fields)
        return [i for i, name in names if name not in self.system.absent]

    def ground(self, tile: Memory) -> Ground:
        """What the walker stands on."""
        found = {Ground._fields[i]: tile["ground", i] for i in self.grounds}
        return Ground(**dict.fromkeys(Ground._fields, 0.0) | found)

    def guard(self, index: int, tile: Memory) -> Callable[[State], Expression]:
        """The function of the state that ends the phase."""
        falls, body, ground = self.phase.guards[index].falls, self.body(tile), self.ground(tile)
        return lambda state: falls(body, state, ground)

    @property
    def dissipates(self) -> bool:
        """Whether there is friction."""
        return self.system.friction_power is not None

    def friction(self, tile: Memory, state: State) -> Expression:
        """What friction takes at a state."""
        assert self.system.friction_power is not None
        return self.system.friction_power(self.body(tile), state)

    def state(self, tile: Memory, prefix: str = "") -> State:
        """The state at a step's start, or with "new_" at its end."""
        return self.as_state(tile.entries(prefix + "angle"), tile.entries(prefix + "rate"))

    def as_state(self, angles: list, rates: list) -> State:
        """A state from the angles that move by themselves and their rates."""
        last = self.phase.links - 1
        return State(*(v[min(i, last)] for v in (angles, rates) for i in range(3)))

    def accelerations(self, tile: Memory, state: State) -> tuple[Expression, ...]:
        """Accelerations of the links."""
        held = {Control._fields[i]: tile["control", i] for i in self.controls}
        control = Control(**dict.fromkeys(Control._fields, 0.0) | held)
        return self.phase.accelerations(self.body(tile), state, control, self.ground(tile))

    def along(
        self, function: Callable[[State], Expression], state: State, bends: list[Any]
    ) -> tuple[Expression, Expression, Expression]:
        """A function of the state, its rate and its second derivative along the motion.

        Args:
            function: The function.
            state: Angles and rates.
            bends: Accelerations; None where the second derivative is of no interest.
        """
        flow = self.as_state(list(state[3:]), bends)
        moves = {x: change for x, change in zip(state, flow, strict=True) if change is not None}

        def derivative(of: Expression) -> Expression:
            change = Tangents(moves)(of)
            return of.number(0.0) if change is None else change

        value = function(state)
        rate = derivative(value)
        return value, rate, derivative(rate)

    # Codes of the native functions: of one lane, then of all.

    def equip(self, tile: Memory, body: Memory) -> None:
        """Give a lane its walker's constants."""
        fields = self.system.Body._fields  # type: ignore[attr-defined]
        for i, name in enumerate(self.names):
            tile["body", i] = body["body", fields.index(name)]

    def load(self, tile: Memory, record: Memory) -> None:
        """Put a walker into a lane; the length of the very first step is the first argument."""
        state = record.entries("state")
        for i in range(3):
            tile["angle", i], tile["rate", i] = state[i], state[3 + i]
        for field, there in (("ground", self.grounds), ("control", self.controls)):
            for i in there:
                tile[field, i] = record[field, i]
        for i in self.controls:
            tile["moved", i] = tile["turned", i] = 0.0
        tile["lost"] = 0.0
        step, rest = record["step"], record["end"] - record["time"]
        following = choose(step > 0.0, step, tile.argument(0))
        tile["time"], tile["end"], tile["next"] = record["time"], record["end"], following
        tile["h"] = choose(1.1 * following < rest, following, rest)
        tile["event"], tile["steps"], tile["fresh"] = 0.0, 0.0, 1.0

    def move(self, tile: Memory, source: Memory) -> None:
        """Move a walker from one lane to another."""
        for name in tile.layout.fields or ():
            for index in np.ndindex(*tile.layout[name].shape[:-1]):
                tile[(name, *index)] = source[(name, *index)]

    def unload(self, tile: Memory, record: Memory) -> None:
        """Take a walker out of its lane; the first argument says whether its time is up.

        What depends on the time's end reaches it sooner or later than the value does.
        """
        up, state = tile.argument(0) > 0.0, self.state(tile)
        late = tile["end"] - tile["time"]
        bends = [tile["stage", 0, link] for link in self.links]
        moved = self.as_state(list(state[3:]), bends)
        for i, (value, change) in enumerate(zip(state, moved, strict=True)):
            record["state", i] = choose(up, value + late * change, value)
        for i in self.controls:
            rate = self.along(partial(self._moved, i), state, [None] * 3)[1]
            for name, change in (("moved", late * rate), ("turned", late * abs(rate))):
                whole = record[name, i] + tile[name, i]
                record[name, i] = choose(up, whole + change, whole)
        if self.dissipates:
            whole = record["friction_loss"] + tile["lost"]
            more = late * self.friction(tile, state)
            record["friction_loss"] = choose(up, whole + more, whole)
        record["time"] = choose(up, tile["end"], tile["time"])
        record["step"], record["steps"] = tile["next"], record["steps"] + tile["steps"]

    def accept(self, tile: Memory, course: Memory) -> None:
        """Take a step's end as the next start.

        The first argument is the event that the step ends on, from 1 on, or 0: the end moves by a
        Newton step onto it, and wherever it depends on something, it moves along with that.
        """
        event = tile.argument(0)
        late = event.number(0.0)
        for i in reversed(range(len(self.phase.guards))):
            onto = -course["after", i] / course["rate_after", i]
            late = choose(event < i + 1.5, onto, late)
        late = choose(event < 0.5, 0.0, late)
        for link in self.links:
            rate, bend = tile["new_rate", link], tile["stage", self.pair.stages, link]
            tile["angle", link] = tile["new_angle", link] + late * (rate + 0.5 * late * bend)
            tile["rate", link] = rate + late * bend
            tile["stage", 0, link] = bend

        def further(i: int) -> Expression:
            bend = course["bend_after", i]
            return course["after", i] + late * (course["rate_after", i] + 0.5 * late * bend)

        for k in self.controls:
            i = len(self.phase.guards) + k
            before, after = course["before", i], further(i)
            fraction = course["turning", k]
            middle = choose(fraction < 0.0, before, quintic(course, i, tile["h"], fraction))
            tile["moved", k] = tile["moved", k] + (after - before)
            tile["turned", k] = tile["turned", k] + (abs(middle - before) + abs(after - middle))
        if self.dissipates:
            tile["lost"] = tile["lost"] + further(len(self.phase.guards) + len(Control._fields))
        tile["time"] = tile["time"] + (tile["h"] + late)
        tile["event"] = 0.0

    def first(self, tile: Memory) -> None:
        """The first stage of lanes that have just been filled; others have it from before."""
        fresh = tile["fresh"] > 0.0
        for i, value in enumerate(self.accelerations(tile, self.state(tile))):
            tile["stage", 0, i] = choose(fresh, value, tile["stage", 0, i])
        tile["fresh"] = 0.0

    def stage(self, index: int) -> Callable[[Memory], None]:
        """One stage of the step; after the last comes the step's end."""

        def code(tile: Memory) -> None:
            h, angles, rates = tile["h"], [], []
            for link in self.links:
                angle, rate = tile["angle", link], tile["rate", link]
                shift = self._weighted(tile, self.pair.angles[index], link)
                node = float(self.pair.nodes[index])
                angles.append(angle + h * (node * rate + h * shift))
                rates.append(rate + h * self._weighted(tile, self.pair.rates[index], link))
            state = self.as_state(angles, rates)
            if self.dissipates:
                self._dissipate(tile, state, index)
            for link, value in enumerate(self.accelerations(tile, state)):
                tile["stage", index, link] = value
                if index == self.pair.stages:
                    tile["new_angle", link], tile["new_rate", link] = angles[link], rates[link]

        return code

    def _dissipate(self, tile: Memory, state: State, index: int) -> None:
        """Add a stage's part to what friction takes on average, by the weights of the rates."""
        weights = self.pair.rates[-1]
        taken = tile["power"]
        if index == 1:
            taken = float(weights[0]) * self.friction(tile, self.state(tile))
        if index < self.pair.stages and weights[index] != 0.0:
            taken = taken + float(weights[index]) * self.friction(tile, state)
        tile["power"] = taken

    def _weighted(self, tile: Memory, weights: Any, link: int) -> Expression | float:
        """The weighted sum of the link's stage accelerations that have a part in it."""
        return sum_of(
            [float(w) * tile["stage", j, link] for j, w in enumerate(weights) if w != 0.0]
        )

    def estimate(self, tile: Memory) -> None:
        """Error of each lane's step over the tolerance, relative to the largest angle or rate.

        Relative to the motion as a whole, so that small motions are resolved as well as large ones.
        """
        h, tolerance = tile["h"], tile.argument(0)
        scale = None
        for field in ("angle", "rate", "new_angle", "new_rate"):
            for link in self.links:
                size = abs(tile[field, link])
                scale = size if scale is None else larger(scale, size)
        assert scale is not None
        # Scale before squaring: the squares of tiny errors must not vanish.
        weight = h / (tolerance * scale + 1e-290)
        squares = []
        for link in self.links:
            of_rate = weight * self._weighted(tile, self.pair.rate_error, link)
            of_angle = weight * h * self._weighted(tile, self.pair.angle_error, link)
            squares += [of_rate * of_rate + of_angle * of_angle]
        tile["error"] = square_root(sum_of(squares))

    def judge(self, tile: Memory) -> None:
        """Settle the ordinary case in every lane; mark where to look closely, or time is up."""
        h, error, event = tile["h"], tile["error"], tile["event"]
        factor = growth(error, self.pair)
        rest = tile["end"] - tile["time"]
        alert = (
            self._fallen(tile)
            | (abs(event) > 0.0)
            | ~(error <= 1e30)
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
        # A step that the time cut short says little of the next one.
        kept = alert | (up & (following <= proposed) & (error <= 0.1))
        tile["next"] = choose(kept, proposed, following)
        tile["h"] = choose(alert, h, choose(1.1 * following < rest, following, rest))
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

    def _fallen(self, tile: Memory) -> Expression:
        """Whether a guard may have fallen, or a control turned what it moves back."""
        none: list[None] = [None] * 3
        before, after = self.state(tile), self.state(tile, "new_")
        alert = None
        for number, guard in enumerate(self.phase.guards):
            falls = self.guard(number, tile)
            g0, v0, _ = self.along(falls, before, none)
            g1, v1, _ = self.along(falls, after, none)
            if guard.watch == Watch.STRIKE:
                found = (g0 > 0.0) & ((g1 <= 0.0) | ((v0 < 0.0) & (v1 > 0.0)))
                found |= (g0 <= 0.0) & (g1 <= 0.0) & (v0 > 0.0) & (v1 < 0.0)
            elif guard.watch == Watch.BOUND:
                reach = g1 - tile["h"] * larger(abs(v0), abs(v1))
                found = (g1 <= 0.0) | ((v0 * v1 < 0.0) & (reach <= 0.0))
            else:
                found = (g0 > 0.0) & (g1 <= 0.0) & (tile.argument(1) > 0.0)
            alert = found if alert is None else alert | found
        assert alert is not None
        first, last = (
            [tile["stage", stage, link] for link in range(3)] for stage in (0, self.pair.stages)
        )
        for i in self.controls:
            moved = partial(self._moved, i)
            _, v0, b0 = self.along(moved, before, first)
            _, v1, b1 = self.along(moved, after, last)
            # To turn back twice, it has to slow down first, and to speed up at last.
            waver = (v0 * b0 < 0.0) & (v1 * b1 > 0.0) & (abs(v0) < tile["h"] * abs(b0))
            alert |= ((v0 * v1 < 0.0) | waver) & (abs(tile["control", i]) > 0.0)
        return alert

    def _moved(self, control: int, state: State) -> Expression:
        """The coordinate that a control moves."""
        return self.system.travel(state)[control]

    def look(self, tile: Memory, course: Memory) -> None:
        """How guards, what controls move and what friction takes run over a lane's step."""
        body, ground = self.body(tile), self.ground(tile)
        guards = len(self.phase.guards)
        functions: dict[int, Callable[[State], Expression]] = {
            **{i: self.guard(i, tile) for i in range(guards)},
            **{guards + i: partial(self._moved, i) for i in self.controls},
        }
        for when, prefix, stage in (("before", "", 0), ("after", "new_", self.pair.stages)):
            state = self.state(tile, prefix)
            bends = [tile["stage", stage, link] for link in range(3)]
            for i, function in functions.items():
                value, rate, bend = self.along(function, state, bends)
                course[when, i], course[f"rate_{when}", i] = value, rate
                course[f"bend_{when}", i] = bend
            if self.dissipates:
                power, change, _ = self.along(partial(self.friction, tile), state, bends)
                last = guards + len(Control._fields)
                course[when, last] = tile["h"] * tile["power"] if when == "after" else 0.0
                course[f"rate_{when}", last], course[f"bend_{when}", last] = power, change
        end = self.state(tile, "new_")
        for i, guard in enumerate(self.phase.guards):
            counts = guard.when(body, end, ground) if guard.when else None
            course["counts", i] = 1.0 if counts is None else choose(counts, 1.0, 0.0)


def without_absent(system: System, body: Any) -> Any:
    """A walker's constants, zero where they are so for certain."""
    return body._replace(**{name: 0.0 for name in system.absent if name in body._fields})


def sum_of(terms: list[Expression]) -> Any:
    """The sum of some terms, in order; 0 of none."""
    if not terms:
        return 0.0
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


def growth(error: Expression, pair: Pair = PAIR) -> Expression:
    """Factor to the next step length, from the error of this one over its tolerance.

    The root of the error's order is a product of square roots: for 8, the third of them.
    """
    root, rest = error + 1e-30, 1.0 / pair.error_order
    factor = root.number(SAFETY)
    for _ in range(ROOTS):
        root, rest = square_root(root), 2.0 * rest
        if rest >= 1.0:
            factor, rest = factor / root, rest - 1.0
    factor = choose(factor < FASTEST, factor, FASTEST)
    return choose(factor > SLOWEST, factor, SLOWEST)


def quintic(course: Memory, i: int, h: Expression, x: Expression) -> Expression:
    """A guard at a fraction x of a step of length h, by its course at both ends."""
    g0, v0, a0 = course["before", i], course["rate_before", i] * h, course["bend_before", i] * h * h
    v1, a1 = course["rate_after", i] * h, course["bend_after", i] * h * h
    rise, turn, bend = course["after", i] - g0 - v0 - 0.5 * a0, v1 - v0 - a0, a1 - a0
    cubic = 10.0 * rise - 4.0 * turn + 0.5 * bend
    high = -15.0 * rise + 7.0 * turn - bend + x * (6.0 * rise - 3.0 * turn + 0.5 * bend)
    return g0 + x * (v0 + x * (0.5 * a0 + x * (cubic + x * high)))
