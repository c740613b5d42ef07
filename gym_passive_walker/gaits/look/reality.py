"""Feasibility of a walk: forces and motions that the model does not limit (Garcia, 4.3.2).

The stride map holds the stance foot on the ground and the stance knee straight at any force. It
lets the swing foot pass through the ground, and the new swing knee bend either way. This module
measures by how much a walk needs each of these assumptions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import (
    check_state,
    check_tolerance,
    number,
    one_slope,
    whole,
)
from gym_passive_walker._tools.shown import Table
from gym_passive_walker.gaits.actuation import one_actuation
from gym_passive_walker.gaits.find.fixed_point import state_on
from gym_passive_walker.gaits.given import GaitLike, walk_of
from gym_passive_walker.gaits.look.dense_stride import (
    DensePhase,
    Impulse,
    TimedExtremum,
    clearance_of,
    dense_phases,
    greatest,
    heelstrike_impulses,
    kneestrike_impulses,
    least,
    ratio_turns,
    turns,
)
from gym_passive_walker.gaits.map_result import NoStride
from gym_passive_walker.gaits.measures import InUnits, in_words
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.model import check_supports
from gym_passive_walker.models.walkers import Walker, describe, name_of

_SWING_KNEE, _DEPTH = "swing knee's least torque", "  its depth below the ground"
"""Readings without a limit."""

_TOUCHING = 1e-6
"""Height in leg lengths up to which a foot is on the ground at the start of a stride."""

_OF_KNEES = "knee lock", "hyperextension"
"""Items of walkers with knees."""


class Reading(NamedTuple):
    """One line of a reality check.

    Attributes:
        item: Item of Garcia (1999), section 4.3.2, that the quantity belongs to.
        quantity: Name of the measured quantity.
        extreme: Worst value in the walker's units, and its time; NaN if it does not exist.
        unit: Unit that makes the value dimensionless, in the walker's units.
        unit_name: Name of `unit`.
    """

    item: str
    quantity: str
    extreme: TimedExtremum
    unit: float
    unit_name: str


@dataclass(frozen=True, repr=False)
class RealityCheck(InUnits, Table):
    """Forces on ground and knees and clearances of a walk, in the walker's own units.

    Print it for a table. Times count from the walk's start. Each value is the worst over all
    strides. NaN marks quantities that do not exist, such as a straight leg's knee torque.

    Attributes:
        walker: The walker.
        slope: Slope in rad.
        strides: Number of strides checked.
        duration: Time taken by the strides.
        friction: Coefficient of friction between foot and ground.
        clearance: Least height of the swing foot over the ground in mid-swing: at its lowest point
            after it rose behind. Negative when it scuffs; 0 at heelstrike if there is no such
            point. The foot is a whole circle here.
        stance_knee_torque: Least torque on the stance knee's stop between impacts. Positive
            presses the knee against its stop; negative would flex it.
        stance_knee_at_kneestrike: Least impulse on the stance knee's stop at kneestrike; negative
            would flex the knee.
        stance_knee_at_heelstrike: Least impulse on the new stance knee's stop at heelstrike;
            negative would flex the knee.
        swing_knee_torque: Least torque on the swing knee's stop from kneestrike to heelstrike.
            Negative requires suction, as in the machine of Garcia (1999).
        least_normal_force: Least normal force of the ground on the stance foot; negative where the
            ground would have to pull.
        greatest_normal_force: Greatest normal force of the ground on the stance foot.
        stance_friction: Greatest coefficient of friction needed between impacts.
        kneestrike_impulse: Impulse of the ground on the stance foot at kneestrike.
        heelstrike_impulse: Impulse of the ground on the new stance foot at heelstrike.
        stance_knee_at_push_off: Least impulse of a push-off on the old stance knee's stop.
        push_off_impulse: Impulse of the ground on the old stance foot at a push-off.
        knee_flexion: Least flexion in rad of the new swing knee from heelstrike to kneestrike;
            negative when it hyperextends.
        release_velocity: Velocity of the old stance foot away from the ground just after
            heelstrike, where a stride starts; negative into the ground.
        release_depth: Least clearance of the old stance foot after its release: 0 or negative.
    """

    walker: Walker
    slope: float
    strides: int
    duration: float
    friction: float
    clearance: TimedExtremum
    stance_knee_torque: TimedExtremum
    stance_knee_at_kneestrike: TimedExtremum
    stance_knee_at_heelstrike: TimedExtremum
    swing_knee_torque: TimedExtremum
    least_normal_force: TimedExtremum
    greatest_normal_force: TimedExtremum
    stance_friction: TimedExtremum
    kneestrike_impulse: Impulse
    heelstrike_impulse: Impulse
    stance_knee_at_push_off: TimedExtremum
    push_off_impulse: Impulse
    knee_flexion: TimedExtremum
    release_velocity: TimedExtremum
    release_depth: TimedExtremum

    @property
    def passed(self) -> dict[str, bool]:
        """Whether each item of section 4.3.2 holds; suction at the swing knee is assumed."""
        passed: dict[str, bool] = {}
        for item, quantity, (value, _), *_ in self.readings:
            margin = self.friction - value if item == "friction" else value
            fails = margin < 0.0 and quantity not in (_SWING_KNEE, _DEPTH)  # NaN passes
            passed[item] = passed.get(item, True) and not fails
        return passed

    @property
    def holds(self) -> bool:
        """Whether every item holds."""
        return all(self.passed.values())

    @property
    def readings(self) -> list[Reading]:
        """All measured quantities, item by item."""
        length, time, torque, _ = units = self.walker.units
        weight = units.force if "units" in self.walker.supports else self.walker.weight
        knee, heel = self.kneestrike_impulse, self.heelstrike_impulse
        push = self.push_off_impulse
        knee_normal, heel_normal = (TimedExtremum(x.normal_impulse, x.time) for x in (knee, heel))

        def pushed(what: str, extreme: TimedExtremum, unit: float, name: str) -> list[Any]:
            there = not np.isnan([push.normal_impulse, extreme.value]).all()
            return [(what, extreme, unit * time, name)] if there else []

        table: dict[str, list[tuple[str, TimedExtremum, float, str]]] = {
            "scuffing": [("swing foot's least clearance", self.clearance, length, "l")],
            "knee lock": [
                ("stance knee's least torque", self.stance_knee_torque, torque, "m g l"),
                ("  impulse at kneestrike", self.stance_knee_at_kneestrike, torque * time, "m l v"),
                ("  impulse at heelstrike", self.stance_knee_at_heelstrike, torque * time, "m l v"),
                *pushed("  impulse at push-off", self.stance_knee_at_push_off, torque, "m l v"),
                (_SWING_KNEE, self.swing_knee_torque, torque, "m g l"),
            ],
            "contact": [
                ("least normal force", self.least_normal_force, weight, "m g"),
                ("greatest normal force", self.greatest_normal_force, weight, "m g"),
                ("normal impulse at kneestrike", knee_normal, weight * time, "m v"),
                ("normal impulse at heelstrike", heel_normal, weight * time, "m v"),
            ],
            "friction": [
                ("needed between collisions", self.stance_friction, 1.0, ""),
                ("needed at kneestrike", knee.needed_friction, 1.0, ""),
                ("needed at heelstrike", heel.needed_friction, 1.0, ""),
                *pushed("needed at push-off", push.needed_friction, 1.0 / time, ""),
            ],
            "hyperextension": [("swing knee's least flexion", self.knee_flexion, 1.0, "rad")],
            "release": [
                ("old stance foot's velocity", self.release_velocity, length / time, "v"),
                (_DEPTH, self.release_depth, length, "l"),
            ],
        }
        found = [Reading(item, *row) for item, rows in table.items() for row in rows]
        if self.walker.equations().ground_force is None:
            return found
        found = [each for each in found if each.item not in _OF_KNEES]  # its equations hold knees
        return [each for each in found if not np.isnan(each.extreme.value)]

    def __str__(self) -> str:
        plural = "s" if self.strides > 1 else ""
        lines = [
            f"{self.strides} stride{plural} of {describe(self.walker)} "
            f"at slope {self.slope:.6g} rad, taking {in_words(self, 'duration')}",
            f"{'':50}{'value':>12}{'at time':>11}{'scaled':>12}",
        ]
        said = ""
        for item, what, (value, when), unit, name in self.readings:
            verdict = "ok" if self.passed[item] else "FAILS"
            head = "" if item == said else f"{item:15}{verdict:6}"
            numbers = f"{value:>12.4g}{when:>11.4g}{value / unit:>12.4g} {name}"
            numbers = f"{'-':>12}" if np.isnan(value) else numbers.rstrip()
            lines.append(f"{head:21}{what:29}{numbers}")
            said = item
        lines.append("value and time in the walker's own units; m, l: mass and leg length;")
        lines.append(f"v = sqrt(g l); friction up to {self.friction:g}")
        return "\n".join(lines)

    def facts(self) -> dict[str, str]:
        """Walker, slope, strides, and whether each item holds."""
        return {
            "walker": name_of(self.walker),
            "slope": f"{self.slope:.6g} rad",
            "strides": str(self.strides),
            **{item: "ok" if holds else "fails" for item, holds in self.passed.items()},
        }

    def columns(self) -> dict[str, NDArray]:
        """One row for each reading."""
        items, quantities, extremes, units, names = zip(*self.readings, strict=True)
        values, times = np.array(extremes).T
        return {
            "item": np.array(items),
            "passed": np.array([self.passed[item] for item in items]),
            "quantity": np.array([quantity.strip() for quantity in quantities]),
            "value": values,
            "time": times,
            "scaled": values / units,
            "unit": np.array(names),
        }


def _release_and_passing(
    heights: list[TimedExtremum], rising: bool
) -> tuple[TimedExtremum, TimedExtremum]:
    """Return the swing foot's lowest clearance after its release, and its lowest in mid-swing.

    Args:
        heights: Local extrema of the swing foot's clearance over a stride, in order of time.
        rising: Whether the foot leaves the ground upwards.
    """
    heights = [h for i, h in enumerate(heights) if i == 0 or h.time > heights[i - 1].time]
    values = [height.value for height in heights]
    inner = range(1, len(values) - 1)
    peak = next((i for i in inner if values[i - 1] < values[i] >= values[i + 1]), 0)
    release = heights[0]._replace(value=0.0) if rising else least(heights[: peak + 1])
    dips = [i for i in inner if values[i - 1] > values[i] <= values[i + 1]]
    passing = least(heights[i] for i in dips if i > peak)
    if np.isnan(passing.value):  # one dip for both, or none at all
        passing = heights[-1]._replace(value=0.0) if rising else release
    return release, passing


def reality_check(
    walker: GaitLike,
    slope: float | None = None,
    state: ArrayLike | None = None,
    *,
    strides: int | None = None,
    friction: float = 0.8,
    hip_torque: float | None = None,
    tolerance: float = 1e-13,
) -> RealityCheck:
    """Measure the forces and clearances of a walk that the model does not limit.

    Args:
        walker: The walker, in a form that `as_walker` takes; or a stride map or a `Gait`, which
            supplies slope, state and actuation where they are not given. Knees of a system are
            not checked.
        slope: Slope in rad, positive downhill.
        state: State on the Poincaré section, just after heelstrike, shape (6,), or (2 m,) of a
            system; that of the gait when None.
        strides: Number of strides to check; 1 by default, or the gait's period.
        friction: Coefficient of friction of foot and ground; 0.8 is the example of Garcia (1999).
        hip_torque: Torque held through all strides, as for `stride`; 0 by default, or the gait's
            own.
        tolerance: Error relative to the largest angle or angular velocity, as for `stride`.

    Returns:
        The `RealityCheck`.

    Raises:
        GaitNotFound: if no state is given, and the walker has no gait.
        NoStride: if a stride does not end with a heelstrike, or if its straight-leg phase has no
            duration.
        ValueError: if a number is not finite or out of its range, or the state is not just after
            heelstrike (of a system, any state may be); or if the map has a terrain, where the
            foot's clearance between footholds is not defined.
    """
    walker, slope, state, motors, period, controlled = walk_of(walker, slope, state, hip_torque)
    period *= 1 if walker.legs_alike else 2
    check_supports(walker, "reality check")
    if controlled is not None and controlled.terrain is not None:
        raise ValueError(
            "reality_check needs smooth ground: on a terrain the ground between two footholds is "
            "not defined, and so is the clearance of the swing foot"
        )
    slope, strides = one_slope(slope), whole(period if strides is None else strides, "strides")
    friction = number(friction, "friction", least=0.0, most=math.inf)
    tolerance = check_tolerance(tolerance)
    number(motors.hip_torque, "hip_torque")
    walks = controlled or StrideMap.of(walker, controller=one_actuation(walker, motors))
    walks = walks.with_tolerance(tolerance)
    here = check_state(state_on(walks, slope, state), of=walker)
    if here.shape != (walker.size,):
        raise ValueError(
            f"reality_check takes one walker: state must be ({walker.size},), not {here.shape}"
        )
    walks.points(here)  # refuses a state off the section
    time = 0.0
    phases: list[DensePhase] = []
    knees, heels, pushes = [], [], []
    velocities, depths, clearances, flexions = [], [], [], []
    own = walker.units
    for count in range(1, strides + 1):
        end = walks.stride(here, slope)
        if end.outcome != Outcome.HEELSTRIKE:
            raise NoStride(
                f"stride {count} does not end with a heelstrike but with "
                f"{Outcome(end.outcome).name}, so there is nothing to check"
            )
        parts = dense_phases(walks, slope, here, end, offset=time)
        first = walks.dimensionless(here)
        height, velocity = (float(part[0]) for part in clearance_of(walks.walker, here[None]))
        leaves = abs(height) <= _TOUCHING * own.length
        depth, clearance = _release_and_passing(
            turns(phase.clearance for phase in parts), rising=velocity >= 0.0 or not leaves
        )
        if not leaves:  # the foot that lands next is not the one that leaves, as on a wheel
            velocity, depth = np.nan, TimedExtremum(np.nan, np.nan)
        velocities.append(TimedExtremum(velocity, time))
        depths.append(depth)
        clearances.append(clearance)
        if walker.knees:
            bends = here[4] >= here[5]
            free = [phase for phase in parts if not phase.locked]
            bent = turns(phase.flexion for phase in free)
            flexions.append(TimedExtremum(0.0, time) if bends else least(bent))
            knee = free[-1].end
            before, after = free[-1].state_at(knee), parts[len(free)].state_at(knee)
            knees.append(kneestrike_impulses(walker, before, after, knee))
        push_off = 0.0
        if "actuation" in walker.supports:
            last = np.array([[float(end.duration) / own.time]])
            push_off = float(walks.look(first, np.array([slope]), last).controls[0, 0, 2])
        strike = parts[-1].end
        before = parts[-1].state_at(strike)
        heel, push = heelstrike_impulses(walks.walker, before, end.state, strike, push_off)
        heels.append(heel)
        pushes += [push] * (not np.isnan(push[0].normal_impulse))
        phases += parts
        time, here, walks = time + float(end.duration), end.state, walks.swapped

    def worst(collisions: list[tuple[Impulse, TimedExtremum]]) -> Impulse:
        none = Impulse(np.nan, np.nan, np.nan)
        return max((x for x, _ in collisions), key=lambda x: x.needed_friction.value, default=none)

    normal = turns(phase.normal for phase in phases)
    ratios = ratio_turns((phase.tangential, phase.normal) for phase in phases)
    return RealityCheck(
        walker=walker,
        slope=slope,
        strides=strides,
        duration=time,
        friction=friction,
        clearance=least(clearances),
        stance_knee_torque=least(turns(p.stance_knee for p in phases if walker.knees)),
        stance_knee_at_kneestrike=least(stop for _, stop in knees),
        stance_knee_at_heelstrike=least(stop for _, stop in heels),
        swing_knee_torque=least(turns(p.swing_knee for p in phases if p.locked and walker.knees)),
        least_normal_force=least(normal),
        greatest_normal_force=greatest(normal),
        stance_friction=greatest(e._replace(value=abs(e.value)) for e in ratios),
        kneestrike_impulse=worst(knees),
        heelstrike_impulse=worst(heels),
        stance_knee_at_push_off=least(stop for _, stop in pushes),
        push_off_impulse=worst(pushes),
        knee_flexion=least(flexions),
        release_velocity=least(velocities),
        release_depth=least(depths),
    )
