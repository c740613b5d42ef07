"""Any number of walkers in a scene: what the single and the vector environments have in common."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.arguments import check_slope, check_state
from gym_passive_walker.envs import task as T
from gym_passive_walker.envs.interface import refuse
from gym_passive_walker.envs.scene import Scene, SceneError
from gym_passive_walker.envs.starts import DRAWS, Starts, checked_state
from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics import record as R
from gym_passive_walker.physics.constants import Kind
from gym_passive_walker.physics.engine import in_parts, step_control
from gym_passive_walker.physics.lanes import cache_directory
from gym_passive_walker.walkers import Walker

OPTIONS = ("state", "slope")
"""What `reset` may be asked for."""

_CROWD = 2048  # walkers from which on threads may share the work


def _rules(scene: Scene, step_limit: float) -> NDArray[np.float64]:
    """A scene's rules, as the kernel reads them."""
    rules = np.empty(T.RULES)
    rules[T.TICK] = scene.tick if scene.control == "tick" else math.inf
    rules[T.LONGEST_STRIDE] = scene.longest_stride
    rules[T.MAX_HIP_TORQUE] = scene.max_hip_torque
    rules[T.ENERGY_WEIGHT] = scene.energy_weight
    rules[T.CHARGED] = T.ENERGIES.index(scene.energy)
    rules[T.STEP_LIMIT] = step_limit
    rules[[T.TOLERANCE, T.LANDING, T.FIRST_STEP]] = step_control(scene.tolerance)
    rules[T.STUB] = scene.stub
    return rules


def _kernel(kind: Kind) -> Any:
    """The step of a kind of walker; says so where compiling it will take a while."""
    kernel = T.KERNELS[kind]
    name = f"task.{kernel.py_func.__name__}-*.nbi"
    if not kernel.signatures and not any(cache_directory().rglob(name)):
        print(
            "gym_passive_walker: compiling the walker's equations, once; a minute or so",
            file=sys.stderr,
            flush=True,
        )
    return kernel


class Batch:
    """Walkers side by side: their records and ledger, starts and steps.

    Args:
        scene: What is simulated.
        count: How many walkers.
        walkers: A walker for each, of one kind, instead of the scene's.
        slopes: A slope for each, instead of the scene's.
        step_limit: Steps after which an episode is truncated.
        threads: How many threads large batches use; numba's number when None.

    Attributes:
        kind: Which equations the walkers obey.
        walkers: The walker in each place.
        records: See `physics.record`; shape (count, FIELDS).
        ledger: See `envs.task`; shape (count, COLUMNS).
        randoms: Each walker's own source of random numbers.

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
        if count < 1:
            raise SceneError(f"there must be at least one walker, not {count!r}")
        for name, given in (("walkers", walkers), ("slopes", slopes)):
            if given is not None and len(given) != count:
                raise SceneError(f"{name}: {len(given)} of them for {count} environments")
        self.scene, self.count, self.threads = scene, count, threads
        self.walkers = [scene.walker] * count if walkers is None else list(walkers)
        kinds = {K.kind_of(walker) for walker in self.walkers}
        if len(kinds) > 1:
            raise SceneError(
                "walkers of one batch must be of one kind: all with knees, all with straight legs, "
                "or all with legs without mass"
            )
        self.kind = kinds.pop()
        slope_of = [None] * count if slopes is None else check_slope(slopes).tolist()
        shared: dict[Any, Starts] = {}
        self._starts = [
            shared.setdefault((walker, slope), Starts(scene, walker, slope))
            for walker, slope in zip(self.walkers, slope_of, strict=True)
        ]
        self._alike_starts = len(shared) == 1
        self._kind = int(self.kind)
        self._alike = walkers is None and not scene.randomise
        known = {walker: K.constants(walker) for walker in set(self.walkers)}
        shown = self.walkers[:1] if self._alike else self.walkers
        self.constants = np.array([known[walker] for walker in shown])
        self.records = np.zeros((count, R.FIELDS))
        self.ledger = np.zeros((count, T.COLUMNS))
        self.rules = _rules(scene, step_limit)
        self.randoms: list[np.random.Generator] = []
        self.step_kernel = _kernel(self.kind)

    def start(
        self,
        lanes: ArrayLike,
        observations: NDArray[np.float32],
        options: Mapping[str, Any] | None = None,
    ) -> None:
        """Begin a new episode for some of the walkers.

        Args:
            lanes: Which.
            observations: Theirs are filled, in the flat array of all: shape (count * SIZE,).
            options: "state" (one for each walker of the batch, or one for all) and "slope"
                (likewise), in the walker's own units, instead of those drawn.

        Raises:
            ValueError: if an option is unknown or out of its range; nothing has changed then
                but the random numbers taken.
        """
        where = np.array(lanes, np.int64)
        states, asked = self._asked(options) if options else (None, None)
        draws = np.empty((len(where), DRAWS))
        for draw, i in zip(draws, where.tolist(), strict=True):
            self.randoms[i].random(out=draw)
        varied = {}
        if self.scene.randomise:
            varied = {i: self._starts[i].varied(self.randoms[i]) for i in where.tolist()}
        slopes, gaits = self._nominal(where, draws[:, 0], asked, wanted=states is None)
        if states is not None:
            given = [(states[i].tolist(), varied.get(i, self.walkers[i])) for i in where.tolist()]
            gaits = np.array([checked_state(state, walker) for state, walker in given])
            draws[:] = 0.5  # no change
        for i, walker in varied.items():
            self.walkers[i], self.constants[i] = walker, K.constants(walker)
        T.begin(
            self.records, self.constants, self.ledger, self._kind,
            where, slopes, gaits, draws, self.scene.perturbation, observations,
        )  # fmt: skip

    def _nominal(
        self,
        where: NDArray[np.int64],
        shares: NDArray[np.float64],
        asked: NDArray[np.float64] | None,
        *,
        wanted: bool,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Slopes, drawn or asked for, and if wanted the gaits there: a row for all, or for each."""
        none = np.zeros((1, 6))
        if asked is not None:
            slopes = asked[where]
            if not wanted:
                return slopes, none
            each = zip(where.tolist(), slopes.tolist(), strict=True)
            return slopes, np.array([self._starts[i].gait(slope) for i, slope in each])
        if self._alike_starts:
            starts = self._starts[0]
            slopes = starts.slopes(shares)
            return slopes, starts.gaits(slopes) if wanted else none
        slopes, gaits = np.empty(len(where)), np.zeros((len(where), 6))
        for j, i in enumerate(where.tolist()):
            slopes[j : j + 1] = self._starts[i].slopes(shares[j : j + 1])
            if wanted:
                gaits[j : j + 1] = self._starts[i].gaits(slopes[j : j + 1])
        return slopes, gaits

    def _asked(
        self, options: Mapping[str, Any]
    ) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]:
        """The states and slopes that options ask for, one for each walker."""
        unknown = set(options) - set(OPTIONS)
        if unknown:
            raise ValueError(
                f"reset knows no option {', '.join(map(repr, sorted(unknown)))}; "
                f"it knows {', '.join(map(repr, OPTIONS))}"
            )
        states, slopes = None, None
        try:
            if options.get("state") is not None:
                states = np.broadcast_to(check_state(options["state"]), (self.count, 6))
            if options.get("slope") is not None:
                slopes = np.broadcast_to(check_slope(options["slope"]), (self.count,))
        except (TypeError, ValueError) as error:
            raise ValueError(f"reset options {dict(options)!r}: {error}") from None
        return states, slopes

    def observe(self, observations: NDArray[np.float32]) -> None:
        """Write all walkers' observations, flat: shape (count * SIZE,)."""
        T.observe(self.records, self.ledger, self._kind, observations)

    def step(
        self,
        actions: NDArray[np.float64],
        observations: NDArray[np.float32],
        rewards: NDArray[np.float64],
        terminated: NDArray[np.bool_],
        truncated: NDArray[np.bool_],
    ) -> tuple[int, int]:
        """A step of every walker whose episode goes on; the others get a reward of 0.

        Args:
            actions: Shape (count,).
            observations: Filled, flat: shape (count * SIZE,).
            rewards: Filled; shape (count,).
            terminated: Filled; shape (count,).
            truncated: Filled; shape (count,).

        Returns:
            How many strides, and how many episodes have ended.

        Raises:
            ValueError: if an action is no finite number; nothing has changed then.
        """
        records, constants, ledger = self.records, self.constants, self.ledger
        if self.count < _CROWD:
            wrong, strides, endings = self.step_kernel(
                records, constants, ledger, self.rules,
                actions, observations, rewards, terminated, truncated,
            )  # fmt: skip
            if wrong >= 0:
                refuse(actions[wrong], int(wrong))
            return strides, endings
        for wrong in np.flatnonzero(~np.isfinite(actions) & ~self.over):  # before anyone steps
            refuse(actions[wrong], int(wrong))
        ended = []

        def job(a: int, b: int) -> None:
            own = constants[a:b] if len(constants) > 1 else constants
            seen = observations[a * T.SIZE : b * T.SIZE]
            counts = self.step_kernel(
                records[a:b], own, ledger[a:b], self.rules,
                actions[a:b], seen, rewards[a:b], terminated[a:b], truncated[a:b],
            )  # fmt: skip
            ended.append(counts[1:])

        in_parts(job, self.count, self.threads)
        return sum(strides for strides, _ in ended), sum(endings for _, endings in ended)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "step_kernel": None}  # compiled code stays at home

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.step_kernel = _kernel(self.kind)

    @property
    def over(self) -> NDArray[np.bool_]:
        """Which walkers' episodes have ended."""
        return (self.ledger[:, T.ENDING] != 0.0) | (self.ledger[:, T.TRUNCATED] != 0.0)

    @property
    def states(self) -> NDArray[np.float64]:
        """States in the walkers' own units, shape (count, 6)."""
        states = self.records[:, :6].copy()
        states[:, 3:] /= np.array([walker.time_unit for walker in self.walkers])[:, None]
        return states

    def contact(self, lane: int) -> float:
        """Where a walker's stance foot touches the ground, in its own units of length."""
        row = self.constants[lane if len(self.constants) > 1 else 0]
        rolled = row[K.FOOT_RADIUS] * self.records[lane, R.ANGLES]
        return float(self.ledger[lane, T.ORIGIN] - rolled) * self.walkers[lane].leg_length

    def get_state(self) -> dict[str, Any]:
        """All that decides what comes next; a copy."""
        return {
            "records": self.records.copy(),
            "ledger": self.ledger.copy(),
            "walkers": list(self.walkers),
            "random": [deepcopy(r.bit_generator.state) for r in self.randoms],
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Go back to a state that `get_state` gave.

        Raises:
            ValueError: if it is of another batch.
        """
        records, ledger = np.array(state["records"]), np.array(state["ledger"])
        if records.shape != self.records.shape or ledger.shape != self.ledger.shape:
            raise ValueError(f"this state is of {len(records)} walkers, and here are {self.count}")
        if self._alike and list(state["walkers"]) != self.walkers:
            raise ValueError("this state is of another walker")
        self.records[:], self.ledger[:] = records, ledger
        if not self._alike:
            self.walkers = list(state["walkers"])
            self.constants[:] = [K.constants(walker) for walker in self.walkers]
        for random, saved in zip(self.randoms, state["random"], strict=True):
            random.bit_generator.state = saved
