"""Examples of gradient-based design, checked by simulation.

    python -m benchmarks.design [cost] [return] [steep] [tuned]

The examples run the code of docs/design.md; tables and pictures are written to that page.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

import gym_passive_walker as gpw
from benchmarks.report import command, table
from benchmarks.tables import DOCS, keep
from gym_passive_walker.pictures.strobe import strobe

PAGE = DOCS / "design.md"
IMAGES = DOCS / "images"
STRIDES = 200  # in a check by simulation
BEFORE, AFTER = "#E08A16", "#0060A0"


def designed(name: str) -> gpw.Design:
    """The design from the page's code, executed up to the block that assigns it to `name`."""
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    last = next(i for i, block in enumerate(blocks) if re.search(rf"^{name} =", block, re.M))
    namespace: dict[str, object] = {}
    exec(compile("\n".join(blocks[: last + 1]), str(PAGE), "exec"), namespace)
    design = namespace[name]
    assert isinstance(design, gpw.Design)
    return design


def compared(design: gpw.Design, parameters: Sequence[str]) -> str:
    """A table of parameters and measures, before and after."""
    gaits = design.start, design.gait
    rows: list[list[object]] = []
    for name in parameters:
        rows.append([name, *(f"{of(gait, name):.5g}" for gait in gaits)])
    for name in ("froude_speed", "step_length", "cost_of_transport"):
        rows.append([name, *(f"{getattr(gait, name):.5g}" for gait in gaits)])
    moduli = (", ".join(f"{abs(m):.4f}" for m in gait.multipliers) for gait in gaits)
    rows.append(["moduli of multipliers", *moduli])
    for name, values in design.values.items():
        if name not in ("froude_speed", "cost_of_transport", "slope", *parameters):
            rows.append([name, *(f"{value:.5g}" for value in values)])
    said = f"{design.tried} walkers tried; SLSQP: {design.message.lower()}."
    return table(["", "before", "after"], rows) + f"\n\n{said}"


def of(gait: gpw.Gait, name: str) -> float:
    """A parameter of a gait's walker, or its slope."""
    return gait.slope if name == "slope" else getattr(gait.walker, name)


def walked(gait: gpw.Gait, push: float, strides: int = STRIDES) -> tuple[np.ndarray, float, float]:
    """Simulate a walk from a gait with perturbed angular velocities.

    Args:
        gait: The gait.
        push: Relative perturbation of the angular velocities.
        strides: Number of strides.

    Returns:
        Relative distance of the state from the gait's at each heelstrike, (strides,); cost of
        transport and speed over sqrt(g l) of the second half of the walk.
    """
    state = gait.state * np.array([1.0, 1.0, 1.0, 1.0 + push, 1.0 - push, 1.0 - push])
    size, apart = np.linalg.norm(gait.state), []
    lost = length = time = 0.0
    for i in range(strides):
        apart.append(np.linalg.norm(state - gait.state) / size)
        step = gpw.stride(gait.walker, gait.slope, state)
        state = step.state
        if i >= strides // 2:
            lost += float(step.collision_loss)
            length += float(step.step_length)
            time += float(step.duration)
    weight = gait.walker.total_mass * gait.walker.gravity
    unit = np.sqrt(gait.walker.leg_length * gait.walker.gravity)
    return np.array(apart), lost / (weight * length), length / time / unit


def figure_of(rows: int, columns: int, size: tuple[float, float]):
    """A figure and its axes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False).ravel()


def cost() -> None:
    """Example: least cost of transport at a given speed."""
    design = designed("cheap")
    text = compared(design, CHEAP)
    for when, gait in (("before", design.start), ("after", design.gait)):
        _, cost_of_transport, speed = walked(gait, 0.01)
        text += (
            f"\nSimulated {when}, begun with rates 1 % off: over strides {STRIDES // 2} to "
            f"{STRIDES} the cost of transport is {cost_of_transport:.8f} at speed {speed:.8f}."
        )
    keep("cheap", text, PAGE)
    figure, axes = figure_of(2, 1, (8.0, 5.0))
    for ax, when, gait in zip(axes, ("before", "after"), (design.start, design.gait), strict=True):
        strobe(gait.walker, gait.slope, gait.state, ax=ax)
        ax.set_title(f"{when}: cost of transport {gait.cost_of_transport:.4f}", fontsize="small")
    figure.savefig(IMAGES / "design-cost.png", dpi=110)


def returning() -> None:
    """Example: smallest spectral radius of the stride map's derivative at a given slope."""
    design = designed("steady")
    text = compared(design, STEADY)
    figure, (ax,) = figure_of(1, 1, (7.0, 3.6))
    for when, gait, colour in (("before", design.start, BEFORE), ("after", design.gait, AFTER)):
        apart = walked(gait, 0.01, 24)[0]
        radius = abs(gait.multipliers[0])
        strides = np.arange(len(apart))
        near = np.flatnonzero(apart < 1e-9)[0]
        ax.semilogy(strides[: near + 1], apart[: near + 1], "o-", color=colour, label=when)
        ax.semilogy(
            strides[: near + 1], apart[0] * radius ** strides[: near + 1], ":", color=colour
        )
        text += (
            f"\nSimulated {when}: rates 1 % off are less than 10⁻⁹ of the state off after {near} "
            f"strides."
        )
    ax.set(xlabel="stride", ylabel="distance from the gait")
    ax.set_title("dotted: the largest multiplier's power", fontsize="small")
    ax.legend()
    figure.savefig(IMAGES / "design-return.png", dpi=110)
    keep("steady", text, PAGE)


def steep() -> None:
    """Example: steepest slope with a stable gait."""
    design = designed("steep")
    text = compared(design, STEEP)
    figure, (ax,) = figure_of(1, 1, (7.0, 3.6))
    for when, walker, colour in (
        ("before", design.start.walker, BEFORE),
        ("after", design.walker, AFTER),
    ):
        (doubled, *_) = gpw.gait_family(walker, 0.05, 0.14).period_doublings
        slopes = np.append(np.linspace(0.05, 0.13, 400), doubled + np.array([-5e-4, 5e-4]))
        diagram = gpw.bifurcation_diagram(
            walker, slopes[slopes > 0], n_transient=1500, n_recorded=64
        )
        ax.plot(diagram.slope, diagram.stance_angle, ".", color=colour, markersize=0.8)
        ax.axvline(doubled, color=colour, linestyle=":", label=f"{when}: doubles at {doubled:.4f}")
        below, above = diagram.period[-2:]
        text += (
            f"\nSimulated {when}: the family's period doubles at {doubled:.6f} rad; after 1500 "
            f"strides walks repeat after {below} stride at {slopes[-2]:.6f} and after {above} at "
            f"{slopes[-1]:.6f}."
        )
    ax.set(xlabel="slope (rad)", ylabel="stance angle (rad)")
    ax.legend(fontsize="small")
    figure.savefig(IMAGES / "design-steep.png", dpi=110)
    keep("steep", text, PAGE)


def tuned() -> None:
    """Example: walkers that lose their gait by tuning, and the nearest tuned walkers with one."""
    lab = gpw.WALKERS["lab"]
    heavy = gpw.Walker(
        thigh_length=0.40, thigh_mass=5.0, thigh_com=0.2, thigh_gyration=0.1,
        shank_length=0.45, shank_mass=3.0, shank_com=0.2, shank_gyration=0.15,
        hip_mass=10.0, foot_radius=0.15, foot_angle=0.15,
    )  # fmt: skip
    rows: list[list[object]] = []
    for name, walker, slope in (("lab", lab, 0.036), ("heavy", heavy, 0.03)):
        gait = gpw.tune_to_walk(walker, slope)
        alone = gpw.find_gaits(gpw.tune(walker), slope)
        for label, one, gaits in (
            (name, walker, gpw.find_gaits(walker, slope)),
            (f"{name}, `tune`", gpw.tune(walker), alone),
            (f"{name}, `tune_to_walk`", gait.walker, [gait]),
        ):
            long = next((f"{abs(g.multipliers[0]):.4f}" for g in gaits if g.kind == "long"), "none")
            rows.append([label, slope, *(f"{getattr(one, key):.4f}" for key in SPREAD), long])
    heads = ["walker", "slope", *SPREAD, "long-step gait's largest multiplier"]
    text = (
        "`heavy` has thighs of 0.40 m and 5 kg, shanks of 0.45 m and 3 kg, a hip of 10 kg, feet of"
    )
    keep("tuned", f"{text} 0.15 m.\n\n{table(heads, rows)}", PAGE)


SPREAD = (
    "thigh_com", "thigh_gyration", "shank_com", "shank_gyration", "thigh_offset", "shank_offset",
)  # fmt: skip
MASS = ("thigh_com", "shank_com", "thigh_offset", "shank_offset", "foot_radius")
CHEAP, STEADY = ("slope", *MASS), MASS
STEEP = ("slope", "thigh_mass", "shank_mass", "thigh_com", "shank_com", "foot_radius")

if __name__ == "__main__":
    command(__doc__, {"cost": cost, "return": returning, "steep": steep, "tuned": tuned})
