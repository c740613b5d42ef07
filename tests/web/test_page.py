"""The player in a page, in Chromium, Firefox and WebKitGTK without a window."""

import json
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.five_links import FIVE_LINKS
from examples.torso import TORSO
from gym_passive_walker.engine.run import advance, new_records
from gym_passive_walker.envs.policies import shipped_policies
from gym_passive_walker.models.model import bodies
from tests.web.browser import LISTEN, Chromium, served
from tests.web.test_walks import SIX, _job, _near, _unlike

PAGE = """<!doctype html>
<html lang="en">
<head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>Walkers</title><link rel="icon" href="data:,">
<link rel="stylesheet" href="player.css"></head>
<body><main id="walker"></main>
<script type="module">
  import { play } from "./player.js";
  globalThis.player = await play(document.querySelector("#walker"), { share: true });
  globalThis.first = performance.now();
</script></body></html>
"""
READY = """new Promise((done) => {
  const wait = () => globalThis.first ? done(globalThis.first) : setTimeout(wait, 10);
  wait();
})"""
FRAMES = """new Promise((done) => {
  const slider = player.sliders.slope.input, began = performance.now();
  let frames = 0;
  const tick = () => {
    frames += 1;
    slider.value = 0.03 + 0.01 * Math.sin(frames / 10);
    slider.dispatchEvent(new Event("input"));
    if (performance.now() - began < 1000) requestAnimationFrame(tick);
    else done(frames);
  };
  requestAnimationFrame(tick);
})"""


_WIDGET = """(async () => {
  const values = VALUES, heard = {}, files = {};
  const names = NAMES;
  for (const name of names) files[name] = new DataView(await (await fetch(name)).arrayBuffer());
  const model = {
    get: (name) => (name === "files" ? files : values[name]),
    set: (name, value) => { values[name] = value; },
    save_changes: () => {},
    on: (event, act) => { heard[event] = act; },
    off: (event) => { delete heard[event]; },
  };
  const pause = (ms) => new Promise((done) => setTimeout(done, ms));
  const { default: { render } } = await import("./widget.js");
  document.body.textContent = "";
  const stop = await render({ model, el: document.body });
  const found = { start: { ...values } };
  while (!values.strides) await pause(20);
  values.slope = 0.03;
  heard["change:slope"]();
  values.running = false;
  heard["change:running"]();
  found.paused = { ...values };
  await pause(100);
  heard["msg:custom"]({ push: 0.02 });
  values.running = true;
  heard["change:running"]();
  await pause(300);
  found.after = { ...values };
  stop();
  found.heard = Object.keys(heard).length;
  return found;
})()"""


@pytest.fixture(scope="module")
def address(package):
    (package / "index.html").write_text(PAGE.replace("<head>", f"<head>{LISTEN}"))
    shutil.copy(Path(__file__).parent / "jobs.mjs", package)
    with served(package) as address:
        yield address


@pytest.fixture
def page(browser, address):
    """The page, opened afresh; a message of its console is an error."""
    browser.heard()
    browser.open("about:blank")

    def opened(settings=""):
        browser.open("about:blank")
        browser.open(f"{address}#{settings}")
        time.sleep(0.1)
        browser.first = browser.run(READY)
        return browser

    yield opened
    assert browser.heard() == []


def test_the_first_frame_comes_within_a_second(page):
    assert min(page().first for _ in range(3)) < 1000.0


def test_the_picture_moves_while_a_slider_does(page):
    there = page()
    assert there.run(FRAMES) > 5  # in a second, beside other processes; docs/web.md has how many
    assert there.run("player.walk.over") is False


def done_in(there, jobs):
    """Do jobs of `jobs.mjs` in a page; return their results."""
    return there.run(f"""(async () => {{
        const {{ run }} = await import("./jobs.mjs");
        const walkers = await import("./passive-walker.js");
        const results = [];
        for (const job of {json.dumps(jobs)}) results.push(await run(walkers, job));
        return results;
    }})()""")


def test_strides_in_a_page_are_the_cpus_byte_for_byte(page):
    jobs, there = [], []
    for name in SIX:
        walker = gpw.WALKERS[name]
        records = new_records(_near(walker, 0.03, 100), 0.03)
        jobs.append(_job(walker, name, records))
        there.append(advance(walker.equations(), bodies(walker), records, tolerance=1e-8))
    found = done_in(page(), jobs)
    assert [_unlike(*pair) for pair in zip(found, there, strict=True)] == [0] * len(SIX)


@pytest.mark.parametrize("terrain", ["waves", "rough"])
def test_walks_on_uneven_ground_are_alike_in_every_browser_and_in_node(page, run, terrain):
    uneven = {"waves": {"height": 0.004, "strides": 6}, "rough": {"height_std": 0.002}}
    scene = {
        "slope": 0.03,
        "terrain": {terrain: uneven[terrain]},
        "pushes": {"rate": 0.3, "impulse": [-0.01, 0.01]},
    }
    starts = [{"key": str(key), "state": None, "actions": [[0.0]] * 100} for key in range(3)]
    jobs = [{"what": "episodes", "walker": "C", "scene": scene, "starts": starts}]
    found = done_in(page(), jobs)
    assert found == run(*jobs) and sum(map(len, found[0])) > 150


def test_every_walker_and_every_policy_walks(page):
    there = page()
    walkers = [("walker", "walkerChoice", name, name) for name in gpw.WALKERS]
    names = [
        name for name in shipped_policies() if not gpw.load_policy(name).scene.domain_randomization
    ]
    offered = there.run("[...player.controllers.options].map((option) => option.value)")
    assert offered == ["passive", "torque", *(f"policy {name}" for name in names)]
    policies = [("policy", "controllers", name, f"policy {name}") for name in names]
    for choice, select, name, value in walkers + policies:
        distance = there.run(f"""(async () => {{
            player.running = false;
            player.{select}.value = {json.dumps(value)};
            player.{select}.dispatchEvent(new Event("change"));
            while (player.settings.{choice} !== {json.dumps(name)} || player.walk.strides) {{
                await new Promise((done) => setTimeout(done, 20));
            }}
            await new Promise((done) => setTimeout(done, 50));
            player.advance(1.0);
            player.draw();
            return [player.walk.info.episode_distance, player.said.textContent];
        }})()""")
        assert distance[0] > 0.1 and distance[1] == "", name


_SYSTEM = """(async () => {
    const { play } = await import("./player.js"), root = document.createElement("div");
    document.body.append(root);
    const own = await play(root, { system: "NAME", slope: SLOPE, paused: true });
    const set = (name, value) => {
        own.sliders[name].input.value = value;
        own.sliders[name].input.dispatchEvent(new Event("input"));
        return new Promise((done) => setTimeout(done, 600));
    };
    own.advance(3.0);
    own.draw();
    const found = { strides: own.walk.strides, said: own.said.textContent };
    found.fields = Object.keys(own.sliders);
    found.measures = own.measures.textContent;
    const { width, height } = own.canvas, context = own.canvas.getContext("2d");
    const pixels = new Uint32Array(context.getImageData(0, 0, width, height).data.buffer);
    found.colors = new Set(pixels).size;
    const before = own.walk.state;
    own.push(0.01);
    own.advance(0.05);
    found.moved = own.walk.state.some((x, i) => x !== before[i]);
    await set("body FIELD", VALUE);
    found.field = own.walk.fields.FIELD;
    found.multipliers = own.multipliers.textContent;
    await own.set({ ground: "rough" }, true);
    own.advance(1.0);
    found.rise = own.walk.block.get("record.ground", 2);
    own.stop();
    root.remove();
    return found;
})()"""


@pytest.mark.parametrize(
    ("name", "slope", "field", "value"),
    [("five", 0.05, "torso", 19.0), ("torso", 0.03, "leg", 0.11)],
)
def test_a_system_of_ones_own_walks_in_the_player(page, name, slope, field, value):
    there = page()
    code = _SYSTEM.replace("NAME", name).replace("SLOPE", str(slope))
    found = there.run(code.replace("FIELD", field).replace("VALUE", str(value)))
    assert found["strides"] >= 1 and found["said"] == "" and "step length" in found["measures"]
    assert found["colors"] > 3 and found["moved"] and found["rise"] != 0.0
    assert found["field"] == value and "The gait is" in found["multipliers"]
    system = {"five": FIVE_LINKS, "torso": TORSO}[name]
    assert {f"body {each}" for each in system.body._fields} <= set(found["fields"])
    assert {f"control {each}" for each in system.controls} <= set(found["fields"])


def test_the_multipliers_are_those_of_the_hip_torque(page):
    there, walker = page("walker=C&slope=0.02"), gpw.WALKERS["C"]
    found = there.run("""(async () => {
        player.running = false;
        await player.set({ torque: 0.001 }, true);
        await new Promise((done) => setTimeout(done, 600));
        return player.gait.multipliers;
    })()""")
    controller = gpw.Actuation(hip_torque=0.001 * walker.units.torque)
    gait = gpw.find_gait(gpw.stride_map(walker, 0.02, controller=controller))
    there_and_here = [[complex(*z) for z in found], gait.multipliers]
    sizes = [sorted(np.abs(multipliers)) for multipliers in there_and_here]
    np.testing.assert_allclose(*sizes, atol=1e-5)


def test_a_held_torque_is_as_large_and_a_push_as_hard_as_asked(page):
    there = page("walker=lab&slope=0.036")
    found = there.run("""(async () => {
        player.running = false;
        await player.set({ torque: 0.08 }, true);
        player.advance(0.05);
        const torque = player.walk.block.get("record.control"), pushed = [];
        player.walk.push = (impulse) => pushed.push(impulse);
        for (const impulse of [0.5, -30]) {
            player.push(impulse);
            player.advance(0.1);
        }
        return [torque, ...pushed];
    })()""")
    assert found == [pytest.approx(0.08, rel=1e-12), 0.5, -10.0]


def test_a_policy_comes_with_its_walker_and_slope_and_without_torque(page):
    there = page()
    found = there.run("""(async () => {
        const { play } = await import("./player.js"), found = [];
        for (const given of [{}, { walker: "E" }, { torque: 0.01 }]) {
            const root = document.createElement("div");
            document.body.append(root);
            try {
                const player = await play(root, { policy: "level-ppo", paused: true, ...given });
                const { settings } = player;
                found.push([settings.policy, settings.walker, settings.slope]);
            } catch (error) {
                found.push(error.message);
            }
            root.remove();
        }
        return found;
    })()""")
    assert found[:2] == [["level-ppo", "C", 0.0], ["level-ppo", "E", 0.0]]
    assert found[2] == "the policy level-ppo works the motor: leave out torque"


def test_a_walker_that_cannot_be_says_why_and_the_walk_goes_on(page):
    there = page()
    there.run("player.sliders.foot_radius.input.max = 2")
    there.run("""(() => {
        player.sliders.foot_radius.input.value = 1.5;
        player.sliders.foot_radius.input.dispatchEvent(new Event("input"));
    })()""")
    time.sleep(0.2)
    assert there.run("player.said.textContent").startswith("foot_radius must lie from 0 to below")
    assert there.run("player.walk.walker.foot_radius") == gpw.WALKERS["lab"].foot_radius


def test_an_address_keeps_the_settings(page):
    there = page("walker=C&slope=0.02&foot_radius=0.21&ground=rough&speed=0.5")
    settings = there.run("player.settings")
    assert (settings["walker"], settings["slope"], settings["ground"]) == ("C", 0.02, "rough")
    assert settings["changes"] == {"foot_radius": 0.21} and settings["speed"] == 0.5
    there.run("player.toggle()")
    there.run("player.sliders.torque.input.value = 0.001")
    written = there.run("""(async () => {
        const written = [], pause = (ms) => new Promise((done) => setTimeout(done, ms));
        history.replaceState = ((write) => function (...given) {
            written.push(performance.now());
            return write.apply(history, given);
        })(history.replaceState);
        for (let i = 0; i < 40; i++) {
            player.sliders.torque.input.dispatchEvent(new Event("input"));
            await pause(i === 20 ? 400 : 5);
        }
        await pause(800);
        return written;
    })()""")
    assert len(written) >= 2 and min(np.diff(written)) >= 290.0  # WebKit allows 100 in ten seconds
    assert "torque=0.001" in there.run("location.hash") and "foot_radius" in there.run(
        "location.hash"
    )


def test_keys_pause_and_push(page):
    there = page()
    key = "player.canvas.dispatchEvent(new KeyboardEvent('keydown', {{ key: '{}' }}))"
    there.run(key.format(" "))
    assert there.run("player.running") is False
    before = there.run("player.walk.state")
    there.run(key.format("ArrowRight"))
    there.run("player.advance(0.1)")
    assert there.run("player.walk.block.get('disturbance.pushes')") == 1
    assert not np.allclose(there.run("player.walk.state"), before)


def test_keys_choose_walkers_policies_and_speeds_and_a_slider_goes_home(page):
    there = page("walker=C&slope=0.02&foot_radius=0.21")
    key = "player.canvas.dispatchEvent(new KeyboardEvent('keydown', {{ key: '{}' }}))"
    wait = "new Promise((done) => setTimeout(done, {}))"
    there.run("player.running = false")
    for speed, pressed in ((1 / 64, "-" * 8), (4, "+" * 10)):
        for each in pressed:
            there.run(key.format(each))
        assert there.run("player.settings.speed") == speed
    for event in ("new KeyboardEvent('keydown', { key: 'Delete' })", "new Event('dblclick')"):
        for name, home in (("slope", 0.02), ("foot_radius", 0.21), ("gravity", 9.81)):
            there.run(f"""(() => {{
                const {{ input }} = player.sliders.{name};
                input.value = 1.1 * {home};
                input.dispatchEvent(new Event("input"));
            }})()""")
            there.run(f"player.sliders.{name}.input.dispatchEvent({event})")
            there.run(wait.format(50))
            assert float(there.run(f"player.sliders.{name}.input.value")) == home
    names, chosen = list(gpw.WALKERS), []
    for pressed in "wWWp":
        there.run(key.format(pressed))
        there.run(wait.format(500))
        chosen.append(there.run("[player.settings.walker, player.controllers.value]"))
    place = names.index("C")
    around = [names[place + 1], "C", names[place - 1]]
    assert chosen[:3] == [[name, "passive"] for name in around]
    assert chosen[3][1] == "torque"


def test_the_picture_is_recorded(page, browser):
    there = page()
    if not there.run("Boolean(player.film)"):
        pytest.skip("this browser records no canvas")
    assert there.run("player.film.textContent") == "Record video"
    found = there.run("""(async () => {
        const pause = (ms) => new Promise((done) => setTimeout(done, ms));
        const made = [], keep = URL.createObjectURL, files = [];
        URL.createObjectURL = (blob) => (made.push(blob), keep.call(URL, blob));
        HTMLAnchorElement.prototype.click = function () { files.push(this.download); };
        player.film.click();
        if (!player.recorder) return player.said.textContent;
        const during = player.film.textContent;
        await pause(700);
        player.record();
        while (!made.length) await pause(20);
        return [during, made[0].size, made[0].type, files, player.film.textContent];
    })()""")
    if isinstance(found, str):
        assert found.startswith("This browser records no video: ")
        return
    during, size, kind, (name,), after = found
    assert (during, after) == ("Save video", "Record video")
    assert size > 1000 and kind.startswith("video/") and name in ("walk.webm", "walk.mp4")


def test_a_reader_who_prefers_reduced_motion_begins_in_pause(page, browser):
    if not isinstance(browser, Chromium):
        pytest.skip("only Chromium's protocol sets what a reader prefers")
    browser.ask(
        "Emulation.setEmulatedMedia",
        features=[{"name": "prefers-reduced-motion", "value": "reduce"}],
    )
    try:
        assert page().run("player.running") is False
    finally:
        browser.ask("Emulation.setEmulatedMedia", features=[])


def test_every_control_has_a_label(page):
    unnamed = page().run("""[...document.querySelectorAll("input, select, button, canvas")]
        .filter((each) => !each.labels?.length && !each.textContent && !each.ariaLabel).length""")
    assert unnamed == 0


def in_a_notebook(there, package, widget, names):
    """What the page of a widget reports as it begins, as it pauses, and after a push."""
    (package / "widget.js").write_text(widget._esm, encoding="utf-8")
    traits = ("given", "slope", "hip_torque", "speed", "running")
    values = json.dumps({name: getattr(widget, name) for name in traits})
    found = there.run(_WIDGET.replace("VALUES", values).replace("NAMES", json.dumps(names)))
    paused, after = found["paused"], found["after"]
    assert (paused["slope"], paused["running"], paused["outcome"]) == (0.03, False, "")
    assert paused["strides"] >= 1 and after["state"] != paused["state"]
    assert found["heard"] == 0
    return found["start"]


def test_the_widget_of_notebooks_walks_and_reports(page, package):
    pytest.importorskip("anywidget")
    from gym_passive_walker.apps.widget import PlayerWidget

    gait = gpw.find_gait("C", 0.02)
    widget = PlayerWidget(gait.walker, gait.slope, start=gait.state)
    start = in_a_notebook(page(), package, widget, ["data.json", "kneed.wasm"])
    assert start["state"] == pytest.approx(gait.state)
    assert gpw.Walker(**start["parameters"]) == gait.walker


def test_the_widget_of_a_system_walks_and_reports(page, package):
    pytest.importorskip("anywidget")
    from gym_passive_walker.apps.widget import PlayerWidget

    gait = gpw.find_gait(TORSO, 0.03)
    widget = PlayerWidget(gait.walker, gait.slope, start=gait.state)
    (package / "systems/own.wasm").write_bytes(widget.files["systems/own.wasm"])
    start = in_a_notebook(page(), package, widget, ["systems/own.wasm"])
    assert start["state"] == pytest.approx(gait.state)
    assert start["parameters"] == TORSO.body._asdict()
