"""Links of the documentation resolve, and each page is near the first one."""

import ast
import re
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import SimpleNamespace

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
BUILT = {DOCS / "reference.md"}
"""Pages that `make docs` writes: the site has them, and the repository does not."""

PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
    ROOT / "benchmarks" / "README.md",
    *sorted({*DOCS.glob("*.md")} - BUILT),
    *sorted((DOCS / "notebooks").glob("*.md")),
]
LONGEST = 3000
"""Words of a page, tables that commands write left out."""
WRITTEN = {DOCS / "environment.md", DOCS / "validation.md"}
"""Pages with a docstring, or of a program's tables."""


def plain(page):
    """A page's text without its code."""
    return re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.S | re.M)


def anchors(page):
    """Anchors of a page's headings, as the repository's site and Sphinx make them."""
    for heading in re.findall(r"^#+ (.+)$", plain(page), re.M):
        yield re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


def targets(page):
    """Paths and anchors of the links to the repository's own files."""
    for link in re.findall(r"\]\(([^)\s]+)\)", plain(page)):
        if not re.match(r"https?:", link):
            name, _, anchor = link.partition("#")
            yield link, (page.parent / name).resolve() if name else page, anchor


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_each_link_leads_to_a_file_and_to_a_heading(page):
    for link, target, anchor in targets(page):
        assert target.exists() and target not in BUILT, link
        assert not anchor or anchor in anchors(target), link
        if DOCS in page.parents and target.suffix == ".md":
            assert DOCS in target.parents, f"{link}: Sphinx takes it for a page of the site"


def redirects():
    """Targets of the site by former addresses; importing docs/conf.py would build pages."""
    for node in ast.parse((DOCS / "conf.py").read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "REDIRECTS":
            return ast.literal_eval(node.value)
    return {}


@pytest.mark.parametrize(("former", "target"), redirects().items())
def test_a_former_address_leads_to_a_page_and_to_a_heading(former, target):
    name, _, anchor = target.partition("#")
    page = (DOCS / former).parent / name
    assert not (DOCS / former).with_suffix(".md").exists()
    assert page.suffix == ".html" and page.with_suffix(".md") in {*PAGES, *BUILT}
    assert not anchor or anchor in anchors(page.with_suffix(".md"))


def test_each_page_is_two_links_from_the_first_at_most():
    near = {DOCS / "index.md"}
    for _ in range(2):
        near |= {target for page in near if page.suffix == ".md" for _, target, _ in targets(page)}
    assert [page for page in PAGES if DOCS in page.parents and page not in near] == []


def test_each_page_is_in_one_table_of_contents():
    listed = ["index"]
    for page in PAGES:
        for tree in re.findall(r"^```{toctree}\n(.*?)^```", page.read_text("utf-8"), re.S | re.M):
            for name in tree.split("\n\n")[-1].split():
                found = {*DOCS.glob(f"{name}.md")} | BUILT & {DOCS / f"{name}.md"}
                listed += [page.relative_to(DOCS).with_suffix("").as_posix() for page in found]
    pages = [
        page.relative_to(DOCS).with_suffix("") for page in [*PAGES, *BUILT] if DOCS in page.parents
    ]
    assert sorted(listed) == sorted(page.as_posix() for page in pages)


def test_no_page_is_longer_than_a_reader_wants():
    for page in {*DOCS.glob("*.md")} - BUILT - WRITTEN:
        text = page.read_text(encoding="utf-8")
        text = re.sub(r"<!-- (.+?) -->\n.*?<!-- end of \1 -->", "", text, flags=re.S)
        assert len(text.split()) <= LONGEST, page.name


def test_the_readme_is_one_page():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 700


def test_a_package_index_shows_the_readme_without_links_that_it_cannot_resolve(monkeypatch):
    hook = SimpleNamespace(MetadataHookInterface=object, BuildHookInterface=object)
    builder = SimpleNamespace(build_wheel=None, __all__=["build_wheel"])
    for name, module in {  # of the build's own environment
        "hatchling": SimpleNamespace(build=builder),
        "hatchling.build": builder,
        "hatchling.metadata.plugin.interface": hook,
        "hatchling.builders.hooks.plugin.interface": hook,
    }.items():
        monkeypatch.setitem(sys.modules, name, module)
    spec = spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    hook, metadata = module.Description(), {}
    hook.root = str(ROOT)
    hook.update(metadata)
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    shown = metadata["readme"]["text"]
    links = re.findall(r"\]\(([^)]+)\)", shown)
    assert links and all(link.startswith("https:") for link in links)
    assert "walk.gif" in text and "walk.gif" not in shown
    outside = re.sub(r"\]\([^)]+\)", "", text)
    assert len(shown.split()) > 0.95 * len(outside.split())  # all else stays
