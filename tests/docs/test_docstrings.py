"""Examples in docstrings print what they say, and each runs in a process that has done no other."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for path in (ROOT / "gym_passive_walker").rglob("*.py")
    if ">>> " in path.read_text(encoding="utf-8") and "gpu" not in path.parts  # those need a GPU
)
_ALONE = """
import doctest, importlib, sys
module = importlib.import_module(sys.argv[1])
found = doctest.DocTestFinder(exclude_empty=True).find(module)
assert any(each.examples for each in found)
sys.exit(sum(doctest.DocTestRunner().run(each).failed for each in found))
"""


@pytest.mark.slow
@pytest.mark.parametrize("module", EXAMPLES)
def test_examples_print_what_they_say(module, tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", _ALONE, module], cwd=tmp_path, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]


def test_a_controller_s_name_is_enough_in_a_fresh_process():
    program = "import gym_passive_walker as gpw; assert gpw.closed_loop_gait('level-ppo').stable"
    subprocess.run([sys.executable, "-c", program], check=True)
