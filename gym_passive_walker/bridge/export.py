"""Files of walkers for other simulators."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from textwrap import fill
from typing import Any, Literal

from gym_passive_walker._tools.arguments import near, number, one_slope, shown
from gym_passive_walker._tools.files import prepare, replacing
from gym_passive_walker.bridge.linkage import Linkage
from gym_passive_walker.bridge.mjcf import TIMESTEP, mjcf, spelled
from gym_passive_walker.bridge.rigid import Tree, TreePose, coordinates, tree_of_walker
from gym_passive_walker.bridge.urdf import sdf, urdf
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.models.walkers import Walker, WalkerLike, as_walker, describe, name_of

FORMATS = {"mjcf": ".xml", "urdf": ".urdf", "sdf": ".sdf"}
"""Formats of files, and the usual ending of each."""

_SWING = "Let the swing foot meet the ground only where it leads and comes down: {}legs scuff."
_KNEES = (
    "Latch the swing knee from its stop on, to the end of the stride and through the next one, in "
    "which it stands. A limit of the joint is not enough.",
    "Free the knee of the leg that leaves the ground {} the impact of the other foot, not {} it.",
)
_TASKS = (
    "Let the feet pass through each other.",
    "End a step on each impact. A foot that is found below the ground is pushed out: it bounces.",
    "Observe a heelstrike after its impact.",
    "Keep contacts as stiff as the timestep allows, and stiffer with a smaller timestep.",
    "Exchange the legs at each heelstrike: a torque of the hip acts on the leg that swings.",
)


def export(
    walker: WalkerLike | Gait,
    path: str | PathLike[str],
    format: Literal["mjcf", "urdf", "sdf"] | None = None,
    *,
    slope: float | None = None,
    timestep: float | None = None,
    unit_length: float | None = None,
    unit_mass: float | None = None,
) -> None:
    """Write a walker as a file for MuJoCo, Drake, Pinocchio or Gazebo, in SI units.

    The file has bodies with their inertia, hinges and stops, circular feet, the ground and the
    hip's actuator; of a gait also its initial state. A comment says what a simulator's user must
    do for it to walk. `PassiveWalkerMujoco-v0` does it.

    Args:
        walker: A walker or a `System` that is stated by links, in a form that `as_walker` takes; or
            a `Gait`, with its state and slope.
        path: The file.
        format: "mjcf", "urdf" or "sdf"; None follows the ending .xml, .urdf or .sdf.
        slope: Slope of the ground in rad, positive downhill; the gait's, or 0, when None. URDF has
            no ground.
        timestep: Timestep of MJCF in s; 0.001 when None. The time constant of contacts is twice as
            long. Other formats have none.
        unit_length: Unit of length of a `System`, in m.
        unit_mass: Unit of mass of a `System`, in kg.

    Raises:
        ValueError: if the walker has no such file, or an argument is out of its range.
        OSError: if the file cannot be written.

    Example:
        >>> import gym_passive_walker as gpw
        >>> gpw.export(gpw.find_gait("lab", 0.036), "lab.xml")
    """
    text = text_for(
        walker, checked_format(path, format), slope=slope, timestep=timestep,
        unit_length=unit_length, unit_mass=unit_mass,
    )  # fmt: skip
    prepare(path)
    with replacing(path) as aside:
        aside.write_text(text, encoding="utf-8")


def text_for(
    walker: WalkerLike | Gait,
    kind: str,
    *,
    slope: float | None = None,
    timestep: float | None = None,
    unit_length: float | None = None,
    unit_mass: float | None = None,
) -> str:
    """Return the text of a file of a format; see `export`."""
    gait = check_plane(walker, "a file's walker is") if isinstance(walker, Gait) else None
    model: Any = gait.walker if gait is not None else as_walker(walker)  # type: ignore[arg-type]
    tilt = (gait.slope if gait is not None else 0.0) if slope is None else one_slope(slope)
    if gait is not None and slope is not None and tilt != gait.slope:
        raise ValueError(
            f"the gait's slope is {gait.slope:g} rad, not {tilt:g}: leave out slope, or export a "
            "gait of that slope"
        )
    if timestep is not None and kind != "mjcf":
        raise ValueError(f"timestep is that of MJCF: a file of {kind.upper()} has none")
    step = number(TIMESTEP if timestep is None else timestep, "timestep", above=0.0, most=1.0)
    tree, pose = _described(model, tilt, gait, unit_length, unit_mass)
    about = _comment(model, tree, tilt, pose, kind)
    if kind == "mjcf":
        return mjcf(tree, tilt, step, pose, about)
    return urdf(tree, about) if kind == "urdf" else sdf(tree, tilt, about)


def check_plane(gait: Gait, doing: str) -> Gait:
    """Return a gait after a check that its ground is a plane.

    Raises:
        ValueError: if it has footholds; the message says what is done on a plane alone.
    """
    if gait.stride_map.terrain is not None:
        raise ValueError(
            f"{doing} on a plane, and this gait has footholds of its own: give the gait of a "
            "stride map without terrain"
        )
    return gait


def checked_format(path: str | PathLike[str], given: str | None) -> str:
    """Return the format of a file.

    Raises:
        ValueError: if there is no such format, or the ending names none.
    """
    if given is not None:
        if given not in [*FORMATS]:
            raise ValueError(
                f"format must be one of {', '.join(FORMATS)}, not {shown(given)}"
                f"{near(given, FORMATS)}"
            )
        return given
    kinds = {ending: kind for kind, ending in FORMATS.items()}
    if (ending := Path(path).suffix.lower()) not in kinds:
        raise ValueError(
            f"a file of a walker ends in {', '.join(FORMATS.values())}, or has a format, one of "
            f"{', '.join(FORMATS)}: {shown(str(path))} has neither"
        )
    return kinds[ending]


def _described(
    model: Any, slope: float, gait: Gait | None, length: float | None, mass: float | None
) -> tuple[Tree, TreePose | None]:
    """Return the tree of a model, and its coordinates just after heelstrike on a gait."""
    if isinstance(model, Walker):
        for name, unit in (("unit_length", length), ("unit_mass", mass)):
            if unit is not None:
                raise ValueError(f"{name} is for a System: {describe(model)} has units of its own")
        tree = tree_of_walker(model, name_of(model))
        return tree, None if gait is None else coordinates(model, slope, gait.state.tolist())
    linkage = Linkage(model)
    if length is None or mass is None:
        raise ValueError(
            f"the system {model.title!r} has no units, and files are in m, kg and s: give "
            "unit_length in m and unit_mass in kg"
        )
    metres = number(length, "unit_length", above=0.0, most=1e6)
    tree = linkage.tree(metres, number(mass, "unit_mass", above=0.0, most=1e9))
    if gait is None:
        return tree, None
    rate = (tree.gravity / metres) ** 0.5
    return tree, linkage.coordinates(slope, gait.state.tolist(), metres, rate)


def _comment(model: Any, tree: Tree, slope: float, pose: TreePose | None, kind: str) -> str:
    """What the reader of a file must know and do."""
    across = "y up and z across" if kind == "urdf" else "z up"
    lines = [
        f"{describe(model)} of gym_passive_walker, in m, kg, s and rad.",
        f"It walks in the direction of x, with {across}. Angles are positive where the upper end "
        "of a body leans back.",
    ]
    if kind == "urdf":
        lines.append(
            f"The format has no ground: tilt a plane by {spelled(slope)} rad, downhill in the "
            "direction of x, and do not tilt gravity, of which this format has none either "
            f"({spelled(tree.gravity)} m/s^2)."
        )
    if stops := any(body.stop for body in tree.bodies):
        lines.append("Knees have their stop at 0.")
    acting = "potential", "dissipation", "forces"
    if absent := [name for name in acting if getattr(model, name, None) is not None]:
        lines.append(
            f"Not in this file, but in the system: its {', '.join(absent)}. Apply their forces."
        )
    known = {motor.name for motor in tree.motors}
    if not isinstance(model, Walker) and (elsewhere := {*model.controls} - known):
        lines.append(f"Motors that act at no hinge of this file: {', '.join(sorted(elsewhere))}.")
    if kind == "urdf" and tree.stiffness:
        springs = ", ".join(f"{joint} {spelled(k)} N m/rad" for joint, k in tree.stiffness.items())
        lines.append(f"The format has no springs: {springs}.")
    if pose is not None and kind != "mjcf":
        for what, values in zip(("Positions", "velocities"), pose, strict=True):
            each = ", ".join(
                f"{name} {spelled(value)}" for name, value in zip(tree.joints, values, strict=True)
            )
            lines.append(f"{what} on the gait, just after heelstrike: {each}.")
    reversed_motors = ", ".join(motor.name for motor in tree.motors if motor.gear < 0.0)
    if reversed_motors and kind != "mjcf":
        lines.append(f"Positive torques turn hinges backwards: {reversed_motors}.")
    lines.append("A simulator walks with this model as the exact one does, if its user does this:")
    order = ("before", "after") if getattr(model, "knees", True) != "held" else ("after", "before")
    knees = [task.format(*order) for task in _KNEES * stops]
    tasks = _SWING.format("" if stops else "straight "), *knees, *_TASKS
    lines += (f"{number}. {task}" for number, task in enumerate(tasks, 1))
    text = "\n".join(fill(line, 96, initial_indent="  ", subsequent_indent="  ") for line in lines)
    return f"\n{text.replace('--', '- -')}\n"
