"""Scenes: configurations of the environments."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, TypeAlias

import numpy as np

from gym_passive_walker._tools.arguments import (
    boolean,
    check_slope,
    check_tolerance,
    near,
    real_array,
    shown,
    unknown,
    whole,
)
from gym_passive_walker._tools.console import cut
from gym_passive_walker._tools.loading import is_file
from gym_passive_walker.gaits.scenes.checks import (
    SceneError,
    UnknownArgumentError,
    bounded,
    check_point_feet,
    checked,
    checked_constraints,
    checked_noise,
    checked_pushes,
    several,
    spread,
)
from gym_passive_walker.gaits.scenes.named import resolved
from gym_passive_walker.gaits.scenes.randomization import (
    CURRICULUM,
    OF_STEPS,
    checked_randomization,
    ends_of,
    entries_of,
    of_episodes,
    randomized_names,
)
from gym_passive_walker.gaits.scenes.rewards import (
    FUNCTIONS,
    OWN,
    checked_groups,
    checked_rule,
    observation_parts,
)
from gym_passive_walker.gaits.scenes.rules import ENERGIES
from gym_passive_walker.gaits.terrain import Terrain, terrain_from
from gym_passive_walker.models.model import Actuator, Model, check_heights_only, check_supports
from gym_passive_walker.models.units import observable
from gym_passive_walker.models.walkers import Walker, as_walker, describe

CONTROLS = ("tick", "stride")

FASTEST = 1.0
"""Largest speed over sqrt(g l) at which a stiff leg can keep ground contact."""

_FARTHEST = 1000  # largest number of observed footholds
_LATEST = 10_000  # largest delay of actions, in control steps
OF_OWN_OBSERVATION: dict[str, Any] = {
    "observe_body": (), "observation_noise": 0.0, "terrain_lookahead": 0,
}  # fmt: skip
"""Arguments that have no effect on an observation of the user's own, and their values there."""

_MAX_HIP_TORQUE = {"tick": 0.05, "stride": 0.03}
_PERTURBATION = {"tick": 0.10, "stride": 0.05}


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Configuration of an environment: a walker, its ground, its actuators and the episode's rules.

    All numbers are in the dimensionless units of the walker: lengths in leg lengths l, times in
    sqrt(l/g), torques and energies in m g l (m is the total mass). An argument of None is replaced
    by its default.

    Attributes:
        walker: A walker in a form that `as_walker` takes: a `Walker`, a name, a mapping or a file;
            or a user's `System`. `make_scene` also takes a `System` as `system`.
        slope: Slope in rad, positive downhill; or (low, high), drawn at each reset.
        control: "tick" for a new action every `tick`, and at each heelstrike; "stride" for one
            action from heelstrike to heelstrike.
        tick: Length of a control step in sqrt(l/g); a heelstrike ends it early.
        actions: Actuators, in the order of the action's numbers. "hip" is a torque between the
            legs. "ankle" is a torque between ground and stance leg, for point feet. "push_off" is
            an impulse along the stance leg just before heelstrike, by the stride's last action.
            None is ("hip",), or all controls of a `System`.
        max_hip_torque: Torque of the action 1; 0 is a passive walker. None is 0.05 for ticks and
            0.03 for strides. For the simplest walker, torque per unit of foot mass.
        max_ankle_torque: Ankle torque of the action 1.
        max_push_off: Push-off of the action 1, in units of m sqrt(g l).
        energy_weight: Price of a unit of energy, in leg lengths of distance.
        energy: Actuator work that the reward subtracts: "absolute", "positive" or "net".
        end_on_toe_stub: Whether a locked swing leg below the ground ends the episode. None is True
            for walkers with knees, and for a `System` with such a guard; straight legs always pass
            through the ground.
        reset_noise_scale: Largest relative change of the initial angle and angular velocities; of
            a system, of its rates alone. None is 0.10 for ticks and 0.05 for strides.
        domain_randomization: What each reset draws of the walker's parameters and of some
            arguments of the scene, by name: ``{"foot_radius": 0.1}`` is a uniform factor from 0.9
            to 1.1, ``{"hip_mass": (0.8, 1.2)}`` one from 0.8 to 1.2; see
            `gaits.scenes.randomization`. "curriculum" is a number of episodes in which draws grow.
            Torques and energies of a `System` stay over the weight of the one that is not drawn.
        randomization_pool: Number of walkers from which `domain_randomization` draws, equal in all
            environments; None draws a new walker at each reset.
        observe_body: Parameters of the walker that agents observe, as ``("foot_radius",)``:
            lengths over l, masses over m, stiffnesses over m g l; fields of the `body` of a
            `System`. They are the last entries of the observation.
        start: Initial state on the Poincaré section instead of the passive gait: [stance, thigh,
            shank] angles in rad, then their angular velocities in units of 1/sqrt(l/g).
        max_stride_time: Time in sqrt(l/g) after which a stride without heelstrike has stalled.
        tolerance: Error of the dynamics of a step; see `stride`.
        pushes: Impulses on the hip along the slope (for a `System`, on its centre of mass), at
            random times; none if empty. "rate" is their mean number in a unit of time. "impulse",
            in units of m sqrt(g l) and positive downhill, is a number or a range to draw from.
        observation_noise: Standard deviation of the noise on each observation: one number for
            angles and angular velocities, or one for each entry.
        action_noise: Standard deviation of the noise on each action, as a share of the largest.
        action_delay: Number of control steps between an action and its effect.
        command: Commanded speed over sqrt(g l), or (low, high), drawn at each reset; it is part of
            the observation. None commands nothing.
        command_weight: Price of each leg length by which a stride differs from the commanded
            distance in its time.
        constraints: "ignore", "report" or "end" for each check of `reality_check`: "scuffing",
            "knee lock", "contact" and "friction".
        terrain: Footholds, in a form that `terrain_from` takes: a `Terrain`, a mapping
            such as ``{"rough": {"height_std": 0.01}}``, text or a file; smooth when None.
        terrain_lookahead: Number of footholds ahead that agents observe, by their changes of height
            and slope.
        friction: Coefficient of friction of foot and ground.
        knee_latch: Largest flexion torque in m g l that a latch of the stance knee holds, and in a
            collision the impulse in m l sqrt(g l); 0 is a knee that is pressed on its stop.
        scuff_depth: Largest depth of the swing foot below the ground, in leg lengths.
        reward: The reward instead of the default: a function of a `Transition`, or weights of
            `gaits.scenes.rewards.TERMS` by name: ``{"distance": 1.0, "energy": -10.0}``.
        observation: The observation instead of the default: a function of a `Transition` that
            returns numbers; or ``{"policy": f, "critic": g}``, what actor and critic see: functions
            or "default", of the critic also "randomized", what is drawn, or a row of them.
        terminated: Termination besides falls: a function of a `Transition`.
        reward_terms: Whether `info` has the terms of each reward: "reward_distance" and so on.
    """

    walker: Walker = "C"  # type: ignore[assignment]
    slope: float | tuple[float, float] = 0.0
    control: str = "tick"
    tick: float = 0.1
    actions: tuple[str, ...] = None  # type: ignore[assignment]
    max_hip_torque: float = None  # type: ignore[assignment]
    max_ankle_torque: float = 0.05
    max_push_off: float = 0.2
    energy_weight: float = 10.0
    energy: str = "absolute"
    end_on_toe_stub: bool = None  # type: ignore[assignment]
    reset_noise_scale: float = None  # type: ignore[assignment]
    domain_randomization: dict[str, Any] = field(default_factory=dict)
    randomization_pool: int | None = None
    observe_body: tuple[str, ...] = ()
    start: tuple[float, ...] | None = None
    max_stride_time: float = 20.0
    tolerance: float = 1e-8
    pushes: dict[str, Any] = field(default_factory=dict)
    observation_noise: float | tuple[float, ...] = 0.0
    action_noise: float = 0.0
    action_delay: int = 0
    command: float | tuple[float, float] | None = None
    command_weight: float = 2.0
    constraints: dict[str, str] = field(default_factory=dict)
    terrain: Terrain | None = None
    terrain_lookahead: int = 0
    friction: float = 0.8
    knee_latch: float = 0.0
    scuff_depth: float = 0.01
    reward: Callable[[Any], Any] | dict[str, float] | None = None
    observation: Callable[[Any], Any] | dict[str, Any] | None = None
    terminated: Callable[[Any], Any] | None = None
    reward_terms: bool = False

    def __post_init__(self) -> None:
        """Check every argument, and choose what was left open."""

        def put(name: str, value: Any) -> None:
            object.__setattr__(self, name, value)

        def bound(name: str, low: float, high: float) -> None:
            put(name, bounded(name, getattr(self, name), low, high))

        put("walker", as_walker(self.walker))
        for name in ("constraints", "pushes"):
            if getattr(self, name):
                checked(check_supports, self.walker, name)
        put("slope", self._checked_slope())
        for name, names in (("control", CONTROLS), ("energy", ENERGIES)):
            if getattr(self, name) not in names:
                allowed = " or ".join(map(repr, names))
                raise SceneError(f"{name} must be {allowed}, not {shown(getattr(self, name))}")
        if self.max_hip_torque is None:
            put("max_hip_torque", _MAX_HIP_TORQUE[self.control])
        if self.reset_noise_scale is None:
            put("reset_noise_scale", _PERTURBATION[self.control])
        if self.end_on_toe_stub is None:
            put("end_on_toe_stub", self.walker.toe_stubs)
        for name in ("end_on_toe_stub", "reward_terms"):
            put(name, checked(boolean, getattr(self, name), name))
        if self.end_on_toe_stub and not self.walker.toe_stubs:
            raise SceneError(
                "end_on_toe_stub is a rule for walkers with knees: straight legs always scuff"
                " (equations of a System may have a guard of it)"
            )
        bound("tick", 1e-3, 1e3)
        for name in ("max_hip_torque", "max_ankle_torque", "max_push_off"):
            bound(name, 0.0, 1e3)
        put("actions", self._checked_actions())
        bound("energy_weight", 0.0, 1e6)
        bound("reset_noise_scale", 0.0, 0.9)
        bound("max_stride_time", 0.1, 1e3)
        put("tolerance", checked(check_tolerance, self.tolerance))
        put("observe_body", several("observe_body", self.observe_body, observable(self.walker)))
        put("pushes", checked_pushes(self.pushes))
        size = len(self.walker.observed)
        put("observation_noise", checked_noise(self.observation_noise, size))
        put("action_delay", self._checked_delay())
        if self.command is not None:
            low, high = spread("command", self.command, 0.0, FASTEST)
            put("command", low if low == high else (low, high))
        put("constraints", checked_constraints(self.constraints, knees=bool(self.walker.knees)))
        put("terrain_lookahead", self._checked_preview())
        bound("action_noise", 0.0, 1.0)
        bound("command_weight", 0.0, 1e3)
        bound("friction", 0.0, 1e3)
        bound("knee_latch", 0.0, 1e3)
        bound("scuff_depth", 0.0, 1.0)
        put("domain_randomization", checked_randomization(self))
        put("randomization_pool", self._checked_pool())
        if self.start is not None:
            put("start", self._checked_start())
        for name in FUNCTIONS:
            if name == "observation" and isinstance(self.observation, Mapping):
                draws = bool(self.domain_randomization)
                put(name, checked_groups(self.observation, draws=draws))
                continue
            put(name, checked_rule(name, getattr(self, name)))
        for name, term in (("energy_weight", "energy"), ("command_weight", "command")):
            given = getattr(self, name)
            if isinstance(self.reward, Mapping) and given != getattr(type(self), name):
                raise SceneError(
                    f"{name}={given:g} has no effect, since reward has its own weights: give "
                    f"the weight of {term!r} there"
                )
        weights = self.reward if isinstance(self.reward, Mapping) else {}
        if "command" in weights and self.command is None:
            raise SceneError(
                "reward has a weight of 'command', and this scene commands no speed: give it a "
                "command, or leave the weight out"
            )
        if "push_off_work" in weights and "push_off" not in self.actions:
            raise SceneError(
                "reward has a weight of 'push_off_work', and no action of this scene pushes off: "
                "give actions with 'push_off', or leave the weight out"
            )
        for name, none in OF_OWN_OBSERVATION.items():
            if getattr(self, name) != none and not self.shows_own:
                raise SceneError(
                    f"{name} changes the environment's own observation, and this scene has "
                    f"another: leave out observation, or choose {name}={none!r}"
                )

    @property
    def groups(self) -> dict[str, Any] | None:
        """Parts of an observation for actor and critic; None if both see the same."""
        return self.observation if isinstance(self.observation, dict) else None

    @property
    def shows_own(self) -> bool:
        """Whether the environment's own observation is observed."""
        groups = self.groups
        if groups is None:
            return self.observation is None
        return any(part == OWN for _, part in observation_parts(groups))

    def _checked_slope(self) -> float | tuple[float, float]:
        """Return the slope or the range of slopes, in rad, after a check."""
        bounds = np.empty(0)
        try:
            bounds = np.atleast_1d(check_slope(self.slope))
        except (TypeError, ValueError):
            pass  # raises the error below
        if bounds.shape not in ((1,), (2,)) or bounds[0] > bounds[-1]:
            raise SceneError(
                "slope must be an angle in rad between -pi/2 and pi/2, or a range of them as "
                f"(low, high), not {shown(self.slope)}"
            )
        low, high = bounds[[0, -1]].tolist()
        return low if len(bounds) == 1 else (low, high)

    def _checked_actions(self) -> tuple[str, ...]:
        """Return the names of the actions after a check."""
        channels = tuple(name for name in self.channels if name not in self.walker.absent)
        if self.actions is None:
            return tuple(each.name for each in self.walker.actuators if each.usual)
        actions = several("actions", self.actions, channels, least=min(len(channels), 1))
        checked(check_point_feet, actions, self.walker)
        return actions

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of possible actions."""
        return tuple(each.name for each in self.walker.actuators)

    def actuator(self, channel: str) -> Actuator:
        """Return the actuator of a channel."""
        return self.walker.actuators[self.channels.index(channel)]

    def largest(self, channel: str) -> float:
        """Return the control or impulse of the action 1 in a channel; the largest that is drawn."""
        limit = self.actuator(channel).limit
        if not isinstance(limit, str):
            return float(limit)
        return self.ends(limit)[1] * recorded_weight(self.walker)

    def ends(self, name: str) -> tuple[float, float]:
        """Return the smallest and the largest value of an argument that can be drawn."""
        own: Any = getattr(self, name)
        if isinstance(own, tuple):
            return own
        given = self.domain_randomization
        return ends_of(entries_of(given), name, own, grows=CURRICULUM in given)

    @property
    def randomized(self) -> tuple[str, ...]:
        """Names of all parameters that `domain_randomization` draws."""
        return randomized_names(self.domain_randomization)

    def least(self, channel: str) -> float:
        """Return the smallest action in a channel."""
        return self.actuator(channel).least

    def _checked_pool(self) -> int | None:
        """Return the number of walkers of the pool, or None, after a check."""
        if self.randomization_pool is None:
            return None
        if not self.domain_randomization:
            raise SceneError(
                "randomization_pool is a number of walkers of domain_randomization: give both"
            )
        return checked(whole, self.randomization_pool, "randomization_pool", most=2**31)

    def _checked_preview(self) -> int:
        """Set the terrain, and return the number of observed footholds, after a check."""
        object.__setattr__(self, "terrain", checked(terrain_from, self.terrain))
        if self.terrain is not None:
            slopes = *self.terrain.slopes, self.terrain.slope_std
            checked(check_heights_only, self.walker, slopes)
        lookahead = checked(
            whole, self.terrain_lookahead, "terrain_lookahead", least=0, most=_FARTHEST
        )
        if lookahead and self.terrain is None:
            raise SceneError(
                "terrain_lookahead shows footholds of a terrain: give one, or terrain_lookahead=0"
            )
        return lookahead

    def _checked_delay(self) -> int:
        """Return the delay of actions in control steps after a check."""
        try:
            return whole(self.action_delay, "action_delay", least=0, most=_LATEST)
        except ValueError as error:
            raise SceneError(f"{error} (of steps)") from None

    def _checked_start(self) -> tuple[float, ...]:
        """Return the initial state after a check."""
        try:
            start = real_array(self.start, "start", "numbers")  # type: ignore[arg-type]
        except ValueError:
            start = np.empty(0)
        if start.shape != (size := self.walker.size,):
            raise SceneError(
                f"start must be {size} finite numbers, {', '.join(self.walker.state_names)}, not "
                f"{shown(self.start)}"
            )
        return tuple(start.tolist())

    @property
    def frames_per_second(self) -> int:
        """Control steps per second of the walker's time; 2 if each step is a stride."""
        if self.control == "stride":
            return 2
        return max(1, round(1.0 / (self.tick * self.walker.time_unit)))


def recorded_weight(walker: Any) -> float:
    """Return the weight of a walker in the unit of its records; 1 for a `Walker`."""
    return walker.weight / walker.units.force


def kept_argument(name: str, value: Any) -> Any:
    """Return an argument of a scene for a saved file: the content of a walker or terrain file.

    The file itself can change or move before a sweep or a training continues.

    Args:
        name: Name of the argument.
        value: Value of the argument; only walkers and terrains are converted.

    Raises:
        ValueError: if the value is no valid walker or terrain.
        ImportError: if the file is YAML and pyyaml is not installed.
    """
    if name == "walker" and (isinstance(value, Walker) or is_file(value)):
        walker = as_walker(value)
        return asdict(walker) | ({"title": walker.title} if walker.title else {})
    if name == "terrain" and (isinstance(value, Terrain) or is_file(value)):
        return asdict(terrain_from(value))  # type: ignore[arg-type]
    return value


UNDISTURBED: dict[str, Any] = {
    "pushes": {}, "observation_noise": 0.0, "action_noise": 0.0, "action_delay": 0,
    "constraints": {},
    "terrain": None, "terrain_lookahead": 0,
}  # fmt: skip
"""Arguments of a scene without disturbances."""

CALM = UNDISTURBED | {"command": None}
"""Arguments of a scene without disturbances and without a command."""

_BODIES = dict.fromkeys(
    ("foot_radius", "shank_com", "shank_gyration", "shank_length", "shank_mass", "thigh_com",
     "thigh_gyration"), 0.1,
)  # fmt: skip

SCENES: dict[str, dict[str, Any]] = {
    "level": {},
    "steep": {"slope": 0.11, "control": "stride"},
    "rolling": {"slope": (0.0, 0.06)},
    "lab": {"walker": "lab", "slope": 0.036},
    "rough": {"slope": 0.02, "terrain": {"rough": {"height_std": 0.002}}, "terrain_lookahead": 2},
    "pushed": {"pushes": {"rate": 0.05, "impulse": (-0.03, 0.03)}},
    "push-off": {
        "walker": "D",
        "control": "stride",
        "actions": ("push_off",),
        "max_push_off": 0.1,
        "reset_noise_scale": 0.02,
        "start": (
            0.194588876, -0.194588876, -0.194588876, -0.202960578, -0.187756427, -0.187756427,
        ),
    },
    "commanded": {"command": (0.1, 0.2)},
    "anywhere": {
        "slope": (0.0, 0.02),
        "command": (0.12, 0.18),
        "domain_randomization": _BODIES,
        "observe_body": tuple(_BODIES),
    },
}  # fmt: skip
"""Named scenes, and the motion of their walkers without actuation.

- "level", the default: walker C on level ground. Its steps shrink until it stubs its toe: 91
  strides and 9.5 l without reset noise, 61 strides and 6.3 l on average over the benchmark's
  episodes. Judge it by distance and speed, not by strides.
- "steep": walker C at a slope of 0.11, one torque a stride. Its gait is unstable; it stubs its toe.
- "rolling": walker C on a slope drawn from 0 to 0.06 at each reset.
- "lab": the laboratory's walker at 0.036, where its passive gait is stable.
- "rough": walker C at a slope of 0.02, on footholds with heights of standard deviation 0.002 l; two
  footholds ahead are observed. It stubs its toe, after eight strides on average.
- "pushed": walker C on level ground, with one push in about seven strides.
- "push-off": the simplest walker on level ground, near Kuo's slow gait (2002), in which each stride
  ends with a push-off of 0.04; without push-off it falls backward, mostly in its first stride.
- "commanded": walker C on level ground, with a commanded speed; passively as "level".
- "anywhere": a new body at each reset, seven parameters of walker C within 10 %, on a slope from 0
  to 0.02 with a commanded speed; slope, speed and body are observed.
"""


def undisturbed(scene: Scene, subject: str, calm: Mapping[str, Any] = CALM) -> Scene:
    """Return a scene after a check of its arguments: by default, no disturbances and no command.

    Args:
        scene: The scene.
        subject: Beginning of the error's message.
        calm: Values that the scene must have, by the names of its arguments.

    Raises:
        SceneError: if the scene has other values.
    """
    found = [name for name, value in calm.items() if getattr(scene, name) != value]
    if "action_delay" in calm and not set(OF_STEPS).isdisjoint(scene.randomized):
        found.append("domain_randomization")
        calm = {**calm, "domain_randomization": of_episodes(scene.domain_randomization)}
    if found:
        calmed = ", ".join(f"{name}={calm[name]!r}" for name in found)
        raise SceneError(
            f"{subject} without {' and '.join(found)}, which this scene has: choose "
            f"make_scene(scene, {calmed})"
        )
    return scene


SceneLike: TypeAlias = Scene | str | os.PathLike[str] | Mapping[str, Any]
"""Type of scene arguments; see `make_scene`."""


def seen_by_policy(scene: Scene) -> Scene:
    """Return the scene in which a policy acts: it observes "policy" alone, without the critic's."""
    if scene.groups is None:
        return scene
    part = scene.groups["policy"]
    if part == OWN:
        return make_scene(scene, observation=None)
    return make_scene(scene, observation=part, **OF_OWN_OBSERVATION)


def make_scene(scene: SceneLike = "level", *, trust: bool | None = None, **changes: Any) -> Scene:
    """Return a scene: a given one, a named one, or one from its arguments, with changes.

    Args:
        scene: A `Scene`, one of `SCENES`, a mapping of a scene's arguments, or a JSON, YAML or TOML
            file of them; or "module:function" for a function without arguments that returns one.
        trust: Whether to import modules of the user's. In a mapping or a file, the walker may be
            "module:NAME", and reward, observation and termination "module:function". None imports
            only the module of the scene itself, since others may have written the mapping.
        **changes: Arguments of `Scene` that replace the scene's own; "system", a `System` of the
            user's own, is another name of "walker".

    Raises:
        SceneError: if the scene is unknown, an argument is invalid, or its code is not trusted. For
            an unknown argument it is a `TypeError` as well.
        WalkerError: if the walker is invalid.
        ImportError: if the file is YAML and pyyaml is not installed.
    """
    try:
        return _made(*resolved(scene, changes, trust))
    except SceneError as error:
        if is_file(scene) and not isinstance(error, UnknownArgumentError):
            raise SceneError(f"{cut(os.fsdecode(scene))}: {error}") from None
        raise


def _made(scene: Scene | str | Mapping[str, Any], changes: dict[str, Any]) -> Scene:
    """Return the scene of `make_scene`, after its modules have been imported."""
    known = [f.name for f in fields(Scene)]
    if isinstance(scene, Scene):
        arguments = {name: getattr(scene, name) for name in known}
    elif isinstance(scene, Mapping):
        arguments = dict(scene)
    elif isinstance(scene, str) and scene in SCENES:
        arguments = dict(SCENES[scene])
    elif isinstance(scene, Model):
        raise SceneError(
            f"{describe(scene)} is no scene: give its arguments, walker=... among them"
        )
    else:
        raise SceneError(
            f"no scene {shown(scene)}{near(scene, SCENES)}: give a Scene, a file, or one of "
            f"{', '.join(SCENES)}"
        )
    for given in (arguments, changes):
        if "system" not in given:
            continue
        if "walker" in given:
            raise SceneError("give a scene a walker or a system, not both")
        given["walker"] = given.pop("system")
        if isinstance(given["walker"], Walker) or not isinstance(given["walker"], Model):
            raise SceneError(f"system must be a gpw.System, not {shown(given['walker'])}")
    if said := unknown(arguments, known, "a scene"):
        raise SceneError(said)
    if said := unknown(changes, known, "a scene"):
        strange = [f"unexpected keyword argument {shown(n)}" for n in changes if n not in known]
        raise UnknownArgumentError(f"{', '.join(strange)}: {said}")
    return Scene(**arguments | changes)
