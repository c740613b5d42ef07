"""A reward summed over the control steps of a stride, with exact derivatives.

The function of a `Transition` is traced as environments trace it. Its derivatives are traced too.
Both are evaluated for all control steps at once.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.loading import cause_of
from gym_passive_walker.engine.own.mechanics import evaluated
from gym_passive_walker.gaits.control.ticks import PiecewiseConstantStride
from gym_passive_walker.gaits.flow import Walkers, hip_places, report_of, states_in
from gym_passive_walker.gaits.map_result import product
from gym_passive_walker.gaits.scenes import rules
from gym_passive_walker.gaits.scenes.rewards import checked_rule, rule_of
from gym_passive_walker.gaits.scenes.scene import Scene, recorded_weight
from gym_passive_walker.gaits.scenes.transition import Transition
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.expressions import Expression, Tangents, read
from gym_passive_walker.models.math import where

_GROWING = ("time", "steps", "strides")
"""Fields that no stride repeats."""
_KNOWN = ("heelstrike", "knee_locked")
"""Fields that are 1 or 0, and do not change along tangents."""
_WORDS = {"abs": "abs()", "choose": "where(), minimum(), maximum() or a comparison"}
_STRUCK = int(Outcome.HEELSTRIKE)

_Place = tuple[Any, ...]
"""A number of a control step: the name of a field, and an index if there are several."""


def own_reward(step: Transition) -> Any:
    """Return the environment's own reward."""
    return step.reward


class StrideReward:
    """The sum of a reward over a stride's control steps, with derivatives.

    Args:
        scene: The scene.
        function: Function of a `Transition`, or weights of `TERMS`.

    Attributes:
        corner: Operation of the reward with a derivative that may jump; empty if there is none.
        digest: Hash of the traced reward.

    Raises:
        ValueError: if the function cannot be traced, or is not one of a periodic gait.
    """

    def __init__(self, scene: Scene, function: Callable[[Transition], Any] | Mapping) -> None:
        self.scene = scene
        self._system = scene.walker.equations()
        works = np.divide(self._system.works, recorded_weight(scene.walker))
        self._works = dict(zip(scene.channels, works.tolist(), strict=False))
        self._result = self._traced(rule_of(checked_rule("reward", function)))
        order = _ordered(self._result)
        reads = {x.args[0]: x for x in order if x.op == "read"}
        self._check(reads)
        one, self._by = self._result.number(1.0), {}
        for place, variable in reads.items():
            derivative = None if place[0] in _KNOWN else Tangents({variable: one})(self._result)
            if derivative is not None:
                self._by[place] = derivative
        self.corner = next((_WORDS[x.op] for x in order if _has_corner(x)), "")
        numbers = {x: i for i, x in enumerate(order)}
        text = [(x.op, [numbers.get(a, repr(a)) for a in _operands(x) or x.args]) for x in order]
        self.digest = hashlib.sha256(repr(text).encode()).hexdigest()

    def _traced(self, function: Callable[[Transition], Any]) -> Expression:
        """Return the expression of a reward, or refuse a function that has none."""
        step = self._step()
        try:
            found, again = (function(step) for _ in range(2))
            found, again = (step.distance.number(x) for x in (found, again))
        except Exception as error:  # a user's function may raise anything
            raise ValueError(
                "the reward has no derivatives, as it cannot be traced "
                f"({cause_of(error)}): use gpw.math, and its where() instead of if"
            ) from error
        if found is not again:
            raise ValueError(
                "the reward has no derivatives, as it gives another result each time: leave out "
                "what is random or counted"
            )
        return found

    def _check(self, reads: Mapping[_Place, Any]) -> None:
        """Refuse a reward of fields that no periodic gait has."""
        for name in _GROWING:
            if (name,) in reads:
                raise ValueError(
                    f"the reward reads step.{name}, which grows from stride to stride, and a "
                    "periodic gait repeats its control steps: leave it out"
                )
        if ("command",) in reads and isinstance(self.scene.command, tuple):
            low, high = self.scene.command
            raise ValueError(
                f"a periodic gait has one commanded speed, and this scene has those from {low:g} "
                f"to {high:g}: choose one by make_scene(scene, command=...)"
            )

    def _step(self) -> Transition:
        """Return a control step of expressions, on smooth ground without disturbances."""
        scene, State = self.scene, self._system.State
        known: dict[Any, Any] = {}
        zero = Expression(known, "constant", 0.0)

        def of(*place: Any) -> Expression:
            return read(known, place)

        def state(name: str) -> Any:
            return State(*(of(name, i) for i in range(len(State._fields))))  # type: ignore[attr-defined]

        net, absolute = (
            {name: of(kind, name) if name in scene.actions else zero for name in self._works}
            for kind in ("net", "absolute")
        )
        positive = {name: 0.5 * (absolute[name] + net[name]) for name in net}
        charged = {"absolute": absolute, "positive": positive, "net": net}[scene.energy]
        pushes = "push_off" in scene.actions and "actuation" in scene.walker.supports
        push_off_work = of("push_off_work") if pushes else zero
        energy = sum(charged.values(), zero) + push_off_work
        struck, distance = of("heelstrike") > 0.5, of("distance")
        length, period, command = of("step_length"), of("step_period"), zero
        reward = rules.reward(distance, energy, scene.energy_weight)
        if scene.command is not None:
            command = of("command")
            lost = rules.command_penalty(length, period, command, scene.command_weight)
            reward = reward - where(struck, lost, 0.0)
        first = [*self._works, "", ""][:2]
        hip, ankle = ((net.get(name, zero), absolute.get(name, zero)) for name in first)
        return Transition(
            before=state("before"), state=state("state"), knee_locked=of("knee_locked") > 0.5,
            distance=distance, duration=of("duration"), time=of("time"), energy=energy,
            hip_work=hip[0], hip_work_absolute=hip[1], ankle_work=ankle[0],
            ankle_work_absolute=ankle[1], push_off_work=push_off_work,
            collision_loss=of("collision_loss"), heelstrike=struck, step_length=length,
            step_period=period, fell=zero > 0.5, strides=of("strides"), steps=of("steps"),
            slope=zero.number(scene.slope), height_change=zero, slope_change=zero, push=zero,
            command=command, reward=reward,
            action=tuple(of("action", name) for name in scene.actions),
            last_action=tuple(of("last_action", name) for name in scene.actions),
        )  # fmt: skip

    def at(
        self, walked: PiecewiseConstantStride, torques: NDArray, held: NDArray, shares: NDArray
    ) -> tuple[float, NDArray[np.float64]]:
        """Return the sum of the rewards over a stride, and its derivatives.

        Args:
            walked: The stride. Where it takes more control steps than there are torques, the last
                one lasts until the heelstrike.
            torques: Torques of each motor, (motors, N).
            held: Sums of their driving and braking parts, (motors, N).
            shares: Values of each action, (actions, N).

        Returns:
            The sum; and its derivatives by the columns of `walked.by`, then those by `held` and
            those by `shares`, row by row.
        """
        fields = self._fields(walked, torques, held, shares)
        values: Any = {place: rows[:, 0] for place, rows in fields.items()}
        with np.errstate(all="ignore"):
            total = np.sum(evaluated(self._result, values) + 0.0 * values["duration",])
            by = sum(
                np.broadcast_to(evaluated(x, values), len(rows)) @ rows[:, 1:]
                for x, rows in ((x, fields[place]) for place, x in self._by.items())
            )
        return float(total), by + np.zeros(fields["duration",].shape[1] - 1)

    def _fields(
        self, walked: PiecewiseConstantStride, torques: NDArray, held: NDArray, shares: NDArray
    ) -> dict[_Place, NDArray[np.float64]]:
        """Return fields of the n control steps with tangents, (n, 1 + k), by their places."""
        steps, scene = walked.steps, self.scene
        (motors, ticks), report = torques.shape, report_of(self._system)
        count, each = min(len(steps.rows), ticks), np.arange(len(steps.rows))
        last = np.append(each[: count - 1], each[-1:])  # the record that ends a control step
        m, own, rows = walked.end.shape[-1], walked.by.shape[1], steps.rows[last]
        columns = 1 + own + held.size + shares.size

        def wide(rows: NDArray) -> NDArray:
            return np.pad(rows, [(0, 0), (0, columns - rows.shape[1])])

        def at_end(name: str) -> NDArray:
            return wide(rows[:, report.at[name]])

        def within(rows: NDArray) -> NDArray:
            """Sums over the control steps that are taken as one."""
            found = np.zeros((count, columns))
            np.add.at(found, np.minimum(each, count - 1), wide(rows))
            return found

        def one_each(first: int, values: NDArray) -> NDArray:
            """Values with a column each, from `first` on."""
            found = np.zeros((count, columns))
            found[:, 0] = values[:count]
            found[each[:count], 1 + first + each[:count]] = 1.0
            return found

        start = states_in(steps.before[0], self._system.coordinates)
        began = np.concatenate([start, steps.change[0].T]).T
        states = np.concatenate([began[None], rows[:, : report.size]])
        struck = (steps.outcomes[last] == _STRUCK)[:, None]
        bodies = Walkers(walker=scene.walker).constants
        places = hip_places(self._system, bodies, states.swapaxes(1, 2))
        there = np.where(struck, rows[:, report.at["passed"]], places[1:])
        locked = np.array([phase.knee_locked for phase in self._system.phases])
        # Of what a record sums up since the stride began, it has the tangents of its own step.
        time, lost = at_end("time"), steps.rows[:, report.at["knee_loss"]].copy()
        duration = time.copy()
        for total in (duration, lost):
            total[1:, 0] -= total[:-1, 0].copy()
        weight = recorded_weight(scene.walker)
        command = scene.command if isinstance(scene.command, float) else 0.0
        fields: dict[_Place, NDArray] = {
            ("distance",): wide(there - places[:-1]),
            ("duration",): duration,
            ("collision_loss",): (within(lost) + struck * at_end("heel_loss")) / weight,
            ("step_period",): struck * time,
            ("step_length",): struck * at_end("step_length"),
            ("push_off_work",): struck * at_end("push_work"),
            ("heelstrike",): wide(struck.astype(float)),
            ("knee_locked",): wide(locked[steps.after["phase"][last]].astype(float)),
            ("command",): wide(np.full((count, 1), command)),
        }
        for i in range(report.size):
            fields["before", i], fields["state", i] = wide(states[:-1, i]), wide(states[1:, i])
        for j, name in enumerate(scene.channels[:motors]):
            work = self._works[name]
            moved, turned = (within(steps.rows[:, report.at[x, j]]) for x in ("moved", "turned"))
            torque, both = one_each(m + j * ticks, torques[j]), one_each(own + j * ticks, held[j])
            fields["net", name] = work * product(torque, moved)
            fields["absolute", name] = abs(work) * product(both, turned)
        for j, name in enumerate(scene.actions):
            action = one_each(own + held.size + j * ticks, shares[j])
            fields["action", name], fields["last_action", name] = action, np.roll(action, 1, axis=0)
        return fields


def _operands(x: Expression) -> tuple[Expression, ...]:
    """Return the operands of an expression; of sine and cosine the angle."""
    given = x.args[:1] if x.op in ("sin", "cos") else x.args
    return tuple(a for a in given if isinstance(a, Expression))


def _ordered(x: Expression) -> list[Expression]:
    """Return an expression and all that it consists of, operands before operations."""
    found: dict[Expression, None] = {}

    def add(x: Expression) -> None:
        if x not in found:
            for each in _operands(x):
                add(each)
            found[x] = None

    add(x)
    return [*found]


def _has_corner(x: Expression) -> bool:
    """Return whether the derivative of an operation may jump along a stride's derivatives."""
    return x.op in _WORDS and any(
        each.op == "read" and each.args[0][0] not in _KNOWN for each in _ordered(x.args[0])
    )
