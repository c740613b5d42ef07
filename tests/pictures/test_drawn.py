"""Pictures are drawn as they were: each line, mark, colour and text, in `tests/pictures/drawn`.

python -m tests.pictures.test_drawn [NAME...]     Write the files again, for changed pictures.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("matplotlib")
pygame = pytest.importorskip("pygame")

from matplotlib import colors  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402

import gym_passive_walker as gpw  # noqa: E402
from examples.driven_torso import DRIVEN_TORSO  # noqa: E402
from examples.torso import TORSO  # noqa: E402
from gym_passive_walker.gaits.control import optimal  # noqa: E402
from gym_passive_walker.gaits.control.baselines import LinearFeedback  # noqa: E402
from gym_passive_walker.gaits.scenes.scene import make_scene  # noqa: E402
from gym_passive_walker.pictures import figures, strobe  # noqa: E402
from gym_passive_walker.pictures.axes import OWN  # noqa: E402
from gym_passive_walker.pictures.brush import Brush  # noqa: E402
from gym_passive_walker.pictures.diagram import walker_diagram  # noqa: E402
from gym_passive_walker.pictures.ground import ground_under  # noqa: E402
from gym_passive_walker.pictures.portrait import both  # noqa: E402
from gym_passive_walker.pictures.screen import Screen  # noqa: E402
from tests.numbers import alike, told  # noqa: E402
from tests.own.statements import DRIVEN  # noqa: E402

FOLDER = Path(__file__).parent / "drawn"


def tint(colour: Any) -> str:
    """A colour in full."""
    return "none" if colour is None else colors.to_hex(colour, keep_alpha=True)


def tints(row: Any) -> str:
    """The different colours of a row, with the number of each."""
    names, counts = np.unique([tint(colour) for colour in row], return_counts=True)
    return " ".join(f"{name}x{count}" for name, count in zip(names, counts, strict=True))


def of_axes(ax: Any) -> Iterator[str]:
    """Each thing in a plot, in a line."""
    yield f"axes x {told(ax.get_xlim())} {ax.get_xscale()}"
    yield f" y {told(ax.get_ylim())} {ax.get_yscale()}"
    yield f" labels {ax.get_xlabel()!r} {ax.get_ylabel()!r} {ax.get_aspect()}"
    yield f" titles {[ax.get_title(loc=side) for side in ('left', 'center', 'right')]}"
    yield f" spines {[name for name, spine in ax.spines.items() if spine.get_visible()]}"
    for line in ax.lines:
        dashes = line._unscaled_dash_pattern  # with the phase, which has no public name
        yield f" line {told(line.get_xydata())}" if len(line.get_xydata()) else " line"
        yield (
            f"  {tint(line.get_color())} {line.get_linewidth():g} {line.get_linestyle()} {dashes} "
            f"alpha {line.get_alpha()} z {line.get_zorder():g} {line.get_drawstyle()} "
            f"{line.get_solid_capstyle()} marker {line.get_marker()} {line.get_markersize():g} "
            f"{tint(line.get_markeredgecolor())} {tint(line.get_markerfacecolor())} "
            f"{line.get_markeredgewidth():g} {line.get_label()!r}"
        )
    for each in ax.collections:
        yield f" {type(each).__name__} {told(each.get_offsets())} paths {len(each.get_paths())}"
        for path in each.get_paths()[:4]:
            yield f"  {told(path.vertices)}"
        values = each.get_array()
        faces = each.get_facecolor() if values is None else each.to_rgba(np.ravel(values))
        yield (
            f"  {tints(faces)} edges {tints(each.get_edgecolor())} "
            f"{told(each.get_linewidth())} z {each.get_zorder():g} {each.get_label()!r} "
            f"values {'none' if values is None else told(np.ravel(values))}"
        )
    for patch in ax.patches:
        corners = patch.get_patch_transform().transform(patch.get_path().vertices)
        yield f" {type(patch).__name__} {told(corners)}"
        yield (
            f"  {tint(patch.get_facecolor())} {tint(patch.get_edgecolor())} "
            f"{patch.get_linewidth():g} {patch.get_linestyle()} alpha {patch.get_alpha()} "
            f"{patch.get_hatch()} z {patch.get_zorder():g} {patch.get_label()!r}"
        )
    for text in ax.texts:
        yield (
            f" text {text.get_text()!r} {told(text.get_position())} {text.get_ha()} "
            f"{text.get_va()} {tint(text.get_color())} {text.get_fontsize():g} "
            f"{text.get_rotation():g} {told(getattr(text, 'xy', [0.0]))}"
        )
    for image in ax.images:
        yield f" image {told(image.get_extent())} {told(np.ravel(image.get_array()))}"
    for side in (ax.xaxis, ax.yaxis):
        yield f" ticks {told(side.get_ticklocs())} {[x.get_text() for x in side.get_ticklabels()]}"
    if ax.get_legend():
        yield from of_legend(ax.get_legend())


def of_legend(legend: Any) -> Iterator[str]:
    """A legend in a line."""
    texts = [text.get_text() for text in legend.get_texts()]
    at = legend.get_bbox_to_anchor().transformed(legend.figure.transFigure.inverted())
    yield f" legend {texts} in {legend._ncols} columns at {told(at.min)}"  # no public name


def of_figure(drawn: Any) -> list[str]:
    """Each thing in a figure, or in the figure of some axes, in a line."""
    figure = drawn if isinstance(drawn, Figure) else np.ravel(drawn)[0].figure
    lines = [f"figure {told(figure.get_size_inches())} {figure.dpi:g}"]
    for ax in figure.axes:
        lines += of_axes(ax)
    for legend in figure.legends:
        lines += of_legend(legend)
    return lines


def of_frame(draw: Callable[[], Any]) -> list[str]:
    """Shapes of each kind and colour in frames that a function draws, and each text, in a line."""
    lines: list[str] = []
    drawn: dict[str, list[Any]] = {}
    write = Brush.write

    def recording(name: str, shape: Callable[..., Any]) -> Callable[..., Any]:
        def record(canvas: Any, colour: Any, *places: Any, **more: Any) -> Any:
            given = np.concatenate([np.ravel(np.array(x, float)) for x in places])
            kind = f"{name} {len(given)} {tuple(colour)[:3]} {more or ''}".rstrip()
            drawn.setdefault(kind, []).append(given)
            return shape(canvas, colour, *places, **more)

        return record

    def written(self: Any, text: str, place: Any, *more: Any, **named: Any) -> float:
        lines.append(f"text {text!r} {told(np.asarray(place, float))} {more} {named}")
        return write(self, text, place, *more, **named)

    shapes = ("circle", "polygon", "line", "lines", "aaline", "aalines", "rect", "arc", "ellipse")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Brush, "write", written)
        for name in shapes:
            patch.setattr(pygame.draw, name, recording(name, getattr(pygame.draw, name)))
        draw()
    return [*lines, *(f"{kind} {told(np.array(given))}" for kind, given in drawn.items())]


def of_screen(name: Any, **shown: Any) -> list[str]:
    """The shapes of a walker's frames, over a stride and a half."""
    walk = gpw.simulate(gpw.find_gait(name, 0.009 if name == "D" else 0.036), strides=2, samples=5)

    def frames() -> None:
        screen = Screen(name)
        for i in range(7):
            given = shown if i < 3 else {}
            screen.draw(
                walk.states[i], walk.slope, walk.contact_x[i], int(walk.stride_index[i]), **given
            )

    return of_frame(frames)


def on_footholds() -> list[str]:
    """The shapes of a frame on uneven ground, with a foot below it."""
    terrain = gpw.footholds([0.0, -0.01, 0.012, 0.0], [0.0, 0.01, -0.01, 0.0])
    gait = gpw.find_gait("lab", 0.036)
    walk = gpw.simulate(gait, strides=2, samples=4, terrain=terrain)
    screen = Screen("lab")
    surface = ground_under(walk, screen.seen)

    def frames() -> None:
        for i in range(len(walk.states)):
            screen.draw(
                walk.states[i], walk.slope, walk.contact_x[i], int(walk.stride_index[i]),
                contact_y=walk.contact_y[i], tilt=walk.tilts[i], profile=surface, push=0.3,
            )  # fmt: skip

    return of_frame(frames)


def _gait() -> gpw.Gait:
    return gpw.find_gait("lab", 0.036)


def _strides() -> gpw.Stride:
    gait = _gait()
    return gpw.stride("lab", 0.036, gait.state * np.array([[0.99], [1.0], [1.3]]))


def branches(walkers: dict[str, Any], low: float, high: float, named: str) -> dict[str, Any]:
    """The branches of long and of short steps of some walkers."""
    return {named.format(name, kind): gpw.gait_family(walker, low, high, kind)
            for name, walker in walkers.items() for kind in ("long", "short")}  # fmt: skip


def doubled() -> dict[str, Any]:
    """Settled walks of periods 1, 2 and 4. Chaotic ones differ with the CPU's rounding."""
    slopes = np.linspace(0.07, 0.09, 6)
    return {"settled walks": gpw.bifurcation_diagram(gpw.tune("C"), slopes, n_transient=500)}


def detuned() -> dict[str, Any]:
    """Walkers of Fig. 4.8."""
    shares, first = (0.0, 0.05, 0.3, 0.6, 0.75, 1.0), gpw.tune("C")
    return {f"{x:.0%} of the way": gpw.interpolate(first, "lab", x) for x in shares}


def of_agents(name: str) -> Figure:
    """A picture of invented results of agents."""
    pytest.importorskip("stable_baselines3")
    from agents import pictures, results

    gaits, walk = optimal.load("level"), make_scene("level")
    scores: list[Any] = [
        {"scene": "level", "agent": agent, "seed": seed, "reached_time_limit": 1.0, "reward": 40.0,
         "learning_steps": 1e5 * (seed + 2), "above_optimum": 0.1 * seed + 0.05,
         "speed": gaits[seed].froude_speed, "cost_of_transport": 0.01 * (seed + 1)}
        for seed in range(3) for agent in ("ppo", "sac", "linear")
    ]  # fmt: skip
    rows = [{"steps": 2e5 * i, "seconds": 9.0 * i, "distance": 3.0 * i, "strides": 2.0 * i,
             "speed": 0.1, "cost_of_transport": 0.1 / (1 + i)} for i in range(3)]  # fmt: skip
    found: list[Figure] = []
    with pytest.MonkeyPatch.context() as patch, TemporaryDirectory() as folder:
        for module in (pictures, results):
            patch.setattr(module, "save", lambda figure, path: found.append(figure))
        path = Path(folder)
        if name == "costs":
            results.draw(path, scores)
        elif name == "runs":
            results.draw_learning(path, path, scores)
        elif name == "curve":
            pictures.learning_curve(path, rows, rows[0], "a title")
        else:
            world = gym.make("PassiveWalker-v0", scene=walk)
            policy = gpw.load_policy("level-ppo")
            pictures.gait(path, policy, world, seed=0, title="a gait")
    return found[0]


FIGURES: dict[str, Callable[[], Any]] = {
    "walker": lambda: gpw.WALKERS["lab"].plot(OWN),
    "diagram": walker_diagram,
    "gait": lambda: _gait().plot(OWN),
    "controlled": lambda: gpw.closed_loop_gait(LinearFeedback("steep"), "steep").plot(OWN),
    "comparison": lambda: gpw.closed_loop_gait(LinearFeedback("steep"), "steep").plot(
        OWN, optimum=optimal.load("steep")[0]
    ),
    "family": lambda: gpw.gait_family("lab", 0.005, 0.1).plot(OWN),
    "speeds": lambda: gpw.gait_family("D", 0.012, 0.016).plot(OWN, by="froude_speed"),
    "stride": lambda: _gait().stride.plot(OWN),
    "strides": lambda: _strides().plot(OWN),
    "walk": lambda: gpw.simulate(_gait(), strides=3, samples=20).plot(OWN),
    "check": lambda: gpw.reality_check(_gait()).plot(OWN),
    "bifurcations": lambda: gpw.bifurcation_diagram(
        "C", [0.02, 0.03], n_transient=20, n_recorded=34
    ).plot(OWN),
    "basin": lambda: gpw.basin_of_attraction("lab", 0.036, resolution=12).plot(OWN),
    "strobe": lambda: strobe("lab", 0.036, _gait().state, strides=2, flashes=5, ax=OWN),
    "portrait": lambda: both(gpw.simulate(_gait(), strides=2, samples=40), OWN),
    "uneven": lambda: strobe(
        "lab", 0.036, _gait().state, strides=3, flashes=3, ax=OWN,
        terrain=gpw.footholds([0.0] * 3, [0.0, 0.01, -0.01]),
    ),
    "transition": lambda: figures.transition(figures.point_feet()),
    "heelstrike": lambda: figures.FIGURES["4.4"].draw(figures.FIGURES["4.4"].tables()),
    "standing": lambda: figures.FIGURES["4.7"].draw({}),
    "knees": lambda: figures.lab_families({
        f"{name}, branch {i}": family for name in ("lab", "lab-straight")
        for i, family in enumerate(figures.families(gpw.WALKERS[name], 0.036, 0.06, looks=1))
    }),
    "detuning": lambda: figures.detuning(branches(detuned(), 0.045, 0.055, "{}, {}")),
    "tuned": lambda: figures.tuned_families(
        branches({name: gpw.tune(name) for name in "ABCDE"}, 0.01, 0.013, "{}, {} step")
    ),
    "doublings": lambda: figures.period_doubling(figures.doublings(slopes=1) | doubled()),
    "torus": lambda: gpw.parameter_family(
        DRIVEN_TORSO, "damping", 2e-4, 0.03, slope=0.03
    ).plot(OWN),
    "path": lambda: gpw.simulate(_gait(), strides=2, samples=20).plot(OWN, of="path"),
    "massless": lambda: gpw.WALKERS["D"].plot(OWN),
    "system": lambda: gpw.find_gait(TORSO, 0.03).plot(OWN),
    "system-torques": lambda: gpw.find_gait(
        gpw.stride_map(DRIVEN, 0.03, controller={"hip": 0.01})
    ).plot(OWN),
    "system-energy": lambda: gpw.simulate(
        gpw.find_gait(TORSO, 0.03), strides=2, samples=20
    ).plot(OWN, of="energy"),
    "locus": lambda: gpw.bifurcation_locus(
        fold := gpw.gait_family("lab", 0.003, 0.15), fold.folds[1], "shank_length", 0.3, 0.6
    ).plot(OWN),
    "cascade": lambda: gpw.doubling_cascade("D", 0.01, 0.0195, doublings=3).plot(OWN),
    "evaluation": lambda: gpw.evaluate("steep-ppo", episodes=2, max_episode_steps=40).plot(OWN),
    "gauntlet": lambda: gpw.gauntlet("steep-ppo", walkers=2).plot(OWN),
    "robustness": lambda: gpw.robustness(
        "D", slope=0.009, walkers=16, strides=20, starts=16
    ).plot(OWN),
    "optimum": lambda: optimal.load("level")[0].plot(OWN),
    "forces": lambda: gpw.simulate(_gait(), strides=2, samples=20).plot(OWN, of="forces"),
    **{f"agents-{x}": lambda x=x: of_agents(x) for x in ("costs", "runs", "curve", "gait")},
}  # fmt: skip
FRAMES: dict[str, Callable[[], list[str]]] = {
    "frame-lab": lambda: of_screen(
        "lab", torque=0.5, push=-0.4, notes=(["left", "more"], ["right"]), warning="fell"
    ),
    "frame-D": lambda: of_screen("D", torque=-1.0),
    "frame-torso": lambda: of_screen(TORSO, push=0.4),
    "frame-footholds": on_footholds,
}
DRAWN: dict[str, Callable[[], list[str]]] = {
    **{name: lambda draw=draw: of_figure(draw()) for name, draw in FIGURES.items()},
    **FRAMES,
}


def test_the_folder_holds_these_pictures_and_no_others() -> None:
    assert {path.stem for path in FOLDER.iterdir()} == DRAWN.keys()


@pytest.mark.parametrize("name", DRAWN)
def test_a_picture_is_drawn_as_it_was(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    before = (FOLDER / f"{name}.txt").read_text("utf-8").splitlines()
    again = f"run python -m tests.pictures.test_drawn {name}, and look at the picture"
    for old, new in zip(before, DRAWN[name](), strict=True):
        assert alike(old, new, 1e-4, 2e-5), f"{old}\n{new}\n{again}"


if __name__ == "__main__":
    os.environ["SDL_VIDEODRIVER"] = "dummy"
    FOLDER.mkdir(exist_ok=True)
    for chosen in sys.argv[1:] or DRAWN:
        text = "\n".join(DRAWN[chosen]())
        (FOLDER / f"{chosen}.txt").write_text(f"{text}\n", "utf-8")
        print(chosen, len(text.splitlines()), "lines")
