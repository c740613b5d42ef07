"""What the documentation says can be done, can be done."""

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parent.parent


PAGES = sorted(
    str(page.relative_to(DOCS))
    for page in [DOCS / "README.md", *(DOCS / "docs").glob("*.md")]
    if "```python" in page.read_text() and page.name != "extending.md"  # has a test of its own
)


@pytest.mark.parametrize("page", PAGES)
def test_the_code_on_a_page_runs_from_top_to_bottom(page, monkeypatch, capsys):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    blocks = re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(), re.S)
    for name in set(re.findall(r'path="([^"]+)"', "".join(blocks))):
        pytest.fail(f"{page} writes {name}: the pages' code must leave nothing behind")
    if "gpw.sweep(" in "".join(blocks):
        pytest.importorskip("pyarrow")
    for learner in ("torch", "stable_baselines3"):  # a large extra; pages without it run anywhere
        if re.search(rf"(import|from) {learner}\b", "".join(blocks)):
            pytest.importorskip(learner)
    exec(compile("\n".join(blocks), page, "exec"), {})
