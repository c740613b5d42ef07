"""Many walkers in one kernel: `gymnasium.make_vec("PassiveWalker-v0", num_envs=...)`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import KEPT, seed_number, shown, whole
from gym_passive_walker._tools.extras import need
from gym_passive_walker.envs import interface, saved, task
from gym_passive_walker.envs.batch import RESET_OPTIONS, UNFINISHED, Batch
from gym_passive_walker.envs.frames import frame
from gym_passive_walker.envs.infos import Infos
from gym_passive_walker.envs.one_thread import one_thread
from gym_passive_walker.envs.registration import MAX_EPISODE_STEPS
from gym_passive_walker.gaits.scenes.scene import SceneLike, make_scene
from gym_passive_walker.models.walkers import Walker, WalkerLike, as_walker

_OUTCOMES = np.array(interface.OUTCOMES, object)


class PassiveWalkerVectorEnv(
    interface.EnergyCost, interface.SingleNames, VectorEnv[NDArray, NDArray, NDArray]
):
    """A batch of `PassiveWalkerEnv`; trajectories are bitwise equal to single environments.

    Observations, rewards, terminations and infos are bitwise equal to those of a `SyncVectorEnv` of
    single environments with equal seeds; the outcome "time_limit" alone is of this class. One call
    of a compiled kernel steps all walkers. The dictionary of infos is filled when it is first read.

    Args:
        num_envs: Number of walkers.
        scene: A scene, its name, or its arguments; see `PassiveWalkerEnv`.
        max_episode_steps: Number of steps after which an episode is truncated; -1 or None for no
            limit.
        autoreset_mode: "NextStep", "SameStep" or "Disabled". "NextStep": the step after the end of
            an episode is its reset. "SameStep": the last step of an episode returns the first
            observation of the next one, and has the last one in ``infos["final_obs"]``.
            "Disabled": call ``reset(options={"reset_mask": ...})``. Gymnasium's vector wrappers of
            observations refuse "SameStep"; all of them take "NextStep".
        walkers: Walkers of the scene's kind, (num_envs,), instead of the scene's.
        slopes: Slopes in rad, (num_envs,), instead of the scene's.
        threads: Most threads, with at least 512 walkers each; all free CPUs' when None. Results do
            not depend on it.
        render_mode: "rgb_array", or None.
        **changes: Arguments of the scene to change; see `PassiveWalkerEnv`.
    """

    metadata = {"render_modes": ["rgb_array"], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int = 1,
        scene: SceneLike = "level",
        *,
        max_episode_steps: int | None = MAX_EPISODE_STEPS,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        walkers: Sequence[WalkerLike] | None = None,
        slopes: Sequence[float] | None = None,
        threads: int | None = None,
        render_mode: str | None = None,
        **changes: Any,
    ) -> None:
        self._screens: dict[int, Any] = {}  # first: what was refused is closed as well
        if render_mode is not None and render_mode != "rgb_array":
            raise ValueError(f"render_mode must be 'rgb_array' or None, not {shown(render_mode)}")
        self.num_envs = num_envs = whole(num_envs, "num_envs", 1, KEPT)
        if isinstance(walkers, Sequence | np.ndarray) and len(walkers):
            walkers = [as_walker(walker) for walker in walkers]
            if "system" not in changes:
                changes.setdefault("walker", walkers[0])
        self.scene = make_scene(scene, **changes)
        if render_mode is not None:
            need("pygame", "render")
        self.render_mode = render_mode
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {
            "render_modes": ["rgb_array"],
            "render_fps": self.scene.frames_per_second,
            "autoreset_mode": self.autoreset_mode,
        }
        self.batch = Batch(
            self.scene,
            num_envs,
            walkers=walkers,  # type: ignore[arg-type]
            slopes=slopes,
            step_limit=interface.step_limit(max_episode_steps),
            threads=threads,
        )
        self.single_observation_space = interface.observation_space(self.scene, self.batch.custom)
        self.single_action_space = interface.action_space(self.scene)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.token = self.batch.token
        self._shape = num_envs, len(self.scene.actions)
        self._everyone = np.ones(num_envs, bool)
        self._ended = self._everyone.copy()
        self._any_ended = True
        self._next: Batch | None = None  # in the scene that `set_scene` has asked for

    @one_thread
    def reset(  # type: ignore[override]
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin episodes.

        Args:
            seed: Seed of the first environment, the others use seed + 1, ...; or one for each.
            options: "reset_mask", whether to reset each environment, booleans (num_envs,); "state"
                and "slope", one for all or one for each, see `PassiveWalkerEnv.reset`. The
                dictionary is not changed.

        Returns:
            Observations, (num_envs, k) with k = 8 by default; and infos as from `step`, with zeros
            where there is no value yet.

        Raises:
            ValueError: if an option or the number of seeds is wrong.
            ResetNeeded: if only some environments are selected, and all must be reset.
            RuntimeError: if another thread is using this environment.
        """
        options = interface.reset_options(options, (*RESET_OPTIONS, "reset_mask"))
        lanes = np.arange(self.num_envs)
        if "reset_mask" in options:
            mask = self._checked_mask(options.pop("reset_mask"), "options['reset_mask']")
            if not mask.any():
                raise ValueError("options['reset_mask'] must ask for at least one reset")
            lanes = np.flatnonzero(mask)
        some = len(lanes) < self.num_envs
        if some and self.batch.unfinished:
            raise ResetNeeded(UNFINISHED)
        if some and self._next is not None:
            raise ResetNeeded("the scene has changed: reset all environments")
        self.renew()
        seed_randoms(self.batch, seed, lanes.tolist())
        if some:
            observations = self.batch.observe()
        else:
            observations = np.empty((self.num_envs, self.batch.observation_size), np.float32)
        self.batch.start(lanes, observations.reshape(-1), options)
        self._ended[lanes] = False
        self._any_ended = bool(self._ended.any())
        self.batch.unfinished = False
        begun = np.zeros(self.num_envs, bool)
        begun[lanes] = True
        infos = self._infos(np.zeros(self.num_envs, bool), begun)
        return self.batch.in_groups(observations), infos

    @one_thread
    def step(self, actions: NDArray) -> tuple[NDArray, NDArray, NDArray, NDArray, dict[str, Any]]:
        """Step every environment; `autoreset_mode` defines the step after the end of an episode.

        Args:
            actions: Actions, (num_envs, actions of the scene).

        Returns:
            Observations (num_envs, k), with k = 8 by default; rewards, terminated and truncated,
            each (num_envs,); and infos, arrays with masks: the entries of single environments,
            which are the same in every step.

        Raises:
            ValueError: if an action is not a finite number, or the shape is wrong; nothing has
                changed then.
            ResetNeeded: if an environment must be reset first.
            RuntimeError: if another thread is using this environment.
        """
        if type(actions) is not np.ndarray or actions.dtype.kind != "f":
            actions = interface.numbers(actions, self.scene.actions)
        if actions.shape != self._shape:
            raise ValueError(f"actions must have shape {self._shape}, not {actions.shape}")
        if self.batch.unfinished:
            raise ResetNeeded(UNFINISHED)
        if self._any_ended and self.autoreset_mode == AutoresetMode.DISABLED:
            raise ResetNeeded("some environments have ended: reset them first")
        observations = np.empty((self.num_envs, self.batch.observation_size), np.float32)
        rewards = np.empty(self.num_envs)
        terminated, truncated = np.empty((2, self.num_envs), bool)
        flat, again = observations.reshape(-1), self._any_ended
        waiting = self._ended.copy() if self._next is not None else None
        if waiting is not None and again:
            if waiting.all():  # NEXT_STEP: all begin in the new scene
                self.renew()
                waiting = None
            else:  # they begin when all episodes have ended
                again = False
        _, endings = self.batch.step(
            actions.reshape(-1), flat, rewards, terminated, truncated, again=again
        )
        if waiting is not None:
            truncated |= waiting
            endings += int(waiting.sum())
        if not endings or self.autoreset_mode != AutoresetMode.SAME_STEP:
            # NEXT_STEP: this was the reset of the environments that had ended.
            stepped = ~self._ended if self._any_ended else self._everyone
            infos = self._infos(stepped, just_now=True)
            if self._any_ended or endings:
                self._ended, self._any_ended = terminated | truncated, endings > 0
        else:
            ended = terminated | truncated
            lanes = np.flatnonzero(ended)
            last = np.full(self.num_envs, None, object)
            for i in lanes:
                last[i] = self.batch.in_groups(observations[i].copy())
            final = self._infos(ended, ended)
            self.renew()
            self.batch.go_on(lanes, flat)
            infos = {
                "final_obs": last,
                "_final_obs": ended,
                "final_info": final,
                "_final_info": ended.copy(),
                **self._infos(~ended),
            }
        self.batch.unfinished = False
        return self.batch.in_groups(observations), rewards, terminated, truncated, infos

    @one_thread
    def set_scene(self, scene: SceneLike | None = None, **changes: Any) -> None:
        """Change the scene of all environments, for example in a curriculum.

        The next step truncates all episodes. Later episodes use the new scene.

        Args:
            scene: Another scene; the present one if None.
            **changes: Arguments of the scene that change.

        Raises:
            SceneError: if the scene is unknown, or its observations or actions differ; nothing has
                changed then.
        """
        self._next = self._changed(scene, changes)
        self.batch.rules["step_limit"] = 0.0

    @property
    def scene_changes(self) -> bool:
        """Whether later episodes have another scene, from `set_scene`."""
        return self._next is not None

    def renew(self) -> None:
        """Apply the scene from `set_scene` after all episodes have ended."""
        if self._next is not None:
            self._become(self._next)

    @one_thread
    def set_slopes(
        self, slopes: ArrayLike, mask: NDArray[np.bool_] | None = None
    ) -> NDArray[np.float32]:
        """Set the slopes of the strides that begin, for rough ground.

        Requires the beginning of a stride, just after a heelstrike or a reset. A slope applies
        until the next call or the next reset.

        Args:
            slopes: Slopes in rad, positive downhill; one for each environment, or one for all.
            mask: Whether to set the slope of each environment, booleans (num_envs,); None for all.

        Returns:
            Observations of all environments with the new slopes, (num_envs, k) with k = 8 by
            default.

        Raises:
            ResetNeeded: if no episode has begun.
            ValueError: if a slope is invalid, or a selected environment is within a stride or at
                the end of an episode; nothing has changed then.
        """
        if self.batch.unfinished:
            raise ResetNeeded(UNFINISHED)
        which = self._everyone if mask is None else self._checked_mask(mask, "mask")
        self.batch.set_slopes(slopes, which)
        return self.batch.in_groups(self.batch.observe())

    @property
    def elapsed_steps(self) -> NDArray[np.int64]:
        """Number of steps of each environment's episode, (num_envs,)."""
        return self.batch.ledger["steps"].copy()

    @one_thread
    def set_elapsed_steps(self, steps: ArrayLike) -> None:
        """Set the number of steps of each environment's episode.

        The time limit counts them, and `steps` of a `Transition` from the next step on. Random
        numbers after a reset keep walkers that begin together from reaching the limit together.

        Args:
            steps: Whole numbers from 0 on and below the time limit, (num_envs,).

        Raises:
            ResetNeeded: if an episode has not begun, or has ended.
            ValueError: if the numbers are invalid; nothing has changed then.
        """
        found = interface.elapsed_steps(steps, self.num_envs, self.batch.step_limit)
        if self.batch.unfinished:
            raise ResetNeeded(UNFINISHED)
        if self._any_ended:
            raise ResetNeeded("some environments have ended: reset them first")
        self.batch.ledger["steps"] = found

    @property
    def reward_terms(self) -> dict[str, NDArray[np.float64]]:
        """Terms (num_envs,) of the last rewards by name; a reward is their sum.

        They are zero where the last step was a reset, after `reset`, and when a new scene begins.
        """
        return self.batch.reward_terms()

    def _infos(
        self,
        stepped: NDArray[np.bool_],
        present: NDArray[np.bool_] | None = None,
        *,
        just_now: bool = False,
    ) -> Infos:
        """Return the infos of single environments as arrays, with masks.

        Args:
            stepped: Whether each walker has made a step, (num_envs,); the others have begun.
            present: Mask of the environments that have these infos, (num_envs,); all if None.
            just_now: Whether `stepped` are the walkers that made the last step.
        """
        steps, counts, ended, measures = self.batch.reported(stepped, just_now=just_now)
        mask = (self._everyone if present is None else present).copy()
        others = self.batch.info_values(stepped)
        drawn = others.pop("randomized", {})
        infos = Infos(distance=steps[0], _distance=mask)

        def content() -> dict[str, Any]:
            names = *task.EVERY_STEP, *task.EVERY_STRIDE
            strides = np.zeros((len(task.EVERY_STRIDE), self.num_envs))
            strides[:, ended] = measures.T
            columns: dict[str, NDArray] = {}
            columns |= zip(names, (*steps, counts[0], *strides), strict=True)
            columns |= {name: np.where(mask, x, 0) for name, x in others.items()}
            columns["outcome"] = _OUTCOMES.take(counts[1])
            columns["outcome"][~mask] = None  # as Gymnasium fills it
            found = {}
            for name, column in columns.items():
                found[name], found["_" + name] = column, mask
            if drawn:
                inner: dict[str, NDArray] = {}
                for name, x in drawn.items():
                    inner[name], inner["_" + name] = np.where(mask, x, 0), mask
                found["randomized"], found["_randomized"] = inner, mask
            return found

        infos.make = content
        return infos

    def _checked_mask(self, mask: Any, name: str) -> NDArray[np.bool_]:
        """Check and return a boolean array (num_envs,)."""
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
            raise TypeError(f"{name} must be a boolean array, not {mask!r}")
        if mask.shape != (self.num_envs,):
            raise ValueError(f"{name} must have shape ({self.num_envs},), not {mask.shape}")
        return mask

    @one_thread
    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return a picture of each walker; None without a render mode.

        More walkers have smaller pictures. `pictures.tiled` joins them to one.

        Raises:
            ResetNeeded: if no episode has begun.
        """
        if self.render_mode is None:
            return None
        if not np.any(self.batch.records["state"]):
            raise ResetNeeded("no episode has begun: call reset first")
        from gym_passive_walker.pictures.screen import Screen
        from gym_passive_walker.pictures.tiles import tile_size

        for i, walker in enumerate(self.batch.walkers):
            if i not in self._screens or self._screens[i].walker != walker:
                size = tile_size(self.num_envs)
                self._screens[i] = Screen(walker, self.render_mode, size=size)
        return tuple(frame(self.batch, i, self._screens[i]) for i in range(self.num_envs))

    def close_extras(self, **_: Any) -> None:
        """Close the windows."""
        for screen in self._screens.values():
            screen.close()
        self._screens = {}

    @property
    def walkers(self) -> list[Walker]:
        """The walker of each environment's episode."""
        return list(self.batch.walkers)

    @property
    def slopes(self) -> NDArray[np.float64]:
        """The slope of each environment's episode, in rad."""
        return self.batch.ledger["slope"].copy()

    @property
    @one_thread
    def states(self) -> NDArray[np.float64]:
        """States in the walkers' units, (num_envs, 6), or (num_envs, 2 m) of a `System`."""
        return self.batch.states

    @property
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The random generator of each environment; drawn where no seed was given."""
        if not self.batch.randoms:
            seed_randoms(self.batch, None, range(self.num_envs))
        return tuple(self.batch.randoms)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seed of each environment's random generator; drawn where none was given."""
        return tuple(random.bit_generator.seed_seq.entropy for random in self.np_random)  # type: ignore[attr-defined]

    @one_thread
    def get_state(self) -> dict[str, Any]:
        """Return a copy of everything that determines later steps and resets."""
        begun = not self.batch.unfinished
        return {**self.batch.get_state(), "ended": self._ended.copy(), "begun": begun}

    @one_thread
    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a state from `get_state`, of this or an equal vector environment.

        It has the scene of the episodes: a later one from `set_scene` is dropped.

        Raises:
            StateError: if the state is damaged, or of another environment; nothing has changed
                then.
            RuntimeError: if another thread is using this environment.
        """
        found = self.batch.checked(state, begun=(), ended=(self.num_envs,))
        begun, ended = bool(found["begun"]), found["ended"]
        if begun and not np.array_equal(ended, saved.over_in(found["ledger"])):
            raise saved.StateError("the state's 'ended' and its ledger differ in which ended")
        if not self.batch.randoms:
            seed_randoms(self.batch, None, range(self.num_envs))
        self.batch.put_back(found)
        self._next, self.batch.rules["step_limit"] = None, self.batch.step_limit
        self._ended, self._any_ended = ended, bool(ended.any())
        self.batch.unfinished = not begun

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_screens": {}}


def seed_randoms(
    batch: Batch, seed: int | Sequence[int | None] | None, lanes: Sequence[int]
) -> None:
    """Seed the random generators of some walkers, each like a single environment.

    Raises:
        ValueError: if there is not one seed for each walker of the batch.
    """
    seeds: Sequence[int | None]
    seed = seed.tolist() if isinstance(seed, np.ndarray) else seed
    if isinstance(seed, Sequence) and not isinstance(seed, str | bytes):
        if len(seed) != batch.count:
            raise ValueError(f"{len(seed)} seeds for {batch.count} environments")
        seeds = [
            None if one is None else seed_number(one, f"seed[{i}]") for i, one in enumerate(seed)
        ]
    elif seed is None:
        seeds = [None] * batch.count
    else:
        try:
            first = seed_number(seed)
        except ValueError:
            raise ValueError(
                f"seed must be a whole number from 0 on, a row of them, or None, not {shown(seed)}"
            ) from None
        seeds = [first + i for i in range(batch.count)]
    randoms: list[Any] = list(batch.randoms) or [None] * batch.count
    for i in lanes:
        if seeds[i] is not None or randoms[i] is None:
            randoms[i], _ = seeding.np_random(seeds[i])
    if randoms != batch.randoms:
        batch.randoms = randoms
