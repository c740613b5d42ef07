"""With FAIL_ON_SKIP=1, a test that lacks a library fails instead of being skipped."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

INSIDE = "import pytest\n\ndef test_one():\n    pytest.importorskip({name!r})\n"
MODULE = "import pytest\npytest.importorskip({name!r})\n\ndef test_one():\n    pass\n"
STATED = "import pytest\n\ndef test_one():\n    pytest.skip('there is no device')\n"


def outcome(text, tmp_path, **environment):
    """Exit status and output of pytest for a test file."""
    (tmp_path / "conftest.py").write_text((Path(__file__).parent / "conftest.py").read_text())
    (tmp_path / "test_it.py").write_text(text)
    usual = {name: x for name, x in os.environ.items() if name != "FAIL_ON_SKIP"}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-c", os.devnull]
    done = subprocess.run(
        [*command, "--rootdir", str(tmp_path), str(tmp_path)],
        env=usual | environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.returncode, done.stdout


@pytest.mark.parametrize("text", [INSIDE, MODULE], ids=["test", "module"])
def test_a_missing_library_fails_where_none_may_be_missing(text, tmp_path):
    for library in ("torch", "stable_baselines3"):
        pytest.importorskip(library)
    absent, ray = text.format(name="no_such_library"), text.format(name="ray.no_such_part")
    status, said = outcome(absent, tmp_path, FAIL_ON_SKIP="1")
    assert status != 0 and "no_such_library is not installed" in said
    for given, environment in ((absent, {}), (ray, {"FAIL_ON_SKIP": "1"}),
                               (STATED, {"FAIL_ON_SKIP": "1"})):  # fmt: skip
        status, said = outcome(given, tmp_path, **environment)
        assert status in (0, 5) and "1 skipped" in said
