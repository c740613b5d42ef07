"""A walk in another simulator beside the exact one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import shown, whole
from gym_passive_walker._tools.console import in_columns
from gym_passive_walker._tools.progress import progress
from gym_passive_walker._tools.shown import Table
from gym_passive_walker.bridge.export import check_plane
from gym_passive_walker.bridge.loop import library
from gym_passive_walker.bridge.mjcf import SOFTNESS
from gym_passive_walker.bridge.mujoco import PassiveWalkerMujocoEnv, checked_steps
from gym_passive_walker.gaits.control.controllers import ControllerLike, SceneLike, acting
from gym_passive_walker.gaits.control.maps import acting_as, calm, map_in
from gym_passive_walker.gaits.control.optimum import OptimalGait
from gym_passive_walker.gaits.control.policy import Policy, policy_name
from gym_passive_walker.gaits.find.fixed_point import find_gait
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.gaits.scenes.scene import Scene, make_scene
from gym_passive_walker.models.walkers import describe, name_of

SIMULATORS = ("mujoco",)
"""Simulators that `compare` knows."""

TIMESTEPS = (4e-3, 2e-3, 1e-3, 5e-4)
"""Default timesteps in s."""

MEASURED = ("step_period", "stance_angle", "step_length", "speed", "cost_of_transport")
"""Quantities that are compared, dimensionless."""

WALKED = "no fall"
"""Outcome of a walk that did not end."""


@dataclass(frozen=True, repr=False)
class Comparison(Table):
    """Results of `compare`, a row for each timestep and softness; print it for a table.

    Attributes:
        simulator: Its name and version.
        controller_name: Name of the controller.
        scene: The scene.
        exact: Quantities in MEASURED of the exact gait, dimensionless, by name.
        timestep: Timestep in s, (n,).
        softness: Time constant of contacts in timesteps, (n,); NaN for the simulator's own ones.
        found: Quantities in MEASURED by name, each (n,): means over the second half of the walk.
        penetration: Largest depth of the stance foot below the ground at the end of a control
            step, in leg lengths, (n,).
        strides: Strides of each walk, (n,).
        outcome: Outcome of each walk: "no fall", or that of a fall, (n,).
    """

    simulator: str
    controller_name: str
    scene: Scene
    exact: dict[str, float]
    timestep: NDArray[np.float64]
    softness: NDArray[np.float64]
    found: dict[str, NDArray[np.float64]]
    penetration: NDArray[np.float64]
    strides: NDArray[np.int64]
    outcome: list[str]

    @property
    def error(self) -> dict[str, NDArray[np.float64]]:
        """Relative errors of the quantities in MEASURED, by name, each (n,)."""
        return {
            name: values / self.exact[name] - 1.0
            if self.exact[name]
            else np.full_like(values, np.nan)
            for name, values in self.found.items()
        }

    def facts(self) -> dict[str, str]:
        """Simulator, controller, walker and the error at the smallest timestep."""
        best = int(np.argmin(self.timestep))
        errors = {f"{x.replace('_', ' ')} error": f"{e[best]:+.2%}" for x, e in self.error.items()}
        return {
            "simulator": self.simulator,
            "controller": self.controller_name,
            "walker": name_of(self.scene.walker),
            "timestep": f"{self.timestep[best]:g} s",
            **errors,
        }

    def columns(self) -> dict[str, NDArray]:
        """A row for each walk: its quantities, and their errors."""
        return {
            "timestep": self.timestep,
            "softness": self.softness,
            **self.found,
            **{f"{name}_error": values for name, values in self.error.items()},
            "penetration": self.penetration,
            "strides": self.strides,
            "outcome": np.array(self.outcome),
        }

    def column_units(self) -> dict[str, str]:
        """Units of columns that have one."""
        return {
            "timestep": "s", "step_period": "sqrt(l/g)", "stance_angle": "rad", "step_length": "l",
            "speed": "sqrt(g l)", "penetration": "l",
        }  # fmt: skip

    def __str__(self) -> str:
        slope = f"{self.scene.slope:g}"
        title = f"{self.controller_name}, {describe(self.scene.walker)}, slope {slope} rad"
        head = ["timestep (s)", "contacts", *(name.replace("_", " ") for name in MEASURED)]
        rows = [[*head, "penetration / l", "strides"]]
        rows.append(["exact", "", *(f"{self.exact[name]:.6g}" for name in MEASURED), "", ""])
        for i, outcome in enumerate(self.outcome):
            soft = self.softness[i]
            row = [f"{self.timestep[i]:g}", "its own" if soft != soft else f"{soft:g} steps"]
            row += [f"{self.found[name][i]:.6g} ({self.error[name][i]:+.3%})" for name in MEASURED]
            ended = "" if outcome == WALKED else f", {outcome}"
            rows.append([*row, f"{self.penetration[i]:.1e}", f"{self.strides[i]}{ended}"])
        return "\n".join([f"{title}, in {self.simulator}", *in_columns(rows)])


def compare(
    controller: ControllerLike | Gait,
    scene: SceneLike | None = None,
    *,
    simulator: str = "mujoco",
    timesteps: Sequence[float] = TIMESTEPS,
    softness: Sequence[float | None] = (SOFTNESS,),
    strides: int = 40,
) -> Comparison:
    """Walk in another simulator, and compare the gait with the exact one.

    A walk begins on the exact gait. Its quantities are means over the second half of its strides,
    in whole periods of the gait.
    An unstable gait is therefore compared over few strides only.

    Args:
        controller: A `Gait`, or any controller of `stride_map`, such as the name of a policy;
            "passive" is a passive walker.
        scene: A `Scene`, its name, or a mapping of its arguments; the gait's or the controller's
            own if None, which an `OptimalGait` does not have. Its disturbances are left out.
        simulator: "mujoco".
        timesteps: Timesteps in s.
        softness: Time constants of contacts in timesteps, from 2 on; None is the simulator's own
            contacts.
        strides: Largest number of strides of each walk.

    Raises:
        ValueError: if there is no such simulator, the scene has features that it lacks, a gait is
            not one on a plane, or an argument is out of its range.
        ImportError: if the simulator is not installed.
        GaitNotFound: if there is no exact gait.

    Example:
        >>> import gym_passive_walker as gpw
        >>> found = gpw.compare(gpw.find_gait("lab", 0.036), timesteps=[2e-3], strides=20)
        >>> bool(abs(found.error["step_period"][0]) < 0.01)
        True
    """
    if simulator not in SIMULATORS:
        raise ValueError(
            f"simulator must be {' or '.join(map(repr, SIMULATORS))}, not {shown(simulator)}"
        )
    count = whole(strides, "strides", 2, 100_000)
    runs = [
        checked_steps(step, soft)
        for soft in _several(softness, "softness")
        for step in _several(timesteps, "timesteps")
    ]
    policy, there, gait = _gait_of(controller, scene)
    own = gait.dimensionless
    exact = {
        "step_period": own.step_period,
        "stance_angle": np.mean(_starts(gait)[:, 0]),
        "step_length": own.step_length,
        "speed": own.speed,
        "cost_of_transport": gait.cost_of_transport,
    }
    walks = []
    with progress("walks", len(runs)) as done:
        for step, soft in runs:
            walks.append(_walk(policy, there, step, soft, count, len(_starts(gait))))
            done()
    found, depths, taken, outcomes = zip(*walks, strict=True)
    return Comparison(
        simulator=f"MuJoCo {library().__version__}",
        controller_name=policy_name(policy),
        scene=there,
        exact={name: float(value) for name, value in exact.items()},
        timestep=np.array([step for step, _ in runs]),
        softness=np.array([math.nan if soft is None else soft for _, soft in runs]),
        found={name: np.array([each[name] for each in found]) for name in MEASURED},
        penetration=np.array(depths),
        strides=np.array(taken),
        outcome=list(outcomes),
    )


def _several(given: Any, name: str) -> list[Any]:
    """Return the items of a sequence.

    Raises:
        ValueError: if it is none, or empty.
    """
    many = isinstance(given, Sequence) or (isinstance(given, np.ndarray) and given.ndim > 0)
    found = [*given] if many and not isinstance(given, str) else []
    if not found:
        raise ValueError(f"{name} must be a list of numbers, as [0.002, 0.001], not {shown(given)}")
    return found


def _gait_of(controller: Any, scene: SceneLike | None) -> tuple[Policy, Scene, Gait | OptimalGait]:
    """Return a controller, its scene that begins on the exact gait, and that gait."""
    gait: Gait | OptimalGait
    if isinstance(controller, Gait):
        gait, strides = check_plane(controller, "a simulator walks"), controller.stride_map
        if scene is not None:
            raise ValueError("a gait has its walker, slope and controller: leave out scene")
        if strides.passive:
            own = {"walker": gait.walker, "slope": gait.slope}
            stub = strides.end_on_toe_stub
            policy, there = acting("passive", make_scene(own, end_on_toe_stub=stub))
        else:
            policy, there = acting_as(strides, gait.slope)
    elif isinstance(controller, OptimalGait):
        gait, (policy, there) = controller, acting(controller, scene)
    else:
        policy, there = acting(controller, scene, calmed=calm)
        passive = policy_name(policy) == "passive"
        gait = find_gait(map_in(there, None if passive else policy))
    there = calm(there)
    start = tuple(gait.dimensionless.state.tolist())
    return policy, make_scene(there, start=start), gait


def _starts(gait: Gait | OptimalGait) -> NDArray[np.float64]:
    """States at which the strides of one period begin, (strides, 6)."""
    first = gait.state[None]
    return np.vstack([first, gait.cycle.state[:-1]]) if isinstance(gait, Gait) else first


def _walk(
    policy: Policy,
    scene: Scene,
    timestep: float,
    softness: float | None,
    count: int,
    period: int,
) -> tuple[dict[str, float], float, int, str]:
    """Walk in MuJoCo; returns means, penetration, number of strides and outcome.

    The means are over whole periods, if there is one.
    """
    env = PassiveWalkerMujocoEnv(scene, timestep=timestep, softness=softness)
    length = env.walker.leg_length
    observation, _ = env.reset(seed=0)
    memory, first = None, np.ones(1, bool)
    rows: list[tuple[float, ...]] = []
    depth, outcome = 0.0, WALKED
    while len(rows) < count:
        action, memory = policy.predict(observation[None], memory, first, deterministic=True)
        observation, _, ended, _, info = env.step(np.asarray(action)[0])
        first = np.zeros(1, bool)
        if ended:
            outcome = info["outcome"].replace("_", " ")
            break
        depth = max(depth, env.batch.loop.depth / length)
        if info["outcome"] == "heelstrike":
            energy = info["cost_of_transport"] * info["step_length"]
            rows.append((info["step_period"], env.state[0], info["step_length"], energy))
    if not rows:
        return dict.fromkeys(MEASURED, math.nan), depth, 0, outcome
    late = rows[len(rows) // 2 :]
    late = late[len(late) % period if len(late) >= period else 0 :]
    duration, angle, way, energy = np.mean(late, axis=0).tolist()
    found = duration, angle, way, way / duration, energy / way
    return dict(zip(MEASURED, found, strict=True)), depth, len(rows), outcome
