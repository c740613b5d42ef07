"""The version in a row changes with the numerical code, and with nothing else."""

import shutil
from pathlib import Path

import pytest

import gym_passive_walker as gpw
from gym_passive_walker.apps.sweeps import version as module
from gym_passive_walker.apps.sweeps.description import Description
from gym_passive_walker.apps.sweeps.version import version
from gym_passive_walker.envs.policies import TENSORS, policy_folder


@pytest.fixture(scope="module")
def copied(tmp_path_factory):
    """A copy of the package."""
    copy = tmp_path_factory.mktemp("package") / "copy"
    only = shutil.ignore_patterns("__pycache__")
    return shutil.copytree(Path(gpw.__file__).parent, copy, ignore=only)


@pytest.mark.parametrize(
    ("part", "counts"),
    [
        ("gaits/find/search.py", True),
        ("engine/lanes.py", True),
        ("models/equations/kneed.py", True),
        ("gaits/control/optimal.py", True),
        ("envs/task.py", True),
        ("envs/evaluation/robustness.py", True),
        ("engine/own/system.py", True),
        ("apps/sweeps/tasks.py", True),
        ("gaits/control/gaits/level.json", True),
        ("envs/policies/level-ppo/policy.safetensors", True),
        ("pictures/axes.py", False),
        ("envs/evaluation/pictures.py", False),
        ("apps/sweeps/pictures.py", False),
    ],
)
def test_another_equation_search_or_policy_is_another_version_and_another_picture_is_not(
    part, counts, copied, monkeypatch
):
    monkeypatch.setattr(module, "__file__", str(copied / "apps" / "sweeps" / "version.py"))
    before, content = version("gait"), (copied / part).read_bytes()
    (copied / part).write_bytes(content + b"# another\n")
    assert (version("gait") != before) == counts
    (copied / part).write_bytes(content)


def test_a_function_of_ones_own_counts_with_its_module(odd):
    before = version("odd_tasks:square")
    assert before != version("gait")
    with (odd / "odd_tasks.py").open("a") as file:
        file.write("# another\n")
    assert version("odd_tasks:square") != before


@pytest.mark.parametrize("form", ["argument", "of a scene"])
def test_the_file_of_a_walker_is_kept_by_its_content(form, tmp_path):
    def digest(mass):
        file = tmp_path / "mine.json"
        file.write_text(f'{{"preset": "lab", "hip_mass": {mass}}}', "utf-8")
        walker = {"walker": str(file)}
        given = walker if form == "argument" else {"scene": walker}
        return Description(analysis="evaluation", over={"seed": [1]}, given=given).digest

    assert digest(1.0) == digest(1.0) != digest(2.0)


def test_a_policy_of_ones_own_counts_with_its_files(tmp_path):
    shutil.copytree(policy_folder("level-ppo"), mine := tmp_path / "mine")
    described = Description(analysis="evaluation", over={"controller": ["passive", str(mine)]})
    before = version("evaluation", described.policies)
    assert before == version("evaluation", described.policies)
    (mine / TENSORS).write_bytes((policy_folder("steep-ppo") / TENSORS).read_bytes())
    assert version("evaluation", described.policies) != before
