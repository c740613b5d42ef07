"""In pictures, walkers stand and land on the uneven ground."""

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.torso import TORSO
from gym_passive_walker.envs import frames
from gym_passive_walker.pictures import level, pose, strobe
from gym_passive_walker.pictures.axes import OWN
from gym_passive_walker.pictures.ground import ground_under, height

LEG_ON_A_FRAME = 0.62 * 450  # pixels
TERRAINS = {
    "rough": gpw.rough(0.003, 0.01),
    "stairs": gpw.stairs(-0.005),
    "waves": gpw.waves(0.005, 6),
    "a step down": gpw.footholds(heights=[0.0, 0.0, -0.01]),
    "a bend": gpw.footholds(slopes=[0.0, 0.0, 0.03, 0.01]),
}
WALKS = {"lab": 0.036, "C": 0.05, "D": 0.009, "A": 0.03}


def postures(walk):
    """Positions of the parts of a walker along its walk."""
    return pose(walk.walker, walk.states, walk.contact_x, walk.contact_y, walk.tilts)


def below(surface, feet):
    """Depth of the deepest point of each foot below a surface."""
    return (height(surface, feet[..., 0]) - feet[..., 1]).max(axis=-1)


@pytest.fixture(params=TERRAINS)
def terrain(request):
    return TERRAINS[request.param]


@pytest.mark.parametrize("name", WALKS)
def test_stance_feet_touch_the_ground_and_swing_feet_land_on_it(name, terrain):
    gait = gpw.find_gait(name, WALKS[name])
    walk = gpw.simulate(
        name, WALKS[name], gait.state, 6, terrain=terrain, terrain_seed=4, samples=30
    )
    assert len(walk.outcomes) >= 2
    length = walk.walker.leg_length
    surface, posture = ground_under(walk, length), postures(walk)
    stands = walk.outcomes[walk.stride_index] == gpw.Outcome.HEELSTRIKE  # a fall may roll off
    off = (height(surface, walk.contact_x) - walk.contact_y)[stands]
    np.testing.assert_allclose(off, 0.0, atol=1e-12)
    assert below(surface, posture.stance.sole[stands]).max() < 1e-9 * length
    ends = np.append(np.flatnonzero(np.diff(walk.stride_index)), len(walk) - 1)
    ends = ends[walk.outcomes == gpw.Outcome.HEELSTRIKE]
    deep = below(surface, posture.swing.sole[ends])
    assert deep.max() < 1e-6 * length < length / LEG_ON_A_FRAME
    # The arc is drawn as a polygon: its lowest corner is near the lowest point.
    assert deep.min() > -length / LEG_ON_A_FRAME


@pytest.mark.parametrize("name", WALKS)
def test_the_foothold_on_which_a_walk_ends_is_where_a_longer_one_goes_on(name):
    ground = gpw.footholds([0.0, 0.0, 0.001, 0.0], [0.0, 0.002, -0.004, 0.004])
    gait = gpw.find_gait(name, WALKS[name])
    short, long = (
        gpw.simulate(name, WALKS[name], gait.state, count, terrain=ground) for count in (2, 3)
    )
    length = short.walker.leg_length
    surface = ground_under(short, length)
    first = np.argmax(long.stride_index == 2)
    assert long.stride_index[first] == 2 and long.tilts[first] == -0.004
    place = long.contact_x[first]
    assert height(surface, place) == pytest.approx(long.contact_y[first], abs=1e-7 * length)
    further = height(surface, place + 1e-3 * length)
    steep = (further - height(surface, place)) / (1e-3 * length)
    assert np.arctan(-steep) == pytest.approx(long.tilts[first], abs=1e-6)


def test_a_system_stands_on_the_stairs_of_its_walk():
    walk = gpw.simulate(TORSO, 0.03, strides=3, terrain=gpw.stairs(0.001))
    surface = ground_under(walk, 1.0)
    assert len(walk.outcomes) == 3 and np.ptp(surface[:, 1]) > 0.002
    np.testing.assert_allclose(height(surface, walk.contact_x), walk.contact_y, atol=1e-12)
    ax = strobe(TORSO, 0.03, strides=3, terrain=gpw.stairs(0.001), ax=OWN)
    assert ax.lines


def test_a_picture_of_smooth_ground_needs_no_footholds():
    gait = gpw.find_gait("lab", 0.036)
    assert ground_under(gpw.simulate("lab", 0.036, gait.state), 1.0) is None


@pytest.mark.parametrize("name", WALKS)
def test_a_walker_on_a_steeper_foothold_is_turned_about_its_contact(name):
    state = np.array([0.2, -0.3, -0.4, 0.0, 0.0, 0.0])
    place = np.array([1.0, 0.5])
    plain, tilted = pose(name, state), pose(name, state, *place, 0.03)
    for part in ("foot", "knee", "tip", "sole"):
        for leg in ("stance", "swing"):
            expected = level(getattr(getattr(plain, leg), part), 0.03) + place
            found = getattr(getattr(tilted, leg), part)
            np.testing.assert_allclose(found, expected, atol=1e-15)
    np.testing.assert_allclose(tilted.hip, level(plain.hip, 0.03) + place, atol=1e-15)


def test_footholds_ahead_lie_as_those_of_a_usual_stride():
    """Stairs of which two steps were taken go on, step by step, at the same pace."""
    gait = gpw.find_gait("C", 0.036)
    walk = gpw.simulate("C", 0.036, gait.state, 2, terrain=gpw.stairs(-0.01))
    length = walk.walker.leg_length
    surface = ground_under(walk, 4.0 * length)
    x, heights = surface[:, 0], surface[:, 1] / length
    np.testing.assert_allclose(np.unique(np.round(np.diff(heights), 9)), [-0.01, 0.0])
    assert x[-1] > walk.contact_x[-1] + 3.0 * length and np.all(np.diff(x) >= 0.0)
    edges = x[1:-1:2]
    np.testing.assert_allclose(np.diff(edges)[3:], np.diff(edges)[3], rtol=1e-12)
    assert np.diff(edges)[3] == pytest.approx(walk.contact_x[100], rel=0.1)


class Listener:
    """A screen that records the arguments of `draw`."""

    seen = 2.0

    def draw(self, state, slope, contact_x, strides, **given):
        """Record the arguments."""
        self.given = given
        self.posture = pose("C", state, contact_x, given["contact_y"], given["tilt"])
        self.slope, self.strides = slope, strides


@pytest.mark.parametrize("count", [1, 3])
def test_environments_show_walkers_on_their_footholds(count):
    scene = {
        "walker": "C",
        "slope": 0.05,
        "terrain": gpw.rough(0.002, 0.004),
        "end_on_toe_stub": False,
    }
    envs = gym.make_vec("PassiveWalker-v0", num_envs=count, max_hip_torque=0.0, **scene)
    envs.reset(seed=5)
    batch, heard, length = envs.unwrapped.batch, Listener(), gpw.WALKERS["C"].leg_length
    struck = 0
    for _ in range(120):
        before = batch.ledger["strides"].copy()
        *_, terminated, _, _ = envs.step(np.zeros((count, 1), np.float32))
        if terminated.any():
            break
        for lane in range(count):
            frames.frame(batch, lane, heard)
            surface, posture = heard.given["profile"], heard.posture
            x, y = posture.contact
            assert height(surface, x) == pytest.approx(y, abs=1e-12)
            assert heard.slope == pytest.approx(0.05, abs=1e-15)
            assert surface[-1, 0] >= x + heard.seen and surface[0, 0] <= min(0.0, x - heard.seen)
            if before[lane] != batch.ledger["strides"][lane]:
                struck += 1
                for leg in (posture.stance, posture.swing):  # it came down; the other leaves
                    assert below(surface, leg.sole) < length / LEG_ON_A_FRAME
    assert struck >= 2 * count


def test_an_environment_s_footholds_are_those_of_the_walk():
    scene = {
        "walker": "C",
        "slope": 0.05,
        "terrain": gpw.rough(0.0005, 0.002),
        "end_on_toe_stub": False,
    }
    env = gym.make(
        "PassiveWalker-v0", control="stride", max_hip_torque=0.0, reset_noise_scale=0.0,
        tolerance=1e-10, disable_env_checker=True, **scene,
    ).unwrapped  # fmt: skip
    env.reset(seed=3)
    key = int(env.batch.disturbances.states["key"][0])
    state = gpw.find_gait("C", 0.05).state
    walk = gpw.simulate("C", 0.05, state, 12, terrain=scene["terrain"], terrain_seed=key, samples=2)
    assert len(walk.outcomes) > 9  # more than are remembered
    for k in range(len(walk.outcomes) - 1):
        np.testing.assert_allclose(
            env.batch.contact(0),
            [walk.contact_x[2 * k], walk.contact_y[2 * k], walk.tilts[2 * k]],
            atol=1e-6,
        )
        heard = Listener()
        frames.frame(env.batch, 0, heard)
        seen = slice(2 * max(0, k - 8), 2 * k + 1, 2)
        passed = height(heard.given["profile"], walk.contact_x[seen])
        np.testing.assert_allclose(passed, walk.contact_y[seen], atol=1e-6)
        env.step(np.zeros(1, np.float32))
