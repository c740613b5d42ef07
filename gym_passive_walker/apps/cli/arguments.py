"""Arguments that commands share: walkers, slopes, gaits."""

from __future__ import annotations

import re
from argparse import Action, ArgumentError, ArgumentParser, ArgumentTypeError, Namespace
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker._tools.arguments import unknown
from gym_passive_walker.apps.cli.report import PLAIN, SI
from gym_passive_walker.envs.policies import load_policy
from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.gaits.control.baselines import BASELINES
from gym_passive_walker.gaits.control.maps import stride_map
from gym_passive_walker.gaits.find.fixed_point import find_gait
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.gaits.scenes.named import named_scene, named_walker
from gym_passive_walker.gaits.scenes.scene import SCENES, Scene
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.gaits.terrain import EXAMPLES, Terrain, terrain_from
from gym_passive_walker.models.walkers import WALKERS, Walker, tune

A_WALKER = (
    f"{', '.join(WALKERS)}, or a JSON, YAML or TOML file of your own walker's parameters, such as "
    '{"preset": "C", "hip_mass": 1.0}; or module:NAME, a System of yours'
)
"""Help text of an argument that names a walker."""

A_SCENE = (
    f"{', '.join(SCENES)}; or module:function, a function of yours that returns a scene or its "
    "arguments"
)
"""Help text of an argument that names a scene."""

A_POLICY = "the path of an exported folder, an ONNX file or a stable-baselines3 file (.zip)"
"""Help text of an argument that names a policy of the user's own."""


_OPTIONS = {
    "hip_torque": "--torque", "slope_min": "LOW", "slope_max": "HIGH", "folder": "--out",
}  # fmt: skip
"""Options for arguments of Python that have another name."""


class Parser(ArgumentParser):
    """A parser that reports an error in one sentence, with similar names, and exits with 2."""

    def error(self, message: str) -> NoReturn:
        """Print the message, and exit."""
        self.exit(2, f"error: {message} (see {self.prog} --help)\n")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse arguments; options that this parser does not have are an error."""
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


def a_walker(text: str) -> Walker:
    """Parse a walker by `named_walker`; the parser prints an error with the argument's name."""
    try:
        return named_walker(text)
    except (ValueError, ImportError) as error:
        raise ArgumentTypeError(str(error)) from None


def a_scene(text: str) -> Scene:
    """Parse a scene by `named_scene`; the parser prints an error with the argument's name."""
    try:
        return named_scene(text, trust=True)
    except (ValueError, ImportError) as error:
        raise ArgumentTypeError(str(error)) from None


def a_terrain(text: str) -> Terrain:
    """Parse a terrain by `terrain_from`; the parser prints an error with the argument's name."""
    try:
        return terrain_from(text)  # type: ignore[return-value]
    except (ValueError, ImportError) as error:
        raise ArgumentTypeError(str(error)) from None


def add_terrain(command: ArgumentParser) -> None:
    """Add the argument --terrain."""
    about = f"{EXAMPLES}, or a mapping as JSON or in a file (smooth ground)"
    command.add_argument("--terrain", type=a_terrain, metavar="GROUND", help=about)


def add_walker(command: ArgumentParser) -> None:
    """Add arguments for a walker; `walker_of` returns the walker."""
    command.add_argument("walker", type=a_walker, metavar="WALKER", help=A_WALKER)
    command.add_argument(
        "--tune", action="store_true", help="tune the walker first, for gaits at vanishing slope"
    )


def walker_of(arguments: Namespace) -> Any:
    """The walker given by the arguments, tuned if requested."""
    return tune(arguments.walker) if arguments.tune else arguments.walker


def add_slope(command: ArgumentParser) -> None:
    """Add an argument for a slope."""
    command.add_argument(
        "slope", type=float, metavar="SLOPE", help="slope in rad, positive downhill"
    )


def add_slopes(command: ArgumentParser) -> None:
    """Add arguments for a range of slopes."""
    command.add_argument("low", type=float, metavar="LOW", help="lowest slope in rad, above 0")
    command.add_argument("high", type=float, metavar="HIGH", help="highest slope in rad")


def add_kind(command: ArgumentParser) -> None:
    """Add an argument that selects the long-step or the short-step gait."""
    command.add_argument(
        "--kind",
        choices=("long", "short"),
        default="long",
        help="long-step or short-step gait (%(default)s)",
    )


def add_motors(command: ArgumentParser, *, push_off: bool = True) -> None:
    """Add arguments for the walker's actuation; `map_of` returns the stride map."""
    add = command.add_argument
    about = "{} in {}, equal in each stride (%(default)s)"
    add("--dimensionless", action="store_true", help="torques, push-off and initial state "
        "in units of m, l, √(l/g), as are results of gait, family, simulate")  # fmt: skip
    add("--torque", type=float, default=0.0, metavar="T", help=about.format("hip torque", "N m"))
    add("--ankle-torque", type=float, default=0.0, metavar="T",
        help=about.format("ankle torque (requires point feet)", "N m"))  # fmt: skip
    if push_off:
        what = about.format("push-off impulse along the stance leg, just before heelstrike,", "N s")
        add("--push-off", type=float, default=0.0, metavar="P", help=what)
    add_controller(command)


def add_controller(command: ArgumentParser) -> None:
    """Add arguments for a controller; `map_of` returns the stride map."""
    command.add_argument(
        "--controller", metavar="NAME", help="controller: a feedback "
        f"({', '.join(BASELINES)}), a trained policy, or {A_POLICY}"
    )  # fmt: skip
    command.add_argument(
        "--scene", type=a_scene, metavar="SCENE",
        help=f"scene of the controller (its own, or level): {A_SCENE}",
    )  # fmt: skip
    add_trust(command)


def add_trust(command: ArgumentParser) -> None:
    """Add the argument --trust; `read_policy` heeds it."""
    command.add_argument(
        "--trust", action="store_true", help="permit a policy with a scene of its own, "
        "module:function; such code runs with your rights",
    )  # fmt: skip


def read_policy(arguments: Namespace, name: str) -> Any:
    """Return a controller by its name; a trained policy is read here if --trust is given.

    Raises:
        ValueError: if --trust is given and the name is not one of a trained policy.
    """
    return load_policy(name, trust=True) if arguments.trust else name


def shown_in(arguments: Namespace, result: Any) -> tuple[Any, dict[str, str]]:
    """Return a result in the units asked for, and the names of these units."""
    plain = arguments.dimensionless or "units" not in result.walker.supports
    return (result.dimensionless, PLAIN) if plain else (result, SI)


def chosen_map(arguments: Namespace, slope: float | None = None) -> StrideMap:
    """The stride map of the walker and the actuation or controller given by the arguments.

    Raises:
        ValueError: if both torques or a push-off and a controller are given.
    """
    parts = (getattr(arguments, name, 0.0) for name in ("torque", "ankle_torque", "push_off"))
    walker, plain = walker_of(arguments), arguments.dimensionless
    held = Actuation.dimensionless(*parts) if plain else Actuation(*parts)
    if arguments.controller is None and arguments.scene is not None:
        raise ValueError("--scene is that of a --controller, which is not given")
    if arguments.controller is None and arguments.trust:
        raise ValueError("--trust permits a --controller, which is not given")
    if arguments.controller is None:
        return stride_map(walker, slope, controller=None if held.passive else held)
    if not held.passive:
        raise ValueError("--controller determines the actuation: omit torques and the push-off")
    controller = read_policy(arguments, arguments.controller)
    return stride_map(walker, slope, controller=controller, scene=arguments.scene)


def gait_of(arguments: Namespace) -> Gait:
    """The gait of the walker, slope and kind given by the arguments.

    Raises:
        GaitNotFound: if there is none.
    """
    return find_gait(chosen_map(arguments, arguments.slope), kind=arguments.kind)


def add_walk(command: ArgumentParser, *, strides: int) -> None:
    """Add arguments for a walk: walker, slope, initial state, actuation and terrain."""
    add_walker(command)
    add_slope(command)
    add_kind(command)
    add = command.add_argument
    add(
        "--strides",
        type=int,
        default=strides,
        metavar="N",
        help="largest number of strides (%(default)s)",
    )
    add("--state", type=float, nargs=6, metavar="X", help="stance, thigh and shank angle in rad, "
        "then angular velocities in rad/s, just after heelstrike (the gait's)")  # fmt: skip
    add_motors(command)
    add_terrain(command)
    add(
        "--terrain-seed",
        type=int,
        default=0,
        metavar="N",
        help="seed of random terrain (%(default)s)",
    )


def start_of(arguments: Namespace) -> NDArray[np.float64]:
    """Initial state of a walk, shape (6,): the state given by the arguments, or the gait's."""
    if arguments.state is not None:
        state = np.array(arguments.state)
        return walker_of(arguments).units.to_own(state) if arguments.dimensionless else state
    walks = chosen_map(arguments, arguments.slope)
    # With constant actuation, a walk starts on the passive gait, so that it shows the transient.
    passive = walker_of(arguments) if not walks.controlled else walks
    return find_gait(passive, arguments.slope, kind=arguments.kind).state
