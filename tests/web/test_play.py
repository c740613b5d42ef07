"""`gpw.play` and its command: the page in a browser, and the walk in a video or a picture."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from urllib.error import HTTPError
from urllib.request import urlopen

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.torso import TORSO
from gym_passive_walker.apps.cli import main
from gym_passive_walker.apps.play import _walk, announcement
from gym_passive_walker.apps.serve import PageServer
from gym_passive_walker.apps.shown import Setup, page_of
from gym_passive_walker.devices.web import page_data
from gym_passive_walker.gaits.scenes.scene import make_scene
from tests.web.browser import LISTEN, Chromium

TYPES = {
    "": "text/html", "player.css": "text/css", "player.js": "text/javascript",
    "passive-walker.js": "text/javascript", "settings.json": "application/json",
    "data.json": "application/json", "kneed.wasm": "application/wasm",
    "policies/level-ppo.safetensors": "application/octet-stream",
}  # fmt: skip
SCRIPT = "import gym_passive_walker as gpw; gpw.play(policy='level-ppo')"
COMMAND = ["-m", "gym_passive_walker", "play", "--policy", "level-ppo"]


@pytest.mark.skipif(os.name == "nt", reason="a process of Windows gets no SIGINT")
@pytest.mark.parametrize(
    ("words", "status", "last"),
    [
        (["-c", SCRIPT], 0, ""),
        (COMMAND, 130, "\nstopped\n"),
        ([*COMMAND, "--json"], 130, "\nstopped\n"),
    ],
    ids=["function", "command", "JSON"],
)
def test_a_process_serves_the_page_until_it_is_interrupted(words, status, last, tmp_path):
    seen = tmp_path / "address"
    browser = f"{sys.executable} -c 'import sys; open(sys.argv[2], \"w\").write(sys.argv[1])' %s"
    process = subprocess.Popen(
        [sys.executable, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "BROWSER": f"{browser} {seen}"},
    )  # fmt: skip
    try:
        line = process.stdout.readline()
        (address,) = re.findall(r"http://127\.0\.0\.1:\d+/", line)
        if "--json" in words:
            assert json.loads(line) == {"address": address, "files": []}
        for name, kind in TYPES.items():
            with urlopen(address + name) as answer:
                assert answer.headers["Content-Type"].partition(";")[0] == kind
                assert len(answer.read()) == int(answer.headers["Content-Length"]) > 100 or name
        for name in ("missing.js", "../pyproject.toml", "%2e%2e/%2e%2e/etc/passwd", "/etc/passwd"):
            with pytest.raises(HTTPError, match="404"):
                urlopen(address + name)
        for _ in range(200):
            if seen.exists() and seen.read_text() == address:
                break
            threading.Event().wait(0.05)
        else:
            pytest.fail("no browser was opened")
    finally:
        process.send_signal(signal.SIGINT)
        rest, said = process.communicate(timeout=30)
    assert (process.returncode, rest) == (status, "")
    assert said.endswith(last) and "Traceback" not in said


def test_a_page_ends_after_some_seconds_and_opens_no_browser_without_a_display(monkeypatch, capsys):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr("webbrowser.open", lambda address: pytest.fail("a browser was opened"))
    assert gpw.play("C", 0.02, seconds=0.1) is None
    (address,) = re.findall(r"http://\S+", capsys.readouterr().out)
    with pytest.raises(OSError, match="refused"):
        urlopen(address)


@contextmanager
def served(setup: Setup) -> Iterator[str]:
    """The address of the page of a setup, which notes errors."""
    files = page_of(setup)
    files["index.html"] = files["index.html"].replace(b"<head>", b"<head>" + LISTEN.encode())
    server = PageServer(files)
    assert server.address in announcement(server)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield server.address
    finally:
        server.shutdown()
        server.server_close()


SHOWN = """new Promise((done) => {
  const wait = () => {
    if (!globalThis.player?.walk) return setTimeout(wait, 20);
    const { walk, settings, policy, said } = player;
    player.running = false;
    player.advance(4.0);
    done({ ...settings, walker: walk.walker, fields: walk.fields, works: Boolean(policy),
           strides: walk.strides, said: said.textContent, network: policy?.weights });
  };
  wait();
})"""


@pytest.fixture
def shown(browser):
    """What the page of arguments of `play` shows, after four seconds."""
    if not isinstance(browser, Chromium):
        pytest.skip("`test_page` tries the player in all browsers")

    def look(walker=None, slope=None, policy=None, start=None):
        with served(Setup.of(walker, slope, policy, start)) as address:
            browser.heard()
            browser.open(address)
            found = browser.run(f"new Promise((done) => setTimeout(done, 200)).then(() => {SHOWN})")
            assert found["said"] == "" and browser.heard() == []
            browser.open("about:blank")
        return found

    return look


def test_a_changed_walker_is_shown_on_its_slope_from_its_start(shown):
    walker = gpw.as_walker({"preset": "B", "hip_mass": 0.25, "gravity": 1.62})
    gait = gpw.find_gait(walker, 0.031)
    found = shown(walker, 0.03, start=gait.state)
    assert gpw.Walker(**found["walker"]) == walker
    assert (found["slope"], found["works"]) == (0.03, False) and found["strides"] >= 1


def test_a_gait_is_shown_under_its_torque(shown):
    strides = gpw.stride_map(
        "C", 0.02, controller=gpw.Actuation(0.001 * gpw.WALKERS["C"].units.torque)
    )
    found = shown(gpw.find_gait(strides))
    assert (found["slope"], found["torque"]) == (0.02, pytest.approx(0.001))


def test_a_trained_policy_works_the_motors_on_another_slope(shown, tmp_path):
    policy = gpw.load_policy("steep-ppo")
    found = shown(slope=policy.scene.slope - 0.003, policy=policy)
    assert found["policy"] == "steep-ppo" and found["works"] and found["strides"] >= 1
    assert found["slope"] == policy.scene.slope - 0.003
    assert gpw.Walker(**found["walker"]) == policy.scene.walker


def test_a_system_of_ones_own_is_shown(shown):
    system = TORSO.vary(torso=0.08)
    gait = gpw.find_gait(system, 0.03)
    found = shown(gait)
    assert (found["slope"], found["fields"]) == (0.03, system.body._asdict())
    assert found["strides"] >= 1


def test_a_policy_of_ones_own_replaces_a_shipped_one_of_its_name(tmp_path):
    policy = gpw.load_policy("steep-ppo")
    mine = tmp_path / "level-ppo"
    mine.mkdir()
    for path in policy.folder.iterdir():
        (mine / path.name).write_bytes(path.read_bytes())
    files = page_of(Setup.of(None, None, mine, None))
    policies = json.loads(files["data.json"])["policies"]
    assert policies["level-ppo"] == policies["steep-ppo"] != policies["lab-ppo"]
    steep = (policy.folder / "policy.safetensors").read_bytes()
    assert files["policies/level-ppo.safetensors"] == steep


def test_a_policy_of_a_walker_of_ones_own_is_that_of_the_nearest_preset(tmp_path):
    mine = tmp_path / "mine"
    shutil.copytree(gpw.load_policy("level-ppo").folder, mine)
    content = json.loads((mine / "policy.json").read_text("utf-8"))
    walker = gpw.WALKERS["C"].with_parameters(hip_mass=1.0)
    content["env"]["walker"] = asdict(walker)
    (mine / "policy.json").write_text(json.dumps(content), "utf-8")
    assert gpw.load_policy(mine).scene.walker == walker
    assert page_data.of_policy(mine)["scene"]["walker"] == {"preset": "C", "hip_mass": 1.0}


def test_a_gait_of_a_policy_is_shown_in_the_policy_s_own_scene():
    policy = gpw.load_policy("lab-ppo")
    own = gpw.find_gait(gpw.stride_map(controller=policy), 0.0361)
    assert Setup.of(own, None, None, None).slope == 0.0361
    other = gpw.closed_loop_gait(policy, make_scene(policy.scene, tick=0.2))
    with pytest.raises(ValueError, match="in its own scene, and this gait is of another"):
        gpw.play(other)


def test_a_start_serves_a_system_without_one():
    system = replace(TORSO, start=None)
    assert Setup.of(system, None, None, TORSO.start).slope == 0.01


def test_a_policy_of_a_scene_of_ones_own_has_no_page(tmp_path):
    mine = tmp_path / "mine"
    shutil.copytree(gpw.load_policy("level-ppo").folder, mine)
    content = json.loads((mine / "policy.json").read_text("utf-8")) | {"scene": "things:hill"}
    (mine / "policy.json").write_text(json.dumps(content), "utf-8")
    with pytest.raises(ValueError, match=r"a page has the scenes level, .* is 'things:hill': draw"):
        page_data.of_policy(mine)


@pytest.mark.parametrize("acts", [{"controller": "lqr"}, {"terrain": gpw.stairs(0.001)}])
def test_a_policy_replaces_no_controller_and_no_footholds_of_a_gait(acts):
    gait = gpw.find_gait(gpw.stride_map("C", 0.03, **acts))
    with pytest.raises(ValueError, match="one controller on smooth ground: leave out policy"):
        gpw.play(gait, policy="level-ppo", seconds=0.1)


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        ({"walker": "Z"}, "no walker 'Z'.*lab"),
        ({"slope": 2.0}, "slope must be an angle"),
        ({"policy": "none"}, "no policy.*level-ppo"),
        ({"policy": "anywhere-ppo"}, "a page has no domain_randomization, observe_body.*picture="),
        ({"start": [0.1] * 5}, r"start must be .*shape \(6,\)"),
        ({"start": "here"}, r"start must be .*shape \(6,\)"),
        ({"start": [0.1, -0.2, 0.3, 0.0, 0.0, 0.0]}, "start bends the knee backwards"),
        ({"seconds": 0.0}, "seconds must be a number above 0"),
        ({"seconds": "long"}, "seconds must be one number"),
        ({"video": "walk.avi"}, r"must end in \.mp4 or \.gif"),
        ({"picture": "seen.webp"}, r"must end in one of \.png"),
    ],
)
def test_bad_arguments_are_refused_in_a_sentence(arguments, reported, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=reported) as refused:
        gpw.play(**{"seconds": 0.1, **arguments})
    assert "\n" not in str(refused.value) and not list(tmp_path.iterdir())


def test_a_page_that_cannot_be_compiled_is_refused_in_a_sentence(monkeypatch, capsys):
    from gym_passive_walker.apps import shown
    from gym_passive_walker.devices.web.build import WebError

    def fail():
        raise WebError("the WebAssembly modules cannot be compiled: no compiler")

    monkeypatch.setattr(shown, "files", fail)
    assert main(["play", "lab", "0.036"]) == 2
    assert capsys.readouterr().err == (
        "error: the WebAssembly modules cannot be compiled: no compiler\n"
    )


# Videos and pictures


@pytest.fixture
def drawn(monkeypatch):
    """States, contacts and strides of the frames that are drawn."""
    pytest.importorskip("pygame")
    from gym_passive_walker.pictures.screen import Screen

    draw, seen = Screen.draw, []

    def record(self, state, slope, contact_x, strides, **more):
        seen.append((state, slope, contact_x, strides))
        return draw(self, state, slope, contact_x, strides, **more)

    monkeypatch.setattr(Screen, "draw", record)
    return seen


def test_a_picture_is_the_last_frame_of_a_walk_of_some_seconds(drawn, tmp_path):
    """Frames are a thirtieth of a second apart, and show the nearest sample of 200 in a stride."""
    from tests.instants import states_at

    gait, start = gpw.find_gait("lab", 0.036), 0.99 * gpw.find_gait("lab", 0.036).state
    for ending in ("png", "bmp"):
        drawn.clear()
        path = tmp_path / f"seen.{ending}"
        assert gpw.play("lab", 0.036, start=start, seconds=0.5, picture=path) is None
        assert len(drawn) == 15 and path.stat().st_size > 1000
    times = np.arange(15) / 30
    expected, _ = states_at("lab", 0.036, start, times)
    states = np.array([state for state, *_ in drawn])
    np.testing.assert_allclose(states[:, :3], expected[:, :3], atol=0.02)
    np.testing.assert_array_equal(states[0], start)
    drawn.clear()
    gpw.play(gait, seconds=3.2 * gait.step_period, picture=tmp_path / "seen.png")
    *_, (_, slope, contact, strides) = drawn
    assert (slope, strides) == (0.036, 3)
    assert 3.0 * gait.step_length < contact < 4.0 * gait.step_length


@pytest.mark.parametrize("ending", [".mp4", ".gif"])
def test_a_video_has_a_frame_for_each_instant(tmp_path, ending, drawn):
    moviepy = pytest.importorskip("moviepy")
    path = tmp_path / f"walk{ending}"
    gpw.play("lab", 0.036, video=path)
    assert len(drawn) == 150
    with moviepy.VideoFileClip(str(path)) as clip:
        assert clip.duration == pytest.approx(5.0, abs=0.06) and clip.size == [800, 450]


def test_a_walk_that_falls_ends_its_video(drawn, tmp_path):
    gpw.play("lab", -0.1, seconds=60.0, picture=tmp_path / "fell.png")
    assert 10 < len(drawn) < 300


@pytest.mark.parametrize("name", ["level-ppo", "push-off-ppo", "commanded-ppo", "anywhere-ppo"])
def test_a_policy_walks_as_in_its_environment(name):
    policy = gpw.load_policy(name)
    command = policy.scene.command and float(np.mean(policy.scene.command))
    walk = _walk(Setup.of(None, None, policy, None), 8.0)
    calm = {
        "reset_noise_scale": 0.0, "tolerance": 1e-10, "command": command, "terrain": None,
        "slope": walk.slope,
    }  # fmt: skip
    calm |= {"domain_randomization": {}} if name == "anywhere-ppo" else {}
    env = gym.make("PassiveWalker-v0", **vars(policy.scene) | calm)
    seen, _ = env.reset(seed=0, options={"state": walk.states[0]})
    began = walk.contact_x[np.flatnonzero(np.diff(walk.stride_index)) + 1]
    lengths = np.diff(began) / walk.walker.leg_length
    made = []
    while len(made) < 4:
        seen, _, fell, _, info = env.step(policy.predict(seen)[0])
        assert not fell
        made += [info["step_length"]] * bool(info["step_length"])
    np.testing.assert_allclose(lengths[:3], made[1:4], rtol=1e-4)


def test_held_torque_and_systems_are_drawn(tmp_path, drawn):
    gait = gpw.find_gait(TORSO, 0.03)
    for number, (walker, slope) in enumerate(((gait, None), (TORSO, 0.03))):
        gpw.play(walker, slope, seconds=0.3, picture=tmp_path / f"{number}.png")
        np.testing.assert_allclose(drawn[0][0], gait.state, atol=1e-6)
        assert len(drawn) == 9
        drawn.clear()


@pytest.mark.parametrize("library", ["pygame", "moviepy"])
def test_a_missing_extra_is_named_before_anything_is_computed(library, monkeypatch, tmp_path):
    pytest.importorskip(library)
    monkeypatch.setattr("gym_passive_walker.apps.play._walk", lambda *_: pytest.fail("computed"))
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(ImportError, match=r"gym-passive-walker\[render\]"):
        gpw.play("lab", 0.036, video=tmp_path / "walk.mp4")


@pytest.mark.parametrize("kept", [{"video": "folder.mp4"}, {"picture": "folder.png"}])
def test_a_file_that_cannot_be_written_is_refused_before_anything_is_computed(
    kept, monkeypatch, tmp_path
):
    pytest.importorskip("moviepy")
    monkeypatch.setattr("gym_passive_walker.apps.play._walk", lambda *_: pytest.fail("computed"))
    ((option, name),) = kept.items()
    (tmp_path / name).mkdir()
    with pytest.raises(IsADirectoryError, match="folder"):
        gpw.play("lab", 0.036, **{option: tmp_path / name})
