"""Periodic gaits of least cost of transport at a speed, or of most reward; found and stored."""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import instance, number, shown, unknown
from gym_passive_walker._tools.files import replacing
from gym_passive_walker._tools.progress import progress
from gym_passive_walker.engine import cache as cached
from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.gaits.control.feedback import first_driven, powered_gait
from gym_passive_walker.gaits.control.optimum import OptimalGait, Problem, slope_of
from gym_passive_walker.gaits.control.stride_reward import StrideReward, own_reward
from gym_passive_walker.gaits.control.ticks import control_steps, ticked_stride
from gym_passive_walker.gaits.find.search import seek
from gym_passive_walker.gaits.gait import Gait, GaitNotFound
from gym_passive_walker.gaits.map_result import NoStride
from gym_passive_walker.gaits.scenes.scene import Scene, make_scene
from gym_passive_walker.gaits.scenes.transition import Transition
from gym_passive_walker.models.model import check_supports
from gym_passive_walker.models.walkers import Walker, describe

STORE = Path(__file__).parent / "gaits"
"""Folder of the stored optimal gaits of named scenes."""

COSTS = Path(__file__).parent / "least_costs.json"
"""File of their costs of transport, at more speeds."""

_SPARE = 1.5  # ticks given to a stride, over those it takes at first
_ALIKE = 1e-6  # relative difference of costs that is none
_AT_HAND = 0.02  # difference in speed, over sqrt(g l), from which a stored gait is a start
_STATIONARY = 1e-3  # violation of optimality, relative, from which a gait is at a corner
_SHARES = (0.1, 0.2, 0.4, 0.6, 0.8, 1.0)  # of the largest push-off or ankle torque, to begin with


def optimal_gait(
    scene: Scene | str | dict[str, Any],
    speed: float | None = None,
    *,
    reward: Callable[[Transition], Any] | Mapping[str, float] | None = None,
    start: OptimalGait | None = None,
    time_limit: float = math.inf,
) -> OptimalGait:
    """Find the periodic gait of least cost of transport at a speed, or of most reward.

    With a speed alone, the gait has the least cost of transport at that speed. Without a speed, it
    has the most reward: the scene's own, or else the environment's. With `reward`, it has the most
    of that reward, at the speed if there is one.

    The most reward means the largest mean over control steps. An episode of N control steps earns
    N times that mean, so it is what a learner maximizes, without discounting. A heelstrike ends the
    last control step of a stride early. Where a control step is a stride, the mean is the reward of
    a stride. The search tries one control step more and one less, as long as this is better.

    The ground is smooth: terrain, disturbances and terminations of one's own do not matter. A
    commanded speed matters for a reward that reads it.
    The optimum is a local one: that which lies nearest to where the search starts. Where the scene
    ends an episode on a stubbed toe (`end_on_toe_stub`), the toe clears the ground on it. Where it
    does not, the toe may stub: `stubs` of the gait says so.

    Args:
        scene: A scene in a form that `make_scene` takes, of one slope: says which torques
            there are, for how long they are held and how the motor is charged.
        speed: Speed over sqrt(g l); of a `System`, in its own units.
        reward: Function of a `Transition`, or weights, as in a scene. Its derivatives are exact. It
            must be smooth at the optimum. The push-off is an action of equal size in all control
            steps.
        start: A gait at a neighbouring speed; None is the nearest of those stored for the scene if
            there is one at hand, else one with a constant torque. From that, the search for least
            cost starts twice more, from the torques it has found a tick later and a tick earlier:
            that takes two to three times as long, and of optima some 0.1 to 1 % apart finds the
            lowest more often. For a reward, None is the one of these with the most.
        time_limit: Largest time of the search in s; checked in each iteration.

    Returns:
        The gait. Its `reward` is the sum over the control steps of a stride, if one is maximized.

    Raises:
        GaitNotFound: if none is found at that speed, or none that the scene's rule
            `end_on_toe_stub` allows; the message has speeds with a gait.
        TimeoutError: if the search takes longer than `time_limit`.
        ValueError: if the scene has a range of slopes or no actuator, or the speed or the time
            limit is not positive; if the reward cannot be traced, has a corner at the optimum, or
            reads what no stride repeats.

    Example:
        >>> import gym_passive_walker as gpw
        >>> scene = {"slope": 0.03, "control": "stride"}
        >>> gait = gpw.optimal_gait(scene, reward=lambda step: step.distance - 5.0 * step.energy)
        >>> print(f"{gait.reward:.4f}")
        0.6347
    """
    scene = make_scene(scene)
    check_supports(scene.walker, "optimal gaits")
    slope_of(scene)  # refuses a range before there is work done
    deadline = time.monotonic() + number(time_limit, "time_limit", above=0.0, most=math.inf)
    fastest = 2.0 if "actuation" in scene.walker.supports else math.inf
    if speed is not None and number(speed, "speed", above=0.0) >= fastest:
        raise ValueError(f"speed must lie between 0 and 2, over sqrt(g l), not {speed!r}")
    if start is not None:
        instance(start, OptimalGait, "start", "gpw.optimal_gait returns")
    rewarded = None
    if reward is not None or speed is None:
        given = scene.reward if reward is None else reward
        rewarded = StrideReward(scene, own_reward if given is None else given)
    near = start or _at_hand(scene, speed, rewarded)
    begun = near or constant_gait(scene)
    spare = 1.0 if rewarded else _SPARE
    ticks = control_steps(scene, spare * begun.dimensionless.step_period)
    problem = Problem(scene, speed, ticks, rewarded)
    problem.deadline = deadline
    try:
        with progress("iterations of the search for an optimal gait") as problem.iterated:
            if rewarded:
                return _most_rewarded(problem, begun)
            return _best(problem, begun, near, start)
    except GaitNotFound as error:
        raise GaitNotFound(f"{error}; {_known_speeds(scene, begun)}") from None
    except TimeoutError:
        at = "" if speed is None else f" at speed {speed:g}"
        raise TimeoutError(
            f"no optimal gait{at} was found in {time_limit:g} s: give the search more time"
        ) from None


def _most_rewarded(problem: Problem, begun: OptimalGait) -> OptimalGait:
    """Return the gait of most reward, in as many control steps as are best."""
    start = problem.begun_at(begun)
    z = problem.solve(start)
    if not problem.allowed(z):
        z = _clearing(problem, [z, start])
    solved = {problem.ticks: (problem.at(z)[0], problem, z)}
    tried = {problem.ticks, 0}
    while problem.steps:
        count = min(solved, key=lambda count: solved[count][0])
        if tried >= {count + 1, count - 1}:
            break
        cost, there, z = solved[count]
        other = problem.with_ticks(count + 1 if count + 1 not in tried else count - 1)
        tried.add(other.ticks)
        with suppress(GaitNotFound):
            start = other.begun_at(there.measured(z))
            z = other.solve(start, known=cost)
            z = z if other.allowed(z) else _clearing(other, [start])
            solved[other.ticks] = other.at(z)[0], other, z
    _, there, z = min(solved.values(), key=lambda each: each[0])
    best = _with_corners(there, z)
    assert problem.reward is not None
    if problem.reward.corner and best.optimality > _STATIONARY:
        raise ValueError(
            f"the reward has {problem.reward.corner}, and the best gait found is at a corner of "
            "it, without a derivative: write a smooth function in its place, such as a square"
        )
    return best


def _best(
    problem: Problem, begun: OptimalGait, near: OptimalGait | None, start: OptimalGait | None
) -> OptimalGait:
    """Return the gait of least cost of the searches of `optimal_gait`.

    Args:
        problem: The problem.
        begun: Gait from which the search begins.
        near: The same, if its speed is near.
        start: The same, if the user has given it.
    """
    scene, z = problem.scene, problem.solve(problem.begun_at(begun))
    if not problem.allowed(z):
        other = begun if start is None else _at_hand(scene, problem.speed) or constant_gait(scene)
        z = _clearing(problem, [z, problem.begun_at(begun), problem.begun_at(other)])
    best = first = _with_corners(problem, z)
    if near is None and problem.ticks > 1:
        # From a start so far away, torques may have come to lie in ticks too late or too early.
        for shifted in _shifted(first):
            with suppress(GaitNotFound):
                z = problem.solve(problem.begun_at(shifted), known=_cost(best))
                if problem.allowed(z):
                    best = _cheaper(best, _with_corners(problem, z))
    return best


def _with_corners(problem: Problem, z: NDArray) -> OptimalGait:
    """Return the gait of a solution, or a cheaper one with a knee that locks as a tick ends."""
    best = problem.measured(z)
    for edge in _edges(best, problem.tick):
        problem.edge = edge
        with suppress(GaitNotFound):
            held = problem.solve(z, known=_cost(best))
            if problem.allowed(held):
                best = _cheaper(best, problem.measured(held))
    problem.edge = None
    return best


def _cost(gait: OptimalGait) -> float:
    """Return what is least of an optimal gait; minus the mean reward, if that is most."""
    return gait.charged_cost if gait.reward is None else -gait.reward_per_control_step


def _cheaper(known: OptimalGait, found: OptimalGait) -> OptimalGait:
    """Return the gait of less cost; `found` if they cost the same."""
    least = _cost(known)
    return found if _cost(found) <= least * (1.0 + math.copysign(_ALIKE, least)) else known


def _shifted(gait: OptimalGait) -> list[OptimalGait]:
    """Return gaits with the torques a tick later, and a tick earlier."""
    held: Any = gait.controller
    controls = held._asdict() if isinstance(held, Actuation) else held
    count, found = gait.control_steps, []
    for order in (np.maximum(np.arange(count + 1) - 1, 0), slice(count > 1, None)):
        moved = {name: x[order] if np.ndim(x) else x for name, x in controls.items()}
        found.append(replace(gait, controller=type(held)(**moved)))
    return found


def _clearing(problem: Problem, starts: list[NDArray]) -> NDArray:
    """Return the first solution, from some starts, on which the toe clears the ground.

    It is a condition only once a search without it has ended in a gait that the scene forbids: to
    know the swing leg at kneestrike takes about as long as the rest of a stride.
    """
    problem.clears = True
    for z in starts[:-1]:
        with suppress(GaitNotFound):
            return problem.solve(z)
    return problem.solve(starts[-1])


def _at_hand(
    scene: Scene, speed: float | None, reward: StrideReward | None = None
) -> OptimalGait | None:
    """Return the stored gait of a scene that is nearest in speed; None if none is near.

    Without a speed it is the one with the most reward.
    """

    def cost(gait: OptimalGait) -> float:
        problem = Problem(scene, None, gait.control_steps, reward)
        return problem.at(problem.begun_at(gait))[0]

    try:
        gaits = load(stored_name(scene))
    except ValueError:
        return None
    if speed is None:
        return min(gaits, key=cost)
    nearest = min(gaits, key=lambda gait: abs(gait.froude_speed - speed))
    return nearest if abs(nearest.froude_speed - speed) < _AT_HAND else None


def _known_speeds(scene: Scene, begun: OptimalGait) -> str:
    """Return a clause on the speeds at which a scene is known to have gaits."""
    speeds = [begun.froude_speed]
    with suppress(ValueError):  # none are stored
        speeds += [gait.froude_speed for gait in load(stored_name(scene))]
    low, high = min(speeds), max(speeds)
    known = f"speed {low:.4g}" if low == high else f"speeds from {low:.4g} to {high:.4g}"
    return (
        f"there are gaits at {known} √(g l), and gpw.optimal_gaits(scene, speeds) finds those that "
        "exist at speeds around"
    )


def _edges(gait: OptimalGait, tick: float) -> list[float]:
    """Return the ends of the ticks before and after a gait's kneestrike.

    A torque that changes just as the knee locks makes a corner in the cost, and most optima lie in
    one; smooth optimization finds them by holding the kneestrike there.
    """
    time = float(gait.dimensionless.kneestrike_time)
    if math.isnan(time) or math.isinf(tick):
        return []
    before = round(time / tick, 2)
    return [edge * tick for edge in range(math.floor(before), math.ceil(before) + 1)]


def constant_gait(scene: Scene) -> OptimalGait:
    """Return the gait at which searches begin: passive, or with one constant actuator.

    Raises:
        GaitNotFound: if there is none.
    """
    walker, slope = scene.walker, slope_of(scene)
    gait = _driven(scene)
    point, (hip, ankle, push_off) = gait.point.values[0], gait.stride_map.actuation
    held, torques = {}, np.zeros((len(walker.controls), 1))
    if "actuation" in walker.supports:
        held = {"hip": (hip,), "ankle": (ankle,), "push_off": (push_off,)}
        torques[:, 0] = hip, ankle
    else:
        push_off = None
    walked = ticked_stride(walker, slope, point, torques, tick=math.inf, push_off=push_off)
    speed = float(walked.length / walked.duration)
    problem = Problem(scene, speed, control_steps(scene, float(walked.duration)))
    try:
        return problem.measured(problem.begun(point, held))
    except NoStride as error:
        raise GaitNotFound(
            f"with what the scene permits of the constant {gait.stride_map.controller} from which "
            f"the search begins, {error}: try larger motors, or another slope"
        ) from None


def _driven(scene: Scene) -> Gait:
    """Return a gait, passive or with one constant actuator."""
    walker, slope = scene.walker, slope_of(scene)
    passive = seek(walker, slope).gait
    if passive is not None:
        return passive
    if "actuation" not in walker.supports:
        raise GaitNotFound(
            f"no passive gait of {describe(walker)} at slope {slope:g}, from which the search "
            "begins: try another slope"
        )
    refused = None
    if "hip" in scene.actions:
        try:
            return powered_gait(walker, slope)
        except GaitNotFound as error:
            refused = error
    for channel, name in (("push_off", "push_off"), ("ankle", "ankle_torque")):
        if channel in scene.actions:
            amounts = (share * scene.largest(channel) for share in _SHARES)
            if found := first_driven(walker, slope, name, amounts):
                return found
    raise refused or GaitNotFound(
        f"no passive gait at slope {slope:g}, and none with a constant "
        f"{' or '.join(scene.actions)} of {_SHARES[0]:g} to {_SHARES[-1]:g} of the largest; "
        "try another slope, or larger motors"
    )


def optimal_gaits(
    scene: Scene | str | dict[str, Any], speeds: Iterable[float]
) -> list[OptimalGait]:
    """Find the optimal gaits that exist at several speeds, each from its neighbours.

    The search goes outwards from the constant torque's own speed until there is no gait any more,
    and then once back; of two optima at one speed the cheaper one is kept. A passive gait, where
    there is one, is the optimum at its speed: it is among them.

    Args:
        scene: As for `optimal_gait`.
        speeds: Speeds over sqrt(g l).
    """
    scene = make_scene(scene)
    if isinstance(speeds, str | bytes | Mapping) or not np.iterable(speeds):
        raise ValueError(f"speeds must be speeds over sqrt(g l) in a row, not {shown(speeds)}")
    speeds = [number(speed, f"speeds[{i}]", above=0.0) for i, speed in enumerate(speeds)]
    natural = constant_gait(scene)
    speeds = sorted(speeds, key=lambda speed: abs(speed - natural.froude_speed))
    best = {natural.froude_speed: natural} if natural.charged_cost == 0.0 else {}
    with progress("searches for an optimal gait") as searched:
        for way in (
            [speed for speed in speeds if speed >= natural.froude_speed],
            [speed for speed in speeds if speed < natural.froude_speed],
        ):
            last = natural
            for speed in [*way, *way[::-1]]:
                if speed in best and last is best[speed]:
                    continue
                searched()
                try:
                    found = optimal_gait(scene, speed, start=last)
                    if speed not in best or found.charged_cost < best[speed].charged_cost:
                        best[speed] = found
                except GaitNotFound:
                    if speed not in best:
                        break
                last = best[speed]
    return [best[speed] for speed in sorted(best)]


def save_gaits(path: Path, gaits: list[OptimalGait]) -> None:
    """Write gaits as JSON."""
    lines = ",\n".join(json.dumps(gait.to_json()) for gait in gaits)
    path.write_text(f"[\n{lines}\n]\n", encoding="utf-8")


def load(scene: str) -> list[OptimalGait]:
    """Return the stored optimal gaits of a named scene, in order of increasing speed.

    Raises:
        ValueError: if there are none.
    """
    path = STORE / f"{scene}.json"
    if not path.is_file():
        known = ", ".join(sorted(path.stem for path in STORE.glob("*.json"))) or "none"
        raise ValueError(
            f"no optimal gaits of scene {scene!r} are stored, only those of: {known}; "
            f"`python train.py optimal --scene {scene}` computes them"
        )
    return [OptimalGait.from_json(gait) for gait in json.loads(path.read_text(encoding="utf-8"))]


def stored_name(scene: Scene) -> str:
    """Return the name of the stored gaits of a scene: of its walker, slope, actuators and charge.

    Raises:
        ValueError: if there are none.
    """
    kept = ("walker", "slope", "control", "tick", "actions", "max_hip_torque", "energy")
    for path in sorted(STORE.glob("*.json")):
        other = make_scene(path.stem)
        if all(getattr(scene, name) == getattr(other, name) for name in kept):
            return path.stem
    raise ValueError(
        "no optimal gaits of this scene are stored: find one by "
        "gym_passive_walker.optimal_gait(scene, speed)"
    )


def charged(gait: OptimalGait) -> float:
    """Cost of transport of a gait, with the work of actuators that its scene charges."""
    return math.sin(gait.slope) + gait.charged_cost


def least_cost(
    gaits: str | Scene | Sequence[OptimalGait], speed: float, *, time_limit: float = math.inf
) -> float:
    """Return the optimum's cost of transport at a speed.

    Between known speeds the logarithm of the cost is interpolated by monotone cubic polynomials.
    The costs of named scenes are stored at intervals of 0.00125 √(g l) or less. Midway between them
    the error is below 0.1 % on "level" and "steep", and up to 0.5 % on "lab". Of gaits at intervals
    of 0.01 √(g l), it is up to 0.7 %.

    Args:
        gaits: Name of a scene with stored costs, or optimal gaits. Of a `Scene` without stored
            costs at that speed, `optimal_gait` searches; the user's cache keeps the result.
        speed: Speed over sqrt(g l).
        time_limit: Largest time of that search in s; with 0 there is none.

    Raises:
        GaitNotFound: if the search finds none.
        TimeoutError: if the search takes longer than `time_limit`.
        ValueError: if no costs are stored for the scene, or the speed is beyond those known; of a
            `Scene`, if it has a range of slopes or no actuator.
    """
    if isinstance(gaits, Scene):
        with suppress(ValueError):
            name = stored_name(gaits)
            if gaits.end_on_toe_stub == make_scene(name).end_on_toe_stub:
                return least_cost(name, speed)
        return _searched_cost(gaits, speed, time_limit)
    speed = round(number(speed, "speed"), 9)
    if isinstance(gaits, str):
        known = stored_costs(gaits)
    elif not (known := [(gait.froude_speed, charged(gait)) for gait in gaits]):
        raise ValueError("least_cost needs at least one gait")
    speeds, costs = np.array(sorted(known)).T
    speeds = speeds.round(9)
    if not speeds[0] <= speed <= speeds[-1]:
        raise ValueError(
            f"least costs are known at speeds from {speeds[0]:g} to {speeds[-1]:g} √(g l), not at "
            f"{speed:g}; gpw.optimal_gait(scene, speed) searches for the gait at another speed"
        )
    if len(speeds) == 1 or not costs.min() > 0.0:  # no logarithm, or no curve
        return float(np.interp(speed, speeds, costs))
    return math.exp(scipy.interpolate.PchipInterpolator(speeds, np.log(costs))(speed))


def _searched_cost(scene: Scene, speed: float, time_limit: float) -> float:
    """Return the cost of an optimal gait, which is searched for once."""
    if time_limit == 0.0:
        raise TimeoutError(
            f"no cost of an optimal gait of this scene at speed {speed:.4g} is stored, and with "
            "time_limit=0 none is searched for"
        )
    check_supports(scene.walker, "optimal gaits")
    slope_of(scene)
    return _kept(
        _cache_name(scene, float(speed)),
        lambda: charged(optimal_gait(scene, speed, time_limit=time_limit)),
    )


def most_reward(scene: Scene, *, time_limit: float = math.inf) -> float:
    """Return the largest mean reward of a control step, of a periodic gait on smooth ground.

    `optimal_gait` searches for it; the user's cache keeps the result.

    Args:
        scene: The scene, with its own reward or the environment's.
        time_limit: Largest time of that search in s; with 0 there is none.

    Raises:
        GaitNotFound: if the search finds none.
        TimeoutError: if the search takes longer than `time_limit`.
        ValueError: as `optimal_gait`.
    """
    check_supports(scene.walker, "optimal gaits")
    slope_of(scene)
    if time_limit == 0.0:
        raise TimeoutError("with time_limit=0 no optimum of its reward is searched for")
    digest = StrideReward(scene, scene.reward or own_reward).digest
    return _kept(
        _cache_name(scene, [digest, scene.command]),
        lambda: -_cost(optimal_gait(scene, reward=scene.reward, time_limit=time_limit)),
    )


def _kept(name: str, search: Callable[[], float]) -> float:
    """Return the result of a search; a cache file keeps it, or the reason why there is none."""
    if kept := cached.found(name):
        known = json.loads(kept)
    else:
        try:
            known = search()
        except GaitNotFound as error:
            known = str(error)
        cached.keep(name, json.dumps(known).encode())
    if isinstance(known, str):
        raise GaitNotFound(known)
    return known


def _cache_name(scene: Scene, wanted: float | list) -> str:
    """Return the name of the cache file of an optimum at a speed, or of a reward and a command.

    The name is a hash of all on which the optimum depends.
    """
    walker: Any = scene.walker
    if isinstance(walker, Walker):
        known: Any = repr(walker)
    else:
        known = walker.hybrid.name, walker.total_mass, np.asarray(walker.start, float).tolist()
    stated = [
        known, dict(walker.parameters),
        scene.slope, scene.control, scene.tick, scene.energy, scene.end_on_toe_stub,
        {name: scene.largest(name) for name in scene.actions}, wanted, scipy.__version__,
    ]  # fmt: skip
    digest = hashlib.sha256(json.dumps(stated).encode())
    for source in sorted(STORE.parents[1].rglob("*.py")):
        digest.update(source.read_bytes())
    return f"optimum-{digest.hexdigest()[:32]}"


@cache
def stored_costs(scene: str) -> list[tuple[float, float]]:
    """Return speeds over sqrt(g l) and the optimum's costs of transport, of a named scene.

    Raises:
        ValueError: if none are stored.
    """
    known = json.loads(COSTS.read_text(encoding="utf-8"))
    if scene not in known:
        raise ValueError(unknown([scene], sorted(known), "the list of least costs by scene"))
    return [(speed, cost) for speed, cost in known[scene]]


def save_costs(scene: str, gaits: Iterable[OptimalGait]) -> None:
    """Store the costs of optimal gaits of a named scene, for `least_cost`."""
    known = json.loads(COSTS.read_text(encoding="utf-8")) if COSTS.is_file() else {}
    known[scene] = [(gait.froude_speed, charged(gait)) for gait in gaits]
    lines = ",\n".join(f"{json.dumps(name)}: {json.dumps(known[name])}" for name in sorted(known))
    with replacing(COSTS) as path:
        path.write_text(f"{{\n{lines}\n}}\n", encoding="utf-8")
    stored_costs.cache_clear()
