"""Description of a sweep: an analysis, its fixed arguments, and those that vary between tasks."""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np

from gym_passive_walker._tools.arguments import number, unknown, whole
from gym_passive_walker._tools.loading import has_address
from gym_passive_walker.gaits.scenes.named import outside, task_arguments
from gym_passive_walker.gaits.scenes.scene import kept_argument
from gym_passive_walker.models.model import Model

_SAMPLERS = {"sobol": "Sobol", "latin-hypercube": "LatinHypercube"}  # in scipy.stats.qmc
HOW = ("grid", "list", *_SAMPLERS)

RESERVED = ("task", "sweep", "version", "seed", "status", "error", "seconds")
"""Columns of every sweep, besides those of parameters and results."""

Given = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Description:
    """Complete description of a sweep; it determines the tasks and their order.

    Attributes:
        analysis: One of `tasks.ANALYSES`, or "module:function" for a function of your own.
        over: Arguments that vary, by name: parameters of the walker, arguments of the analysis or
            of its scene. A list of values for a grid or a list; [low, high] for a sample.
        how: "grid" for all combinations; "list" for the first values together, then the second
            ones, and so on; "sobol" or "latin-hypercube" for a random sample of the box.
        given: Arguments that are equal in all tasks, by name. A walker or a terrain may be a file
            here and in `over`; the description stores the content of the file. A `System` is
            "module:NAME", and a scene of your own "module:function" or a JSON, YAML or TOML file
            of its arguments, of which the content is kept.
        samples: Number of points of a random sample; a power of two balances Sobol's.
        seed: Seed of the sample, and of each task without a seed of its own.
        time_out: Seconds after which a task is given up; None waits forever.

    Raises:
        ValueError: if the description is invalid.
    """

    analysis: str
    over: Mapping[str, Any]
    how: str = "grid"
    given: Mapping[str, Any] = field(default_factory=dict)
    samples: int | None = None
    seed: int = 0
    time_out: float | None = None

    def __post_init__(self) -> None:
        """Check the description."""
        if not isinstance(self.analysis, str):
            raise ValueError(f"analysis must be a name, not {self.analysis!r}")
        if self.how not in HOW:
            raise ValueError(f"how must be one of {', '.join(HOW)}, not {self.how!r}")
        for name in ("over", "given"):
            if not isinstance(getattr(self, name), Mapping):
                raise ValueError(f"{name} must name values, as in slope: [0.02, 0.03]")
        kept = {name: _kept_one(name, value) for name, value in self.given.items()}
        object.__setattr__(self, "given", kept)
        over = {name: _kept(name, values) for name, values in self.over.items()}
        object.__setattr__(self, "over", over)
        if not self.over:
            raise ValueError("over must name what varies, as in slope: [0.02, 0.03]")
        if both := sorted(self.over.keys() & self.given.keys()):
            raise ValueError(
                f"{', '.join(both)} must be either in `over` or in `given`, not in both"
            )
        if taken := {*self.over, *self.given} & {*RESERVED} - {"seed"}:
            raise ValueError(f"{', '.join(sorted(taken))} is a column of every sweep's: rename it")
        whole(self.seed, "seed", 0, 2**63 - 1)
        if self.time_out is not None:
            number(self.time_out, "time_out", above=0.0)
        if (self.how in _SAMPLERS) != (self.samples is not None):
            raise ValueError(
                "samples is the size of a sobol or latin-hypercube sample; omit it otherwise"
            )
        self._check_values()

    def _check_values(self) -> None:
        for name, values in self.over.items():
            if not isinstance(values, list | tuple | np.ndarray) or not len(values):
                raise ValueError(f"{name} must change over a list of values, not {values!r}")
            if self.how in _SAMPLERS:
                if len(values) != 2 or not number(values[0], name) < number(values[1], name):
                    raise ValueError(f"{name} must be sampled from [low, high], not {values!r}")
        lengths = {name: len(values) for name, values in self.over.items()}
        if self.how == "list" and len(set(lengths.values())) > 1:
            said = ", ".join(f"{name} has {length}" for name, length in lengths.items())
            raise ValueError(f"the columns of a list must be of one length, but {said}")
        if self.samples is not None:
            whole(self.samples, "samples")

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> Description:
        """Return a description from a mapping of its attributes.

        Raises:
            ValueError: if the description is invalid.
        """
        known = tuple(f.name for f in fields(cls))
        if not {"analysis", "over"} <= content.keys():
            raise ValueError("a sweep needs an analysis, and `over` for what varies")
        if said := unknown(content, known, "a sweep"):
            raise ValueError(said)
        return cls(**content)

    @cached_property
    def content(self) -> dict[str, Any]:
        """All attributes, as plain JSON values."""
        return json.loads(json.dumps(asdict(self), default=_plain))

    @cached_property
    def outside(self) -> dict[str, str]:
        """What stands outside the package, by its "module:name": analysis, walkers and scenes."""
        named = [("analysis", self.analysis)]
        for name in ("walker", "scene"):
            named += [(name, value) for value in (self.given.get(name), *self.over.get(name, ()))]
        found = {value: name for name, value in named if has_address(value)}
        for name, value in named:
            if name == "scene":
                found |= outside(value)
        return found

    @cached_property
    def policies(self) -> list[str]:
        """Names and paths of controllers; a later training may change their files."""
        named = [self.given.get("controller"), *self.over.get("controller", ())]
        return sorted({name for name in named if isinstance(name, str)})

    @cached_property
    def digest(self) -> str:
        """Hash of the content, 16 hexadecimal digits."""
        text = json.dumps(self.content, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @cached_property
    def tasks(self) -> list[Given]:
        """Arguments of each task by name; the index in the list is the task's number."""
        names, columns = list(self.over), [list(values) for values in self.over.values()]
        rows: Any
        if self.how in _SAMPLERS:
            from scipy.stats import qmc  # slow to import

            low, high = np.array(columns, dtype=float).T
            made = getattr(qmc, _SAMPLERS[self.how])
            sampler = made(len(names), seed=np.random.default_rng(self.seed))
            rows = (low + (high - low) * sampler.random(self.samples)).tolist()
        else:
            rows = itertools.product(*columns) if self.how == "grid" else zip(*columns, strict=True)
        same = {"seed": self.seed, **self.given}
        return [json.loads(json.dumps({**same, **dict(zip(names, row, strict=True))},
                                      default=_plain)) for row in rows]  # fmt: skip


def _kept_one(name: str, value: Any) -> Any:
    """Return an argument with the content of its file, if it names one."""
    if name == "scene" and isinstance(arguments := task_arguments(value), Mapping):
        return {each: kept_argument(each, part) for each, part in arguments.items()}
    return kept_argument(name, value)


def _kept(name: str, values: Any) -> Any:
    return (
        [_kept_one(name, value) for value in values] if isinstance(values, list | tuple) else values
    )


def _plain(value: Any) -> Any:
    """Return a value as plain JSON."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Model):
        model: Any = value
        if "McGeer's parameters" not in model.supports:
            raise ValueError(
                f"a sweep stores its arguments as text: name the system {model.title!r} as "
                '"module:NAME", with trust=True'
            )
        return asdict(model)
    raise ValueError(f"a sweep takes numbers, words, lists and walkers, not {value!r}")
