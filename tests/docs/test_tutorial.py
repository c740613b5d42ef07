"""The commands of the tutorial do what it says, one after another, as a user types them."""

import math
import os
import re
import shlex
import subprocess
import sys

import pytest

from tests.docs.test_shell import FILES, ROOT

PROGRAMS = {"python": [], "passive-walker": ["-m", "gym_passive_walker"]}
NUMBER = re.compile(r"\d+(?:\.\d+)?")


def agrees(shown, printed):
    """Whether a text has a sentence, but for what learning on another machine may change."""
    words = NUMBER.split(shown)
    found = re.search(r"(\d+(?:\.\d+)?)".join(map(re.escape, words)), printed)
    pairs = zip(NUMBER.findall(shown), found.groups() if found else (), strict=False)
    return found and all(math.isclose(*map(float, x), rel_tol=0.05, abs_tol=3.0) for x in pairs)


@pytest.mark.learning
def test_the_tutorial_s_commands_train_evaluate_and_export_its_task(tmp_path):
    for library in ("stable_baselines3", "moviepy", "onnx", "matplotlib"):
        pytest.importorskip(library)
    for name in ("task.py", "task.yaml"):
        (tmp_path / name).write_text(FILES[name])
    env = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "1000"}
    printed, checked = "", 0
    page = (ROOT / "docs" / "tutorial.md").read_text()
    for kind, body in re.findall(r"```(sh|text)\n(.*?)```", page, re.S):
        for line in body.strip().splitlines():
            if kind == "text":
                assert agrees(line, printed), f"{line!r} is not in {printed}"
                checked += 1
                continue
            program, *words = shlex.split(line)
            words[:1] = [str(ROOT / words[0])] if program == "python" else words[:1]
            command = [sys.executable, *PROGRAMS[program], *words]
            done = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True)
            printed = done.stdout
            assert done.returncode == 0, done.stderr
    assert checked == 2
    made = {"brisk", "policy", "brisk.onnx", "brisk.mp4", "gait.png"}
    assert made <= {path.name for path in tmp_path.iterdir()}
