"""`PassiveWalkerMujoco-v0`: the task of `PassiveWalker-v0` with the dynamics of MuJoCo."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import number
from gym_passive_walker.bridge.loop import Loop, library
from gym_passive_walker.bridge.mjcf import SOFTNESS, TIMESTEP
from gym_passive_walker.bridge.rigid import tree_of_walker
from gym_passive_walker.envs import saved, task, transitions
from gym_passive_walker.envs.batch import Batch
from gym_passive_walker.envs.walker_env import PassiveWalkerEnv
from gym_passive_walker.gaits.scenes.checks import checked
from gym_passive_walker.gaits.scenes.randomization import OF_STEPS
from gym_passive_walker.gaits.scenes.scene import Scene, SceneError, make_scene
from gym_passive_walker.models.equations import legs
from gym_passive_walker.models.equations.hybrid import Outcome, State
from gym_passive_walker.models.walkers import Walker

_WIDTH, _HEIGHT = 640, 480  # of pictures, in pixels
_NO_SCREEN: list[str] = []  # why there is no renderer, once there was none
_LACKS = (
    "pushes", "observation_noise", "action_noise", "action_delay", "command", "constraints",
    "terrain",
)  # fmt: skip


def check_features(scene: Scene) -> Scene:
    """Return a scene after a check that MuJoCo's loop has all of its features.

    Raises:
        SceneError: if it lacks one, or the walker is no tree of rigid bodies.
    """
    lacks = [name for name in _LACKS if getattr(scene, name) not in (None, {}, 0, 0.0)]
    lacks += [name for name in ("push_off", "ankle") if name in scene.actions]
    lacks += [f"domain_randomization of {name}" for name in OF_STEPS if name in scene.randomized]
    if not isinstance(scene.walker, Walker):
        lacks.append("a System of your own")
    lacks += ["tolerance"] * (scene.tolerance != Scene.tolerance)
    if lacks:
        raise SceneError(
            f"PassiveWalkerMujoco-v0 does not have {', '.join(lacks)}: leave out what this scene "
            "has of it, or choose PassiveWalker-v0"
        )
    checked(tree_of_walker, scene.walker)
    return scene


class NamedRow:
    """A row of an array with fields, which are attributes: also one named as NumPy's `strides`."""

    def __init__(self, row: Any) -> None:
        self.__dict__["row"] = row

    def __getattr__(self, name: str) -> Any:
        value = self.__dict__["row"][name]
        return value if value.ndim else value.item()

    def __setattr__(self, name: str, value: Any) -> None:
        self.row[name] = value


class NamedRows:
    """An array with fields, as the functions of `task` read it."""

    def __init__(self, array: NDArray) -> None:
        self.array = array

    def __len__(self) -> int:
        return len(self.array)

    def __getitem__(self, place: Any) -> NamedRow:
        return NamedRow(self.array[place])


class MujocoBatch(Batch):
    """A batch of one walker, of which MuJoCo integrates the control steps.

    Records, ledger, starts and rules are those of `Batch`, so that rewards and `info` are too.

    Args:
        scene: The scene.
        timestep: Largest step of MuJoCo, in s.
        softness: Time constant of contacts in timesteps; see `mjcf`.

    Attributes:
        kind: Class of the loop.
        loop: The walker in MuJoCo.
    """

    kind: type[Loop] = Loop

    def __init__(self, scene: Scene, timestep: float, softness: float | None) -> None:
        self.timestep, self.softness = timestep, softness
        super().__init__(check_features(scene))
        self.loop = self._loop(self.walkers[0])

    def _loop(self, walker: Walker) -> Loop:
        return self.kind(
            walker, self.timestep, softness=self.softness, friction=self.scene.friction,
            scuff=bool(self.scene.end_on_toe_stub),
        )  # fmt: skip

    def changed(self, scene: Scene) -> Batch:
        """Return a batch in another scene, before its episodes."""
        super().changed(check_features(scene))
        fresh = MujocoBatch(scene, self.timestep, self.softness)
        fresh.ledger["truncated"] = 1
        return fresh

    def start(
        self,
        lanes: ArrayLike,
        observations: NDArray[np.float32],
        options: Mapping[str, Any] | None = None,
    ) -> None:
        """Begin an episode; see `Batch.start`."""
        super().start(lanes, observations, options)
        if self.loop.walker != self.walkers[0]:
            self.loop = self._loop(self.walkers[0])
        self._place()

    def set_slopes(self, slopes: ArrayLike, lanes: NDArray[np.bool_]) -> None:
        """Set the slope of the stride that begins; see `Batch.set_slopes`."""
        super().set_slopes(slopes, lanes)
        self._place()

    def _place(self) -> None:
        """Place the walker of the record on the ground, just after a heelstrike."""
        slope, contact = float(self.ledger["slope"][0]), self.contact(0).x
        stance = int(self.ledger["strides"][0]) % 2
        self.loop.reset(self.states[0], slope, stance=stance, place=contact)
        self._begin_stride()

    def _begin_stride(self) -> None:
        """Note where the stride begins: its foot, the centre of mass and the energy."""
        loop = self.loop
        self._foot, self._height = loop.foot_along(loop.stance), loop.centre_height
        self._energy, self._work = self._energy_now(), 0.0

    def _energy_now(self) -> float:
        """Kinetic energy and that of springs / (m g l)."""
        body, system, rest = self._body, self.system, State(*[0.0] * 6)
        state = State(*self._dimensionless())
        spring = system.spring_gain(body, rest, state) if system.spring_gain else 0.0
        return float(system.kinetic_energy(body, state) + spring)

    @property
    def _body(self) -> Any:
        return self.system.Body(*self.bodies[0, 0, : len(self.system.Body._fields)])  # type: ignore[attr-defined]

    def _dimensionless(self) -> list[float]:
        return self.walkers[0].units.to_dimensionless(self.loop.state).tolist()

    def _connect(self) -> None:
        """Make the arrays, also as the functions of `task` and `transitions` read them."""
        super()._connect()
        here: dict[str, Any] = {
            name: NamedRows(array) if array.dtype.names else array
            for name, array in self.arrays.items()
        }
        here["phases"] = [
            SimpleNamespace(knee_locked=phase.knee_locked) for phase in self.system.phases
        ]
        if self.custom:  # all is noted; functions are called below
            here["own"] = NamedRows(np.array([(-1, 0, 0, 0, False)], transitions.USER_RULES))
        self._here = SimpleNamespace(**here)

    def step_alone(self, action: NDArray[np.floating]) -> tuple[int, int]:
        """Step the walker; the results go to the arrays of the `EntryPoint`."""
        here, units = self._here, self.walkers[0].units
        here.actions[...] = action
        if task.first_invalid(here, 0, 1) >= 0:
            self.refuse(0)
        self.unfinished = True
        if self.custom:
            transitions.before(here, 0, 1)
        task.apply_action(here, 0, 1, here.actions)
        record, loop = here.records[0, 0], self.loop
        along = loop.hip
        outcome = loop.advance(record.control[0] * units.torque, record.end * units.time)
        record.outcome, record.time = outcome, min(loop.time / units.time, record.end)
        if outcome is Outcome.RUNNING:
            record.time = record.end
        record.moved[0], record.turned[0] = loop.moved, loop.turned
        record.state[:] = self._dimensionless()
        record.phase = len(here.phases) - 1 if loop.locked else 0
        record.knee_time = loop.kneestrike_time / units.time
        record.friction_loss += loop.lost / units.energy
        self._work += record.control[0] * loop.moved
        place = record.place + (loop.hip - along) / units.length
        record.place = place
        if outcome is Outcome.HEELSTRIKE:
            self._end_stride(record, place)
        strides = task.account_step(here, 0)
        if self.custom:
            self._evaluate(here)
        task.write_observation(here, 0)
        self._write_observations(self.observations)
        return strides, int(here.terminated[0])

    def _end_stride(self, record: Any, place: float) -> None:
        """Write the measures of the stride that has ended, and begin the next one."""
        loop, units = self.loop, self.walkers[0].units
        length, weight = units.length, units.force
        record.time, record.knee_time = (time / units.time for time in loop.ended)
        record.passed, record.place = place, legs.hip_travel(self._body, record.state[0])
        record.start[:] = record.state[:3]
        record.step_length = (loop.foot_along(loop.stance) - self._foot) / length
        record.gravity_work = (self._height - loop.centre_height) * weight / units.energy
        spent = record.gravity_work + self._work - record.friction_loss
        record.heel_loss = spent - (self._energy_now() - self._energy)
        self._begin_stride()

    def _evaluate(self, here: Any) -> None:
        """Evaluate the user's functions of the transition."""
        assert self.custom
        transitions.note_step(here, 0)
        rules, notes = self.custom.rules, self.custom.notes
        given = {"reward": "paid", "terminated": "ends"}
        for name, place in given.items():
            if name in rules:
                notes[place] = rules[name](notes)[:, 0]
        pays, stops = (name in rules for name in given)
        kernels, results = self.entry_point.kernels, self.entry_point.results
        kernels.enter(self.entry_point.address, pays, stops, *results[:2])

    def get_state(self) -> dict[str, Any]:
        """Return a copy of everything that determines later steps."""
        own = self._foot, self._height, self._energy, self._work
        return {**super().get_state(), "mujoco": np.concatenate([own, self.loop.get_state()])}

    def checked(self, state: Any, **flags: tuple[int, ...]) -> dict[str, Any]:
        """Return copies of the entries of a state after checks; see `Batch.checked`."""
        rest = dict(state) if isinstance(state, Mapping) else state
        given = rest.pop("mujoco", None) if isinstance(rest, dict) else None
        found, size = super().checked(rest, **flags), len(self.loop.get_state()) + 4
        own = given if isinstance(given, np.ndarray) else np.empty(0)
        if own.shape != (size,) or own.dtype != float or not np.isfinite(own).all():
            raise saved.StateError(f"the state's 'mujoco' must be {size} finite numbers")
        return found | {"mujoco": own.copy()}

    def put_back(self, found: Mapping[str, Any]) -> None:
        """Restore a state from `checked`."""
        super().put_back(found)
        if self.loop.walker != self.walkers[0]:
            self.loop = self._loop(self.walkers[0])
        numbers = found["mujoco"]
        self._foot, self._height, self._energy, self._work = numbers[:4].tolist()
        self.loop.set_state(numbers[4:])

    def __getstate__(self) -> dict[str, Any]:
        return {**super().__getstate__(), "_here": None}


class PassiveWalkerMujocoEnv(PassiveWalkerEnv):
    """The task of `PassiveWalker-v0`, with MuJoCo instead of exact hybrid dynamics.

    Spaces, actions, observations, rewards, `info` and the arguments of the scene are those of
    `PassiveWalkerEnv`; a policy for one acts in the other. MuJoCo has contacts that are soft, and
    steps of equal length. `bridge.loop` describes what it takes to walk with them. The page on
    simulators has the errors of gaits by timestep.

    Features that it lacks are refused: actions other than "hip", legs without mass, a `System`,
    pushes, noise, delay, commands, constraints and terrain. `friction` is that of the contacts.
    "collision_cost" is the energy that is missing at the end of a stride. The picture is drawn by
    MuJoCo's renderer, which needs OpenGL; without a display, set MUJOCO_GL to "egl" or "osmesa".

    Args:
        scene: The scene.
        render_mode: "rgb_array" or None.
        timestep: Largest step of MuJoCo, in s.
        softness: Time constant of contacts and latches in timesteps, from 2 on. None is MuJoCo's
            own contacts, which are as soft at any timestep.
        **changes: Arguments of the scene that change.

    Raises:
        SceneError: if the scene has a feature that it lacks.
        ValueError: if another argument is out of its range.
        ImportError: if mujoco is not installed.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 30}  # noqa: RUF012
    batch: MujocoBatch

    def __init__(
        self,
        scene: Scene | str | Mapping[str, Any] = "level",
        *,
        render_mode: str | None = None,
        timestep: float = TIMESTEP,
        softness: float | None = SOFTNESS,
        **changes: Any,
    ) -> None:
        library()
        timestep, softness = checked_steps(timestep, softness)
        super().__init__(check_features(make_scene(scene, **changes)))
        modes = self.metadata["render_modes"]
        if render_mode is not None and render_mode not in modes:
            raise ValueError(f"render_mode must be one of {modes} or None, not {render_mode!r}")
        self.render_mode = render_mode
        self.batch = MujocoBatch(self.scene, timestep, softness)
        self.token = self.batch.token

    def _draw(self) -> NDArray[np.uint8] | None:
        """Draw the present state by MuJoCo's renderer."""
        mujoco, loop = library(), self.batch.loop
        if self._screen is None or self._screen.model is not loop.model:
            self.close()
            if not _NO_SCREEN:
                try:
                    self._screen = mujoco.Renderer(loop.model, _HEIGHT, _WIDTH)
                except Exception as error:  # another attempt would end the process
                    _NO_SCREEN.append(str(error))
            if self._screen is None:
                raise RuntimeError(
                    f"MuJoCo has no OpenGL here ({_NO_SCREEN[0]}): set MUJOCO_GL to egl or osmesa, "
                    "with their libraries installed, before MuJoCo is imported"
                )
        mujoco.mj_forward(loop.model, loop.data)
        # An orthographic view from the side: in perspective the horizon crosses the walker.
        camera, length = mujoco.MjvCamera(), self.walker.leg_length
        x, z = loop.data.qpos[:2]
        camera.lookat[:], camera.distance = (x, 0.0, z - 0.4 * length), 3.0 * length
        camera.azimuth, camera.elevation, camera.orthographic = 90.0, 0.0, 1
        loop.model.vis.global_.fovy = 1.8 * length
        self._screen.update_scene(loop.data, camera)
        scene, turn = self._screen.scene, loop.data.geom("ground").xmat.reshape(3, 3)
        size = length * np.array([2.0, 0.5, 0.5])
        mujoco.mjv_initGeom(  # the ground's section: from here the plane itself is a line
            scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_BOX, size,
            turn @ [loop.hip, 0.0, -size[2]], turn.ravel(), np.array([0.8, 0.8, 0.8, 1.0]),
        )  # fmt: skip
        scene.ngeom += 1
        return self._screen.render()


def checked_steps(timestep: float, softness: float | None) -> tuple[float, float | None]:
    """Return a timestep in s and a softness in timesteps, or None, after a check.

    Raises:
        ValueError: if one is out of its range.
    """
    step = number(timestep, "timestep", above=0.0, most=0.1)
    return step, None if softness is None else number(softness, "softness", least=2.0, most=1e6)
