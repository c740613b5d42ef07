"""The figures to explore: their data, and the page in browsers without a window."""

import importlib.util
import json
import re
import shutil
import time
from base64 import b64decode
from pathlib import Path

import numpy as np
import pytest

import gym_passive_walker as gpw
from tests.web.browser import LISTEN, WebKit, served

DOCS = Path(__file__).parents[2] / "docs"
SPEC = importlib.util.spec_from_file_location("explore", DOCS / "explore.py")
explore = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(explore)

PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Figures</title><link rel="icon" href="data:,">
<link rel="stylesheet" href="passive-walker/player.css">
<link rel="stylesheet" href="explore.css"></head><body><main>
<div data-figure="family"></div><figure class="explore-still">still</figure>
<div id="explore-player"></div>
<div data-figure="basin"></div><div data-figure="bifurcation"></div></main>
<script type="module">
  import { explore } from "./explore.js";
  globalThis.explored = await explore(document);
</script></body></html>
"""
READY = """new Promise((done) => {
  const wait = () => globalThis.explored ? done() : setTimeout(wait, 20);
  wait();
})"""


def test_points_of_the_branch_are_gaits():
    found = explore.of_family(explore.family())
    for i in range(0, len(found["slope"]), 20):
        state = gpw.WALKERS["lab"].units.to_own(np.array(found["state"][i]))
        walk = gpw.stride("lab", found["slope"][i], state)
        assert walk.state == pytest.approx(state, abs=1e-6)


def test_marks_of_the_branch_are_its_folds_and_bifurcations():
    family = explore.family()
    found = explore.of_family(family)
    for name, wanted in (
        ("fold", family.folds),
        ("period doubling", family.period_doublings),
    ):
        slopes = sorted(found["slope"][i] for each, i in found["marks"] if each == name)
        assert slopes == pytest.approx(sorted(wanted), rel=0.01)


def test_cells_of_the_basin_end_as_their_codes_say():
    found = explore.of_basin(explore.basin(40))
    codes = np.frombuffer(b64decode(found["codes"]), np.uint8).reshape(40, 40)
    assert found["gait"][4] == pytest.approx(np.cos(2.0 * found["gait"][0]) * found["gait"][3])
    assert {*np.unique(codes // 32)} == {0, 1, 2}
    kinds = {gpw.Outcome.FELL_FORWARD: 1, gpw.Outcome.FELL_BACKWARD: 2}
    for j, i in np.random.default_rng(0).integers(40, size=(30, 2)):
        angle, rate = found["angles"][i], found["rates"][j]
        swing = found["ratios"][i] * rate
        own = gpw.WALKERS["D"].units.to_own(np.array([angle, -angle, -angle, rate, swing, swing]))
        walk = gpw.simulate("D", found["slope"], own, 100)
        assert codes[j, i] // 32 == kinds.get(int(walk.outcomes[-1]), 0)


def test_the_diagram_has_the_angles_of_the_package():
    diagram = explore.bifurcation(24)
    found = explore.of_bifurcation(diagram)
    low, high = found["range"]
    coded = np.frombuffer(b64decode(found["angles"]), "<u2").reshape(-1, found["count"])
    angles = low + (high - low) * coded / explore.FINEST
    assert found["slope"] == diagram.slope[diagram.walks].tolist()
    assert angles == pytest.approx(diagram.stance_angle[diagram.walks], abs=1e-6)


def test_the_page_has_a_still_picture_for_each_figure():
    text = (DOCS / "explore.md").read_text(encoding="utf-8")
    figures = re.findall(r'data-figure="(\w+)".*?\{figure\} (\S+)\n:alt: \S+', text, re.S)
    assert figures == [(name, f"images/explore-{name}.png") for name in explore.FIGURES]
    assert all((DOCS / image).exists() for _, image in figures)


@pytest.fixture(scope="module")
def address(package, tmp_path_factory):
    folder = tmp_path_factory.mktemp("figures")
    shutil.copytree(package, folder / "passive-walker")
    shutil.copytree(DOCS / "explore", folder, dirs_exist_ok=True)
    (folder / "index.html").write_text(PAGE.replace("<head>", f"<head>{LISTEN}"))
    figures = {
        "family": explore.of_family(explore.family()),
        "basin": explore.of_basin(explore.basin(60)),
        "bifurcation": explore.of_bifurcation(explore.bifurcation(48)),
    }
    (folder / "explore.json").write_text(json.dumps(figures))
    with served(folder) as address:
        yield address


@pytest.fixture
def page(browser, address):
    """The page, opened; a message of its console is an error."""
    browser.heard()
    browser.open("about:blank")
    browser.open(address)
    time.sleep(0.1)
    browser.run(READY)
    yield browser
    assert browser.heard() == []


def _keys(page, figure, *keys):
    event = "new KeyboardEvent('keydown', {{ key: '{}' }})"
    for key in keys:
        page.run(f"explored.figures.{figure}.canvas.dispatchEvent({event.format(key)})")


def _started(page, figure):
    """Wait for the walk of a figure's cursor in the player; return its slope and start."""
    wanted = page.run(f"explored.figures.{figure}.walk(explored.figures.{figure}.item)")
    for _ in range(200):
        now = page.run("[explored.player.walk.scene.slope, explored.player.settings.walker]")
        if now == [wanted["slope"], wanted["walker"]]:
            return wanted
        time.sleep(0.02)
    raise AssertionError(f"{now} instead of {wanted['slope']}, {wanted['walker']}")


@pytest.mark.parametrize("figure", explore.FIGURES)
def test_enter_starts_the_walk_under_the_cursor(page, figure):
    page.run("explored.player.running && explored.player.toggle()")
    page.run("matchMedia = () => ({ matches: true })")  # the player stays in pause
    _keys(page, figure, "ArrowRight", "ArrowRight", "ArrowUp", "ArrowLeft", "Enter")
    wanted = _started(page, figure)
    time.sleep(0.1)
    assert page.run("explored.player.walk.state") == pytest.approx(wanted["start"], abs=1e-12)
    text = page.run(f"explored.figures.{figure}.said.textContent")
    assert text.startswith("Stance angle" if figure == "basin" else "Slope")
    assert page.run(f"explored.figures.{figure}.root.nextElementSibling.id") == "explore-player"


def test_the_diagrams_walk_has_the_chosen_stance_angle(page):
    _keys(page, "bifurcation", *["ArrowRight"] * 30, "ArrowUp")
    chosen = page.run("explored.figures.bifurcation.at(explored.figures.bifurcation.item)")
    start = page.run("explored.figures.bifurcation.walk(explored.figures.bifurcation.item)")
    assert start["start"][0] == pytest.approx(chosen["y"], abs=1e-6)


def test_a_click_starts_the_nearest_walk(page):
    box = page.run("""(() => {
        const { canvas } = explored.figures.family;
        canvas.scrollIntoView();
        const box = canvas.getBoundingClientRect();
        return [box.left + 0.4 * box.width, box.top + 0.3 * box.height].map(Math.round);
    })()""")
    page.touch([[tuple(box)]], "mouse")
    slopes, state = _started(page, "family")["slope"], page.run("explored.player.walk.scene.slope")
    assert state == slopes and 0.02 < state < 0.05


def test_keys_zoom(page):
    zoomed = "explored.figures.bifurcation.zoomed"
    _keys(page, "bifurcation", "+", "+")
    assert page.run(zoomed) == pytest.approx(1.6**2)
    _keys(page, "bifurcation", "0")
    assert page.run(zoomed) == 1.0


def test_two_fingers_zoom(page):
    if isinstance(page, WebKit):
        pytest.skip("WebKitGTK's driver has no touch")
    zoomed = "explored.figures.bifurcation.zoomed"
    box = page.run("""(() => {
        const { canvas } = explored.figures.bifurcation;
        canvas.scrollIntoView();
        const box = canvas.getBoundingClientRect();
        return [box.left + 0.6 * box.width, box.top + 0.5 * box.height].map(Math.round);
    })()""")
    x, y = box
    page.touch([[(x + side * apart, y) for apart in (20, 30, 60)] for side in (-1, 1)])
    assert page.run(zoomed) == pytest.approx(3.0, rel=0.1)


def test_the_vertical_axis_can_be_another(page):
    page.run("""(() => {
        const select = explored.figures.family.tools.querySelector("select");
        select.value = "multiplier";
        select.dispatchEvent(new Event("change"));
    })()""")
    assert page.run("explored.figures.family.whole[1][1]") > 1.0


def test_still_pictures_give_way_and_controls_have_labels(page):
    assert page.run("document.querySelector('.explore-still').hidden") is True
    unnamed = page.run("""[...document.querySelectorAll("input, select, button, canvas")]
        .filter((each) => !each.labels?.length && !each.textContent && !each.ariaLabel).length""")
    assert unnamed == 0
