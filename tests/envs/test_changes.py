"""What may change while walkers walk: the ground from stride to stride, and the motor's price."""

import numpy as np
import pytest
from gymnasium.error import ResetNeeded

from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.scenes.checks import SceneError

ZEROS = np.zeros((3, 1))
BUMPY = np.array([0.02, 0.036, 0.05])


def learners(*arguments, **others):
    """Environments as stable-baselines3 has them."""
    pytest.importorskip("stable_baselines3")
    from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv

    return PassiveWalkerVecEnv(*arguments, **others)


def strides_on(scene="lab", **arguments):
    """Three walkers that take one torque a stride, and their first observations."""
    envs = PassiveWalkerVectorEnv(3, scene, control="stride", **arguments)
    seen, _ = envs.reset(seed=4)
    return envs, seen


def test_a_stride_on_a_slope_that_is_set_is_the_stride_of_that_slope():
    envs, _ = strides_on()
    starts = envs.states
    seen = envs.set_slopes(BUMPY)
    assert seen[:, 7] == pytest.approx(BUMPY) and envs.slopes.tolist() == BUMPY.tolist()
    ends, _, _, _, infos = envs.step(ZEROS)
    there, _ = strides_on()
    there.reset(options={"state": starts, "slope": BUMPY})
    expected, _, _, _, its = there.step(ZEROS)
    assert ends == pytest.approx(expected, abs=1e-6)
    assert infos["gravity_cost"] == pytest.approx(its["gravity_cost"], rel=1e-9)


def slope_and_angle(step):
    """An observation of one's own."""
    return step.slope, step.state.stance


def test_an_observation_of_one_s_own_sees_the_slope_that_is_set():
    envs, before = strides_on(observation=slope_and_angle)
    seen = envs.set_slopes(BUMPY, np.array([True, False, True]))
    expected = np.array([BUMPY[0], 0.036, BUMPY[2]])
    assert before[:, 0] == pytest.approx(0.036) and seen[:, 0] == pytest.approx(expected)
    assert seen[:, 1].tolist() == before[:, 1].tolist()
    assert envs.step(ZEROS)[0][:, 0] == pytest.approx(expected)


def test_slopes_and_walkers_of_each_environment_are_not_those_of_a_scene():
    """A change that would have no effect is refused."""
    for own, changes in (
        ({"slopes": BUMPY}, {"slope": 0.01}),
        ({"slopes": BUMPY}, {"scene": "steep"}),
        ({"walkers": ["C", "lab", "C"]}, {"walker": "lab"}),
        ({"walkers": ["C", "lab", "C"]}, {"scene": "lab"}),
    ):
        envs = PassiveWalkerVectorEnv(3, "lab", **own)
        with pytest.raises(SceneError, match="has no effect, since the environments have"):
            envs.set_scene(**changes)
        envs.set_scene(energy_weight=3.0)
        envs.reset()
        assert envs.scene.energy_weight == 3.0 and [*envs.slopes] == [
            *own.get("slopes", [0.036] * 3)
        ]


def test_a_saved_state_replaces_a_scene_that_has_not_begun(assert_same):
    envs, twin = (PassiveWalkerVectorEnv(3, "lab", max_episode_steps=9) for _ in range(2))
    for each in (envs, twin):
        each.reset(seed=0)
    state = envs.get_state()
    envs.set_scene(slope=0.02)
    envs.set_state(state)
    assert not envs.scene_changes and envs.scene == twin.scene
    for _ in range(10):
        assert_same(envs.step(ZEROS)[:4], twin.step(ZEROS)[:4])


def test_a_slope_stays_until_the_next_reset():
    envs, _ = strides_on()
    envs.set_slopes(BUMPY)
    seen, *_ = envs.step(ZEROS)
    assert seen[:, 7] == pytest.approx(BUMPY)
    seen, _ = envs.reset()
    assert seen[:, 7] == pytest.approx(0.036)


def test_the_ground_does_not_change_in_the_midst_of_a_stride():
    envs = PassiveWalkerVectorEnv(3, "lab")
    with pytest.raises(ResetNeeded):
        envs.set_slopes(0.05)
    envs.reset(seed=0)
    envs.step(ZEROS)
    before = envs.get_state()
    with pytest.raises(ValueError, match=r"are walkers \[0, 2\]"):
        envs.set_slopes(0.05, np.array([True, False, True]))
    assert np.array_equal(envs.get_state()["ledger"], before["ledger"])
    assert np.array_equal(envs.get_state()["records"], before["records"])


def test_a_walker_whose_time_is_up_has_no_stride_to_begin():
    envs, _ = strides_on(max_episode_steps=1)
    assert envs.step(ZEROS)[3].all()
    with pytest.raises(ValueError, match=r"are walkers \[0, 1, 2\]"):
        envs.set_slopes(0.05)


def test_a_fallen_walker_has_no_stride_to_begin(make):
    env = make(scene="lab")
    env.reset(seed=0, options={"state": [0.01, -0.01, -0.01, -0.1, 0.0, 0.0]})
    while not env.step(np.ones(1))[2]:
        pass
    with pytest.raises(ResetNeeded):
        env.set_slope(0.03)


@pytest.mark.parametrize("slopes", [2.0, np.nan, "steep", [0.1, 0.2], [[0.1, 0.1, 0.1]]])
def test_what_is_no_slope_is_refused(slopes):
    envs, _ = strides_on()
    with pytest.raises(ValueError, match="slope"):
        envs.set_slopes(slopes)
    assert envs.slopes == pytest.approx(0.036)


@pytest.mark.parametrize(
    ("mask", "error"),
    [([True] * 3, TypeError), (np.ones(3), TypeError), (np.ones(2, bool), ValueError)],
)
def test_masks_are_boolean_arrays_of_all_environments(mask, error):
    envs, _ = strides_on()
    with pytest.raises(error, match="mask"):
        envs.set_slopes(0.05, mask)


def test_one_walker_alone_meets_the_ground_that_it_meets_in_a_batch(make, assert_same):
    envs, _ = strides_on()
    env = make(scene="lab", control="stride")
    env.reset(seed=5)
    for slope in (0.05, 0.03, 0.04):
        assert_same(env.set_slope(slope), envs.set_slopes([0.02, slope, 0.03])[1])
        alone, many = env.step(np.zeros(1)), envs.step(ZEROS)
        assert_same(alone[0], many[0][1])
        assert alone[1] == many[1][1]


def costs(envs, torques):
    """What the first stride's motor was charged for, in each of three environments."""
    _, _, _, _, infos = envs.step(torques)
    return infos["hip_cost"], infos["net_hip_cost"]


def test_the_price_of_a_motor_can_change():
    torques = np.full((3, 1), -0.2)  # brakes: net work is negative
    charged = {}
    for energy in ("absolute", "positive", "net"):
        envs, _ = strides_on()
        envs.set_energy_cost(energy)
        assert envs.energy_cost == energy
        charged[energy], net = costs(envs, torques)
        its = costs(strides_on(energy=energy)[0], torques)[0]
        assert np.array_equal(charged[energy], its)
    assert charged["net"] == pytest.approx(net)
    assert charged["positive"] == pytest.approx(0.5 * (charged["absolute"] + net))


def test_none_is_the_price_of_the_scene(make):
    for world in (make(scene="lab", energy="net"), learners(2, "lab", energy="net")):
        world.set_energy_cost("positive")
        world.set_energy_cost(None)
        charged = (
            world.get_attr("energy_cost")[0] if hasattr(world, "get_attr") else world.energy_cost
        )
        assert charged == "net"


def test_a_price_stays_until_the_scene_or_its_energy_is_given(make):
    """As a schedule sets it, while a curriculum changes the scene."""
    for world in (make(), PassiveWalkerVectorEnv(2), learners(2)):

        def cost(world=world):
            return (
                world.get_attr("energy_cost")[0] if hasattr(world, "lanes") else world.energy_cost
            )

        for price, scene, changes, later in (
            ("positive", None, {"slope": 0.01}, "positive"),
            ("positive", None, {"energy": "absolute"}, "absolute"),
            ("positive", None, {"energy": "net", "tick": 0.2}, "net"),
            (None, None, {"tick": 0.1}, "net"),
            ("positive", "lab", {}, "absolute"),
        ):
            world.set_energy_cost(price)
            world.set_scene(scene, **changes)
            world.set_scene(energy_weight=3.0)
            world.reset()
            assert cost() == later


def test_an_unknown_price_is_refused(make):
    env = make()
    with pytest.raises(ValueError, match="money"):
        env.set_energy_cost("money")
    assert env.energy_cost == "absolute"


def test_footholds_tilt_by_as_much_on_a_slope_that_is_set():
    tilted = {"rough": {"height_std": 0.0, "slope_std": 0.02}}
    envs, _ = strides_on(terrain=tilted)
    envs.set_slopes(BUMPY)
    envs.step(ZEROS)
    tilts = envs.batch.disturbances.states["tilt"].copy()
    assert np.all(tilts != 0.0)
    seen = envs.set_slopes(BUMPY[::-1].copy())
    np.testing.assert_allclose(seen[:, 7], BUMPY[::-1] + tilts, rtol=1e-6)
    ground = envs.batch.records["ground"][:, 0]
    np.testing.assert_allclose(np.arctan2(*ground[:, :2].T), BUMPY[::-1] + tilts, atol=1e-12)
