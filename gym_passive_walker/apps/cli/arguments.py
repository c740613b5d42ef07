"""Arguments of commands, made from the signatures of their functions, and those that many share.

A parameter before the star is positional, one after it an option. Its annotation has the type, the
help text, and settings for `add_argument`, as in ``Annotated[int, "period", {"nargs": 2}]``. A
parameter that is annotated with a dataclass stands for all of the dataclass's fields.
"""

from __future__ import annotations

import re
import sys
from argparse import Action, ArgumentError, ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass, is_dataclass
from functools import cached_property
from inspect import Parameter, signature
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, NoReturn, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import unknown
from gym_passive_walker.apps.cli.report import PLAIN, SI
from gym_passive_walker.envs.policies import load_policy, shipped_policies
from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.gaits.control.baselines import BASELINES
from gym_passive_walker.gaits.control.maps import stride_map
from gym_passive_walker.gaits.find.fixed_point import find_gait
from gym_passive_walker.gaits.gait import Gait, GaitNotFound
from gym_passive_walker.gaits.scenes.named import named_walker
from gym_passive_walker.gaits.scenes.scene import SCENES, make_scene
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.gaits.terrain import EXAMPLES, terrain_from
from gym_passive_walker.models.walkers import WALKERS, describe, tune

_OPTIONS = {
    "hip_torque": "--torque", "slope_min": "LOW", "slope_max": "HIGH", "folder": "--out",
}  # fmt: skip
"""Options for arguments of Python that have another name."""

_METAVARS: dict[Any, str] = {int: "N", float: "X", Path: "FILE", str: "NAME"}


class Parser(ArgumentParser):
    """A parser that reports an error in one sentence, with similar names, and exits with 2."""

    def error(self, message: str) -> NoReturn:
        """Print the message, and exit."""
        self.exit(2, f"error: {message} (see {self.prog} --help)\n")

    trusts = False
    """Whether --trust is among the arguments."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse arguments; options that this parser does not have are an error."""
        self.trusts = "--trust" in (sys.argv[1:] if args is None else args)
        found, rest = super().parse_known_args(args, namespace)
        strange = [word for word in rest if re.match("-+[a-z]", word)]
        known = [name for name in self._option_string_actions if name.startswith("--")]
        if said := unknown(strange, known, self.prog):
            self.error(said)
        return found, rest

    def _check_value(self, action: Action, value: Any) -> None:
        """Raise an error for a value that is none of the choices."""
        if action.choices is not None and value not in action.choices:
            known = [*map(str, action.choices)]
            raise ArgumentError(action, str(unknown([value], known, "the list of choices")))

    def by_option(self, message: str) -> str:
        """Return an error's message with options in place of the arguments of Python functions."""
        names = {
            action.dest: action.option_strings[-1] if action.option_strings else action.metavar
            for action in self._actions
        }
        names = {name: option for name, option in {**_OPTIONS, **names}.items() if option}

        def option(found: re.Match[str]) -> str:
            return str(names.get(found[0], found[0]))

        message = re.sub(r"^\w+(?= must | needs | takes )|\bslope_m(?:in|ax)\b", option, message)
        message = message.replace("stride_map(walker, controller=...)", "a --controller")
        calls = r"\bmake_scene\(scene, (\w+)=[^()]*\)|(?<=\bby )(\w+)=(?=$|\W)"
        return re.sub(calls, lambda found: names.get(found[1] or found[2], found[0]), message)


def add_arguments(parser: ArgumentParser, command: Callable[..., Any]) -> None:
    """Add the arguments of a command, or the fields of a dataclass."""
    for name, each in _parameters(command):
        if is_dataclass(each.annotation):
            add_arguments(parser, each.annotation)  # type: ignore[arg-type]
        else:
            _add_argument(parser, name, each)


def _parameters(command: Callable[..., Any]) -> list[tuple[str, Parameter]]:
    """Return the parameters of a command, or the fields of a dataclass, with their annotations."""
    hints = get_type_hints(command, include_extras=True)  # also those that a dataclass inherits
    found = signature(command).parameters.items()
    return [(name, each.replace(annotation=hints[name])) for name, each in found]


def _add_argument(parser: ArgumentParser, name: str, each: Parameter) -> None:
    """Add the argument of one parameter."""
    kind, about, *more = get_args(each.annotation)
    kinds = [part for part in get_args(kind) if part is not NoneType]
    option, given = each.kind is Parameter.KEYWORD_ONLY, {}
    if get_origin(kind) is Literal:
        given["choices"] = get_args(kind)
    elif kind is bool:
        given["action"] = "store_true"
    else:
        given["type"] = kinds[0] if kinds else kind
        given["metavar"] = _METAVARS.get(given["type"]) if option else name.upper()
    if each.kind is Parameter.VAR_POSITIONAL:
        given["nargs"] = "*"
    elif each.default is not Parameter.empty:
        given["default"] = each.default
        if each.default is not None and kind is not bool:
            about += " (%(default)s)"
        if not option:
            given["nargs"] = "?"
    flag = f"--{name.replace('_', '-')}" if option else name
    parser.add_argument(flag, **{**given, "help": about, **(more[0] if more else {})})


def call_with(command: Callable[..., Any], arguments: Namespace) -> Any:
    """Call a command, or make a dataclass, with parsed arguments."""
    given: list[Any] = []
    rest: dict[str, Any] = {}
    for name, each in _parameters(command):
        value: Any = getattr(arguments, name, None)
        if is_dataclass(each.annotation):
            value = call_with(each.annotation, arguments)  # type: ignore[arg-type]
        if each.kind is Parameter.VAR_POSITIONAL:
            given += value
        elif each.kind is Parameter.KEYWORD_ONLY:
            rest[name] = value
        else:
            given.append(value)
    return command(*given, **rest)


def _read_by(read: Callable[[str], Any]) -> Callable[[str], Any]:
    """Parse an argument by a function; the parser prints its error with the argument's name."""

    def parsed(text: str) -> Any:
        try:
            return read(text)
        except (ValueError, ImportError) as error:
            raise ArgumentTypeError(str(error)) from None

    return parsed


A_WALKER = (
    f"{', '.join(WALKERS)}, or a JSON, YAML or TOML file of your own walker's parameters, such as "
    '{"preset": "C", "hip_mass": 1.0}; or module:NAME, a System of yours'
)
"""Help text of an argument that names a walker."""

A_SCENE = (
    f"{', '.join(SCENES)}; or module:function, a function of yours that returns a scene or its "
    "arguments; or a JSON, YAML or TOML file of its arguments"
)
"""Help text of an argument that names a scene."""

A_POLICY = "the path of an exported folder, an ONNX file or a stable-baselines3 file (.zip)"
"""Help text of an argument that names a policy of the user's own."""

CONTROLLERS = f"{', '.join([*shipped_policies(), *BASELINES])}, or {A_POLICY}"
"""Help text of an argument that names a controller."""


class _SceneAction(Action):
    """Reads a scene; a file that names code needs --trust, for it may be another person's."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: Any = None) -> None:
        """Store the scene, or raise the error of the argument."""
        try:
            found = make_scene(values, trust=parser.trusts or None)
        except (ValueError, ImportError) as error:
            raise ArgumentError(self, str(error)) from None
        setattr(namespace, self.dest, found)


OF_SCENE: dict[str, Any] = {"type": str, "action": _SceneAction, "metavar": "SCENE"}
"""Settings of an argument that names a scene."""

AScene = Annotated[Any, A_SCENE, OF_SCENE]
AWalker = Annotated[Any, A_WALKER, {"type": _read_by(named_walker), "metavar": "WALKER"}]
ATerrain = Annotated[
    Any,
    f"{EXAMPLES}, or a mapping as JSON or in a file (smooth ground)",
    {"type": _read_by(terrain_from), "metavar": "GROUND"},
]
Slope = Annotated[float, "slope in rad, positive downhill"]
Low = Annotated[float, "lowest slope in rad, above 0"]
High = Annotated[float, "highest slope in rad"]
Kind = Annotated[Literal["long", "short"], "long-step or short-step gait"]
Strides = Annotated[int, "largest number of strides"]
Trust = Annotated[
    bool,
    "permit the code, module:function, that a file of a scene or a policy names; it runs with your "
    "rights",
]
_HELD = "{} in {}, equal in each stride"


@dataclass(frozen=True)
class Machine:
    """A walker with its actuation or controller, from arguments that many commands share."""

    walker: AWalker
    _: KW_ONLY
    tune: Annotated[bool, "tune the walker first, for gaits at vanishing slope"] = False
    dimensionless: Annotated[
        bool,
        "torques, push-off and initial state in units of m, l, √(l/g), as are results of gait, "
        "family, simulate",
    ] = False
    torque: Annotated[float, _HELD.format("hip torque", "N m"), {"metavar": "T"}] = 0.0
    ankle_torque: Annotated[
        float, _HELD.format("ankle torque (requires point feet)", "N m"), {"metavar": "T"}
    ] = 0.0
    push_off: Annotated[
        float,
        _HELD.format("push-off impulse along the stance leg, just before heelstrike,", "N s"),
        {"metavar": "P"},
    ] = 0.0
    controller: Annotated[
        str | None,
        f"controller: a feedback ({', '.join(BASELINES)}), a trained policy, or {A_POLICY}",
    ] = None
    scene: Annotated[
        Any,
        f"scene of the controller (its own, or level): {A_SCENE}",
        OF_SCENE,
    ] = None
    trust: Trust = False

    @cached_property
    def model(self) -> Any:
        """The walker, tuned if requested."""
        return tune(self.walker) if self.tune else self.walker

    @property
    def title(self) -> str:
        """The walker in words."""
        return describe(self.model)

    def map(self, slope: float | None = None) -> StrideMap:
        """The stride map of the walker and its actuation or controller.

        Raises:
            ValueError: if both torques or a push-off and a controller are given.
        """
        held = (Actuation.dimensionless if self.dimensionless else Actuation)(
            self.torque, self.ankle_torque, self.push_off
        )
        if self.controller is None:
            if self.scene is not None:
                raise ValueError("--scene is that of a --controller, which is not given")
            if self.trust:
                raise ValueError("--trust permits a --controller, which is not given")
            return stride_map(self.model, slope, controller=None if held.passive else held)
        if not held.passive:
            raise ValueError("--controller determines the actuation: omit torques and the push-off")
        controller = read_policy(self.controller, self.trust)
        return stride_map(self.model, slope, controller=controller, scene=self.scene)

    def gait(self, slope: float, kind: Any) -> Gait:
        """The gait of a kind at a slope.

        Raises:
            GaitNotFound: if there is none.
        """
        return find_gait(self.map(slope), kind=kind)

    def shown(self, result: Any) -> tuple[Any, dict[str, str]]:
        """Return a result in the units asked for, and the names of these units."""
        plain = self.dimensionless or "units" not in result.walker.supports
        return (result.dimensionless, PLAIN) if plain else (result, SI)


@dataclass(frozen=True)
class Walk:
    """A walk: walker, slope, initial state, actuation and terrain."""

    machine: Machine
    slope: Slope
    _: KW_ONLY
    kind: Kind = "long"
    strides: Strides = 10
    state: Annotated[
        list[float] | None,
        "stance, thigh and shank angle in rad, then angular velocities in rad/s, just after "
        "heelstrike; of a System its coordinates, then their rates (the gait's)",
        {"nargs": "+", "type": float, "metavar": "X"},
    ] = None
    terrain: ATerrain = None
    terrain_seed: Annotated[int, "seed of random terrain"] = 0

    @property
    def map(self) -> StrideMap:
        """The stride map."""
        return self.machine.map(self.slope)

    @property
    def start(self) -> NDArray[np.float64]:
        """Initial state, (6,): the one given, or the gait's."""
        machine = self.machine
        if self.state is not None:
            state, names = np.array(self.state), machine.model.state_names
            if len(state) != len(names):
                raise ValueError(f"state must be {len(names)} numbers, {', '.join(names)}")
            return machine.model.units.to_own(state) if machine.dimensionless else state
        walks = self.map
        if not walks.controlled:
            # With constant actuation, a walk starts on the passive gait, to show the transient.
            with suppress(*[] if walks.passive else [GaitNotFound]):
                return find_gait(machine.model, self.slope, kind=self.kind).state
        return find_gait(walks, self.slope, kind=self.kind).state


def read_policy(name: str, trust: bool) -> Any:
    """Return a controller by its name; a trained policy is read here if `trust` is True."""
    return load_policy(name, trust=True) if trust and name not in BASELINES else name
