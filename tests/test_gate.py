"""With FAIL_ON_SKIP=1, a test that lacks a library fails instead of being skipped."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

INSIDE = "import pytest\n\ndef test_one():\n    pytest.importorskip({!r})\n"
MODULE = "import pytest\npytest.importorskip({!r})\n\ndef test_one():\n    pass\n"
FILES = {
    "test_inside.py": INSIDE.format("no_such_library"),
    "test_module.py": MODULE.format("no_such_library"),
    "test_ray_inside.py": INSIDE.format("ray.no_such_part"),
    "test_ray_module.py": MODULE.format("ray.no_such_part"),
    "test_stated.py": "import pytest\n\ndef test_one():\n    pytest.skip('there is no device')\n",
}
LACKING = {"test_inside.py", "test_module.py"}


def outcome(folder, **environment):
    """Run pytest for the files; return its exit status, which were skipped, and its output."""
    (folder / "conftest.py").write_text((Path(__file__).parent / "conftest.py").read_text())
    for name, text in FILES.items():
        (folder / name).write_text(text)
    usual = {name: x for name, x in os.environ.items() if name != "FAIL_ON_SKIP"}
    words = "-q -rs -p no:cacheprovider --continue-on-collection-errors -c".split()
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *words, os.devnull, "--rootdir", folder, folder],
        env=usual | environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return (
        done.returncode,
        set(re.findall(r"^SKIPPED.*/(\w+\.py):", done.stdout, re.M)),
        done.stdout,
    )


def test_a_missing_library_fails_where_none_may_be_missing(tmp_path):
    for library in ("torch", "stable_baselines3"):
        pytest.importorskip(library)
    status, skipped, _ = outcome(tmp_path)
    assert status == 0 and skipped == FILES.keys()
    status, skipped, said = outcome(tmp_path, FAIL_ON_SKIP="1")
    assert status != 0 and skipped == FILES.keys() - LACKING
    assert said.count("no_such_library is not installed") == len(LACKING)
