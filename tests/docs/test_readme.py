"""Each number of the README is that of the package, or of a table that a command writes."""

import inspect
import math
import re
import tomllib
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import yaml

import gym_passive_walker as gpw
from agents.config import DEFAULT_ALGORITHM
from gym_passive_walker.gaits.scenes.scene import SCENES, make_scene
from tests.docs.test_tables import MADE

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def page(name):
    return (ROOT / name).read_text(encoding="utf-8")


def power(value):
    """A power of ten as it is printed."""
    exponent = str(math.floor(math.log10(value)))
    return f"10{exponent.translate(str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'))}"


def cells(table, *first):
    """Rows of a table that begin with some cells; of the first one, its beginning is enough."""
    rows = [line.strip("| ").split(" | ") for line in table.splitlines() if line.startswith("|")]
    return [r for r in rows if r[0].startswith(first[0]) and r[1 : len(first)] == [*first[1:]]]


def environment():
    scene, spec = make_scene("level"), gym.spec("PassiveWalker-v0")
    env = gym.make("PassiveWalker-v0")
    assert env.observation_space.shape == (8,) and env.action_space == gym.spaces.Box(-1, 1, (1,))
    assert len(gpw.find_gait(scene.walker, 0.03).state) == 6
    yield f"({power(scene.tolerance)} in\nenvironments, "
    yield f"{power(inspect.signature(gpw.stride_map).parameters['tolerance'].default)} in gaits"
    yield f"hip torque / {scene.max_hip_torque} m g l, held for {scene.tick} √(l/g)"
    yield "3 angles (rad), 3 angular velocities, knee locked (0, 1), slope (rad)"
    yield f"distance / l − {scene.energy_weight:g} × absolute hip work"
    yield f"truncated after {spec.max_episode_steps:,} steps"


def scenes():
    def walker(name):
        return next(key for key, one in gpw.WALKERS.items() if one == make_scene(name).walker)

    low, high = SCENES["rolling"]["slope"]
    slow, fast = SCENES["commanded"]["command"]
    rough, push = SCENES["rough"], SCENES["pushed"]["pushes"]["impulse"]
    assert walker("lab") == "lab" and -push[0] == push[1]
    assert not any(make_scene(x).slope for x in ("level", "pushed", "push-off", "commanded"))
    yield f"| `level` (default) | {walker('level')}; 0 |"
    yield f"| `steep` | {walker('steep')}; {SCENES['steep']['slope']}; one action a stride |"
    yield f"| `rolling` | {walker('rolling')}; {low:g} to {high} |"
    yield f"| `lab` | the laboratory's; {SCENES['lab']['slope']} |"
    yield f"| `rough` | {walker('rough')}; {rough['slope']}; foothold heights with σ = "
    yield f"{rough['terrain']['rough']['height_std']} l |"
    yield f"| `pushed` | {walker('pushed')}; 0; pushes up to {push[1]} m √(g l) |"
    yield f"| `push-off` | {walker('push-off')}; 0; one push-off impulse a stride |"
    yield f"| `commanded` | {walker('commanded')}; 0; speed {slow} to {fast} √(g l) |"
    low, high = SCENES["anywhere"]["slope"]
    yield f"| `anywhere` | bodies near {walker('anywhere')}; {low:g} to {high}; commanded speed |"


def results():
    from agents.results import by_agent, middle, read_csv  # loads torch

    speed = MADE["benchmarks/ticks"]

    def steps(name, count="1,024"):
        (row,) = cells(speed, f"{name}, 1 core", count)
        return f"{float(row[3]):,.0f}"

    yield (
        f"one core, 1,024 environments | {steps('PassiveWalker-v0, native batch')} | "
        f"EnvPool: BipedalWalker-v3 {steps('EnvPool BipedalWalker-v3')}, "
        f"Walker2d-v4 {steps('EnvPool Walker2d-v4')} |"
    )
    level = [s for s in read_csv(ROOT / "docs" / "agents-scores.csv") if s["scene"] == "level"]
    above = {
        agent: 100.0 * middle(np.array([score["above_optimum"] for score in own]))
        for agent, own in by_agent(level).items()
        if len(own) == 10
    }
    yield "of 10 seeds"
    yield f"SHAC {above['shac']:.1f} %, PPO of `train.py` {above[DEFAULT_ALGORITHM]:.1f} %"
    yield f"Stable-Baselines3, tuned: PPO {above['ppo']:.1f} %, SAC {above['sac']:.0f} %"
    lab = MADE["benchmarks/work-precision"].split("walker lab")[1]
    error = next(row for row in cells(lab, "method")).index("µs at error 1e-08")

    def took(name):
        return f"{min(float(row[error]) for row in cells(lab, name)):,.4g}"

    yield "time of a `lab` stride with error 10⁻⁸"
    yield f"{took('this engine, 2048')} µs in a batch of 2,048, "
    yield f"{took('this engine, alone')} µs alone"
    yield f"diffrax {took('diffrax')}, heyoka {took('heyoka, 8')} µs in a batch"
    yield f"heyoka {took('heyoka, alone')}, SciPy {took('SciPy')} µs alone"
    gpu = max(float(row[3]) for row in cells(MADE["gpu/gpu strides"], "GPU"))
    yield f"({power(gpu)} strides/s)"
    counts = re.search(r"(\d+) statements; (\d+) agree", page("docs/validation.md"))
    yield f"Of {counts[1]} known numbers, [{counts[2]} are reproduced]"
    for table in (speed, lab, MADE["benchmarks/work-precision"]):
        assert re.search(r"2026-11-\d\d, AMD EPYC", table)
    yield "AMD EPYC, November 2026"


def programs():
    project = tomllib.loads(page("pyproject.toml"))["project"]
    yield f"Python {project['requires-python'].removeprefix('>=')} or later"
    preset = yaml.safe_load(page(f"agents/presets/{DEFAULT_ALGORITHM}.yml"))["level"]
    took = re.search(r"(\d+ s) in all with (AVX-512)", page("docs/agents.md"))
    yield f"with {took[2]} training takes {took[1]} ({preset['n_timesteps']:,} steps)"
    minutes = re.search(r"fast tests take (\d+ minutes)", page("CONTRIBUTING.md"))
    yield f"tests take {minutes[1]}"


COUNT = re.search(r"The ([\d,]+)\s", README)[1]
"""Number of tests, which is compared with what pytest collects."""


def test_each_number_of_the_readme_has_a_source():
    pytest.importorskip("torch")
    left = re.sub(r"```.*?```", "", README, flags=re.S)  # a test runs its code
    for claims in (environment, scenes, results, programs):
        for claim in claims():
            assert claim in left, claim
            left = left.replace(claim, "")
    left = re.sub(r"`[^`]*`|\]\([^)]*\)|!\[[^]]*\]", "", left.replace(COUNT, ""))
    assert re.findall(r".*[\d⁰¹²³⁴-⁹].*", left) == []


def test_the_readme_says_how_many_tests_there_are(request):
    for library in ("torch", "stable_baselines3"):  # without these, folders are not collected
        pytest.importorskip(library)
    config, option = request.config, request.config.option
    every = [Path(word).resolve() for word in config.args] == [ROOT / "tests"]
    if not every or option.keyword or option.markexpr != config.getini("addopts")[-1]:
        pytest.skip("some tests were chosen")
    assert f"{round(request.session.testscollected, -3):,}" == COUNT
