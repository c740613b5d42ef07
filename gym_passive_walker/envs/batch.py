"""A batch of walkers in a scene, on which the single and the vector environments are built."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from functools import cached_property, partial
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import check_slope, check_state, whole
from gym_passive_walker.engine.compiled import compiled
from gym_passive_walker.engine.lanes import RESTING
from gym_passive_walker.engine.layout import layout_of
from gym_passive_walker.engine.machine import default_threads
from gym_passive_walker.engine.run import options, states_in
from gym_passive_walker.envs import memory, saved, task, ticks
from gym_passive_walker.envs.constraints import ROOM
from gym_passive_walker.envs.custom import Custom, is_custom
from gym_passive_walker.envs.disturbances import Contact, Disturbances, disturbed
from gym_passive_walker.envs.interface import observation_space, refuse
from gym_passive_walker.envs.one_thread import Token
from gym_passive_walker.envs.randomized import Randomized, settled
from gym_passive_walker.envs.saved import ROUNDING
from gym_passive_walker.gaits.scenes.checks import check_point_feet, checked
from gym_passive_walker.gaits.scenes.rewards import DRAWN, OWN
from gym_passive_walker.gaits.scenes.rules import ENERGIES, KNEE_LOCK, proportion
from gym_passive_walker.gaits.scenes.scene import Scene, SceneError, recorded_weight
from gym_passive_walker.gaits.scenes.starts import DRAWS, Starts, as_recorded
from gym_passive_walker.models.equations.hybrid import System
from gym_passive_walker.models.equations.systems import FITTINGS, UNEVEN
from gym_passive_walker.models.model import bodies
from gym_passive_walker.models.units import observed_numbers
from gym_passive_walker.models.walkers import Walker

RESET_OPTIONS = ("state", "slope")
"""Options of `reset`."""

_WALKERS_OF_A_THREAD = 512  # at least

UNFINISHED = "no episode has begun, or an error interrupted the last step: reset all environments"
"""Message for a step of a batch that is `unfinished`."""


def rules_of(scene: Scene, system: System, step_limit: float) -> NDArray:
    """Return the rules of a scene as kernels read them, (1,) of `task.RULES`."""
    rules = np.zeros(1, task.rules_for(layout_of(system)))
    rules["tick"] = scene.tick if scene.control == "tick" else math.inf
    rules["max_stride_time"] = scene.max_stride_time
    rules["actions"] = len(scene.actions)
    for i, name in enumerate(scene.actions):
        channel = scene.channels.index(name)
        rules["channels"][0, i], rules["largest"][0, channel] = channel, scene.largest(name)
    rules["energy_weight"] = scene.energy_weight
    rules["charged"] = ENERGIES.index(scene.energy)
    rules["step_limit"] = step_limit
    rules["reset_noise_scale"] = scene.ends("reset_noise_scale")[1]
    rules["weight"] = recorded_weight(scene.walker)
    rules["works"][0, : len(system.works)] = np.divide(system.works, rules["weight"])
    rules["works"][0, -1] = 1.0
    places = scene.walker.exchanged_places
    rules["exchange"][0, : len(places)], rules["exchanged"] = places, len(places)
    rules["coordinates"] = 0 if KNEE_LOCK in scene.walker.supports else system.coordinates
    return rules


def system_in(scene: Scene, *walkers: Walker) -> System:
    """Return the system of equations of walkers of one kind in a scene."""
    fitted = {name for name in FITTINGS for walker in walkers if getattr(walker, name, 0.0)}
    using = {*fitted, *scene.randomized, *scene.actions}
    return walkers[0].equations({*using, *(UNEVEN if scene.terrain else ())})


def radii_of(walkers: Sequence[Walker]) -> NDArray[np.float64]:
    """Return the foot radii in leg lengths, (n,)."""
    return np.array([walker.foot_radius / walker.leg_length for walker in walkers])


def observed_bodies(scene: Scene, walkers: Sequence[Walker]) -> NDArray[np.float32]:
    """Return the proportions of walkers that a scene's agents observe, (walkers, names)."""
    found = np.zeros((len(walkers), len(scene.observe_body)), np.float32)
    if scene.observe_body:
        known = {walker: observed_numbers(walker, scene.observe_body) for walker in {*walkers}}
        found[:] = [known[walker] for walker in walkers]
    return proportion(found)


def _check_alike(scene: Scene, walkers: Sequence[Walker]) -> None:
    """Check that one set of equations and of rules is that of all walkers, and of the scene's."""
    each = {scene.walker, *walkers}
    if len({walker.kind for walker in each}) > 1:
        raise SceneError(
            "walkers of one batch, and the scene's, must be of one kind: all with free knees, all "
            "with held knees, all with straight legs, all with legs without mass, or all one system"
        )
    weights = np.array([recorded_weight(walker) for walker in each])
    if np.ptp(weights) > ROUNDING * weights[0]:
        raise SceneError(
            "systems of one batch, and the scene's, must have one weight, by which torques and "
            f"energies are measured, not from {weights.min():g} to {weights.max():g}"
        )
    checked(check_point_feet, scene.actions, *each)


class Batch:
    """A batch of walkers: records, ledger, starts and control steps.

    One thread at a time may use a batch: environments hold its `token` around every call.

    Args:
        scene: The scene.
        count: Number of walkers.
        walkers: Walkers of the scene's kind, (count,), instead of the scene's.
        slopes: Slopes in rad, (count,), instead of the scene's.
        step_limit: Steps after which an episode is truncated.
        threads: Most threads, with at least 512 walkers each; all free CPUs' when None.

    Attributes:
        walkers: The walker of each environment, (count,).
        records: States of the integration, (count, 1) of `engine.layout.RECORD`.
        ledger: Accounts of stride and episode, (count,) of `task.LEDGER`.
        randoms: Random generator of each environment, (count,).
        observation_size: Size of an observation.
        observations: Observations of all walkers, flat, from `step_alone`.
        step_limit: Steps after which an episode is truncated.
        custom: The user's own functions; None without them.
        disturbances: Disturbances; None in a scene without them.
        token: Token that the calling thread holds; see `one_thread`.
        randomized: Draws of domain randomization; None without it.
        scene_infos: Whether `info` has entries that depend on the scene.
        unfinished: Whether all walkers must be reset: they have not begun, or an error or an
            interrupt has ended the last step or reset before it was complete.

    Raises:
        SceneError: if the walkers are of different kinds or weights, or a count does not fit.
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
        self.custom = Custom(scene, count) if is_custom(scene) else None
        self._shown = self.custom.observation_size if self.custom else None
        self.observation_size: int = self._shown or observation_space(scene).shape[0]
        self.step_limit = step_limit
        self.threads = None if threads is None else whole(threads, "threads")
        self.walkers = [scene.walker] * count if walkers is None else list(walkers)
        _check_alike(scene, self.walkers)
        slope_of = [None] * count if slopes is None else check_slope(slopes).tolist()
        shared: dict[Any, Starts] = {}
        self._starts = [
            shared.setdefault((walker, slope), Starts(scene, walker, slope))
            for walker, slope in zip(self.walkers, slope_of, strict=True)
        ]
        self._proportions = observed_bodies(scene, self.walkers)
        own = self.custom is not None and (self._shown or not self.custom.native)
        self._apart = bool(own or scene.observe_body)  # a step is more than one compiled call
        self._alike_starts = len(shared) == 1
        self.randomized = Randomized(self._starts) if scene.domain_randomization else None
        self._drawn_before: Randomized | None = None  # the last draws, of a scene before this one
        self._alike = walkers is None and not self.randomized
        self._alike &= scene.walker.legs_alike  # else each exchanges its own
        self.disturbances: Disturbances | None = None
        if disturbed(scene):
            self.disturbances = Disturbances(scene, self.system.name, count)
        shown = self.walkers[:1] if self._alike and not self.disturbances else self.walkers
        self.scene_infos = bool(self.disturbances or self.randomized or scene.reward_terms)
        self.bodies = bodies(*shown)
        if self.disturbances:
            self.bodies = np.pad(self.bodies, ((0, 0), (0, 0), (0, ROOM)))
        self._radii = radii_of(shown)
        self.layout = layout_of(self.system)
        self.rules = rules_of(scene, self.system, step_limit)
        self.randoms: list[np.random.Generator] = []
        self.unfinished = True
        self._report: tuple[NDArray, NDArray] | None = None  # of the last step, if it is written
        self._last: tuple[NDArray, ...] | None = None  # walkers, ledgers and notes; see `go_on`
        self.arrays: dict[str, NDArray] = {}
        self._connect()
        self.records, self.ledger = self.arrays["records"], self.arrays["ledger"]

    def changed(self, scene: Scene) -> Batch:
        """Return a batch of equal size in another scene, before its episodes; see `become`.

        Raises:
            SceneError: if its observation space or its actions differ, or it changes what each
                walker has of its own.
        """
        for name, of_all in (("walkers", "walker"), ("slopes", "slope")):
            own = self._given[name] is not None
            if own and getattr(scene, of_all) != getattr(self.scene, of_all):
                raise SceneError(
                    f"{of_all} of the scene has no effect, since the environments have {name} of "
                    f"their own: leave it as it is, or make other environments"
                )
        fresh = Batch(scene, self.count, threads=self.threads, **self._given)
        now, later = (
            (each.observation_size, each.scene.actions, observation_space(each.scene, each.custom))
            for each in (self, fresh)
        )
        if now != later:
            others = " within other bounds" * (now[:2] == later[:2])
            raise SceneError(
                f"an environment keeps its {now[0]} numbers of observation and its actions "
                f"{now[1]}, and the new scene has {later[0]}{others} and {later[1]}: they cannot "
                "change; make another environment"
            )
        fresh.ledger["truncated"] = 1
        return fresh

    def become(self, fresh: Batch) -> None:
        """Become the batch that `changed` returned, with the random generators of this batch."""
        drawn = self.randomized or self._drawn_before
        if fresh.randomized:
            fresh.randomized.follow(drawn)
        kept = {"randoms": self.randoms, "token": self.token, "_drawn_before": drawn}
        self.__dict__ = fresh.__dict__ | kept

    @property
    def has_own(self) -> bool:
        """Whether walkers or slopes are given for each environment, in place of the scene's."""
        return self._given["walkers"] is not None or self._given["slopes"] is not None

    @property
    def of_first(self) -> dict[str, Any]:
        """Arguments of the scene that the first walker has of its own: its walker and slope."""
        rows = {"walker": self._given["walkers"], "slope": self._given["slopes"]}
        return {name: row[0] for name, row in rows.items() if row is not None}

    @property
    def starts_alike(self) -> bool:
        """Whether compiled code can begin episodes: all start alike, and all rules are compiled."""
        alike = self._alike_starts and not self.randomized
        return alike and (not self.custom or self.custom.native)

    def _connect(self) -> None:
        """Make the arrays that are not there, set compiled code in them, and the entry point."""
        name, scene = self.system.name, self.scene  # `system` registers its name
        lengths = {
            "walkers": self.count, "channels": len(scene.actions),
            "delay": int(scene.ends("action_delay")[1]),
            "seen": observation_space(scene).shape[0],
        }  # fmt: skip
        parts = {"disturbed": self.disturbances, "custom": self.custom}
        given = {"bodies": self.bodies, "radii": self._radii, "rules": self.rules} | self.arrays
        given["options"] = options(scene.tolerance, scuff=bool(scene.end_on_toe_stub))
        given["phases"] = compiled(name)
        if self.disturbances:
            given["phases"], given["hooks"] = self.disturbances.hooks
        for part in filter(None, parts.values()):
            given |= part.arrays()
        declared = memory.present(*(feature for feature, part in parts.items() if part))
        self.arrays = memory.made(declared, self.layout, lengths, given)
        threads = self.count // _WALKERS_OF_A_THREAD
        if threads > 1:
            threads = min(threads, self.threads or default_threads())
        self.entry_point = ticks.EntryPoint(self.arrays, max(1, threads), **lengths)
        self.observations = self.arrays["observations"]
        # The default observation, if the user's function returns another one.
        self._plain = self.observations if self._shown else None
        if self._shown:
            self.observations = np.zeros(self.count * self._shown, np.float32)

    @property
    def system(self) -> System:
        """The system of equations of the walkers."""
        return system_in(self.scene, *set(self.walkers))

    def start(
        self,
        lanes: ArrayLike,
        observations: NDArray[np.float32],
        options: Mapping[str, Any] | None = None,
    ) -> None:
        """Begin a new episode for some of the walkers.

        The batch is `unfinished` then; the environment sets it to False when it is done.

        Args:
            lanes: Indices of the walkers.
            observations: Flat array (count * observation_size,); entries of these walkers are
                filled.
            options: "state" and "slope" instead of random ones, in the walker's units: one for all
                walkers, or one for each walker of the batch.

        Raises:
            ValueError: if an option is unknown or outside its range; the batch is unchanged then,
                except for its random generators.
        """
        where = np.array(lanes, np.int64)
        if not len(where):
            return
        if self._last is not None:
            others = ~np.isin(self._last[0], where)
            self._last = tuple(rows[others] for rows in self._last)
        if self.custom and len(where) == self.count:
            self.custom.look_again()
        plain = observations if self._plain is None else self._plain
        if self.starts_alike and not options:
            self._prepare()
            self.unfinished = True
            self.entry_point.kernels.begin_alike(self.entry_point.address, where, plain)
            self._write_observations(observations, where)
            return
        states, asked = self._asked(options) if options else (None, None)
        draws = self.drawn(where)
        walkers, drawn, values = [self.walkers[i] for i in where.tolist()], None, None
        if self.randomized:
            walkers, values = self.randomized.draw(where, self.randoms, asked)
            drawn = settled(self.scene, self.randomized.names, values)
            draws[:, 1:] = 0.5 + drawn["noise"][:, None] * (draws[:, 1:] - 0.5)
        if asked is not None:
            slopes = asked[where]
        elif drawn is not None and np.isfinite(drawn["slope"]).all():
            slopes = drawn["slope"].copy()
        else:
            slopes = self._of_starts(Starts.slopes, where, draws[:, 0])
        if states is not None:
            each = zip(walkers, states[where].tolist(), strict=True)
            found = [walker.checked_state(state) for walker, state in each]
            gaits = as_recorded(self.walkers[0], found)
            draws[:] = 0.5  # no change
        elif asked is not None:
            each = zip(where.tolist(), slopes.tolist(), strict=True)
            found = [self._starts[i].state(slope) for i, slope in each]
            gaits = as_recorded(self.walkers[0], found)
        else:
            gaits = self._of_starts(Starts.states, where, slopes)
        keyed = [self.randoms[i] for i in where.tolist()] if self.disturbances else []
        keys = np.array([each.integers(2**64, dtype=np.uint64) for each in keyed], np.uint64)
        self.unfinished = True
        if self.randomized and values is not None:
            self.randomized.begin(where, values)
            self._embody(where, walkers)
        given = where, slopes, gaits, draws, keys, plain
        self.entry_point.kernels.begin(self.entry_point.address, *given)
        if self.disturbances and drawn is not None:
            self.disturbances.settle(where, drawn)
        self._write_observations(observations, where)

    def go_on(self, lanes: NDArray[np.int64], observations: NDArray[np.float32]) -> None:
        """Begin the next episodes of walkers after the step that ended their last; see `start`.

        The terms of their last rewards are still those of that step, unless the scene is new.
        """
        walked = lanes[self._stepped[lanes]]
        last = walked, *(rows.take(walked) for rows in self._accounts)
        self.start(lanes, observations)
        self._last = last

    def _embody(self, lanes: NDArray[np.int64], walkers: Sequence[Walker]) -> None:
        """Replace some of the walkers."""
        for i, walker in zip(lanes.tolist(), walkers, strict=True):
            self.walkers[i] = walker
        constants = bodies(*walkers)  # readings of checks are behind them
        odd = self.ledger["strides"][lanes] % 2 == 1  # on the other leg
        constants[odd] = self.walkers[0].swap(constants[odd])
        self.bodies[lanes, :, : constants.shape[-1]] = constants
        self._radii[lanes] = radii_of(walkers)
        self._proportions[lanes] = observed_bodies(self.scene, walkers)

    def _prepare(self) -> None:
        """Set the generators and starts for compiled code that begins episodes."""
        self.entry_point.draw_from(self.randoms)
        self.entry_point.begin_at(self._starts[0])

    def drawn(self, where: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the random numbers of some walkers' starts, (lanes, DRAWS)."""
        draws = np.empty((len(where), DRAWS))
        self.entry_point.draw_from(self.randoms)
        ticks.draw_numbers(self.entry_point.address, where, draws, np.zeros(0, np.uint64))
        return draws

    def _of_starts(
        self,
        method: Callable[[Starts, NDArray[np.float64]], NDArray[np.float64]],
        where: NDArray,
        numbers: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return what a method of starts returns of numbers: a row for all walkers, or for each."""
        if self._alike_starts:
            return method(self._starts[0], numbers)
        each = enumerate(where.tolist())
        return np.concatenate([method(self._starts[i], numbers[j : j + 1]) for j, i in each])

    def _asked(
        self, options: Mapping[str, Any]
    ) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]:
        """Return the states and slopes in options, one for each walker; None if not given."""
        found: list[NDArray[np.float64] | None] = []
        numbers = self.walkers[0].size
        for name, check, size in (
            ("state", partial(check_state, of=self.walkers[0]), (numbers,)),
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
        """Set the slopes of the strides that some walkers begin.

        Args:
            slopes: Slopes in rad, one for each walker of the batch, or one for all. Slopes of a
                terrain's footholds are added.
            lanes: Whether to set the slope of each walker, (count,).

        Raises:
            ValueError: if a slope is invalid, or a walker has begun its stride already.
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
            checked = self.disturbances.set_slopes(checked, lanes)
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
            height_changes: Added to the height of the next foothold, in leg lengths; one for all,
                or (count,).
            impulses: Pushes of the hip, in units of m sqrt(g l), positive downhill; one for
                all, or (count,).
            times: Times of the pushes since the stride began, in sqrt(l/g); one for all, or
                (count,).

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

    def reward_terms(self) -> dict[str, NDArray[np.float64]]:
        """Return the terms of the last rewards by name, each (count,); a reward is their sum.

        They are zero for a walker that has begun an episode, or rested, in place of a step.
        """
        terms, stepped = self._terms(*self._accounts), self._stepped
        terms = {name: np.where(stepped, term, 0.0) for name, term in terms.items()}
        if self._last is not None:
            lanes, *rows = self._last
            for name, term in self._terms(*rows).items():
                terms[name][lanes] = term
        return terms

    @property
    def _stepped(self) -> NDArray[np.bool_]:
        """Whether each walker has made the last step, (count,): it is one of its episode."""
        return (self.ledger["steps"] > 0) & (self.records["outcome"][:, 0] != RESTING)

    @property
    def _accounts(self) -> tuple[NDArray, ...]:
        """Accounts of the last step: the ledger, and the transitions of the user's functions."""
        return (self.ledger, self.custom.notes) if self.custom else (self.ledger,)

    def _terms(self, ledger: NDArray, *notes: NDArray) -> dict[str, NDArray]:
        """Return the terms of the rewards in rows of `_accounts`."""
        if self.custom and "reward" in self.custom.rules:
            return self.custom.terms(*notes)
        terms = {
            "distance": ledger["distance"], "energy": -self.scene.energy_weight * ledger["energy"]
        }  # fmt: skip
        if self.scene.command is not None:
            terms["command"] = ledger["reward"] - (terms["distance"] + terms["energy"])
        return terms

    def observe(self) -> NDArray[np.float32]:
        """Return the observations of all walkers, (count, observation_size)."""
        observations = np.empty(self.count * self.observation_size, np.float32)
        if self.scene.shows_own:
            plain = observations if self._plain is None else self._plain
            self.entry_point.kernels.observe(self.entry_point.address, plain)
        self._write_observations(observations)
        return observations.reshape(self.count, -1)

    def _write_observations(
        self, observations: NDArray[np.float32], lanes: Any = slice(None)
    ) -> None:
        """Write the observed proportions of all walkers, and the user's own observations of some.

        Args:
            observations: Filled, flat: (count * observation_size,).
            lanes: The walkers with the user's own observations.
        """
        plain = observations if self._plain is None else self._plain
        rows = plain.reshape(self.count, -1)
        if size := self._proportions.shape[1]:
            rows[:, -size:] = self._proportions
        if self.custom and self._plain is not None:
            known = {}
            if self.custom.groups:
                known[OWN] = rows
                if self.randomized:
                    known[DRAWN] = self.randomized.scaled
            self.custom.observe(observations, lanes, known)

    def in_groups(self, observations: Any) -> Any:
        """Return observations (..., k) as environments do: by group, if there are any."""
        if self.custom is None or self.custom.groups is None:
            return observations
        groups = sorted(self.custom.groups.items())
        return {name: observations[..., place] for name, place in groups}

    def info_values(self, stepped: NDArray[np.bool_] | None = None) -> dict[str, Any]:
        """Return copies of the entries of `info` that depend on the scene, each (count,).

        "randomized" has the drawn values, a dictionary of such arrays.

        Args:
            stepped: Whether each walker has made a step, (count,): the others have no reward.
        """
        found: dict[str, Any] = {}
        if self.disturbances:
            values = self.disturbances.info_values(self.bodies)
            found = {name: column.copy() for name, column in values.items()}
        if self.randomized:
            found["randomized"] = self.randomized.info_values()
        if self.scene.reward_terms:
            for name, term in self.reward_terms().items():
                found[f"reward_{name}"] = term if stepped is None else np.where(stepped, term, 0.0)
        return found

    def reported(
        self, stepped: NDArray[np.bool_], *, just_now: bool = False
    ) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """Return the entries of `info` that every scene has, of walkers that have made a step.

        Args:
            stepped: Whether each walker has made a step, (count,); entries of the others are zero.
            just_now: Whether these are the walkers that made the last step.

        Returns:
            EVERY_STEP without the strides, (entries, count); number of strides and index of the
            outcome in OUTCOMES, (2, count); the walkers that have ended a stride, in any order; and
            their EVERY_STRIDE, (walkers, entries), which is zero for all others.
        """
        if (report := self._report) is None:
            report = self._new_report()
            self.entry_point.write_info(self.entry_point.address, *report)
        steps, counts = report
        number = self.entry_point.ended.item(0)
        ended = self.entry_point.ended[1 : number + 1].copy()
        measures = self.entry_point.measures[:number].copy()
        if not (just_now and self._report) and not stepped.all():
            steps, counts = np.where(stepped, steps, 0.0), np.where(stepped, counts, 0)
            ended, measures = ended[stepped[ended]], measures[stepped[ended]]
        return steps, counts, ended, measures

    def step(
        self,
        actions: NDArray[np.floating],
        observations: NDArray[np.float32],
        *results: NDArray,
        again: bool = False,
    ) -> tuple[int, int]:
        """Step each walker within an episode; the reward of the others is 0.

        Args:
            actions: Actions, flat: (count * actions of the scene,).
            observations: Filled, flat: (count * observation_size,).
            *results: Filled: rewards, float64, terminations and truncations, each (count,).
            again: Whether walkers without an episode begin the next one.

        Returns:
            Number of strides that end, and number of episodes that end. The batch is `unfinished`;
            the environment sets it to False when it is done.

        Raises:
            ValueError: if an action is not finite; the batch is unchanged then.
        """
        entry_point, at_once = self.entry_point, again and self.starts_alike
        seen = observations if self._plain is None else self._plain
        entry_point.actions[...] = actions
        self._report = self._last = None
        if at_once:
            self._prepare()
        self.unfinished, report = True, self._new_report()
        strides, endings = entry_point.step(at_once, seen, *results, *report)
        if strides < 0:
            self.refuse(-1 - strides)
        if not self.custom or self.custom.native:  # else an episode may end below
            self._report = report
        if self._apart:
            if self.custom and not self.custom.native:
                endings += self.custom.evaluate(self, *results[:2])
            self._write_observations(observations)
        if again and not at_once:
            self.start(np.flatnonzero(self.records["outcome"][:, 0] == RESTING), observations)
        return strides, endings

    def step_alone(self, action: NDArray[np.floating]) -> tuple[int, int]:
        """Step a batch of one; the results go to the arrays of the `EntryPoint`."""
        entry_point = self.entry_point
        if self._apart:
            return self.step(action, self.observations, *entry_point.results)
        entry_point.actions[...] = action
        self.unfinished = True
        answer = entry_point.step_here()
        if answer < 0:
            self.refuse(-1 - answer)
        return ticks.counts(answer)

    def _new_report(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return arrays for `write_info`."""
        rows = len(task.EVERY_STEP) - 1
        return np.empty((rows, self.count)), np.empty((2, self.count), np.int64)

    def refuse(self, wrong: int) -> NoReturn:
        """Raise an error for the action of a walker in the `EntryPoint`."""
        self.unfinished = False
        lane = wrong if self.count > 1 else None
        refuse(self.entry_point.actions.reshape(self.count, -1)[wrong], self.scene.actions, lane)

    def __getstate__(self) -> dict[str, Any]:
        kept = {name: array for name, array in self.arrays.items() if name not in memory.COMPILED}
        return {**self.__dict__, "arrays": kept, "entry_point": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._connect()

    @property
    def over(self) -> NDArray[np.bool_]:
        """Whether the episode of each walker has ended, (count,)."""
        return saved.over_in(self.ledger)

    @property
    def states(self) -> NDArray[np.float64]:
        """States in the walkers' units, (count, 6), or (count, 2 m) of a `System`."""
        half = self.walkers[0].size // 2
        states = states_in(self.records[:, 0], half).copy()
        states[:, half:] /= np.array([walker.time_unit for walker in self.walkers])[:, None]
        return states

    def contact(self, lane: int) -> Contact:
        """Return the contact point of a walker's stance foot."""
        radius = self._radii[lane if len(self._radii) > 1 else 0]
        length, record = self.walkers[lane].leg_length, self.records[lane, 0]
        if self.disturbances and self.scene.terrain is not None:
            rolled, here = radius * (record["start"][0] - record["state"][0]), self.disturbances
            x, y, tilt = (float(here.states[name][lane]) for name in ("x", "y", "tilt"))
            x, y = x + rolled * math.cos(tilt), y - rolled * math.sin(tilt)
            return Contact(float(x * length), float(y * length), tilt)
        rolled = radius * record["state"][0]
        return Contact(float(self.ledger["origin"][lane] - rolled) * length)

    @property
    def saved_arrays(self) -> dict[str, NDArray]:
        """Arrays of a saved state, by name."""
        arrays = self.arrays.items()
        drawn = self.randomized.saved_arrays if self.randomized else {}
        found = {name: array for name, array in arrays if memory.ARRAYS[name].limits is not None}
        return found | drawn

    def get_state(self) -> dict[str, Any]:
        """Return a copy of everything that determines later steps."""
        return {
            "scene": self._described,
            "energy_cost": ENERGIES[int(self.rules["charged"][0])],
            "walkers": [saved.kept(walker) for walker in self.walkers],
            "random": [deepcopy(r.bit_generator.state) for r in self.randoms],
            **{name: array.copy() for name, array in self.saved_arrays.items()},
        }

    @cached_property
    def _limits(self) -> list[saved.Limits]:
        return saved.limits_of(self)

    @cached_property
    def _described(self) -> str:
        return saved.described(self.scene)

    def checked(self, state: Any, **flags: tuple[int, ...]) -> dict[str, Any]:
        """Return copies of the entries of a state after checks; the batch does not change.

        Args:
            state: From `get_state`.
            **flags: Shapes of the booleans that an environment adds, by name. A single boolean, of
                shape (), says whether all walkers had begun an episode.

        Raises:
            StateError: if the state is damaged, or of another batch.
        """
        if isinstance(state, Mapping) and "scene" in state:  # the most informative error
            saved.check_scene(state["scene"], self._described)
        arrays = self.saved_arrays
        own = "scene", "energy_cost", "walkers", "random"
        given = saved.entries(state, [*own, *arrays, *flags])
        found: dict[str, Any] = {
            name: saved.like(given[name], name, own) for name, own in arrays.items()
        }
        found |= {name: saved.flags(given[name], name, shape) for name, shape in flags.items()}
        begun = all(found[name] for name, shape in flags.items() if shape == ())
        saved.check_arrays(found, self._limits, begun=begun)
        if self.randomized:
            self.randomized.check(found, begun=begun)
        found["energy_cost"] = saved.check_energy(given["energy_cost"])
        found["walkers"] = saved.check_walkers(given["walkers"], self.walkers, self._starts)
        kind = type(self.randoms[0].bit_generator) if self.randoms else np.random.PCG64
        found["random"] = saved.check_randoms(given["random"], self.count, kind)
        return found

    def put_back(self, found: Mapping[str, Any]) -> None:
        """Restore a state from `checked`."""
        self.unfinished = True
        self.rules["charged"], self._last = ENERGIES.index(found["energy_cost"]), None
        for name, array in self.saved_arrays.items():
            array[:] = found[name]
        if not self._alike:
            self._embody(np.arange(self.count), found["walkers"])
        for random, state in zip(self.randoms, found["random"], strict=False):
            random.bit_generator.state = state
        if self.randomized:
            self.randomized.put_back(self.randoms)
