"""Configuration of a run: a preset, a scene and the user's changes, saved with the run as YAML."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import asdict, dataclass, field, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from gym_passive_walker._tools.arguments import unknown, whole
from gym_passive_walker._tools.loading import has_address, read_content, reason, untrusted
from gym_passive_walker.gaits.scenes.named import check_source, outside, source_of, task_arguments
from gym_passive_walker.gaits.scenes.scene import SCENES, kept_argument, make_scene

ALGORITHMS = ("ppo", "ppo-fast", "sac", "shac", "shac-learned")
DEFAULT_SCENE = "level"
DEFAULT_ALGORITHM = "ppo-fast"
"""Algorithm of `train.py`, unless `--algo` names another one."""
TRUST = "permit the scene module:function of a run or a policy, and the code of that module"
"""Help text of `--trust`."""
EVALUATIONS = 20
"""Default number of evaluations and checkpoints of a run."""

_PRESETS = Path(__file__).parent / "presets"
# Entries of a preset that are not arguments of the algorithm.
_OF_THE_RUN = ("normalize", "env_wrapper", "callback", "env_kwargs")
_TIME_LIMIT = "gymnasium.wrappers.TimeLimit"


class ConfigError(ValueError):
    """An invalid configuration; the message names the fault and the allowed values."""

    @classmethod
    @contextmanager
    def instead_of(cls, *errors: type[Exception]) -> Iterator[None]:
        """Raise this error, with the same message, in place of errors of some classes."""
        try:
            yield
        except errors as error:
            raise cls(str(error)) from None


@dataclass(frozen=True, kw_only=True)
class Config:
    """Everything that determines a run.

    Attributes:
        algo: One of `ALGORITHMS`.
        scene: Name of the scene; "module:function" for one of the user's own. Arguments of a file
            are in `env`.
        env: Arguments of the environment that differ from the scene's own.
        n_envs: Number of parallel environments.
        steps: Environment steps to train for, summed over the environments.
        seed: Seed of the environments, the initial weights and the exploration.
        every: Steps from one evaluation and checkpoint to the next.
        episode_steps: Steps after which a training episode is truncated, so that there are many
            initial states; None is the environment's limit. Evaluations always use that limit.
        normalize: Arguments of VecNormalize; None trains without it.
        hyperparams: Arguments of the algorithm.
        exploration: Arguments of the algorithm's callback in `exploration`; None for no callback.
        training: Arguments of the environment that apply to training only.
        start: Policy that gives the training its first actor and normalizer: a name or a folder;
            None for random weights.
        source: Source of the module of the user's own scene; None for one of the package.
    """

    algo: str
    scene: str
    env: dict[str, Any] = field(default_factory=dict)
    n_envs: int
    steps: int
    seed: int = 0
    every: int
    episode_steps: int | None = None
    normalize: dict[str, Any] | None
    hyperparams: dict[str, Any]
    exploration: dict[str, Any] | None = None
    training: dict[str, Any] = field(default_factory=dict)
    start: str | None = None
    source: str | None = None

    def __post_init__(self) -> None:
        """Validate all values.

        Raises:
            ConfigError: if a value has the wrong type, or is out of range.
        """
        with ConfigError.instead_of(ValueError):
            for name in ("n_envs", "steps", "every"):
                whole(getattr(self, name), name)
            if self.episode_steps is not None:
                whole(self.episode_steps, "episode_steps")
            whole(self.seed, "seed", 0, 2**31 - 1)
        for name in ("algo", "scene"):
            if not isinstance(getattr(self, name), str):
                raise ConfigError(f"{name} must be the name of one, not {getattr(self, name)!r}")
        if not isinstance(self.start, str | None):
            raise ConfigError(f"start must name a policy, or be None, not {self.start!r}")
        if not isinstance(self.source, str | None):
            raise ConfigError(f"source must be text, or None, not {self.source!r}")
        presets(self.algo)
        for name in ("env", "hyperparams", "training", "normalize", "exploration"):
            value, may_be_none = getattr(self, name), name in ("normalize", "exploration")
            if not (isinstance(value, dict) or (value is None and may_be_none)):
                raise ConfigError(f"{name} must map names to values, not {value!r}")

    @property
    def name(self) -> str:
        """Scene and algorithm, as part of a folder's name."""
        return f"{self.scene.replace(':', '.')}-{self.algo}"

    def save(self, path: Path) -> None:
        """Write the run's YAML."""
        path.write_text(self._yaml(), encoding="utf-8")

    def _yaml(self) -> str:
        """Return the run's YAML."""
        values = asdict(self)
        if self.source is None:
            del values["source"]
        return yaml.safe_dump(values, sort_keys=False)

    def preset(self) -> dict[str, Any]:
        """The preset, in rl_zoo3's layout, with this configuration's steps and hyperparameters."""
        preset = preset_of(self.algo, self.scene, self.env)
        # rl_zoo3 writes policy_kwargs as text, so the preset's text is kept.
        plain = {name: v for name, v in self.hyperparams.items() if name != "policy_kwargs"}
        return preset | plain | {"n_envs": self.n_envs, "n_timesteps": self.steps}

    @classmethod
    def load(cls, path: Path, *, trust: bool = False) -> Config:
        """Read a run's YAML; `trust` allows a scene of the user's own.

        Raises:
            ConfigError: if it is missing, not what `save` writes, or its scene is not trusted.
        """
        if not path.is_file():
            raise ConfigError(f"{path.parent} is not a run: it has no {path.name}")
        with ConfigError.instead_of(ValueError):
            values = read_content(path)
        try:
            if not isinstance(values, dict):
                raise ConfigError("it is not a mapping of names to values")
            if said := unknown(values, [f.name for f in fields(cls)], "a run"):
                raise ConfigError(said)
            names = [f.name for f in fields(cls) if f.name != "source"]
            if lacking := [name for name in names if name not in values]:
                raise ConfigError(f"it lacks {', '.join(lacking)}: was it cut off?")
            found = cls(**values)
        except Exception as error:  # a damaged file may raise anything
            raise ConfigError(f"{path} is not a run's configuration: {reason(error)}") from None
        return found.trusted(trust)

    def trusted(self, trust: bool) -> Config:
        """Return this configuration after a check that its scene is trusted.

        Raises:
            ConfigError: if the scene is the user's own, and `trust` is False.
        """
        if not trust:
            for address, what in self.outside.items():
                raise ConfigError(untrusted(f"the {what} {address!r}"))
        return self

    @property
    def outside(self) -> dict[str, str]:
        """What the scene names outside the package, by its "module:name"."""
        return outside(self.scene, self.env)

    def check_same(self, path: Path, *, ignore: tuple[str, ...] = ()) -> None:
        """Check that a run has this configuration, and its own scene the same code.

        Args:
            path: YAML of the run; nothing is checked if there is none.
            ignore: Names of values that may differ.

        Raises:
            ConfigError: if the configurations differ; the message names all values that do.
        """
        if not path.is_file():
            return
        kept = Config.load(path, trust=True)
        asked = Config(**yaml.safe_load(self._yaml()))  # as it is read: tuples are lists there
        if found := kept.differences(asked, ignore=("source", *ignore)):
            raise ConfigError(f"{path.parent} is another run:\n  " + "\n  ".join(found))
        try:
            check_source(self.outside, kept.source)
        except ValueError as error:
            raise ConfigError(f"{path.parent} is another run: {error}") from None

    def differences(self, other: Config, *, ignore: tuple[str, ...] = ()) -> list[str]:
        """Values in which another configuration differs, one line each; of mappings, their own."""
        found: list[str] = []
        for name in (f.name for f in fields(self) if f.name not in ignore):
            here, there = getattr(self, name), getattr(other, name)
            if here == there:
                continue
            if isinstance(here, dict) and isinstance(there, dict):
                lines = ((f"{name}.{key}", here.get(key), there.get(key)) for key in here | there)
            else:
                lines = iter([(name, here, there)])
            found += [f"{line}: {a!r} here, {b!r} asked for" for line, a, b in lines if a != b]
        return found


@cache
def presets(algo: str) -> dict[str, dict[str, Any]]:
    """An algorithm's presets, by scene and by control."""
    if algo not in ALGORITHMS:
        raise ConfigError(f"no algorithm {algo!r}: choose from {', '.join(ALGORITHMS)}")
    return yaml.safe_load((_PRESETS / f"{algo}.yml").read_text(encoding="utf-8"))


def preset_of(algo: str, scene: str, env: dict[str, Any]) -> dict[str, Any]:
    """A copy of the preset of a scene; `control` in `env` selects the preset of that name.

    A scene without a preset, such as one of the user's own, has that of its control.
    """
    of_algo = presets(algo)
    name = env.get("control", scene)
    if has_address(name) or (name in SCENES and name not in of_algo):
        with ConfigError.instead_of(TypeError, ValueError):
            name = make_scene(scene, trust=True, **env).control
    if name not in of_algo:
        raise ConfigError(f"no preset for {name!r} in {algo}.yml: it has {', '.join(of_algo)}")
    return deepcopy(of_algo[name])


def configure(
    algo: str = "ppo",
    scene: str = DEFAULT_SCENE,
    *,
    env: dict[str, Any] | None = None,
    steps: int | None = None,
    n_envs: int | None = None,
    seed: int = 0,
    every: int | None = None,
    episode_steps: int | None = None,
    start: str | None = None,
) -> Config:
    """A run's configuration: the preset of a scene, with the given values in place of its own.

    Args:
        algo: One of `ALGORITHMS`.
        scene: Name of the scene; "module:function" for a function of the user's own that returns a
            `Scene` or its arguments; or a JSON, YAML or TOML file of its arguments, which the run
            stores as `env`.
        env: Arguments of the environment that differ from the scene's own. `control` selects the
            preset of that control. A walker or a terrain may be a file; the run stores the file's
            content.
        steps: Environment steps; the preset's when None.
        n_envs: Number of parallel environments; the preset's when None. PPO keeps the size of its
            update.
        seed: Seed of the environments, the initial weights and the exploration.
        every: Steps from one evaluation and checkpoint to the next; a twentieth of all when None.
        episode_steps: Steps after which a training episode is truncated; the preset's when None.
        start: Policy to begin with: a name or a folder. Noise and learning rate then follow the
            last part of their schedules, in which braking is no longer free.

    Raises:
        ConfigError: if a name or a number is out of range.
    """
    with ConfigError.instead_of(ImportError, ValueError):
        given = task_arguments(scene)
        if isinstance(given, dict):
            scene, env = DEFAULT_SCENE, given | (env or {})
        asked = {name: value for name, value in (env or {}).items() if value is not None}
        env = {name: kept_argument(name, value) for name, value in asked.items()}
    preset = preset_of(algo, scene, env)
    count: int = preset.pop("n_envs")
    total: int = preset.pop("n_timesteps")
    normalize, wrapper, callback, training = (preset.pop(key, None) for key in _OF_THE_RUN)
    if n_envs is not None and algo in ("ppo", "ppo-fast") and n_envs > 0:
        # Keep the size of an update and its number of batches, as nearly as whole steps permit.
        update = preset["n_steps"] * count
        batches = max(1, update // preset["batch_size"])
        preset["n_steps"] = batches * max(1, round(update / n_envs / batches))
        preset["batch_size"] = preset["n_steps"] * n_envs // batches
    n_envs = count if n_envs is None else n_envs
    steps = total if steps is None else steps
    if episode_steps is None:
        episode_steps = (wrapper or {}).get(_TIME_LIMIT, {}).get("max_episode_steps")
    exploration = _exploration(algo, callback)
    with ConfigError.instead_of(ValueError):
        source = source_of(*outside(scene, env))
    if start is not None:
        preset["learning_rate"], exploration = _last_part(preset["learning_rate"], exploration)
    return Config(
        algo=algo,
        scene=scene,
        env=env,
        n_envs=n_envs,
        steps=steps,
        seed=seed,
        every=max(1, steps // EVALUATIONS) if every is None else every,
        episode_steps=episode_steps,
        normalize=_normalizer(normalize),
        hyperparams=preset | _arguments_of_the_policy(preset),
        exploration=exploration,
        training=training or {},
        start=start,
        source=source,
    )


def _last_part(rate: Any, exploration: dict[str, Any] | None) -> tuple[Any, dict[str, Any] | None]:
    """The learning rate and the exploration of the last segment of the schedule of the noise.

    It begins after `until`, the share of a training in which braking is free.
    """
    if exploration is None or not exploration.get("until"):
        return rate, exploration
    shares, values = zip(*sorted(exploration["log_std"].items()), strict=True)
    begin = max(exploration["until"], shares[-2])
    noise = {0.0: float(np.interp(begin, shares, values)), 1.0: values[-1]}
    if isinstance(rate, str):
        rate = f"lin_{float(rate.removeprefix('lin_')) * (1.0 - begin):.3g}"
    return rate, {"log_std": noise}


def _exploration(algo: str, callbacks: dict[str, Any] | None) -> dict[str, Any] | None:
    """The arguments of the one callback that a preset may name."""
    allowed = f"agents.exploration.{'Ladder' if algo == 'sac' else 'Schedule'}"
    if unknown := set(callbacks or {}) - {allowed}:
        raise ConfigError(
            f"{algo.upper()} has no callback {', '.join(sorted(unknown))}: it has {allowed}"
        )
    return (callbacks or {}).get(allowed)


def _normalizer(entry: bool | str | dict[str, Any]) -> dict[str, Any] | None:
    """VecNormalize's arguments from rl_zoo3's notation: a boolean, or a dict as a string."""
    if isinstance(entry, str):
        entry = ast.literal_eval(entry)
    return {} if entry is True else (entry or None)  # type: ignore[return-value]


def _arguments_of_the_policy(preset: dict[str, Any]) -> dict[str, Any]:
    """A preset's "policy_kwargs" from rl_zoo3's notation: a dict, or "dict(...)" as a string.

    Names of torch such as nn.ReLU stay text, which a run's YAML can store.
    """
    entry = preset.get("policy_kwargs")
    if not isinstance(entry, str):
        return {}
    call = ast.parse(entry, mode="eval").body
    return {
        "policy_kwargs": {
            given.arg: ast.unparse(given.value)
            if isinstance(given.value, ast.Attribute)
            else ast.literal_eval(given.value)
            for given in call.keywords  # type: ignore[attr-defined]
        }
    }
