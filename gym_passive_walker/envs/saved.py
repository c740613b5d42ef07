"""Saved states of a batch, and the checks before `set_state` writes them.

Compiled code uses the indices in a record without checks: an invalid phase leads to an invalid
address. A saved state may come from a file, so each of its entries is checked. Functions that
check raise a `StateError`; its message names what is wrong.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import shown
from gym_passive_walker._tools.loading import parse_json, reason
from gym_passive_walker.envs.memory import ARRAYS, COUNTER, FINITE
from gym_passive_walker.envs.transitions import STOPPED
from gym_passive_walker.gaits.scenes.rules import ENERGIES
from gym_passive_walker.gaits.scenes.scene import Scene
from gym_passive_walker.gaits.scenes.starts import Starts
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.model import Model
from gym_passive_walker.models.walkers import Walker, name_of

_LATE = 1e-6  # largest delay of a push that is due, in sqrt(l/g)
ROUNDING = 1e-9
"""Relative error of numbers in a saved state."""


class StateError(ValueError):
    """The saved state is damaged, or belongs to another environment."""


def entries(state: Any, names: Sequence[str]) -> Mapping[str, Any]:
    """Return a saved state after a check that its entries have these names."""
    if not isinstance(state, Mapping):
        raise StateError(f"a state is what get_state returned, a mapping, not {shown(state)}")
    lacking = [name for name in names if name not in state]
    strange = [str(name) for name in state if name not in names]
    if lacking or strange:
        said = [f"{what} {', '.join(n)}" for what, n in (("lacks", lacking), ("has", strange)) if n]
        raise StateError(f"this state is of another kind of environment: it {' and '.join(said)}")
    return state


def _array(given: Any, name: str) -> NDArray:
    """Return a copy of an entry as an array."""
    try:
        return np.array(given)
    except Exception as error:  # a damaged file may hold anything
        raise StateError(f"the state's {name!r} is no array ({reason(error)})") from None


def flags(given: Any, name: str, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return a copy of an entry of booleans; the shape () is that of a single one."""
    array = _array(given, name)
    if array.dtype != np.bool_ or array.shape != shape:
        wanted = f"booleans of shape {shape}" if shape else "True or False"
        raise StateError(f"the state's {name!r} must be {wanted}, not {shown(given)}")
    return array


def like(given: Any, name: str, own: NDArray) -> NDArray:
    """Return a copy of an entry with the shape and type of the batch's own array."""
    array = _array(given, name)
    if array.dtype != own.dtype:
        raise StateError(
            f"the state's {name!r} has other fields or types than here: it was damaged, or saved "
            "by another version"
        )
    if array.shape != own.shape:
        raise StateError(
            f"this state is of {len(array) if array.ndim else 1} walkers, and here are {len(own)}: "
            f"its {name!r} has shape {array.shape}, not {own.shape}"
        )
    return array


def over_in(ledger: NDArray) -> NDArray[np.bool_]:
    """Return whether the episode of each walker has ended, (count,)."""
    return (ledger["ending"] != 0) | (ledger["truncated"] != 0)


def described(scene: Scene) -> str:
    """Return all arguments of a scene as JSON."""
    parts = {field.name: getattr(scene, field.name) for field in fields(scene)}
    return json.dumps(parts, default=_described)


def kept(walker: Any) -> Any:
    """Return a walker as saved: of a `System`, the name of its equations and its constants."""
    return walker if isinstance(walker, Walker) else (walker.kind, *map(float, walker.body))


def _described(value: Any) -> Any:
    """Return a NumPy number, the name of a function, or a walker in a form for JSON."""
    if isinstance(value, Model) and not isinstance(value, Walker):
        return [name_of(value), *kept(value)]
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    if callable(value):
        return f"{value.__module__}:{getattr(value, '__qualname__', type(value).__qualname__)}"
    return value.item()


def check_scene(given: Any, own: str) -> None:
    """Check that descriptions of a state's scene and of the batch's own are equal."""
    try:
        if str(given) == own:
            return
        theirs = parse_json(str(given))
    except (ValueError, RecursionError):  # text is nested less deeply than its lists may be
        theirs = None
    if not isinstance(theirs, dict):
        raise StateError("the state's 'scene' describes no scene: it was damaged")
    ours = json.loads(own)
    names = [name for name in {**ours, **theirs} if ours.get(name) != theirs.get(name)]
    if names:
        raise StateError(
            f"this state is of another scene (of another {', '.join(names)}): put it back into an "
            "environment of that scene"
        )


def check_energy(given: Any) -> str:
    """Return the kind of work that the energy term counts, after a check."""
    if str(given) not in ENERGIES:  # a file has text as an array
        allowed = " or ".join(map(repr, ENERGIES))
        raise StateError(f"the state's 'energy_cost' must be {allowed}, not {shown(given)}")
    return str(given)


def check_walkers(given: Any, own: Sequence[Walker], starts: Sequence[Starts]) -> list[Walker]:
    """Return the walkers of a state after a check that the batch permits them.

    Args:
        given: Walkers in the state, in the form of `kept`.
        own: Walkers of the batch, (count,).
        starts: Starts of each walker, with its nominal one and the draws, (count,).
    """
    row = list(given) if isinstance(given, Sequence) else []
    found = [_restored(entry, each.walker) for entry, each in zip(row, starts, strict=False)]
    if len(row) != len(own) or None in found:
        raise StateError(
            f"the state's 'walkers' must be a row of {len(own)} walkers of this environment's "
            f"kind, not {type(given).__name__} of {len(row)}"
        )
    for i, (walker, here, each) in enumerate(zip(found, own, starts, strict=True)):
        if walker == here or (values := _parameters(walker)) == _parameters(here):
            continue
        drawing = each.randomization
        off = []
        for name, value in _parameters(each.walker).items():
            if name == "knees":
                off += [name] * (values[name] != value)
                continue
            low, high = drawing.ends(name) if drawing else (value, value)
            room = ROUNDING * max(abs(low), abs(high))
            if not low - room <= values[name] <= high + room:
                off.append(name)
        if drawing is None or off:
            raise StateError(
                f"this state is of another walker than that of environment {i}: its "
                f"{', '.join(off) or 'parameters'} cannot be here"
            )
    return found  # type: ignore[return-value]


def _restored(entry: Any, base: Any) -> Walker | None:
    """Return the walker that `kept` wrote, of the kind of a base; None if it is none."""
    if isinstance(base, Walker):
        return entry if isinstance(entry, Walker) else None
    names = base.body._fields
    name, *values = entry if isinstance(entry, tuple | list) and entry else [None]
    if (
        not isinstance(name, str)
        or name != base.kind
        or [*map(type, values)] != [float] * len(names)
    ):
        return None
    return base.with_body(dict(zip(names, values, strict=True)))


def _parameters(walker: Any) -> dict[str, Any]:
    """Return the parameters of a walker, or the constants of a `System`, by name."""
    return walker.parameters | {"knees": walker.knees}


def check_randoms(given: Any, count: int, kind: type) -> list[dict[str, Any]]:
    """Return the states of bit generators of a class, (count,) or none, after a check."""
    row = list(given) if isinstance(given, Sequence) else None
    if row is None or len(row) not in (0, count):
        found = type(given).__name__ if row is None else len(row)
        raise StateError(f"the state's 'random' must be {count} states of generators, not {found}")
    for i, state in enumerate(row):
        try:
            _trial(kind).state = state
        except Exception:  # a damaged file may hold anything
            raise StateError(
                f"the state's 'random' of environment {i} is no state of a {kind.__name__} "
                "generator"
            ) from None
    return row


@cache
def _trial(kind: type) -> Any:
    """Return a generator that only tests states; no numbers are drawn from it."""
    return kind(0)


def require(name: str, holds: NDArray[np.bool_], allowed: str) -> None:
    """Check that a condition `holds` for every environment, (count,) or (count, ...).

    The message has the name of the entry and the values that are allowed.
    """
    if not holds.all():
        place = int(np.argmin(holds.reshape(len(holds), -1).all(axis=1)))
        raise StateError(f"the state's {name} of environment {place} must be {allowed}")


class Limits(NamedTuple):
    """Limits of those numbers in the rows of an array that have one type, each of 8 bytes.

    Attributes:
        array: Name of the array.
        kind: The type, "f8" or "i8".
        places: Places of the numbers in a row, (k,).
        names: The numbers' names in messages, (k,).
        low: Their smallest values, (k,).
        high: Their largest values, (k,).
    """

    array: str
    kind: str
    places: list[int]
    names: list[str]
    low: NDArray
    high: NDArray


def limits_of(batch: Any) -> list[Limits]:
    """Return the limits of the arrays in a state of a batch; see `memory.ARRAYS`."""
    rules, arrays, found = batch.rules[0], batch.arrays, []
    *largest, push_off = rules["largest"]
    bounds = {
        "phase": len(arrays["phases"]) - 1, "max_stride_time": rules["max_stride_time"],
        "lowest": np.negative(largest), "largest": largest, "push_off": push_off,
        "steps": min(batch.step_limit, COUNTER[1]),
        "reason": STOPPED - (batch.scene.terminated is None),
    }  # fmt: skip
    if batch.disturbances:
        bounds["slowest"], bounds["fastest"] = arrays["settings"]["command"][0]
        bounds["delay"] = arrays["pending"].shape[1]
    for array, own in batch.saved_arrays.items():
        if array not in ARRAYS:
            continue
        row = own.dtype if own.dtype.names else np.dtype([(array, own.dtype, own.shape[1:])])
        low, high, given = np.zeros(1, row), np.zeros(1, row), ARRAYS[array].limits or {}
        words = [name for name in row.names or () for _ in range(row[name].itemsize // 8)]
        for kind in ("f8", "i8") if words else ():
            of = {name: given.get(name, FINITE) for name in words if row[name].base == kind}
            places = [i for i, name in enumerate(words) if of.get(name) is not None]
            for i in places:
                for end, limit in zip((low, high), of[words[i]] or FINITE, strict=True):
                    end[words[i]] = bounds[limit] if isinstance(limit, str) else limit
            names = [array if words[i] == array else f"{array}[{words[i]!r}]" for i in places]
            ends = [end.view(kind)[places] for end in (low, high)]
            found.append(Limits(array, kind, places, names, *ends))
    return found


def check_arrays(found: Mapping[str, NDArray], limits: Sequence[Limits], *, begun: bool) -> None:
    """Check that arrays of a state are within their limits and consistent.

    Integers are checked for every walker, because compiled code uses them as indices. Floats are
    checked only while an episode is running. After its end they are not read again, and they are
    infinite if the motion diverged.

    Args:
        found: Arrays of the state by name, with the types and shapes of the batch's own.
        limits: Limits from `limits_of`.
        begun: Whether all walkers have begun an episode.
    """
    here, ledger = found["records"][:, 0], found["ledger"]
    going = ~over_in(ledger) & begun
    for array, kind, places, names, low, high in limits:
        numbers = found[array].reshape(len(going), -1).view(kind)[:, places]
        holds = (low <= numbers) & (numbers <= high)  # false for NaN
        if kind == "f8" and not holds.all():
            holds |= ~going[:, None]
        for k in np.flatnonzero(~holds.all(axis=0)):
            ends = f"from {low[k]:g} to {high[k]:g}"
            finite = (low[k], high[k]) == FINITE
            require(names[k], holds[:, k], "a finite number" if finite else ends)
    moves = (here["outcome"] == 0) | (here["outcome"] == int(Outcome.HEELSTRIKE))
    require("records['outcome']", moves | ~going, "0 or 1 while the episode goes on")
    slope = ledger["slope"][:, None]
    off = np.abs(here["ground"][:, :2] - np.concatenate([np.sin(slope), np.cos(slope)], axis=1))
    fits = (off <= ROUNDING) | ~going[:, None]
    require("records['ground']", fits, "sine and cosine of the slope in the ledger")
    if "disturbances" in found:
        # Due pushes are applied one by one, so a time far in the past would take very long.
        fits = (found["disturbances"]["due"] >= here["time"] - _LATE) | ~going
        require("disturbances['due']", fits, "no earlier than the walker's time")
