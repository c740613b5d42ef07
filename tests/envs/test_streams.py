"""Random numbers of different purposes are independent: no two share a stream.

Starts, slopes, varied walkers, commands, terrain, pushes, and noise of sensors and motors draw from
streams of their own: numbers are uncorrelated between them, between walkers and between steps, and
to switch one off changes no number of the others.
"""

import numpy as np
import pytest
from scipy import stats

from gym_passive_walker.engine.counter_rng import uniform
from gym_passive_walker.envs.disturbance_kernels import _WHEN
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.terrain import rough

MANY, STEPS = 1600, 6
FEATURES = {
    "reset_noise_scale": 0.06,
    "slope": (0.0, 0.03),
    "domain_randomization": {"hip_mass": 0.1, "thigh_mass": 0.1},
    "command": (0.1, 0.3),
    "terrain": {"rough": {"height_std": 1e-4, "slope_std": 1e-4}},
    "terrain_lookahead": 3,
    "pushes": {"rate": 1.5, "impulse": (-1e-4, 1e-4)},
    "observation_noise": 0.01,
    "action_noise": 0.1,
}
OFF = {
    "command": None,
    "pushes": {},
    "observation_noise": 0.0,
    "action_noise": 0.0,
}
"""What is switched off without another draw from a walker's own generator."""
WALKER = {"preset": "C", "hip_mass": 0.5}


def draws(count=MANY, seed=0, steps=STEPS, **changes):
    """All that is drawn for some walkers in their first steps, a column for each number."""
    arguments = {
        "walker": WALKER,
        "actions": ("hip", "push_off"),
        "tick": 0.2,
        **FEATURES,
        **changes,
    }
    env = PassiveWalkerVectorEnv(count, **arguments)
    observations, _ = env.reset(seed=seed)
    found, batch = {}, env.batch
    states = batch.records["state"][:, 0]
    disturbances = batch.disturbances.states
    slopes = disturbances["slope"].copy()
    found["start: slope"] = slopes
    found["start: angle"], found["start: rate"] = states[:, 0].copy(), states[:, 3].copy()
    found["start: swing"] = states[:, 4].copy()
    for name in FEATURES["domain_randomization"]:
        found[f"walker: {name}"] = np.array([getattr(walker, name) for walker in env.walkers])
    if arguments["command"] is not None:
        found["command"] = disturbances["command"].copy()
    for ahead in range(3):
        place = 8 + (arguments["command"] is not None) + 2 * ahead
        found[f"terrain: rise {ahead}"] = observations[:, place]
        found[f"terrain: turn {ahead}"] = observations[:, place + 1]
    due, impulse, pushed = disturbances["due"].copy(), np.full(count, np.nan), np.zeros(count, int)
    if arguments["pushes"]:
        for n in range(3):
            each = np.array([uniform(key, n, _WHEN) for key in disturbances["key"]])
            found[f"push {n}: when"] = -np.log(1.0 - each) / arguments["pushes"]["rate"]
        np.testing.assert_allclose(due, found["push 0: when"], rtol=1e-12)
    left = np.ones(count, bool)
    for step in range(steps + 1):
        if arguments["observation_noise"]:
            for k in range(6):
                found[f"sensor: {k} of step {step}"] = observations[:, k] - states[:, k]
        if step == steps:
            break
        observations, _, fell, _, infos = env.step(np.zeros((count, 2), np.float32))
        left &= ~fell & (infos["strides"] == 0)
        if arguments["action_noise"]:
            found[f"motor: hip of step {step}"] = batch.records["control"][:, 0, 0].copy()
            share = batch.records["push_off"][:, 0].copy()
            found[f"motor: push-off of step {step}"] = np.where(share > 0.0, share, np.nan)
        if arguments["pushes"]:
            first = (pushed == 0) & (infos["pushes"] == 1)
            impulse[first] = disturbances["impulse"][first]
            waited = found["push 0: when"] + found["push 1: when"]
            np.testing.assert_allclose(disturbances["due"][first & left], waited[first & left])
            pushed = infos["pushes"].copy()
    if arguments["pushes"]:
        found["push 0: how hard"] = impulse
    return {name: np.where(left, values, np.nan) for name, values in found.items()}


@pytest.fixture(scope="module")
def drawn():
    return draws()


def uncorrelated(one, other, names):
    """No two columns move together, nor does one's size with the other."""
    both = np.isfinite(one) & np.isfinite(other)
    one, other = one[both], other[both]
    assert len(one) > 200, names
    limit = 5.5 / np.sqrt(len(one))
    for x in (one, np.abs(one - np.median(one))):
        for y in (other, np.abs(other - np.median(other))):
            assert abs(stats.spearmanr(x, y).statistic) < limit, names


def thing(name):
    return name.partition(":")[0]


def test_numbers_of_different_things_and_steps_are_uncorrelated(drawn):
    """Except those of one thing that hang together by themselves, as heights of footholds do."""
    names = list(drawn)
    tied = {"start", "walker", "terrain"}
    # Rates and angles of starts hang on the slope; take what is drawn for them apart from it.
    for i, one in enumerate(names):
        for other in names[:i]:
            things = {thing(one), thing(other)}
            if not ((len(things) == 1 and things <= tied) or things <= {"start", "walker"}):
                uncorrelated(drawn[one], drawn[other], (one, other))


def test_numbers_of_neighbours_are_uncorrelated(drawn):
    names = list(drawn)
    for one in names:
        for other in (one, *np.random.default_rng(len(one)).choice(names, 12)):
            uncorrelated(drawn[one][:-1], drawn[str(other)][1:], (one, str(other)))


def test_heights_and_slopes_of_footholds_are_uncorrelated():
    found = rough(1.0, 1.0).ground(np.arange(MANY), np.arange(1, 9)[:, None])
    heights, slopes = np.cumsum(found[..., 1], axis=0), found[..., 0]
    increments = np.concatenate([heights, slopes])
    # The height of a foothold is its rise's own number less the one before.
    table = found[..., 1] * 1.0
    for i in range(8):
        for j in range(8):
            uncorrelated(table[i], slopes[j], (i, j))
            if i != j:
                uncorrelated(slopes[i], slopes[j], (i, j))
    assert np.isfinite(increments).all()
    for gap in (2, 3, 5):  # neighbours share a height
        uncorrelated(table[0], table[gap], gap)


@pytest.mark.parametrize("feature", OFF)
def test_to_switch_one_thing_off_changes_no_number_of_the_others(feature):
    few = {"count": 40, "steps": 4}
    usual, without = draws(**few), draws(**few, **{feature: OFF[feature]})
    gone = {"observation_noise": "sensor", "action_noise": "motor", "pushes": "push"}.get(
        feature, feature
    )
    assert {name for name in usual if name not in without} == {
        name for name in usual if name.startswith(gone)
    }
    for name, values in without.items():
        # Walks differ by what was switched off, and what is observed is in single precision.
        np.testing.assert_allclose(values, usual[name], rtol=1e-5, atol=3e-7, err_msg=name)


@pytest.mark.parametrize(
    ("feature", "value", "named"),
    [
        ("command", (0.2, 0.4), "command"),
        ("terrain", {"rough": {"height_std": 2e-4, "slope_std": 2e-4}}, "terrain"),
        ("pushes", {"rate": 1.5, "impulse": (-2e-4, 1e-4)}, "how hard"),
        ("observation_noise", 0.02, "sensor"),
        ("action_noise", 0.05, "motor"),
        ("reset_noise_scale", 0.04, "start"),
    ],
)
def test_to_change_one_thing_changes_no_number_of_the_others(feature, value, named):
    few = {"count": 40, "steps": 2}
    usual, changed = draws(**few), draws(**few, **{feature: value})
    assert usual.keys() == changed.keys()
    for name, values in changed.items():
        if named in name:
            continue
        np.testing.assert_allclose(values, usual[name], rtol=1e-5, atol=3e-7, err_msg=name)
    touched = [name for name in usual if named in name]
    assert any(not np.array_equal(usual[x], changed[x], equal_nan=True) for x in touched)


def test_a_start_s_own_numbers_are_uncorrelated():
    """Slope, angle, stance rate and swing rates, without what a gait has to do with its slope."""
    env = PassiveWalkerVectorEnv(
        MANY,
        start=(0.3, -0.3, -0.3, -0.4, -0.3, -0.2),
        slope=(0.0, 0.03),
        domain_randomization={"hip_mass": 0.1, "thigh_mass": 0.1},
        walker=WALKER,
    )
    env.reset(seed=0)
    states = env.batch.records["state"][:, 0]
    columns = [env.slopes, states[:, 0], states[:, 3], states[:, 4]]
    columns += [
        [getattr(walker, name) for walker in env.walkers] for name in ("hip_mass", "thigh_mass")
    ]
    columns = np.array(columns)
    for i, one in enumerate(columns):
        for other in columns[:i]:
            uncorrelated(one, other, i)
        uncorrelated(one[1:], one[:-1], i)
    env.reset()  # nor with those of the next episode
    for i, one in enumerate(columns[:1]):
        uncorrelated(one, env.slopes, i)
