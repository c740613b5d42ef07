"""The change in docs/extending.md, applied to a copy of the package."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CHANGE = re.search(r"```diff\n(.*?)```", (ROOT / "docs/extending.md").read_text("utf-8"), re.DOTALL)

BOOKS = """
import sys
from dataclasses import replace
import gym_passive_walker as gpw
from gym_passive_walker.models.equations.hybrid import State

def missing(walker, slope, state):
    units, system = walker.units, walker.equations()
    def energy(at):
        moving = State(*units.to_dimensionless(at))
        return system.kinetic_energy(walker.body, moving) * units.energy
    stride = gpw.stride(walker, slope, state, tolerance=1e-12)
    assert stride.outcome == gpw.Outcome.HEELSTRIKE
    gained = energy(stride.state) - energy(state)
    given, lost = stride.gravity_work + stride.spring_work, stride.collision_loss
    return (given - gained - lost - stride.friction_loss) / units.energy

for name, slope in (("lab", 0.036), ("A", 0.03)):
    walker = gpw.WALKERS[name]
    units, state = walker.units, gpw.find_gait(walker, slope).state
    hardening = {"hip_hardening": 0.02 * units.energy}
    friction = {"hip_friction": 0.005 * units.energy * units.time}
    for more in ({}, hardening, hardening | friction):
        print(missing(replace(walker, **more), slope, state))
    print(gpw.stride(replace(walker, **hardening), slope, state).spring_work / units.energy)
    hard = replace(walker, hip_hardening=0.01 * units.energy)
    by = gpw.stride_jacobian(hard, slope, state, wrt="hip_hardening")[:, 0]
    step = 1e-5 * units.energy
    ends = [
        gpw.stride(replace(hard, hip_hardening=hard.hip_hardening + s), slope, state).state
        for s in (step, -step)
    ]
    kept = [0, 3, 4, 5] if walker.knees else [0, 3, 4]
    print(abs(by - (ends[0] - ends[1])[kept] / (2 * step)).max() / abs(by).max())
"""


def test_the_change_applies_to_three_files():
    assert CHANGE is not None
    assert len(re.findall(r"^diff --git", CHANGE[1], re.MULTILINE)) == 3
    command = ["git", "apply", "--check", "-"]
    subprocess.run(command, cwd=ROOT, input=CHANGE[1], text=True, check=True)


@pytest.mark.slow
def test_a_spring_that_hardens_keeps_its_energy(tmp_path):
    shutil.copytree(ROOT / "gym_passive_walker", tmp_path / "gym_passive_walker")
    (tmp_path / "change.diff").write_text(CHANGE[1], encoding="utf-8")
    subprocess.run(["git", "apply", "change.diff"], cwd=tmp_path, check=True)
    reported = subprocess.run(
        [sys.executable, "-c", BOOKS],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(tmp_path)},
        check=True, capture_output=True, text=True,
    ).stdout.split()  # fmt: skip
    for plain, hardening, both, given, slope_error in zip(*[map(float, reported)] * 5, strict=True):
        assert abs(plain) < 1e-13 and abs(hardening) < 1e-13 and abs(both) < 1e-13
        assert abs(given) > 1e-5
        assert slope_error < 1e-6


BLOCKS = re.findall(
    r"```python\n(.*?)```", (ROOT / "docs/extending.md").read_text("utf-8"), re.DOTALL
)


def test_a_torso_takes_one_file_of_at_most_eighty_lines_and_is_an_environment(tmp_path):
    assert BLOCKS[0].count("\n") <= 80
    (tmp_path / "torso.py").write_text("\n".join(BLOCKS), encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "torso.py"], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert ", stable>" in done.stdout and "period doublings 0.118" in done.stdout
