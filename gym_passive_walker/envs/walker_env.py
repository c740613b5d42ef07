"""`PassiveWalker-v0`: one walker, one agent."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import seed_number
from gym_passive_walker._tools.extras import need
from gym_passive_walker.envs import interface, saved, task
from gym_passive_walker.envs.batch import RESET_OPTIONS, Batch
from gym_passive_walker.envs.frames import frame
from gym_passive_walker.envs.infos import lane_values
from gym_passive_walker.envs.interface import NO_STRIDE
from gym_passive_walker.envs.one_thread import one_thread, refuse_second
from gym_passive_walker.gaits.scenes.scene import SceneLike, make_scene
from gym_passive_walker.models.walkers import Walker


class PassiveWalkerEnv(
    interface.EnergyCost, gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]
):
    """A passive walker with a hip actuator, on exact hybrid dynamics.

    ## Description

    A planar walker with two legs, with or without knees, walks down a slope or on level ground. On
    a gentle slope it can walk without an actuator: gravity supplies the energy that the collisions
    of knee and heel lose (McGeer; Garcia, Chatterjee and Ruina). This environment adds a hip
    torque. The agent has to walk far with little energy.

    Between collisions the equations of motion are integrated with error control. The time of each
    collision is found as the root of an event function; collisions are plastic. All numbers that
    an agent observes are dimensionless. Their units are the leg length l, the total mass m and
    sqrt(l/g), so that one agent fits any walker. A stride is one step, heelstrike to heelstrike.

    ## Action Space

    A `Box(-1.0, 1.0, (1,), float32)`: the hip torque between stance leg and swing thigh, as a share
    of `max_hip_torque` (in m g l), positive when it swings the free leg forward. Actions outside
    the box are clipped. A non-finite action raises a `ValueError`.

    With `control="tick"` an action is held for `tick`, or until the heelstrike if that comes first;
    a control step begins with each stride. With `control="stride"` it is held from one heelstrike
    to the next. The legs of the simplest walker have no mass: its torque is per unit of foot mass,
    and costs nothing.

    With `actions=("hip", "push_off", "ankle")`, or some of them in any order, an action has one
    number for each. "push_off", from 0 to 1, is an impulse along the stance leg just before
    heelstrike, as a share of `max_push_off`; the last action of a stride determines it. "ankle" is
    a torque between ground and stance leg, as a share of `max_ankle_torque`, for walkers with point
    feet. It is positive when it tips the walker forward.

    ## Observation Space

    A `Box` of shape (8,), float32, the same for all walkers and controls:

    | Num | Observation                                    | Min   | Max  |
    | --- | ---------------------------------------------- | ----- | ---- |
    | 0   | stance leg's angle (rad)                       | -pi/2 | pi/2 |
    | 1   | swing thigh's angle (rad)                      | -pi   | pi   |
    | 2   | swing shank's angle (rad)                      | -pi   | pi   |
    | 3   | stance leg's angular velocity, times sqrt(l/g) | -10   | 10   |
    | 4   | swing thigh's, times sqrt(l/g)                 | -10   | 10   |
    | 5   | swing shank's, times sqrt(l/g)                 | -10   | 10   |
    | 6   | 1 if the swing knee is locked, 0 if it is free | 0     | 1    |
    | 7   | slope (rad), positive downhill                 | -pi/2 | pi/2 |

    A `command` adds one number, from 0 to 1. A `terrain_lookahead` adds two numbers for each
    foothold: the change of height from -1 to 1 leg lengths, and that of slope from -pi/2 to pi/2.
    `observe_body` adds parameters of the walker at the end: lengths over l, masses over m,
    stiffnesses over m g l.

    Angles are measured from the normal of the ground, positive where the hip is uphill of the foot;
    the stance angle decreases during a stride. Angular velocities beyond their bounds are clipped.
    The legs swap names at heelstrike: "stance" is always the leg on the ground.

    ## Rewards

    At each step: distance - `energy_weight` * energy.

    - distance: displacement of the hip along the slope, in leg lengths. A stride that ends without
      heelstrike does not count: its distance is subtracted again at the fall. So the distances of
      an episode add up to the completed strides, and a dive has no value.
    - energy: work of all actuators over m g l. Work of hip and ankle is absolute, positive or net,
      as `energy` says. The work of a push-off, 1/2 mu P^2, always counts in full.

    A fall has no other price. With a `command`, a stride loses
    `command_weight` * | length - command * period |, but never more than its length. At the default
    weight of 2, a walker at the commanded speed v earns v in each unit of time. It earns 3 s - 2 v
    at a lower speed s, and 2 v - s at a higher one. Energy is subtracted from that.

    The default task counts as solved from a mean return of 47.3 (`reward_threshold` of its spec).
    This is nine tenths of the way from the passive walker's return, 6.3, to the optimal gait's,
    51.9.

    ## Info

    Every step and every reset have the same entries: NumPy numbers, and the outcome's name.

    | Entry                                           | Of         | Quantity                      |
    | ----------------------------------------------- | ---------- | ----------------------------- |
    | "distance", "energy"                            | each step  | terms of the reward           |
    | "episode_distance", "episode_energy", "strides" | each step  | sums in the episode           |
    | "outcome"                                       | stride end | "heelstrike", or see below    |
    | "step_length"                                   | stride end | over l                        |
    | "step_period", "kneestrike_time"                | stride end | over sqrt(l/g); 0: no knees   |
    | "speed"                                         | stride end | over sqrt(g l)                |
    | "cost_of_transport"                             | stride end | gravity and all actuators     |
    | "gravity_cost"                                  | stride end | work of gravity               |
    | "hip_cost", "net_hip_cost"                      | stride end | hip work, as charged and net  |
    | "ankle_cost", "net_ankle_cost", "push_off_cost" | stride end | work of the other actuators   |
    | "collision_cost", "friction_cost"               | stride end | energy lost                   |
    | "command"                                       | each step  | over sqrt(g l)                |
    | "pushes"                                        | each step  | number so far                 |
    | "push_work", "episode_push_work"                | each step  | over m g l                    |
    | "normal_force", "normal_impulse"                | each step  | least, m g and m sqrt(g l)    |
    | "stance_knee_torque", "stance_knee_impulse"     | each step  | least, m g l, m l sqrt(g l)   |
    | "clearance"                                     | each step  | least, over l                 |
    | "friction"                                      | each step  | largest coefficient required  |
    | "randomized"                                    | each step  | drawn values by name          |

    Entries of a stride are 0, and "outcome" is "", in steps that end no stride and no episode.
    Vector environments and `PassiveWalkerVecEnv` report the outcome "time_limit" where they
    truncate an episode; here a wrapper of Gymnasium truncates, which sets no outcome.

    Costs are energies over weight times step length. "command", "pushes" and their work are in the
    info of scenes that have them. Six others are there with `constraints`, and "randomized" with
    `domain_randomization`. A least value
    is infinite if the step had no such event; "friction" is infinite if the ground would have had
    to pull.

    ## Starting State

    Just after a heelstrike, at the walker's passive gait on the slope of the episode. If there is
    no such gait, it is the gait on the nearest of a few gentle slopes. Angle, stance angular
    velocity and swing angular velocities are each multiplied by a number drawn from
    1 - `reset_noise_scale` to 1 + `reset_noise_scale`. A system begins with its gait's coordinates,
    so that its contacts are where they are after an impact; one number multiplies its first rate
    and one all others. The slope is drawn first, if it is a range.
    With `domain_randomization`, the gait is that of the walker without the changes, at the slope
    that is drawn.
    `reset(options={"state": ..., "slope": ...})` sets either of them instead. This state has the
    [stance, thigh, shank] angles in rad and their angular velocities in the walker's own units
    (rad/s); the argument `start` has them in units of sqrt(g/l).

    ## Episode End

    Termination, with its reason in `info["outcome"]`:

    - "fell_forward", "fell_backward": the stance leg lies on the ground.
    - "swing_overrotation": the swing leg has rotated beyond upright.
    - "stubbed_toe": a locked swing leg is below the ground, if `end_on_toe_stub`. A free knee may
      let the foot scuff by a fraction of a percent of the leg, as in Garcia (1999). Without this
      rule agents learn to lock the knee early and move a stiff leg through the floor.
    - "knee_not_locked": the foot came down in front before the knee had locked.
    - "stalled": no heelstrike within `max_stride_time`.
    - "diverged": the state left the range of numbers; no ordinary action does this.
    - "lost_contact", "slipped", "stance_knee_gave_way", "scuffed": if `constraints` has "end" for
      the check "contact", "friction", "knee lock" or "scuffing". The stride does not count.
    - "stopped": the scene's own `terminated` returned True.

    Truncation: after 4000 steps (`max_episode_steps` of `gymnasium.make`).

    ## Arguments

    ```python
    >>> import gymnasium as gym
    >>> import gym_passive_walker
    >>> env = gym.make("PassiveWalker-v0")  # walker C on level ground
    >>> env = gym.make("PassiveWalker-v0", walker="lab", slope=(0.02, 0.04), control="stride")
    >>> env = gym.make("gym_passive_walker:PassiveWalker-v0", scene="steep")  # imports by itself

    ```

    `scene` is the name of a scene in `gym_passive_walker.envs.scene.SCENES`: "level" (the default),
    "steep", "rolling", "lab", "rough", "pushed", "push-off", "commanded" or "anywhere". The other
    arguments change it.

    | Argument               | Default             | What                                       |
    | ---------------------- | ------------------- | ------------------------------------------ |
    | `walker`               | "C"                 | preset, `Walker`, or mapping of parameters |
    | `system`               | None                | a `gym_passive_walker.System` instead      |
    | `slope`                | 0.0                 | rad, positive downhill; or (low, high)     |
    | `control`              | "tick"              | "tick" or "stride"                         |
    | `tick`                 | 0.1                 | length of a control step, in sqrt(l/g)     |
    | `actions`              | ("hip",)            | "hip", "push_off", "ankle"; or controls    |
    | `max_hip_torque`       | 0.05 (stride: 0.03) | torque of action 1, in m g l; 0 is passive |
    | `max_ankle_torque`     | 0.05                | ankle torque of action 1, in m g l         |
    | `max_push_off`         | 0.2                 | push-off of action 1, over m sqrt(g l)     |
    | `energy_weight`        | 10.0                | leg lengths that a unit of energy is worth |
    | `energy`               | "absolute"          | "absolute", "positive" or "net" work       |
    | `end_on_toe_stub`      | True with knees     | whether a stubbed toe ends the episode     |
    | `reset_noise_scale`    | 0.10 (stride: 0.05) | relative range of initial states           |
    | `domain_randomization` | {}                  | parameter: what each reset draws           |
    | `randomization_pool`   | None                | number of draws that it chooses from       |
    | `observe_body`         | ()                  | parameters of the walker that are observed |
    | `start`                | None                | dimensionless state instead of the gait    |
    | `max_stride_time`      | 20.0                | limit of a stride, in sqrt(l/g)            |
    | `tolerance`            | 1e-8                | error of the dynamics                      |
    | `pushes`               | {}                  | {"rate": ..., "impulse": (low, high)}      |
    | `observation_noise`    | 0.0                 | std of observations; or of each entry      |
    | `action_noise`         | 0.0                 | std of actions                             |
    | `action_delay`         | 0                   | control steps before an action acts        |
    | `command`              | None                | speed over sqrt(g l); or (low, high)       |
    | `command_weight`       | 2.0                 | price of a leg length beside the command   |
    | `constraints`          | {}                  | check: "ignore", "report" or "end"         |
    | `terrain`              | None                | {"rough": {"height_std": ...}} or another  |
    | `terrain_lookahead`    | 0                   | footholds ahead that are observed          |
    | `friction`             | 0.8                 | coefficient of foot and ground             |
    | `knee_latch`           | 0.0                 | torque that holds the stance knee, in m g l|
    | `scuff_depth`          | 0.01                | largest depth of the swing foot, in l      |
    | `reward`               | None                | function of a `Transition`, or weights     |
    | `observation`          | None                | function of a `Transition`; or two groups  |
    | `terminated`           | None                | function of a `Transition`: ends episodes  |
    | `reward_terms`         | False               | whether `info` has the reward's terms      |
    | `render_mode`          | None                | "human", "rgb_array" or None               |

    `gymnasium.make_vec` takes the same arguments, and simulates all environments in one kernel.

    `reward`, `observation` and `terminated` are functions of a `gym_passive_walker.Transition`, the
    result of one control step. They replace the reward and the observation above; `terminated` ends
    episodes in addition to the rules above. A function is compiled if it uses arithmetic,
    comparisons and `gym_passive_walker.math` alone; others are called after each step. A condition
    counts as 1.0 or 0.0 in arithmetic. Values that a function holds are read once, when the
    environment is made or copied; `set_scene(reward=...)` reads them again. Of a reward, weights of
    terms by name are enough: `reward={"distance": 1.0, "energy": -10.0, "alive": 0.1}`.

    ```python
    >>> from gym_passive_walker.math import exp, maximum, where
    >>> def track_speed(step):  # at heelstrikes, because the speed varies within a stride
    ...     speed = step.step_length / maximum(step.step_period, 1e-6)
    ...     closeness = exp(-(((speed - 0.15) / 0.03) ** 2))
    ...     return where(step.heelstrike, step.step_length * closeness, 0.0)
    >>> env = gym.make("PassiveWalker-v0", reward=track_speed)

    ```

    With `system`, a `gym_passive_walker.System` walks. The actions are its controls, the
    observation is its state and the slope.

    `gym_passive_walker.explain(env)` prints observation, action, reward and termination as tables,
    and the arguments of the scene that differ from those above.
    `env.unwrapped.set_scene(slope=0.02)` changes arguments for the episodes that follow.

    `PassiveWalkerEasy-v0` is the same environment with another default scene, "level" with
    `reset_noise_scale=0.05` and ten times the reward. PPO and SAC of stable-baselines3 with default
    hyperparameters learn to walk from all of its initial states. It counts as solved from a mean
    return of 476.

    ## Version History

    - v0: first version.

    ## References

    - M. Garcia, A. Chatterjee, A. Ruina, "Efficiency, speed, and scaling of two-dimensional
      passive-dynamic walking", Dynamics and Stability of Systems 15 (2000) 75-99.
    - T. McGeer, "Passive dynamic walking", Int. J. Robotics Research 9 (1990) 62-82.
    """

    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": 30}  # noqa: RUF012

    def __init__(
        self,
        scene: SceneLike = "level",
        *,
        render_mode: str | None = None,
        **changes: Any,
    ) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(
                f"render_mode must be one of {self.metadata['render_modes']} or None, "
                f"not {render_mode!r}"
            )
        self.scene = make_scene(scene, **changes)
        if render_mode is not None:
            need("pygame", "render")
        self.render_mode = render_mode
        self.batch = Batch(self.scene)
        self.observation_space = interface.observation_space(self.scene, self.batch.custom)
        self.action_space = interface.action_space(self.scene)
        self.token = self.batch.token
        self.metadata = {**self.metadata, "render_fps": self.scene.frames_per_second}
        self._shape = (len(self.scene.actions),)
        self._ready = False
        self._between = NO_STRIDE.copy()  # the `info` of steps within a stride
        self._screen: Any = None

    @one_thread
    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Seed of the random numbers of this and the following episodes.
            options: "state" and "slope" instead of random ones. The state is just after a
                heelstrike: [stance, thigh, shank] angles in rad and their angular velocities in rad
                per unit of the walker's time. The slope is in rad.

        Returns:
            The observation; and `info` as from `step`, with zeros where there is no value yet.

        Raises:
            ValueError: if an option is unknown or outside its range.
            RuntimeError: if another thread is using this environment.
        """
        super().reset(seed=None if seed is None else seed_number(seed))
        if self.np_random not in self.batch.randoms:
            self.batch.randoms = [self.np_random]
        observation = np.empty(self.batch.observation_size, np.float32)
        self.batch.start((0,), observation, interface.reset_options(options, RESET_OPTIONS))
        self._ready, self.batch.unfinished = True, False
        self._between = NO_STRIDE.copy()
        if self.render_mode == "human":
            self._draw()
        info: dict[str, Any] = NO_STRIDE.copy()
        if self.batch.scene_infos:
            self._add_values(info, np.zeros(1, bool))
        return self.batch.in_groups(observation), info

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Hold the controls of an action for a control step: a `tick`, or a stride.

        Raises:
            ValueError: if the action is not a finite number, or its shape is wrong; nothing has
                changed then.
            ResetNeeded: if no episode is under way.
            RuntimeError: if another thread is using this environment.
        """
        token, mine = self.token, True
        try:  # `one_thread` by hand
            try:
                token.pop()
            except IndexError:
                mine = False
                refuse_second(self)
            act: NDArray[np.floating] = action
            if type(action) is not np.ndarray or action.dtype.kind != "f":
                act = interface.numbers(action, self.scene.actions)
            if act.shape != self._shape:
                raise ValueError(f"the action must have shape {self._shape}, not {act.shape}")
            batch = self.batch
            if batch.unfinished or not self._ready:
                raise ResetNeeded(
                    "no episode is under way, or an error interrupted its last step: call reset "
                    "first"
                )
            struck, ended = batch.step_alone(act)
            entry_point = batch.entry_point
            words, info = entry_point.words, self._between.copy()
            info["distance"], info["energy"] = words[0], words[1]  # task.EVERY_STEP
            info["episode_distance"], info["episode_energy"] = words[2], words[3]
            if struck or ended:
                strides, outcome = entry_point.outcomes
                info |= zip(task.EVERY_STRIDE, words[4:-2], strict=True)
                info["strides"], info["outcome"] = strides, interface.OUTCOMES[outcome]
                self._between["strides"] = strides
                self._ready = not ended
            if batch.scene_infos:
                self._add_values(info)
            batch.unfinished = False
            if self.render_mode == "human":
                self._draw()
            observation, reward = batch.observations.copy(), entry_point.results[0].item()
            return batch.in_groups(observation), reward, ended > 0, False, info
        finally:
            if mine:
                token.append(None)

    def _add_values(self, info: dict[str, Any], stepped: NDArray[np.bool_] | None = None) -> None:
        """Add the entries that depend on the scene; `stepped` as for `Batch.info_values`."""
        outcome = info.pop("outcome")
        info |= lane_values(self.batch.info_values(stepped), 0)
        info["outcome"] = outcome

    @one_thread
    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """Draw the present state in a window ("human"), or return it as an array ("rgb_array")."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() needs a render_mode: gym.make(..., render_mode=...)")
            return None
        if not self.batch.randoms:
            raise ResetNeeded("no episode has begun: call reset first")
        return self._draw()

    def _draw(self) -> NDArray[np.uint8] | None:
        assert self.render_mode is not None
        if self._screen is None or self._screen.walker != self.walker:
            from gym_passive_walker.pictures.screen import Screen

            self.close()
            self._screen = Screen(self.walker, self.render_mode)
        self._screen.fps = self.metadata["render_fps"]
        return frame(self.batch, 0, self._screen)

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._screen is not None:
            self._screen.close()
            self._screen = None

    @property
    def walker(self) -> Walker:
        """The walker of this episode."""
        return self.batch.walkers[0]

    @property
    def slope(self) -> float:
        """The slope of this episode, in rad."""
        return float(self.batch.ledger["slope"][0])

    @property
    @one_thread
    def state(self) -> NDArray[np.float64]:
        """Angles in rad and angular velocities in the walker's units, (6,).

        The order is stance, thigh, shank. Of a `System` the shape is (2 m,).
        """
        return self.batch.states[0]

    @one_thread
    def set_slope(self, slope: float) -> NDArray[np.float32]:
        """Set the slope of the stride that begins, for rough ground.

        Requires the beginning of a stride, just after a heelstrike or a reset. The slope applies
        until the next call or the next reset.

        Args:
            slope: Slope in rad, positive downhill.

        Returns:
            The observation, which contains the new slope.

        Raises:
            ResetNeeded: if no episode is under way.
            ValueError: if the slope is invalid, or the walker is within a stride; nothing has
                changed then.
        """
        if self.batch.unfinished or not self._ready:
            raise ResetNeeded("no episode is under way: call reset first")
        self.batch.set_slopes(slope, np.ones(1, bool))
        return self.batch.in_groups(self.batch.observe()[0])

    @one_thread
    def set_scene(self, scene: SceneLike | None = None, **changes: Any) -> None:
        """Change the scene, for example in a curriculum.

        The present episode ends; call `reset`.

        Args:
            scene: Another scene; the present one if None.
            **changes: Arguments of the scene that change.

        Raises:
            SceneError: if the scene is unknown, or its observations or actions differ; nothing has
                changed then.
        """
        self._become(self._changed(scene, changes))
        self._ready = False

    @property
    def reward_terms(self) -> dict[str, float]:
        """Terms of the last reward by name; the reward is their sum; zero after a reset."""
        return {name: term.item() for name, term in self.batch.reward_terms().items()}

    @property
    @one_thread
    def contact(self) -> float:
        """Contact point of the stance foot along the slope, in the walker's units of length."""
        return self.batch.contact(0).x

    @one_thread
    def get_state(self) -> dict[str, Any]:
        """Return a copy of everything that determines later steps and resets."""
        return {**self.batch.get_state(), "ready": self._ready and not self.batch.unfinished}

    @one_thread
    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a state from `get_state`, of this or an equal environment.

        The time limit belongs to a wrapper, and its count does not change.

        Raises:
            StateError: if the state is damaged, or of another environment; nothing has changed
                then.
            RuntimeError: if another thread is using this environment.
        """
        found = self.batch.checked(state, ready=())
        ready = bool(found["ready"])
        if ready and saved.over_in(found["ledger"]).any():
            raise saved.StateError("the state is 'ready', and its episode has ended")
        if not self.batch.randoms:
            self.batch.randoms = [self.np_random]
        self.batch.put_back(found)
        self._ready = ready
        self._between = {**NO_STRIDE, "strides": self.batch.entry_point.outcomes[0]}
        self.batch.unfinished = False

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_screen": None}
