"""Results of a benchmark: raw scores as CSV, tables in Markdown, and pictures."""

from __future__ import annotations

import csv
import math
import subprocess
from collections import Counter
from collections.abc import Sequence
from datetime import date
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import bootstrap, mannwhitneyu, trim_mean

from agents.benchmark import AGENTS, LASTING, SCORES, Unit, least_cost
from agents.config import ALGORITHMS
from agents.evaluation import write_rows
from agents.files import reading
from gym_passive_walker import GaitFamily, gait_family
from gym_passive_walker._tools.files import prepare, replacing
from gym_passive_walker.envs.evaluation.walks import TIME_LIMIT
from gym_passive_walker.gaits.control import optimal
from gym_passive_walker.gaits.scenes.scene import SCENES
from gym_passive_walker.pictures.axes import BLACK, GREY, SPEED, legend, panels, save, series

BEGIN, END = "<!-- benchmark -->", "<!-- end of benchmark -->"
"""The lines of a document that enclose the tables."""

ROWS = (
    ("distance", "distance / l", ".1f"),
    ("reward", "return of a walk", ".1f"),
    ("speed", "speed / √(gl)", ".3f"),
    ("cost_of_transport", "cost of transport, absolute work", ".4f"),
    ("positive_hip_cost", "  of which positive hip work", ".4f"),
    ("net_hip_cost", "  net hip work", ".4f"),
    ("gravity_cost", "  gravity's share", ".4f"),
    ("above_optimum", "cost above the optimum at that speed", ".0%"),
    ("strides", "strides", ".0f"),
    ("hundred_strides", "walks of 100 strides", ".0%"),
    ("reached_time_limit", "walks to the time limit", ".0%"),
    ("perturbation_forward", "largest forward perturbation survived", ".0%"),
    ("perturbation_backward", "largest backward perturbation survived", ".0%"),
    ("rough_strides", "strides to a fall on rough ground", ".0f"),
    ("steps_to_hundred", "steps until half the walks reach 100 strides", ",.0f"),
    ("seconds_to_hundred", "  seconds of training", ".1f"),
    ("learning_steps", "steps of training in all", ",.0f"),
)
_RANKED = ("reward", "above_optimum")
_CURVE = ("steps", "reward", "speed", "cost_of_transport")  # columns of a learning curve
_COSTS = ("cost_of_transport", "positive_hip_cost", "net_hip_cost", "gravity_cost")
_FEWEST = 3  # smallest number of seeds for an interval or a rank test
_RESAMPLES = 2000

Score = dict[str, Any]


def middle(values: NDArray, axis: int = -1) -> NDArray | float:
    """Interquartile mean: the mean of the middle half of the values."""
    return trim_mean(values, 0.25, axis=axis)


def interval(values: NDArray) -> tuple[float, float]:
    """95 % bootstrap interval of the interquartile mean; NaN for fewer than three values."""
    if len(values) < _FEWEST:
        return math.nan, math.nan
    if np.ptp(values) == 0.0:
        return float(values[0]), float(values[0])
    found = bootstrap(
        (values,), middle, n_resamples=_RESAMPLES, method="percentile",
        rng=np.random.default_rng(0),
    )  # fmt: skip
    return float(found.confidence_interval.low), float(found.confidence_interval.high)


def cell(values: Sequence[float], form: str) -> str:
    """A table cell: interquartile mean over seeds, with its interval if there are enough."""
    known = np.array([value for value in values if value is not None and math.isfinite(value)])
    if not len(known):
        return "–"
    form = f"z{form}"  # no sign before a rounded zero
    text = f"{middle(known):{form}}"
    low, high = interval(known)
    return text if math.isnan(low) else f"{text} [{low:{form}}, {high:{form}}]"


def shown(score: Score, name: str) -> float:
    """A value of a score; NaN for a cost if most walks end in a fall."""
    falling = name in _COSTS and score["reached_time_limit"] < LASTING
    return math.nan if falling else score.get(name, math.nan)


def by_agent(scores: Sequence[Score]) -> dict[str, list[Score]]:
    """Scores grouped by agent, in the order of `AGENTS`; agents without scores are left out."""
    found = {agent: [score for score in scores if score["agent"] == agent] for agent in AGENTS}
    return {agent: own for agent, own in found.items() if own}


def walking_on_level_ground(scores: Sequence[Score]) -> dict[str, list[Score]]:
    """Scores on level ground, by agent, for which costs are shown."""
    level = [score for score in scores if score["scene"] == "level"]
    return by_agent([score for score in level if score["reached_time_limit"] >= LASTING])


def tables(scores: Sequence[Score]) -> str:
    """Markdown tables: one for each scene, rank tests, and costs on level ground."""
    pieces = []
    for scene in (name for name in SCENES if any(s["scene"] == name for s in scores)):
        columns = by_agent([score for score in scores if score["scene"] == scene])
        heads = [
            f"{agent} ({len(own)} seed{'s' * (len(own) > 1)})" if agent in ALGORITHMS else agent
            for agent, own in columns.items()
        ]
        lines = ["| " + " | ".join([f"`{scene}`", *heads]) + " |", "|---" * (len(heads) + 1) + "|"]
        for name, label, form in ROWS:
            cells = [cell([shown(s, name) for s in own], form) for own in columns.values()]
            if any(text != "–" for text in cells):
                lines.append("| " + " | ".join([label, *cells]) + " |")
        if all("endings" in score for own in columns.values() for score in own):
            lines.append("| " + " | ".join(["falls", *map(falls, columns.values())]) + " |")
        pieces.append("\n".join(lines))
    return "\n\n".join(filter(None, [*pieces, rank_tests(scores), equal_speeds(scores)]))


def rank_tests(scores: Sequence[Score]) -> str:
    """A Markdown table of two-sided Mann-Whitney tests between trained agents; empty without any.

    Each sample is the agent's seeds in a scene.
    """
    lines = []
    for scene in SCENES:
        columns = by_agent([s for s in scores if s["scene"] == scene and s["agent"] in ALGORITHMS])
        for pair in combinations(columns, 2):
            tested = [_rank_test([columns[agent] for agent in pair], name) for name in _RANKED]
            if any(text != "–" for text in tested):
                lines.append(f"| `{scene}` | {' and '.join(pair)} | {' | '.join(tested)} |")
    head = ["| rank tests, p | agents | return | cost above the optimum |", "|---|---|---|---|"]
    return "\n".join([*head, *lines] if lines else [])


def _rank_test(pair: Sequence[Sequence[Score]], name: str) -> str:
    """The p-value of a Mann-Whitney test, to two digits; a dash if a sample is too small."""
    first, second = ([s[name] for s in own if math.isfinite(s[name])] for own in pair)
    if min(len(first), len(second)) < _FEWEST:
        return "–"
    return f"{mannwhitneyu(first, second).pvalue:.2g}"


def falls(scores: Sequence[Score]) -> str:
    """Shares of walks that ended before the time limit, by termination reason."""
    total = sum((Counter(score["endings"]) for score in scores), Counter())
    shares = [
        f"{cause} {count / total.total():.0%}"
        for cause, count in total.most_common()
        if cause != TIME_LIMIT
    ]
    return ", ".join(shares) or "none"


def equal_speeds(scores: Sequence[Score]) -> str:
    """A Markdown table of agents on level ground, with the optimum and the passive walker.

    It is empty if none walks there. All three costs of transport in a row are for one speed, that
    of the agent.
    """
    walking = walking_on_level_ground(scores)
    if not walking:
        return ""
    family = _passive()
    lines = [
        "| `level` | speed / √(gl) | cost of transport | optimum there | passive there, downhill |",
        "|---|---|---|---|---|",
    ]
    for agent, walked in walking.items():
        speed = float(middle(np.array([s["speed"] for s in walked])))
        cost = float(middle(np.array([s["cost_of_transport"] for s in walked])))
        best = least_cost("level", speed)
        lines.append(
            f"| {agent} | {speed:.3f} | {cost:.4f} | {best:.4f} | {_cost_at(family, speed):.4f} |"
        )
    return "\n".join(lines)


def _passive() -> GaitFamily:
    return gait_family("C", 5e-4, 0.05)


def _cost_at(family: GaitFamily, speed: float) -> float:
    """Passive walker's cost of transport at a speed: the sine of the slope."""
    order = np.argsort(family.froude_speed)
    speeds, slopes = family.froude_speed[order], family.slope[order]
    return math.sin(float(np.interp(speed, speeds, slopes, left=math.nan, right=math.nan)))


def write_csv(path: Path, scores: Sequence[Score]) -> None:
    """Write the raw scores as CSV, one row for each unit."""
    names = ("scene", "agent", "seed", *SCORES)
    order = sorted(scores, key=lambda s: (s["scene"], AGENTS.index(s["agent"]), s["seed"]))
    rows = [{name: score.get(name, "") for name in names} for score in order]
    with replacing(path) as aside:
        write_rows(
            aside,
            [{k: f"{v:.6g}" if isinstance(v, float) else v for k, v in r.items()} for r in rows],
        )


def read_csv(path: Path) -> list[Score]:
    """The scores in a file of `write_csv`, which has no termination reasons.

    Raises:
        ConfigError: if the file is missing, or is not such a file.
    """
    with reading(path), path.open(encoding="utf-8") as file:
        return [
            {"scene": row["scene"], "agent": row["agent"], "seed": int(row["seed"])}
            | {name: float(row[name] or "nan") for name in SCORES}
            for row in csv.DictReader(file)
        ]


def around_tables(path: Path) -> tuple[str, str]:
    """Text of a document before and after the tables between `BEGIN` and `END`.

    Raises:
        ValueError: if the document has no such lines.
        OSError: if the document cannot be read or written.
    """
    document = prepare(path).read_text(encoding="utf-8")
    if BEGIN not in document or END not in document:
        raise ValueError(f"{path} has no lines {BEGIN} and {END} to write between")
    head, rest = document.split(BEGIN, 1)
    return head, rest.split(END, 1)[1]


def provenance(command: str) -> str:
    """A line with the command, the date and the commit of a result."""
    words = ["git", "rev-parse", "--short=7", "HEAD"]
    done = subprocess.run(words, cwd=Path(__file__).parent, capture_output=True, text=True)
    return f"*`{command}`, {date.today()}, commit `{done.stdout.strip()}`*"


def write_document(path: Path, text: str) -> None:
    """Replace the text between a document's lines `BEGIN` and `END`.

    Raises:
        ValueError: if the document has no such lines.
        OSError: if the document cannot be read or written.
    """
    head, tail = around_tables(path)
    with replacing(path) as aside:
        aside.write_text(f"{head}{BEGIN}\n{text}\n{END}{tail}", encoding="utf-8")


def draw(path: Path, scores: Sequence[Score]) -> None:
    """Draw cost of transport over speed: passive and optimal gaits, and agents on level ground."""
    family, gaits = _passive(), optimal.load("level")
    figure, (ax,) = panels(size=(7.0, 5.4))
    ax.plot(family.froude_speed, np.sin(family.slope), "--", color=GREY, label="passive, slope")
    speeds = [g.froude_speed for g in gaits]
    costs = [g.cost_of_transport for g in gaits]
    ax.plot(speeds, costs, color=BLACK, label="optimal gaits, level ground")
    for index, (agent, walked) in enumerate(walking_on_level_ground(scores).items()):
        speeds = [s["speed"] for s in walked]
        costs = [s["cost_of_transport"] for s in walked]
        style = {**series(index), "linestyle": "", "markersize": 5.0, "alpha": 0.7}
        ax.plot(speeds, costs, label=f"{agent}, level ground", **style)
    ax.set(xlabel=SPEED, ylabel="cost of transport (absolute work)", yscale="log")
    ax.set(xlim=(0.04, 0.2), ylim=(3e-4, 0.1))
    legend(ax)
    save(figure, path)


def draw_learning(path: Path, runs: Path, scores: Sequence[Score]) -> None:
    """Draw learning curves on level ground: a line for each run, a marker for its final policy.

    Args:
        path: The picture's file.
        runs: Folder of the benchmark's runs; for a missing run only the marker is drawn.
        scores: Scores of the benchmark.
    """
    from matplotlib.ticker import PercentFormatter

    figure, axes = panels(1, 2, (9.0, 3.6), sharex=True)
    for index, (agent, walked) in enumerate(walking_on_level_ground(scores).items()):
        if agent not in ALGORITHMS:
            continue
        style, drawn = series(index), False
        for score in walked:
            curve = runs / str(Unit("level", agent, score["seed"])) / "learning_curve.csv"
            if curve.is_file():
                drawn = True
                with reading(curve):
                    lines = curve.read_text(encoding="utf-8").splitlines()
                    lines = list(csv.DictReader(lines))[1:]  # skip the untrained
                    rows = np.array([[float(row[name]) for name in _CURVE] for row in lines])
                above = [cost / least_cost("level", v) - 1.0 for v, cost in rows[:, 2:]]
                for ax, values in zip(axes, (rows[:, 1], above), strict=True):
                    ax.plot(rows[:, 0], values, color=style["color"], linewidth=0.7, alpha=0.7)
        ends = {**style, "linestyle": "", "markersize": 5.0, "alpha": 0.7}
        shown = {**style, "linestyle": "-" if drawn else "", "linewidth": 0.7, "markersize": 5.0}
        axes[0].plot([], [], **shown, label=agent)
        steps = [score["learning_steps"] for score in walked]
        for ax, name in zip(axes, ("reward", "above_optimum"), strict=True):
            ax.plot(steps, [score[name] for score in walked], **ends)
    axes[0].set(xscale="log", xlabel="steps of training", ylabel="return of a walk", ylim=(0, 55))
    axes[1].set(xlabel="steps of training", ylabel="cost above the optimum")
    axes[1].set(ylim=(-0.05, 1.0))
    axes[1].yaxis.set_major_formatter(PercentFormatter(1.0))
    legend(axes[0], columns=4)
    save(figure, path)
