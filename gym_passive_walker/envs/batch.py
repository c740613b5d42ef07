"""Any number of walkers in a scene: what the single and the vector environments have in common."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import deepcopy
from functools import cached_property, partial
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.arguments import check_slope, check_state, whole
from gym_passive_walker.engine.compiled import compiled
from gym_passive_walker.engine.lanes import RESTING
from gym_passive_walker.engine.layout import layout_of, record_for
from gym_passive_walker.engine.run import in_parts, options, states_in, workspace
from gym_passive_walker.envs import disturbance_kernels, saved, task, ticks
from gym_passive_walker.envs.constraints import ROOM
from gym_passive_walker.envs.custom import RULES, Custom
from gym_passive_walker.envs.disturbances import Contact, Disturbances, disturbed
from gym_passive_walker.envs.interface import refuse
from gym_passive_walker.envs.one_thread import Token
from gym_passive_walker.envs.scene import Scene, SceneError
from gym_passive_walker.envs.starts import DRAWS, Starts, as_recorded, checked_state
from gym_passive_walker.envs.transitions import STOPPED
from gym_passive_walker.physics.hybrid import System
from gym_passive_walker.physics.systems import UNEVEN, bodies, kind_of, system_of
from gym_passive_walker.units import proportions
from gym_passive_walker.walkers import Walker, state_size

OPTIONS = ("state", "slope")
"""What `reset` may be asked for."""

_UNASKED = np.empty(0), np.empty((0, 6)), np.empty((0, DRAWS))
_CROWD = 2048  # walkers from which on threads may share the work


def rules_of(scene: Scene, system: System, step_limit: float) -> NDArray:
    """A scene's rules, as the kernel reads them."""
    rules = np.zeros(1, task.rules_for(layout_of(system)))
    own = scene.own_system
    rules["tick"] = scene.tick if scene.control == "tick" else math.inf
    rules["max_stride_time"] = scene.max_stride_time
    rules["actions"] = len(scene.actions)
    for i, name in enumerate(scene.actions):
        channel = scene.channels.index(name)
        rules["channels"][0, i], rules["largest"][0, channel] = channel, scene.largest(name)
    rules["energy_weight"] = scene.energy_weight
    rules["charged"] = task.ENERGIES.index(scene.energy)
    rules["step_limit"] = step_limit
    rules["weight"] = 1.0 if own is None else own.total_mass
    rules["works"][0, : len(system.works)] = np.divide(system.works, rules["weight"])
    rules["works"][0, -1] = 1.0
    return rules


def system_in(scene: Scene, *walkers: Walker) -> System:
    """Which equations walkers of one kind obey in a scene."""
    using = {*scene.domain_randomization, *scene.actions, *(UNEVEN if scene.terrain else ())}
    return system_of(*walkers, using=using)


def _radii(walkers: Sequence[Walker]) -> NDArray[np.float64]:
    """Foot radii in leg lengths."""
    return np.array([walker.foot_radius / walker.leg_length for walker in walkers])


class Saved(NamedTuple):
    """A state that `Batch.checked` has found whole.

    Attributes:
        records: As in `Batch`.
        ledger: As in `Batch`.
        walkers: As in `Batch`.
        randoms: States of its generators; empty if there were none.
        befell: As returned by `Disturbances.checked`; None in a scene without disturbances.
        transitions: Of `Custom`; None without rules of one's own.
    """

    records: NDArray
    ledger: NDArray
    walkers: list[Walker]
    randoms: list[dict[str, Any]]
    befell: tuple[NDArray, NDArray] | None
    transitions: NDArray | None


class Batch:
    """Walkers side by side: their records and ledger, starts and steps.

    One thread at a time may use a batch: environments hold its `token` around every call.

    Args:
        scene: What is simulated.
        count: How many walkers.
        walkers: A walker for each, of one kind, instead of the scene's.
        slopes: A slope for each, instead of the scene's.
        step_limit: Steps after which an episode is truncated.
        threads: How many threads large batches use; numba's number when None.

    Attributes:
        walkers: The walker in each place.
        records: Shape (count, 1) of `engine.layout.RECORD`.
        ledger: Shape (count,) of `task.LEDGER`.
        randoms: Each walker's own source of random numbers.
        seen: Numbers in an observation.
        custom: The user's own rules; None where there are none.
        disturbances: Their disturbances; None without any.
        token: Held by the thread that uses the batch; see `one_thread`.

    Raises:
        SceneError: if the walkers are of different kinds, or a count does not fit.
    """

    def __init__(
        self,
        scene: Scene,
        count: int = 1,
        *,
        walkers: Sequence[Walker] | None = None,
        slopes: Sequence[float] | None = None,
        step_limit: float = math.inf,
        threads: int | None = None,
    ) -> None:
        for name, given in (("walkers", walkers), ("slopes", slopes)):
            row = isinstance(given, Sequence | np.ndarray)
            if given is not None and not (row and len(given) == count):
                found = f"{len(given)} of them" if row else repr(given)
                raise SceneError(
                    f"{name} must be in a row, one for each of {count} environments, not {found}"
                )
        self.scene, self.count, self.token = scene, count, Token()
        self._given = {"walkers": walkers, "slopes": slopes, "step_limit": step_limit}
        self.seen = task.SIZE + (scene.command is not None) + 2 * scene.terrain_lookahead
        self.seen += len(scene.observe_body)
        judged = scene.own_system is not None or any(getattr(scene, name) for name in RULES)
        self.custom = Custom(scene, count) if judged else None
        self._plain: NDArray[np.float32] | None = None  # what is seen where that is not asked for
        if self.custom and self.custom.seen:
            self._plain = np.empty(count * self.seen, np.float32)
            self.seen = self.custom.seen
        self.threads = None if threads is None else whole(threads, "threads")
        self.walkers = [scene.walker] * count if walkers is None else list(walkers)
        if len({kind_of(walker) for walker in self.walkers}) > 1:
            raise SceneError(
                "walkers of one batch must be of one kind: all with knees, all with straight legs, "
                "all with legs without mass, or all one system"
            )
        slope_of = [None] * count if slopes is None else check_slope(slopes).tolist()
        shared: dict[Any, Starts] = {}
        self._starts = [
            shared.setdefault((walker, slope), Starts(scene, walker, slope))
            for walker, slope in zip(self.walkers, slope_of, strict=True)
        ]
        self._proportions = self._proportions_of(self.walkers)
        own = self.custom is not None and (self.custom.seen or not self.custom.native)
        # Whether a step is more than one call of compiled code.
        self._apart = own or disturbed(scene) or bool(scene.observe_body)
        self._alike_starts = len(shared) == 1
        self._alike = walkers is None and not scene.domain_randomization
        self.disturbances: Disturbances | None = None
        if disturbed(scene):
            self.disturbances = Disturbances(scene, self.system.name, count)
        shown = self.walkers[:1] if self._alike and not self.disturbances else self.walkers
        self.bodies = bodies(*shown)
        if self.disturbances:
            self.bodies = np.pad(self.bodies, ((0, 0), (0, 0), (0, ROOM)))
        self._radii = _radii(shown)
        self.layout = layout_of(self.system)
        self.records = np.zeros((count, 1), record_for(self.layout))
        self.ledger = np.zeros(count, task.ledger_for(self.layout))
        self.rules = rules_of(scene, self.system, step_limit)
        self.randoms: list[np.random.Generator] = []
        self.machinery = self._machinery()
        self.door = self._door()

    def changed(self, scene: Scene) -> Batch:
        """As many walkers in another scene, before their episodes; see `become`.

        Raises:
            SceneError: if its agents would observe or do other things.
        """
        fresh = Batch(scene, self.count, threads=self.threads, **self._given)
        if (fresh.seen, scene.actions) != (self.seen, self.scene.actions):
            raise SceneError(
                f"an environment keeps its {self.seen} numbers of observation and its actions "
                f"{self.scene.actions}, and the new scene has {fresh.seen} and {scene.actions}: "
                "they cannot change; make another environment"
            )
        fresh.ledger["truncated"] = 1
        return fresh

    def become(self, fresh: Batch) -> None:
        """Be what `changed` returned, with the random numbers of this batch."""
        self.__dict__ = fresh.__dict__ | {"randoms": self.randoms, "token": self.token}

    @property
    def own_seen(self) -> int | None:
        """Numbers in an observation of the user's own; None where there is none."""
        return self.custom.seen if self.custom else None

    @property
    def starts_alike(self) -> bool:
        """Whether compiled code alone may begin episodes: all walkers start alike, as they are."""
        alike = self._alike_starts and not self.scene.domain_randomization
        return alike and not self.disturbances and not self.custom

    def _machinery(self) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """Compiled phases, options of the engine, and the work space of one thread."""
        here, name = self.disturbances, self.system.name  # makes a user's system known by its name
        phases = here.natives[0] if here else compiled(name)
        told = options(self.scene.tolerance, scuff=bool(self.scene.end_on_toe_stub))
        return phases, told, *workspace(layout=self.layout)

    def _door(self) -> ticks.Door:
        """Where compiled code finds the walkers."""
        phases, told, tiles, courses = self.machinery
        door = ticks.Door(
            self.scene, self.count, records=self.records, bodies=self.bodies, radii=self._radii,
            ledger=self.ledger, rules=self.rules, phases=phases, options=told, tiles=tiles,
            courses=courses,
        )  # fmt: skip
        if self.custom and not self.disturbances:
            door.judge_by(self.custom)
        return door

    @property
    def _constants(self) -> NDArray[np.float64]:
        """Walkers' constants, without what there may be behind them."""
        return self.bodies[..., : len(self.system.Body._fields)]  # type: ignore[attr-defined]

    @property
    def system(self) -> System:
        """Which equations the walkers obey."""
        return system_in(self.scene, *set(self.walkers))

    def start(
        self,
        lanes: ArrayLike,
        observations: NDArray[np.float32],
        options: Mapping[str, Any] | None = None,
    ) -> None:
        """Begin a new episode for some of the walkers.

        Args:
            lanes: Which.
            observations: Theirs are filled, in the flat array of all: shape (count * seen,).
            options: "state" (one for each walker of the batch, or one for all) and "slope"
                (one for each, or one for all), in the walker's own units, instead of those drawn.

        Raises:
            ValueError: if an option is unknown or out of its range; nothing has changed then
                but the random numbers taken.
        """
        where = np.array(lanes, np.int64)
        if self.starts_alike and not options:
            self._prepare()
            self.door.kernels.begin(self.door.where, where, True, *_UNASKED, observations)
            self._show_bodies(observations)
            return
        states, asked = self._asked(options) if options else (None, None)
        draws = self.drawn(where)
        varied = {}
        if self.scene.domain_randomization:
            varied = {i: self._starts[i].varied(self.randoms[i]) for i in where.tolist()}
        slopes, gaits = self._nominal(where, draws[:, 0], asked, wanted=states is None)
        if states is not None:
            given = [(states[i].tolist(), varied.get(i, self.walkers[i])) for i in where.tolist()]
            found = [checked_state(state, walker) for state, walker in given]
            gaits = as_recorded(self.walkers[0], found)
            draws[:] = 0.5  # no change
        for i, walker in varied.items():
            self.walkers[i], self._constants[i : i + 1] = walker, bodies(walker)
            self._radii[i : i + 1] = _radii([walker])
            self._proportions[i : i + 1] = self._proportions_of([walker])
        plain = observations if self._plain is None else self._plain
        self.door.kernels.begin(self.door.where, where, False, slopes, gaits, draws, plain)
        if self.disturbances:
            self.disturbances.begin(where, self.randoms, self.records, self.ledger)
            self.disturbances.observe(self.ledger, where, plain)
        self._show_bodies(plain)
        if self.custom:
            self.custom.begin(self, where)
            self._see(observations, where)

    def _proportions_of(self, walkers: Sequence[Walker]) -> NDArray[np.float32]:
        """What is observed of walkers' bodies, (walkers, names)."""
        names = self.scene.observe_body
        known = {walker: proportions(walker, names) for walker in {*walkers}} if names else {}
        found = np.zeros((len(walkers), len(names)), np.float32)
        for row, walker in zip(found, walkers if names else (), strict=False):
            row[:] = known[walker]
        return found

    def _show_bodies(self, observations: NDArray[np.float32]) -> None:
        """Write what is observed of walkers' bodies, into the flat observations of all."""
        if size := self._proportions.shape[1]:
            observations.reshape(self.count, -1)[:, -size:] = self._proportions

    def _prepare(self) -> None:
        """Make known what calm walkers start by."""
        self.door.draw_from(self.randoms)
        self.door.begin_at(self._starts[0])

    def drawn(self, where: NDArray[np.int64]) -> NDArray[np.float64]:
        """The numbers that some walkers' starts take from their random ones, (lanes, DRAWS)."""
        draws = np.empty((len(where), DRAWS))
        self.door.draw_from(self.randoms)
        ticks.draw(self.door.where, where, draws)
        return draws

    def _nominal(
        self,
        where: NDArray[np.int64],
        shares: NDArray[np.float64],
        asked: NDArray[np.float64] | None,
        *,
        wanted: bool,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Slopes, drawn or asked for, and if wanted the gaits there: a row for all, or for each."""
        size = 2 * self.layout.links
        none = np.zeros((1, size))
        if asked is not None:
            slopes = asked[where]
            if not wanted:
                return slopes, none
            each = zip(where.tolist(), slopes.tolist(), strict=True)
            found = [self._starts[i].state(slope) for i, slope in each]
            return slopes, as_recorded(self.walkers[0], found)
        if self._alike_starts:
            starts = self._starts[0]
            slopes = starts.slopes(shares)
            return slopes, starts.states(slopes) if wanted else none
        slopes, gaits = np.empty(len(where)), np.zeros((len(where), size))
        for j, i in enumerate(where.tolist()):
            slopes[j : j + 1] = self._starts[i].slopes(shares[j : j + 1])
            if wanted:
                gaits[j : j + 1] = self._starts[i].states(slopes[j : j + 1])
        return slopes, gaits

    def _asked(
        self, options: Mapping[str, Any]
    ) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]:
        """The states and slopes that options ask for, one for each walker."""
        found: list[NDArray[np.float64] | None] = []
        numbers = state_size(self.walkers[0])
        for name, check, size in (
            ("state", partial(check_state, size=numbers), (numbers,)),
            ("slope", check_slope, ()),
        ):
            if options.get(name) is None:
                found.append(None)
                continue
            try:
                given = check(options[name])
            except ValueError as error:
                raise ValueError(f"options[{name!r}]: {error}") from None
            if given.shape not in (size, (1, *size), (self.count, *size)):
                raise ValueError(
                    f"options[{name!r}] must have shape {size}, or {(self.count, *size)} for one "
                    f"for each environment, not {given.shape}"
                )
            found.append(np.broadcast_to(given, (self.count, *size)))
        return found[0], found[1]

    def set_slopes(self, slopes: ArrayLike, lanes: NDArray[np.bool_]) -> None:
        """Put the strides that some walkers begin on slopes of their own.

        Args:
            slopes: In rad, one for each walker of the batch, or one for all; footholds of a terrain
                slope that much more or less than it.
            lanes: Which walkers, (count,).

        Raises:
            ValueError: if a slope is none, or a walker has begun its stride already.
        """
        checked = check_slope(slopes)
        if checked.shape not in ((), (self.count,)):
            raise ValueError(f"{checked.size} slopes for {self.count} environments")
        checked = np.broadcast_to(checked, (self.count,))
        under_way = np.flatnonzero(lanes & (self.over | (self.records["time"][:, 0] != 0.0)))
        if len(under_way):
            raise ValueError(
                "the ground changes where a stride begins, at a heelstrike or a reset; in the "
                f"midst of one, or at the end of an episode, are walkers {under_way.tolist()}"
            )
        if self.disturbances:
            checked = self.disturbances.lean(checked, lanes)
        ground = np.stack([np.sin(checked), np.cos(checked)], axis=-1)
        self.ledger["slope"][lanes] = checked[lanes]
        self.records["ground"][lanes, 0, :2] = ground[lanes]
        if self.custom:
            self.custom.notes["slope"][lanes] = checked[lanes]

    def schedule_events(
        self,
        *,
        height_changes: ArrayLike = 0.0,
        impulses: ArrayLike = 0.0,
        times: ArrayLike = 0.0,
    ) -> None:
        """Add a step in the ground or a push to the stride that walkers have just begun.

        Args:
            height_changes: By how much the next foothold is higher than the terrain has it, in leg
                lengths; one for all, or (count,).
            impulses: Pushes of the hip, in units of m sqrt(g l), positive downhill; one for
                all, or (count,).
            times: When these come, since the stride began; one for all, or (count,).

        Raises:
            ValueError: if the scene has no terrain, or no pushes.
        """
        here = self.disturbances
        for name, given, of in (
            ("height_changes", height_changes, "terrain"),
            ("impulses", impulses, "pushes"),
        ):
            if np.any(given) and (here is None or getattr(self.scene, of) in (None, {})):
                raise ValueError(f"{name} need a scene with {of}, if only idle ones")
        if here is None:
            return
        here.states["extra_height"] = height_changes
        self.records["ground"][:, 0, 2] += height_changes
        here.states["known"] = impulses
        here.states["due"] = np.where(here.states["known"] != 0.0, times, here.states["due"])

    @property
    def energy_cost(self) -> str:
        """What motors are charged for: "absolute", "positive" or "net" hip work."""
        return task.ENERGIES[int(self.rules["charged"][0])]

    def set_energy_cost(self, energy: str | None) -> None:
        """Charge all motors for another kind of work from now on; None is the scene's own.

        Raises:
            ValueError: if there is no such kind.
        """
        energy = self.scene.energy if energy is None else energy
        if energy not in task.ENERGIES:
            allowed = ", ".join(map(repr, task.ENERGIES))
            raise ValueError(f"motors are charged for {allowed} or None, not {energy!r}")
        self.rules["charged"] = task.ENERGIES.index(energy)

    def reward_terms(self) -> dict[str, NDArray[np.float64]]:
        """Terms (count,) of the last rewards by name; a reward is their sum."""
        if self.custom and "reward" in self.custom.rules:
            return self.custom.terms()
        ledger, scene = self.ledger, self.scene
        terms = {"distance": ledger["distance"], "energy": -scene.energy_weight * ledger["energy"]}
        if scene.command is not None:
            terms["command"] = ledger["reward"] - (terms["distance"] + terms["energy"])
        return {name: np.array(term) for name, term in terms.items()}

    def observe(self, observations: NDArray[np.float32]) -> None:
        """Write all walkers' observations, flat: shape (count * seen,)."""
        if self.custom and self.custom.seen:
            self._see(observations)
            return
        task.observe(self.records, self.ledger, self.machinery[0], observations)
        if self.disturbances:
            self.disturbances.observe(self.ledger, np.arange(self.count), observations)
        self._show_bodies(observations)

    def _see(
        self, observations: NDArray[np.float32], lanes: NDArray[np.int64] | None = None
    ) -> None:
        """Write walkers' observations by a function, with noise on those of a `System`."""
        if self.custom is None or not self.custom.seen:
            return
        self.custom.observe(observations, slice(None) if lanes is None else lanes)
        if self.disturbances and self.scene.own_system and self.scene.observation is None:
            lanes = np.arange(self.count) if lanes is None else lanes
            self.disturbances.spoil(self.ledger, lanes, observations)

    def info_values(self) -> dict[str, NDArray]:
        """Entries (count,) of `info` at every step besides those of `task.EVERY_STEP`."""
        found = self.disturbances.info_values(self.bodies) if self.disturbances else {}
        if self.scene.reward_terms:
            found |= {f"reward_{name}": term for name, term in self.reward_terms().items()}
        return found

    def step(
        self,
        actions: NDArray[np.floating],
        observations: NDArray[np.float32],
        rewards: NDArray[np.float64],
        terminated: NDArray[np.bool_],
        truncated: NDArray[np.bool_],
        *,
        again: bool = False,
    ) -> tuple[int, int]:
        """A step of every walker with an episode that goes on; others get a reward of 0.

        Args:
            actions: Flat: shape (count * actions of the scene,).
            observations: Filled, flat: shape (count * seen,).
            rewards: Filled; shape (count,).
            terminated: Filled; shape (count,).
            truncated: Filled; shape (count,).
            again: Whether these others begin their next episode.

        Returns:
            How many strides, and how many episodes have ended.

        Raises:
            ValueError: if an action is no finite number; nothing has changed then.
        """
        custom, plain = self.custom, self._plain
        if not (custom and self._apart):
            return self._step(actions, observations, rewards, terminated, truncated, again=again)
        plain = observations if plain is None else plain
        if self.disturbances:
            custom.before(self)
        results = rewards, terminated, truncated
        strides, endings = self._step(actions, plain, *results, again=False)
        if self.disturbances:
            endings += custom.after(self, rewards, terminated)
        if not custom.native:
            endings += custom.judge(self, rewards, terminated)
        self._see(observations)
        if again:
            self._begin_again(observations)
        return strides, endings

    def _step(
        self,
        actions: NDArray[np.floating],
        observations: NDArray[np.float32],
        rewards: NDArray[np.float64],
        terminated: NDArray[np.bool_],
        truncated: NDArray[np.bool_],
        *,
        again: bool,
    ) -> tuple[int, int]:
        """A step by the environment's own rules; see `step`."""
        door, at_once = self.door, again and self.starts_alike
        door.actions[...] = actions
        if self.count < _CROWD and not self.disturbances:
            if at_once:
                self._prepare()
            wrong, strides, endings = door.kernels.step.compiled(
                door.where, 0, self.count, *door.desk, at_once,
                observations, rewards, terminated, truncated,
            )  # fmt: skip
            if wrong >= 0:
                self.refuse(wrong)
            self._show_bodies(observations)
            if again and not at_once:
                self._begin_again(observations)
            return strides, endings
        each = door.actions.reshape(self.count, -1)
        finite = np.isfinite(each).all(axis=1)
        for wrong in np.flatnonzero(~finite & ~self.over):  # before anyone steps
            refuse(each[wrong], self.scene.actions, int(wrong))
        ended = []

        def job(a: int, b: int) -> None:
            whole = (a, b) == (0, self.count)
            desk = self.machinery[2:] if whole else workspace(layout=self.layout)
            size = len(observations) // self.count
            seen = observations[a * size : b * size]
            results = seen, rewards[a:b], terminated[a:b], truncated[a:b]
            if self.disturbances:
                own = self.bodies[a:b] if len(self.bodies) > 1 else self.bodies
                walkers = self.records[a:b], own, self.ledger[a:b], self.rules
                further = *self.disturbances.part(a, b), each[a:b].reshape(-1)
                ended.append(
                    disturbance_kernels.step(
                        *walkers, *self.machinery[:2], *desk, *further, *results
                    )
                )
            else:
                at = [part.ctypes.data for part in desk]
                ended.append(door.kernels.step(door.where, a, b, *at, False, *results)[1:])

        in_parts(job, self.count, self.threads)
        self._show_bodies(observations)
        if again:
            self._begin_again(observations)
        return sum(strides for strides, _ in ended), sum(endings for _, endings in ended)

    def step_alone(
        self, action: NDArray[np.floating], observation: NDArray[np.float32]
    ) -> tuple[int, int]:
        """A step of a batch of one; the other arrays that `step` fills are the `Door`'s."""
        if self._apart:
            return self.step(action, observation, *self.door.results)
        self.door.actions[...] = action
        wrong, strides, endings = self.door.step_here(self.door.where, observation)
        if wrong >= 0:
            self.refuse(wrong)
        return strides, endings

    def refuse(self, wrong: int) -> NoReturn:
        """Say what is wrong with a walker's action, of the actions in the `Door`."""
        lane = wrong if self.count > 1 else None
        refuse(self.door.actions.reshape(self.count, -1)[wrong], self.scene.actions, lane)

    def _begin_again(self, observations: NDArray[np.float32]) -> None:
        """Begin the next episode of every walker that has rested in this step."""
        self.start(np.flatnonzero(self.records["outcome"][:, 0] == RESTING), observations)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "machinery": None, "door": None}  # compiled code stays at home

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.machinery = self._machinery()
        self.door = self._door()

    @property
    def over(self) -> NDArray[np.bool_]:
        """Which walkers' episodes have ended."""
        return saved.over(self.ledger)

    @property
    def states(self) -> NDArray[np.float64]:
        """States in the walkers' own units, shape (count, 6), or (count, 2 m) of a `System`."""
        half = state_size(self.walkers[0]) // 2
        states = states_in(self.records[:, 0], half).copy()
        states[:, half:] /= np.array([walker.time_unit for walker in self.walkers])[:, None]
        return states

    def contact(self, lane: int) -> Contact:
        """Where a walker's stance foot touches the ground."""
        radius = self._radii[lane if len(self._radii) > 1 else 0]
        length, record = self.walkers[lane].leg_length, self.records[lane, 0]
        if self.disturbances and self.scene.terrain is not None:
            rolled = radius * (record["start"][0] - record["state"][0])
            return self.disturbances.contact(lane, float(rolled), length)
        rolled = radius * record["state"][0]
        return Contact(float(self.ledger["origin"][lane] - rolled) * length)

    def get_state(self) -> dict[str, Any]:
        """All that decides what comes next; a copy."""
        befell = self.disturbances.get_state() if self.disturbances else {}
        if self.custom:
            befell["transitions"] = self.custom.notes.copy()
        return {
            "scene": self._described,
            "records": self.records.copy(),
            "ledger": self.ledger.copy(),
            "walkers": [saved.kept(walker) for walker in self.walkers],
            "random": [deepcopy(r.bit_generator.state) for r in self.randoms],
            **befell,
        }

    @cached_property
    def _limits(self) -> saved.RowLimits:
        last = STOPPED - (self.scene.terminated is None)
        return saved.RowLimits(self.rules[0], len(self.machinery[0]), last, self.layout)

    @cached_property
    def _described(self) -> str:
        return saved.described(self.scene)

    def checked(self, state: Any, *further: str, begun: bool = True) -> Saved:
        """What a state holds, as copies, if it can be put back; nothing has changed here.

        Args:
            state: From `get_state`.
            *further: Entries that an environment has added.
            begun: Whether all walkers had begun an episode.

        Raises:
            StateError: if it is damaged, or of another batch.
        """
        if isinstance(state, Mapping) and "scene" in state:  # says most about what is wrong
            saved.check_scene(state["scene"], self._described)
        names = ["scene", "records", "ledger", "walkers", "random", *further]
        if self.disturbances:
            names += ["disturbances", "pending"]
        if self.custom:
            names.append("transitions")
        given = saved.entries(state, names)
        records = saved.like(given["records"], "records", self.records)
        ledger = saved.like(given["ledger"], "ledger", self.ledger)
        going = self._limits.check(records, ledger, begun=begun)
        befell = None
        if self.disturbances:
            befell = self.disturbances.checked(given, records["time"][:, 0], going)
        walkers = saved.check_walkers(
            given["walkers"],
            self.walkers,
            [s.walker for s in self._starts],
            self.scene.domain_randomization,
        )
        kind = type(self.randoms[0].bit_generator) if self.randoms else np.random.PCG64
        randoms = saved.check_randoms(given["random"], self.count, kind)
        transitions = None
        if self.custom:
            transitions = saved.like(given["transitions"], "transitions", self.custom.notes)
        return Saved(records, ledger, walkers, randoms, befell, transitions)

    def put_back(self, state: Saved) -> None:
        """Go back to a state that was `checked`."""
        self.records[:], self.ledger[:] = state.records, state.ledger
        if not self._alike:
            self.walkers = state.walkers
            self._constants[:], self._radii[:] = bodies(*self.walkers), _radii(self.walkers)
            self._proportions[:] = self._proportions_of(self.walkers)
        if self.disturbances and state.befell:
            self.disturbances.put_back(state.befell)
        if self.custom and state.transitions is not None:
            self.custom.notes[:] = state.transitions
        for random, saved_state in zip(self.randoms, state.randoms, strict=False):
            random.bit_generator.state = saved_state

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Go back to a state that `get_state` gave.

        Raises:
            StateError: if it is damaged, or of another batch; nothing has changed then.
        """
        self.put_back(self.checked(state))
