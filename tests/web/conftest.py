"""The JavaScript package, built once, and Node.js to run it."""

import json
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import gym_passive_walker as gpw
from examples.five_links import FIVE_LINKS
from examples.torso import TORSO
from gym_passive_walker.devices.web.build import build
from tests.own.statements import DRIVEN, PROGRESSIVE
from tests.web.browser import BROWSERS, Browser


@pytest.hookimpl(tryfirst=True)  # before pytest leaves marked tests out
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of the compiled package, which takes a minute to compile."""
    for item in items:
        if "package" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="session")
def node() -> str:
    """Node.js."""
    found = shutil.which("node")
    if found is None:
        pytest.skip("Node.js is not installed, which runs walkers as a web page does")
    return found


@pytest.fixture(scope="session")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the JavaScript package."""
    five = gpw.find_gait(FIVE_LINKS, 0.05)
    systems = {"torso": TORSO, "driven": DRIVEN, "five": five, "progressive": PROGRESSIVE}
    return build(tmp_path_factory.mktemp("package"), systems)


@pytest.fixture(scope="session")
def run(node: str, package: Path) -> Callable[..., list[Any]]:
    """Run jobs of `walks.mjs` in Node; return their results."""

    def jobs(*given: dict[str, Any]) -> list[Any]:
        command = [node, str(Path(__file__).parent / "walks.mjs"), str(package)]
        done = subprocess.run(
            command, input=json.dumps(given), text=True, capture_output=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return jobs


@pytest.fixture(scope="session", params=BROWSERS)
def browser(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Browser]:
    """Each browser, without a window."""
    kind = BROWSERS[request.param]
    programs = kind.programs()
    if programs is None:
        needed = " and ".join(names[0] for names in kind.NEEDS)
        pytest.skip(f"{needed} is not installed, by which the page is tried")
    made = kind(programs, tmp_path_factory.mktemp(request.param))
    yield made
    made.close()
