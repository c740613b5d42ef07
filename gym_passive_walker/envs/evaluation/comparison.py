"""A controller's walks beside those of others, and beside the optimum of cost and reward."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import number, shown, whole
from gym_passive_walker._tools.progress import progress
from gym_passive_walker._tools.shown import Table
from gym_passive_walker.envs.evaluation.walks import (
    TIME_LIMIT,
    Share,
    Walks,
    median,
    score_table,
    simulate_episodes,
)
from gym_passive_walker.envs.registration import MAX_EPISODE_STEPS
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.gaits.control.baselines import BASELINES
from gym_passive_walker.gaits.control.controllers import ControllerLike, acting
from gym_passive_walker.gaits.control.optimal import least_cost, most_reward
from gym_passive_walker.gaits.control.policy import Policy, StridePlan, policy_name
from gym_passive_walker.gaits.gait import GaitNotFound
from gym_passive_walker.gaits.scenes.scene import Scene, SceneLike, make_scene
from gym_passive_walker.models.walkers import describe, name_of

FEEDBACK, FEEDBACKS = "feedback", ("lqr", "deadbeat", "optimal")
"""Name of the best of the baselines with feedback in `evaluate`; those baselines."""

_MEDIANS = ("distance", "strides", "speed")


@dataclass(frozen=True, repr=False)
class Evaluation(Table):
    """Results of `evaluate`, a row for each controller; print it for a table. Dimensionless.

    Attributes:
        scene: The scene.
        walks: Walks of each controller, by its name; the evaluated one is the first.
        least_cost: Cost of transport of the optimal gait at the controller's speed, by its name;
            NaN if it is not known. The gait walks on smooth ground, without disturbances. The
            speed is the median of the walks that reach the time limit.
        no_optimum: Why it is not known, by the names of those controllers.
        most_reward: Largest sum of the rewards of an episode, of the gait of most reward on smooth
            ground, without disturbances; NaN if it is not known, or the scene has no reward of its
            own.
        no_most_reward: Why it is not known.
    """

    scene: Scene
    walks: Mapping[str, Walks]
    least_cost: Mapping[str, float]
    no_optimum: Mapping[str, str]
    most_reward: float = math.nan
    no_most_reward: str = ""

    @property
    def controller_name(self) -> str:
        """Name of the evaluated controller."""
        return next(iter(self.walks))

    @property
    def above_optimum(self) -> dict[str, float]:
        """Cost of transport above the optimum, as a share of it, by controller; NaN if unknown.

        Both costs are those of the walks that reach the time limit, at their median speed.
        """
        return {
            name: median_of_lasting(walks, "cost_of_transport") / self.least_cost[name] - 1.0
            for name, walks in self.walks.items()
        }

    @property
    def below_most_reward(self) -> dict[str, float]:
        """Mean reward of an episode below the most, as a share of it, by controller.

        NaN if unknown. Falls count. The first strides may earn more, by the energy of the initial
        state.
        """
        return {
            name: (self.most_reward - float(np.mean(walks.reward))) / abs(self.most_reward)
            for name, walks in self.walks.items()
        }

    def summary(self) -> dict[str, dict[str, Any]]:
        """Main results of each controller, by its name.

        Returns:
            For each controller, "walks", their number; "reached_time_limit", a `Share` of them
            with a 95 % interval (Wilson); "falls", a `Share` for each outcome that ended walks;
            "reward", the mean return; medians of "distance" / l, "strides" and "speed" / sqrt(g l);
            the median "cost_of_transport" of walks to the time limit, NaN if none reaches it;
            "least_cost" and "above_optimum", as the attributes. Of a scene with a reward of its
            own, "most_reward" and "below_most_reward" too.
        """
        return {name: self._summary(name, walks) for name, walks in self.walks.items()}

    def _summary(self, name: str, walks: Walks) -> dict[str, Any]:
        medians = walks.summary()
        falls = sorted({*walks.endings} - {TIME_LIMIT})
        reward = {
            "most_reward": self.most_reward,
            "below_most_reward": self.below_most_reward[name],
        }
        return {
            "walks": len(walks),
            "reached_time_limit": walks.share(TIME_LIMIT),
            "falls": {ending: walks.share(ending) for ending in falls},
            "reward": medians["reward"],
            **{each: medians[each] for each in _MEDIANS},
            "cost_of_transport": median_of_lasting(walks, "cost_of_transport"),
            "least_cost": self.least_cost[name],
            "above_optimum": self.above_optimum[name],
            **(reward if self.scene.reward is not None else {}),
        }

    def columns(self) -> dict[str, NDArray]:
        """A row for each controller; shares have their intervals in columns of their own."""
        each = self.summary()
        kinds = sorted({kind for row in each.values() for kind in row["falls"]})
        rows = []
        for name, row in each.items():
            falls, none = row.pop("falls"), Share.of(np.zeros(row["walks"], bool))
            shares = {"reached_time_limit": row.pop("reached_time_limit")}
            shares |= {kind.replace(" ", "_"): falls.get(kind, none) for kind in kinds}
            parts = {
                kind + part: value
                for kind, share in shares.items()
                for part, value in zip(("", "_low", "_high"), share, strict=True)
            }
            rows.append({"controller": name, **row, **parts})
        return {name: np.array([row[name] for row in rows]) for name in rows[0]}

    def column_units(self) -> dict[str, str]:
        """Units of distance and speed."""
        return {"distance": "l", "speed": "sqrt(g l)"}

    def facts(self) -> dict[str, str]:
        """Controller, walker, the share of walks to the time limit, and the cost."""
        row = self.summary()[self.controller_name]
        return {
            "controller": self.controller_name,
            "walker": name_of(self.scene.walker),
            "walks to the time limit": f"{row['reached_time_limit']} of {row['walks']}",
            "cost of transport": f"{row['cost_of_transport']:.4g}",
            "above the optimum": f"{row['above_optimum']:z.1%}",
        }

    def in_words(self) -> str:
        """Sentences on the controller's cost and its own reward, beside their optima."""
        return " ".join(filter(None, (self._cost_in_words(), self._reward_in_words())))

    def _reward_in_words(self) -> str:
        """A sentence on a reward of the scene's own beside the most; empty without one."""
        if self.scene.reward is None or self.no_most_reward:
            return self.no_most_reward
        share = self.below_most_reward[self.controller_name]
        earned = float(np.mean(self.walks[self.controller_name].reward))
        beside = "below" if share > 0.0 else "above"
        return (
            f"Its mean reward of an episode is {earned:.4g}, {abs(share):.1%} {beside} that of the "
            f"gait of most reward on smooth ground, {self.most_reward:.4g}."
        )

    def _cost_in_words(self) -> str:
        """A sentence on the controller's cost beside the optimum at its speed."""
        name = self.controller_name
        if reason := self.no_optimum.get(name):
            return reason
        share, walks = self.above_optimum[name], self.walks[name]
        beyond = f"{abs(share):.1%} {'above' if share > 0.0 else 'below'}"
        above = beyond if abs(share) >= 5e-4 else "no more than"
        speed, cost = (median_of_lasting(walks, each) for each in ("speed", "cost_of_transport"))
        return (
            f"Its speed is {speed:.3f} √(g l) and its cost of transport {cost:.4f}, {above} that "
            f"of the optimal gait at that speed on smooth ground, {self.least_cost[name]:.4f}."
        )

    def __str__(self) -> str:
        slopes = " to ".join(f"{bound:g}" for bound in np.atleast_1d(self.scene.slope))
        name = self.controller_name
        title = (
            f"{name}, {describe(self.scene.walker)}, slope {slopes} rad; "
            f"{len(self.walks[name])} episodes"
        )
        return f"{score_table(title, self.walks, self.above_optimum)}\n{self.in_words()}"


def evaluate(
    controller: ControllerLike,
    scene: SceneLike | None = None,
    *,
    episodes: int = 20,
    seed: int = 1000,
    max_episode_steps: int = MAX_EPISODE_STEPS,
    beside: Sequence[ControllerLike] = ("passive", "feedback"),
    time_limit: float = 60.0,
) -> Evaluation:
    """Evaluate a controller over episodes of a scene, beside others and the optimum at its speed.

    The optimum is the gait of least cost of transport at the median speed of the walks that reach
    the time limit, on smooth ground without disturbances. Stored costs are used if there are any;
    else `optimal_gait` searches, once for a scene and a speed: the user's cache keeps its result.
    Of a scene with a reward of its own, it also searches for the gait of most reward.

    Args:
        controller: Any controller of `stride_map`; it acts deterministically.
        scene: A scene in a form that `make_scene` takes; the controller's own if None.
        episodes: Number of episodes of each controller.
        seed: Seed of the first episode, the next ones follow. All controllers have the same
            initial states and slopes.
        max_episode_steps: Control steps to the time limit. In short walks the cost is lower by the
            energy of the initial state.
        beside: Controllers to compare with. "feedback" is the one of "lqr", "deadbeat" and
            "optimal" with the highest mean return, if any can act in the scene; it comes last.
        time_limit: Largest time of each search for an optimal gait, in s; with 0 only stored costs
            are used.

    Returns:
        The `Evaluation`.

    Raises:
        ValueError: if there is no such controller, it has no scene, or an argument is out of its
            range.

    Example:
        >>> import gym_passive_walker as gpw
        >>> found = gpw.evaluate("level-ppo", episodes=4)
        >>> print(found.summary()["level-ppo"]["falls"], f"{found.above_optimum['level-ppo']:.0%}")
        {} 3%
    """
    count = whole(episodes, "episodes", 1, 100_000)
    first = whole(seed, "seed", 0)
    steps = whole(max_episode_steps, "max_episode_steps")
    limit = number(time_limit, "time_limit", least=0.0, most=math.inf)
    if not isinstance(beside, list | tuple) or isinstance(beside, Actuation):
        raise ValueError(
            f'beside must be a list of controllers, as ["passive", "feedback"], not {shown(beside)}'
        )
    _, own = acting(controller, scene)
    agents: dict[str, tuple[Policy, Scene]] = {}
    texts = {FEEDBACK}  # other controllers may have the name of a baseline
    for each in (controller, *beside):
        named = str(each) if isinstance(each, str | PathLike) else ""
        if named in texts:
            continue
        texts |= {named} - {""}
        agent, there = acting(each, own)
        if own.observation is not None and isinstance(agent, StridePlan):  # it reads the state
            agent, there = acting(each, own, observation=None)
        agents[_unused(named or policy_name(agent), agents)] = agent, there
    walks: dict[str, Walks] = {}
    with progress("controllers", len(agents)) as done:
        for name, (agent, there) in agents.items():
            envs = PassiveWalkerVectorEnv(count, there, max_episode_steps=steps)
            walks[name] = simulate_episodes(agent, envs, seed=first)
            done()
    if any(isinstance(each, str) and each == FEEDBACK for each in beside):
        seen = make_scene(own, observation=None)
        envs = PassiveWalkerVectorEnv(count, seen, max_episode_steps=steps)
        for name, made in _best_feedback(seen, envs, first).items():
            if name not in texts:
                walks[_unused(name, walks)] = made
    costs, reasons = {}, {}
    for name, made in walks.items():
        costs[name] = math.nan
        try:
            costs[name] = _least_cost(own, made, limit)
        except (GaitNotFound, TimeoutError, ValueError) as error:
            reasons[name] = f"Its cost is not compared with the optimum: {error}."
    most, unknown = math.nan, ""
    if own.reward is not None:
        try:
            _check_single(own, "slope")
            if own.terminated is not None:
                raise ValueError("the scene's own `terminated` may end an episode of that gait")
            most = steps * most_reward(own, time_limit=limit)
        except (GaitNotFound, TimeoutError, ValueError) as error:
            unknown = f"Its reward is not compared with the optimum: {error}."
    return Evaluation(own, walks, costs, reasons, most, unknown)


def median_of_lasting(walks: Walks, name: str) -> float:
    """Return the median of a quantity of walks that reach the time limit; NaN without any."""
    return median(getattr(walks, name)[walks.reached_limit])


def _unused(name: str, known: Mapping[str, Any]) -> str:
    """Return a name that no controller has yet: the name, or with a number."""
    names = [name, *(f"{name} ({i})" for i in range(2, len(known) + 2))]
    return next(each for each in names if each not in known)


def _best_feedback(scene: Scene, envs: PassiveWalkerVectorEnv, seed: int) -> dict[str, Walks]:
    """Return walks of the baseline with feedback of the highest mean return by its name, if any."""
    tried: dict[str, Walks] = {}
    for name in FEEDBACKS:
        try:
            agent = BASELINES[name](scene)
        except (ValueError, GaitNotFound):  # it cannot act in this scene
            continue
        tried[name] = simulate_episodes(agent, envs, seed=seed)
    best = max(tried, key=lambda name: float(np.mean(tried[name].reward)), default=None)
    return {} if best is None else {best: tried[best]}


def _check_single(scene: Scene, *names: str) -> None:
    """Check that walks are alike: arguments of some names, and the body, have no range.

    Raises:
        ValueError: if one has.
    """
    ranges = [name for name in names if isinstance(getattr(scene, name), tuple)]
    if scene.domain_randomization:
        ranges.append("domain_randomization")
    if ranges:
        raise ValueError(f"an optimal gait is one of a single walk, and {ranges[0]} has a range")


def _least_cost(scene: Scene, walks: Walks, time_limit: float) -> float:
    """Return the optimum's cost of transport at the speed of some walks.

    Raises:
        GaitNotFound: if there is no gait at that speed.
        TimeoutError: if the search takes longer than `time_limit`, in s.
        ValueError: if the scene, or the walks, have no one optimum to be compared with.
    """
    if 2 * walks.reached_limit.sum() < len(walks):
        raise ValueError("most of its walks end before the time limit")
    _check_single(scene, "slope", "command")
    return least_cost(scene, median_of_lasting(walks, "speed"), time_limit=time_limit)
