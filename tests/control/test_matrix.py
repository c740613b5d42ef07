"""Every analysis of everything that walks: pair by pair it works, or an error says why not.

`docs/analyses.md` shows the table; ``python -m tests.control.test_matrix`` writes it, and the file
`matrix.json` beside this one: the results of each pair, and how many strides it integrated.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.gaits.control.baselines import LinearFeedback
from tests.numbers import compare, numbers_in, work

KEPT = Path(__file__).with_name("matrix.json")
PAGE = Path(__file__).parents[2] / "docs" / "analyses.md"
BEGIN, END = "<!-- pairs -->", "<!-- end of pairs -->"
LAB = {"walker": "lab", "slope": 0.036}


def brake(observation):
    """A function of observations: a torque against the stance angle's deviation."""
    return 0.4 * (observation[:, :1] - 0.243)


class Pushes:
    """An object with `predict` and a scene, as users write them."""

    scene = LAB

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """A little torque, always the same."""
        return np.full((len(observation), 1), 0.05, np.float32), state


WALKS = {
    "nothing: passive": lambda: gpw.stride_map("lab", 0.036),
    "`Actuation`": lambda: gpw.stride_map("lab", 0.036, controller=gpw.Actuation(hip_torque=0.05)),
    "`OptimalGait`": lambda: gpw.stride_map(
        controller=gpw.gaits.control.optimal.load("level")[-5], scene="level"
    ),
    "feedback": lambda: gpw.stride_map(controller=LinearFeedback("lab")),
    "policy": lambda: gpw.stride_map(controller="lab-ppo"),
    "object with `predict`": lambda: gpw.stride_map(controller=Pushes()),
    "function": lambda: gpw.stride_map(controller=brake, scene=LAB),
}
"""What works the motors, and its stride map."""


def near(value, share=0.02):
    return value * (1.0 - share), value * (1.0 + share)


def in_torch(found):
    """Strides of torch know motors that are held, and controllers that are modules."""
    torch = pytest.importorskip("torch")
    from gym_passive_walker.torch import stride

    strides = found.stride_map
    if strides.controlled:
        raise ValueError(
            "a stride of torch has held motors: walk under a module by "
            "gym_passive_walker.torch.rollout"
        )
    held = strides.controller or gpw.Actuation()
    state = torch.tensor(found.state, dtype=torch.float64, requires_grad=True)
    return stride(found.walker, found.slope, state, **held._asdict()).state


def watched(found):
    """A frame of a video."""
    from gym_passive_walker.pictures.strobe import strobe

    return strobe(found, strides=1)


@cache
def gait(name):
    return gpw.find_gait(WALKS[name]())


def of(name):
    return gait(name).stride_map.with_tolerance(1e-10)


ANALYSES = {
    "gait, multipliers": lambda n: gpw.find_gait(WALKS[n]()),
    "family in slope": lambda n: gpw.gait_family(
        of(n), gait(n).slope - 1e-3, gait(n).slope + 1e-3, start=gait(n), resolution=0.5
    ),
    "family in a parameter": lambda n: gpw.parameter_family(
        of(n), "foot_radius", *near(gait(n).walker.foot_radius), resolution=0.5
    ),
    "bifurcation diagram": lambda n: gpw.bifurcation_diagram(
        of(n),
        [max(gait(n).slope, 1e-3)],
        start=gait(n).state,
        n_transient=5,
        n_recorded=6,
        longest_period=2,
    ),
    "period-doubling cascade": lambda n: gpw.doubling_cascade(
        of(n), *near(max(gait(n).slope, 1e-3)), doublings=1
    ),
    "crisis": lambda n: gpw.crisis(
        of(n),
        max(gait(n).slope, 1e-3),
        0.4,
        start=gait(n).state,
        strides=20,
        walkers=2,
        accuracy=0.05,
    ),
    "Lyapunov exponents": lambda n: gpw.lyapunov_exponents(
        of(n), [max(gait(n).slope, 1e-3)], start=gait(n).state, strides=4, n_transient=2
    ),
    "basin": lambda n: gpw.basin_of_attraction(of(n), resolution=5, strides=20),
    "largest push": lambda n: gpw.largest_push(
        of(n), gait=gait(n), strides=10, accuracy=0.02, tolerance=1e-8
    ),
    "robustness": lambda n: gpw.robustness(gait(n), walkers=4, strides=5, starts=4),
    "simulation": lambda n: gpw.simulate(gait(n), strides=2, samples=10),
    "simulation on rough ground": lambda n: gpw.simulate(
        gait(n), strides=2, samples=10, terrain=gpw.rough(0.001)
    ),
    "reality check": lambda n: gpw.reality_check(gait(n)),
    "Jacobian": lambda n: gpw.stride_jacobian(gait(n), wrt=("state", "slope", "shank_com")),
    "design": lambda n: gpw.optimize_walker(
        of(n), "cost_of_transport", ["shank_com"], [near(gait(n).walker.shank_com)], iterations=2
    ),
    "pictures": lambda n: watched(gait(n)),
    "torch": lambda n: in_torch(gait(n)),
}


def tried(analysis, name):
    """What a pair reports: why it does not work, or its numbers and its work."""
    try:
        gait(name)
        with work() as counts:
            result = ANALYSES[analysis](name)
    except (ValueError, gpw.GaitNotFound) as error:
        return str(error), {}
    assert result is not None
    if analysis == "robustness":  # the initial gaits of an environment are kept
        counts = {}
    return "", counts | ({} if analysis == "pictures" else dict(numbers_in(result)))


REASONS = {
    "does not double its period": "works",  # there is no doubling in this range, and it says so
    "a stride of torch has held motors": "by `rollout`",
}


def cell(analysis, name):
    said, _ = reported(analysis, name)
    if not said:
        return "yes"
    known = [mark for words, mark in REASONS.items() if words in said]
    assert known, f"{analysis} of {name}: {said}"
    return "yes" if known[0] == "works" else known[0]


@cache
def reported(analysis, name):
    return tried(analysis, name)


@pytest.mark.parametrize("name", WALKS)
@pytest.mark.parametrize("analysis", [a for a in ANALYSES if a != "torch"])
def test_every_analysis_takes_everything_that_walks_and_finds_what_it_did(analysis, name):
    """A change of a result, or of the work for it, is meant and stands in the changelog."""
    assert cell(analysis, name) == "yes"
    kept = json.loads(KEPT.read_text("utf-8"))[f"{analysis}, {name}"]
    _, found = reported(analysis, name)
    compare(kept, found)


def table(cell=cell) -> str:
    """The pairs as a table in Markdown."""
    head = ["", *WALKS]
    rows = [[analysis, *(cell(analysis, name) for name in WALKS)] for analysis in ANALYSES]
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


@pytest.mark.slow
def test_the_table_of_the_documentation_is_what_the_pairs_say():
    """Pairs of other analyses than torch work, by the test above."""
    text = PAGE.read_text(encoding="utf-8")
    written = text.split(BEGIN)[1].split(END)[0].strip()
    assert written == table(lambda a, name: cell(a, name) if a == "torch" else "yes")


if __name__ == "__main__":
    text = PAGE.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    PAGE.write_text(f"{before}{BEGIN}\n{table()}\n{END}{rest.split(END)[1]}", encoding="utf-8")
    pairs = {f"{a}, {n}": reported(a, n)[1] for a in ANALYSES for n in WALKS if a != "torch"}
    KEPT.write_text(json.dumps(pairs, indent=0, ensure_ascii=False) + "\n", "utf-8")
