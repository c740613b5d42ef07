"""Domain randomization of a scene: distributions of its parameters, and draws by a key.

A draw is a function of the key of an episode (`engine.counter_rng`), so it depends neither on the
number of environments nor on the device that simulates them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np

from gym_passive_walker._tools.arguments import check_slope, number, shown, unknown, whole
from gym_passive_walker.engine.counter_rng import normal, uniform, word
from gym_passive_walker.gaits.scenes.checks import SceneError, bounded, check_point_feet, checked
from gym_passive_walker.models.model import bodies
from gym_passive_walker.models.units import KINDS
from gym_passive_walker.models.walkers import Walker, WalkerError

OPERATIONS = ("scale", "add", "abs")
"""How a drawn number changes a parameter: it multiplies it, is added to it, or replaces it."""

DISTRIBUTIONS = ("uniform", "log_uniform", "normal", "choices")

CURRICULUM = "curriculum"
"""Distribution of `domain_randomization` with the number of episodes in which it grows."""

CURRICULUM_LEVELS = 10
"""Number of steps in which a curriculum grows from the scene's own values to the distributions."""

WHICH = 201
"""Stream of an episode's key that chooses a member of the pool."""

DELAY, SLOPE, NOISE, FRICTION = "action_delay", "slope", "reset_noise_scale", "friction"

SCENE_PARAMETERS = {
    SLOPE: ("rad", -0.5 * math.pi, 0.5 * math.pi),
    NOISE: ("1", 0.0, 0.9),
    DELAY: ("control steps", 0.0, 10_000.0),
    FRICTION: ("1", 0.0, 1e3),
    "max_hip_torque": ("m g l", 0.0, 1e3),
    "max_ankle_torque": ("m g l", 0.0, 1e3),
    "max_push_off": ("m sqrt(g l)", 0.0, 1e3),
}
"""Arguments of a scene that can be drawn: unit, smallest and largest value."""

OF_STEPS = tuple(name for name in SCENE_PARAMETERS if name not in (SLOPE, NOISE))
"""Those that control steps need; the others are used at the start of an episode only."""

_POOL = 1999
"""Seed of the members of `randomization_pool`, together with their index."""

_ARGUMENT = "domain_randomization"
_FORMS = (
    "a number from 0 to 0.5 (0.1 is 10 % to either side), factors (low, high), or a mapping "
    'such as {"log_uniform": (0.5, 2.0)}, {"normal": (1.0, 0.1), "clip": (0.8, 1.2)} or '
    '{"choices": (0, 1, 2), "operation": "abs"}'
)


class Distribution(NamedTuple):
    """An entry of `domain_randomization`: parameters that share one random number.

    Attributes:
        names: Names of the parameters.
        distribution: One of DISTRIBUTIONS.
        numbers: Smallest and largest number; of "normal", mean and standard deviation; of
            "choices", all of them.
        operation: One of OPERATIONS.
        clip: Smallest and largest number of "normal"; else those of `numbers`.
    """

    names: tuple[str, ...]
    distribution: str
    numbers: tuple[float, ...]
    operation: str
    clip: tuple[float, float]

    @property
    def key(self) -> str:
        """Its key in `domain_randomization`."""
        return ", ".join(self.names)

    @property
    def title(self) -> str:
        """Its name in messages."""
        return f"{_ARGUMENT}[{self.key!r}]"

    @property
    def stepped(self) -> bool:
        """Whether only some numbers may be drawn, and none between them."""
        return self.distribution == "choices" or DELAY in self.names

    def number(self, key: int, attempt: int) -> float:
        """Return the number that a key draws."""
        stream = crc32(self.key.encode())
        if self.distribution == "normal":
            mean, std = self.numbers
            low, high = self.clip
            return min(max(mean + std * normal(key, attempt, stream), low), high)
        share = uniform(key, attempt, stream)
        if self.distribution == "choices":
            return self.numbers[int(share * len(self.numbers))]
        low, high = self.numbers
        if DELAY in self.names:
            return math.floor(low + (high - low + 1.0) * share)
        if self.distribution == "log_uniform":
            return low * (high / low) ** share
        return low + (high - low) * share

    def reached(self, key: int, level: int) -> bool:
        """Return whether a curriculum at a level has the drawn number, and not the scene's own."""
        return uniform(key, 0, crc32(self.key.encode()) + 1) * CURRICULUM_LEVELS < level

    def applied(self, nominal: float, drawn: float) -> float:
        """Return a parameter from its nominal value and the drawn number."""
        if self.operation == "scale":
            return nominal * drawn
        return nominal + drawn if self.operation == "add" else drawn

    def ends(self, nominal: float) -> tuple[float, float]:
        """Return the smallest and the largest value of a parameter."""
        low, high = sorted(self.applied(nominal, end) for end in self.clip)
        return low, high

    def about(self) -> str:
        """Return the distribution in words."""
        texts = [f"{number:g}" for number in self.numbers]
        what = {
            "uniform": "uniform from {} to {}", "log_uniform": "log-uniform from {} to {}",
            "normal": "normal, mean {}, std {}", "choices": "one of " + ", ".join(texts),
        }[self.distribution].format(*texts)  # fmt: skip
        if self.distribution == "normal":
            what += f", clipped to {self.clip[0]:g} to {self.clip[1]:g}"
        how = {"scale": "times its value", "add": "added to its value", "abs": ""}[self.operation]
        return f"{what}, {how}".removesuffix(", ")


class Drawn(NamedTuple):
    """What an episode draws: its walker, and the values of all parameters in order."""

    walker: Walker
    values: tuple[float, ...]


def entries_of(given: Mapping[str, Any]) -> list[Distribution]:
    """Return the entries of a checked `domain_randomization`."""
    return [_entry(key, value) for key, value in given.items() if key != CURRICULUM]


def randomized_names(given: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of all parameters in a checked `domain_randomization`."""
    return tuple(name for entry in entries_of(given) for name in entry.names)


def of_episodes(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return a checked `domain_randomization` without the arguments that control steps need."""
    of_steps = {e.key for e in entries_of(given) if not {*OF_STEPS}.isdisjoint(e.names)}
    found = {key: value for key, value in given.items() if key not in of_steps}
    return {} if {*found} == {CURRICULUM} else found


def ends_of(
    entries: Sequence[Distribution], name: str, nominal: float, *, grows: bool
) -> tuple[float, float]:
    """Return the smallest and the largest value of a parameter, in a curriculum if it `grows`."""
    for entry in entries:
        if name in entry.names:
            low, high = entry.ends(nominal)
            return (min(low, nominal), max(high, nominal)) if grows else (low, high)
    return nominal, nominal


class Randomization:
    """The draws of a scene.

    Args:
        scene: A scene with `domain_randomization`.
        walker: Nominal walker.
        slope: Nominal slope in rad.

    Attributes:
        entries: The distributions.
        names: Names of the parameters, in the order of the values.
        curriculum: Number of episodes in which the distributions grow; 0 without a curriculum.
    """

    def __init__(self, scene: Any, walker: Walker, slope: float) -> None:
        given = scene.domain_randomization
        self.entries, self.names = entries_of(given), randomized_names(given)
        self.curriculum: int = given.get(CURRICULUM, 0)
        self.walker, self._pool = walker, scene.randomization_pool
        own = {name: getattr(scene, name) for name in SCENE_PARAMETERS} | {SLOPE: slope}
        self.nominal = {name: {**walker.parameters, **own}[name] for name in self.names}

    def ends(self, name: str) -> tuple[float, float]:
        """Return the smallest and the largest value of a parameter; its own if it is not drawn."""
        nominal = {**self.walker.parameters, **self.nominal}[name]
        return ends_of(self.entries, name, nominal, grows=self.curriculum > 0)

    def level(self, episode: int) -> int:
        """Return the level of an environment's episode, by its number from 0; see `draw`."""
        if not self.curriculum:
            return CURRICULUM_LEVELS
        return min(CURRICULUM_LEVELS, CURRICULUM_LEVELS * episode // self.curriculum)

    def drawn(self, key: int, episode: int) -> Drawn:
        """Return the draw of an episode: of a new walker, or of a member of the pool.

        Args:
            key: Key of the episode.
            episode: Number of the environment's episode, from 0.
        """
        if self._pool is None:
            return self.draw(key, self.level(episode))
        return self.member(int(uniform(key, 0, WHICH) * self._pool), self.level(episode))

    def member(self, index: int, level: int = CURRICULUM_LEVELS) -> Drawn:
        """Return a member of the scene's `randomization_pool`, the same in every environment."""
        return self.draw(word(word(_POOL, WHICH), index), level)

    def draw(self, key: int, level: int = CURRICULUM_LEVELS) -> Drawn:
        """Return the draw of a key at a level of the curriculum, from 0 to CURRICULUM_LEVELS.

        Raises:
            SceneError: if hardly any draw makes a valid walker.
        """
        for attempt in range(100):
            values = self._values(key, level, attempt)
            body = {
                name: value
                for name, value in zip(self.names, values, strict=True)
                if name not in SCENE_PARAMETERS
            }
            try:
                return Drawn(self.walker.with_body(body) if body else self.walker, values)
            except WalkerError:
                continue
        raise SceneError(
            f"{_ARGUMENT}: hardly any walker lies within "
            f"{ {name: self.ends(name) for name in self.names} } of this one"
        )

    def _values(self, key: int, level: int, attempt: int) -> tuple[float, ...]:
        """Return the values of all parameters; `attempt` counts the walkers that cannot be."""
        found: list[float] = []
        for entry in self.entries:
            drawn = entry.number(key, attempt)
            for name in entry.names:
                nominal = self.nominal[name]
                value = entry.applied(nominal, drawn)
                if level < CURRICULUM_LEVELS and entry.stepped:
                    value = value if entry.reached(key, level) else nominal
                elif level < CURRICULUM_LEVELS:
                    value = nominal + (value - nominal) * level / CURRICULUM_LEVELS
                found.append(value)
        return tuple(found)


def checked_randomization(scene: Any) -> dict[str, Any]:
    """Return the `domain_randomization` of a scene after a check, in the order of its keys.

    Raises:
        SceneError: if an entry is invalid, or cannot have an effect in this scene.
    """
    given = scene.domain_randomization
    if not isinstance(given, Mapping):
        raise SceneError(f"{_ARGUMENT} must map parameters to what is drawn, not {shown(given)}")
    found: dict[str, Any] = {}
    known = (*scene.walker.parameters, *SCENE_PARAMETERS, CURRICULUM)
    keys = {key: _names(key) for key in given}
    names = [name for each in keys.values() for name in each]
    if said := unknown(names, known, f"{_ARGUMENT}: a walker"):
        raise SceneError(said)
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise SceneError(f"{_ARGUMENT} must draw each parameter once, and draws {twice[0]} twice")
    for key in sorted({*given} - {CURRICULUM}):
        value = given[key]
        entry = _entry(", ".join(keys[key]), value)
        if DELAY in entry.names:
            _check_delay(entry)
        _check_units(entry, scene.walker)
        found[entry.key] = _plain(value)
        for name in entry.names:
            if found[entry.key] != 0.0 or name in SCENE_PARAMETERS:  # 0 leaves a body as it is
                _check_effect(entry, name, scene, tolerance=not np.iterable(value))
    if CURRICULUM in given:
        title = f"{_ARGUMENT}['{CURRICULUM}']"
        if not found:
            raise SceneError(
                f"{title} is a number of episodes in which what is drawn grows, and nothing is "
                "drawn: give parameters beside it"
            )
        found[CURRICULUM] = checked(whole, given[CURRICULUM], title, most=2**31)
    return found


def _names(key: Any) -> tuple[str, ...]:
    """Return the names of the parameters in a key."""
    if not isinstance(key, str):
        raise SceneError(f"{_ARGUMENT} must have names of parameters as keys, not {shown(key)}")
    return tuple(name.strip() for name in key.split(","))


def _plain(value: Any) -> Any:
    """Return a checked value with tuples of numbers."""
    if isinstance(value, Mapping):
        return {name: _plain(part) for name, part in value.items()}
    if isinstance(value, str):
        return value
    return tuple(map(float, value)) if np.iterable(value) else float(value)


def _row(value: Any, title: str, count: int | None = None) -> tuple[float, ...]:
    """Return a row of finite numbers, of a given length or at least one."""
    some = np.iterable(value) and not isinstance(value, str | Mapping)
    row = list(value) if some else []
    if not row or (count is not None and len(row) != count):
        wanted = "one or more numbers" if count is None else f"{count} numbers"
        raise SceneError(f"{title} must be {wanted}, not {shown(value)}")
    return tuple(checked(number, each, f"{title}[{i}]") for i, each in enumerate(row))


def _entry(key: str, value: Any) -> Distribution:
    """Return the entry of a key, after a check of its numbers."""
    names = _names(key)
    title = f"{_ARGUMENT}[{key!r}]"
    if not np.iterable(value) or isinstance(value, str):
        try:
            share = bounded(title, value, 0.0, 0.5)
        except SceneError:
            raise SceneError(f"{title} must be {_FORMS}; not {shown(value)}") from None
        ends = 1.0 - share, 1.0 + share
        return Distribution(names, "uniform", ends, "scale", ends)
    given = value if isinstance(value, Mapping) else {"uniform": value}
    kinds = [name for name in DISTRIBUTIONS if name in given]
    allowed = (*DISTRIBUTIONS, "operation", "clip")
    if said := unknown(given, allowed, title):
        raise SceneError(said)
    if len(kinds) != 1:
        raise SceneError(
            f"{title} must have one of {', '.join(DISTRIBUTIONS)}, not {shown(dict(given))}"
        )
    kind, operation = kinds[0], given.get("operation", "scale")
    if operation not in OPERATIONS:
        raise SceneError(
            f"{title}['operation'] must be one of {', '.join(map(repr, OPERATIONS))}, not "
            f"{shown(operation)}"
        )
    where = f"{title}[{kind!r}]"
    numbers = _row(given[kind], where, None if kind == "choices" else 2)
    if kind == "normal":
        if "clip" not in given:
            raise SceneError(f'{title} needs "clip": (low, high), the ends of what normal draws')
        if numbers[1] <= 0.0:
            raise SceneError(f"{where} must be (mean, std) with a std above 0, not {numbers}")
        clip = _row(given["clip"], f"{title}['clip']", 2)
    elif "clip" in given:
        raise SceneError(f"{title}['clip'] cuts the tails of \"normal\", and {kind!r} has none")
    else:
        clip = min(numbers), max(numbers)
    low, high = clip if kind in ("normal", "choices") else numbers
    if low > high:
        last = "clip" if kind == "normal" else kind
        raise SceneError(f"{title}[{last!r}] must have low before high, not {(low, high)}")
    if low == high:
        raise SceneError(f"{where} draws one number alone, {low:g}: make it an argument instead")
    if kind == "log_uniform" and low <= 0.0:
        raise SceneError(f"{where} must be above 0, since logarithms are drawn, not {numbers}")
    if operation == "scale" and low < 0.0:
        raise SceneError(
            f'{where} must be factors from 0 on, not {numbers}: "operation": "abs" draws '
            'values and "add" what is added'
        )
    return Distribution(names, kind, numbers, operation, (low, high))


def _check_delay(entry: Distribution) -> None:
    """Check that a delay is drawn as a whole number."""
    _, kind, numbers, operation, _ = entry
    if len(entry.names) > 1 or operation == "scale" or kind not in ("uniform", "choices"):
        raise SceneError(
            f'{entry.title}: a delay is a whole number of control steps, which "uniform" or '
            '"choices" draw with "operation": "abs" or "add", for this parameter alone'
        )
    if any(each != math.floor(each) for each in numbers):
        raise SceneError(f"{entry.title} must have whole numbers of control steps, not {numbers}")


def _check_units(entry: Distribution, walker: Any) -> None:
    """Check that parameters with one draw have one unit, unless it is a factor."""
    if entry.operation == "scale" or "units" not in walker.supports:
        return
    units = {name: SCENE_PARAMETERS[name][0] if name in SCENE_PARAMETERS else KINDS[name]
             for name in entry.names}  # fmt: skip
    if len({*units.values()}) > 1:
        said = ", ".join(f"{name} ({unit})" for name, unit in units.items())
        raise SceneError(
            f"{entry.title} draws one value for parameters of different units, {said}: draw a "
            'factor, "operation": "scale", or each by itself'
        )


def _check_effect(entry: Distribution, name: str, scene: Any, *, tolerance: bool) -> None:
    """Check that the values of a parameter are valid and have an effect in a scene."""
    title, of_body = entry.title, name not in SCENE_PARAMETERS
    nominal = scene.walker.parameters[name] if of_body else getattr(scene, name)
    if entry.operation == "scale" and nominal == 0.0:
        raise SceneError(
            f"{title}: {name} is 0 in this scene, and no factor changes it: draw values, as in "
            '{"uniform": (0, 0.1), "operation": "abs"}'
        )
    if of_body:
        _check_body(entry, name, scene, tolerance=tolerance)
        return
    if name == SLOPE and isinstance(nominal, tuple):
        raise SceneError(f"{title}: the scene's slope is a range already: give one of the two")
    if name == FRICTION and scene.constraints.get("friction") != "end":
        raise SceneError(
            f"{title}: the coefficient of friction matters where a slip ends the episode: give "
            'constraints={"friction": "end"}'
        )
    limits = {each.limit for each in map(scene.actuator, scene.actions)}
    if name.startswith("max_") and name not in limits:
        raise SceneError(
            f"{title}: {name} is of an action that this scene lacks: its actions are "
            f"{', '.join(scene.actions) or 'none'}"
        )
    _, least, most = SCENE_PARAMETERS[name]
    low, high = entry.ends(nominal)
    if name == SLOPE:
        checked(check_slope, [low, high], title)
    elif not least <= low <= high <= most:
        raise SceneError(
            f"{title}: {name} must be from {least:g} to {most:g}, and is drawn from {low:g} to "
            f"{high:g}"
        )


_OF_GRAVITY = (
    "; another gravity changes what a given motor's torque is in m g l, so draw max_hip_torque"
)


def _check_body(entry: Distribution, name: str, scene: Any, *, tolerance: bool) -> None:
    """Check that the ends of a parameter's values make walkers that differ.

    Of a tolerance an end may make none, for draws without a walker are repeated.
    """
    walker, made = scene.walker, []
    for end in entry.ends(walker.parameters[name]):
        try:
            made.append(walker.with_body({name: end}))
        except WalkerError as error:
            if tolerance:
                return
            raise SceneError(f"{entry.title} draws {name}={end:g} too: {error}") from None
    if {each.kind for each in made} != {walker.kind}:
        raise SceneError(
            f"{entry.title} draws {name}={made[0].parameters[name]:g} too, where the walker has "
            "other equations of motion: all draws need the same"
        )
    checked(check_point_feet, scene.actions, *made)
    low, high = (bodies(each)[0, 0] for each in made)
    if np.allclose(low, high, rtol=1e-12, atol=0.0):
        raise SceneError(
            f"{entry.title} changes nothing: in units of leg length, mass and gravity, this walker "
            f"is the same with each {name}" + _OF_GRAVITY * (name == "gravity")
        )
