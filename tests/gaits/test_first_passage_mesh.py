"""Mean first-passage times by a mesh of states: of chains that are known, and of walkers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.torso import TORSO
from gym_passive_walker.gaits.control.baselines import LinearFeedback
from gym_passive_walker.gaits.flow import Walkers
from gym_passive_walker.gaits.robust import first_passage_mesh as module
from gym_passive_walker.gaits.robust.first_passage import SETTLING, FirstPassage, survivors
from gym_passive_walker.gaits.robust.first_passage_mesh import MeshPassage, mesh_passage
from gym_passive_walker.gaits.scenes.scene import make_scene

SLOPE = 0.036


class Autoregression(module.Chain):
    """x' = a x + n with normal n, which ends where |x'| exceeds a limit."""

    def __init__(self, memory: float, limit: float) -> None:
        self.memory, self.limit, self.gait, self.strides = memory, limit, np.zeros(1), 0
        self.std = 1.0 / math.sqrt(1.0 - memory**2)

    def step(self, states, heights):
        """Return the next states, and which of them have not ended."""
        ends = self.memory * states + heights[:, None]
        return ends, np.abs(ends[:, 0]) < self.limit

    def place(self, states):
        """In standard deviations."""
        return states / self.std

    def known(self) -> float:
        """The mean first-passage time, by quadrature of the transition density."""
        points, weights = np.polynomial.legendre.leggauss(400)
        x, weights = self.limit * points, self.limit * weights
        density = np.exp(-0.5 * (x[None] - self.memory * x[:, None]) ** 2) / math.sqrt(2 * math.pi)
        return 1.0 / (1.0 - np.abs(np.linalg.eigvals(density * weights)).max())


@pytest.mark.parametrize(
    ("memory", "limit"), [(0.3, 2.0), (0.5, 3.0), (0.8, 5.0), (0.9, 8.0), (0.5, 6.0)]
)
def test_the_mean_of_a_known_chain_is_that_of_its_eigenvalue(memory, limit):
    chain = Autoregression(memory, limit)
    found = module._passage(chain, 0.01, 0)
    assert 0.0 < found.error <= 0.01 * found.mean
    assert found.mean == pytest.approx(chain.known(), abs=3.5 * found.error)


def test_intervals_contain_the_mean_of_a_known_chain_95_times_of_a_hundred():
    chain = Autoregression(0.5, 3.0)
    known = chain.known()
    mesh, _ = module._mesh(chain, 200, math.log(known) + 7.0, 1.0)
    found = []
    for seed in range(60):
        rate, error = module._rate_of_falls(chain, mesh, 0.03, seed)
        found.append(MeshPassage(1.0 / rate, error / rate**2, mesh.size, 1))
    off = np.array([(one.mean - known) / one.error for one in found])
    assert abs(off.mean()) < 3.5 / math.sqrt(60) and 0.7 < off.std() < 1.4
    inside = [one.interval[0] < known < one.interval[1] for one in found]
    assert 51 <= sum(inside)  # 57 on average; fewer than 51 in one of a thousand tests


def test_a_mean_by_a_coarse_mesh_is_the_same_within_its_error(monkeypatch):
    chain = Autoregression(0.8, 5.0)
    monkeypatch.setattr(module, "_STATES", 20)
    coarse = module._passage(chain, 0.02, 1)
    assert coarse.states < 80
    assert coarse.mean == pytest.approx(chain.known(), abs=3.5 * coarse.error)


def test_known_chains_last_from_tens_of_strides_to_more_than_a_million():
    assert Autoregression(0.0, 2.0).known() == pytest.approx(1.0 / math.erfc(math.sqrt(2.0)))
    assert Autoregression(0.5, 6.0).known() > 1e6


def lab_map(slope: float = SLOPE):
    return gpw.stride_map("lab", slope), gpw.find_gait("lab", slope).state


def test_a_mesh_agrees_with_walkers_that_fall():
    strides, state = lab_map()
    ground = gpw.rough(height_std=0.002)
    left = survivors(
        Walkers(walker=strides.walker, tolerance=1e-8),
        strides.walker.units.to_dimensionless(state), SLOPE, ground, walkers=4000,
        strides=SETTLING + 100,
    )  # fmt: skip
    sampled = FirstPassage.of(left)
    found = mesh_passage(strides, state, ground)
    assert abs(found.mean - sampled.mean) < 3.0 * math.hypot(found.error, sampled.error)
    assert 1000 <= found.states < 4000 and found.strides > 33 * found.states
    assert found == mesh_passage(strides, state, ground)
    again = mesh_passage(strides, state, ground, seed=1)
    assert 0.0 < abs(again.mean - found.mean) < 4.0 * math.hypot(found.error, again.error)
    smoother = mesh_passage(strides, state, gpw.rough(height_std=0.0008), error=0.1)
    assert smoother.mean > 1e5 and smoother.error <= 0.1 * smoother.mean


def test_a_mesh_takes_a_system_of_ones_own():
    strides = gpw.stride_map(TORSO, 0.03)
    assert strides.chart.balance is None
    found = mesh_passage(strides, gpw.find_gait(strides).state, gpw.rough(0.001), error=0.05)
    asked: Any = dict(slope=0.03, roughness=0.001, strides=60, starts=2)
    sampled = gpw.robustness(TORSO, walkers=1000, **asked).first_passage
    assert abs(found.mean - sampled.mean) < 3.0 * math.hypot(found.error, sampled.error)


def test_ground_on_which_no_state_is_near_a_fall_lasts_for_ever(monkeypatch):
    monkeypatch.setattr(module, "_MOST", 200_000)  # the strides after which it gives up
    strides, state = lab_map()
    found = mesh_passage(strides, state, gpw.rough(height_std=1e-5))
    assert math.isinf(found.mean) and found.interval == (math.inf, math.inf)
    assert "near a fall" in str(found)


def test_where_all_walkers_fall_at_once_the_first_passage_is_to_be_sampled():
    with pytest.raises(ValueError, match="sample the first passage"):
        module._passage(Autoregression(0.0, 1e-3), 0.02, 0)


@pytest.mark.parametrize("error", [0.0, 1.0, -0.1, math.nan])
def test_an_error_must_be_a_share(error):
    with pytest.raises(ValueError, match="error"):
        mesh_passage(*lab_map(), gpw.rough(0.002), error=error)


@pytest.mark.parametrize(
    "ground", [gpw.rough(slope_std=0.01), gpw.rough(0.0), gpw.stairs(0.01), gpw.rough(0.01, 0.01)]
)
def test_ground_must_have_random_heights_alone(ground):
    with pytest.raises(ValueError, match="random heights alone"):
        mesh_passage(*lab_map(), ground)


def test_a_mesh_has_ground_of_its_own():
    strides = gpw.stride_map("lab", SLOPE, terrain=gpw.waves(0.001, 4))
    with pytest.raises(ValueError, match="map of smooth ground"):
        mesh_passage(strides, lab_map()[1], gpw.rough(0.002))


def test_an_unstable_gait_is_refused():
    gait = gpw.find_gait("E", 0.009)
    with pytest.raises(ValueError, match="stable gait"):
        mesh_passage(gpw.stride_map("E", 0.009), gait.state, gpw.rough(1e-4))


def test_a_controller_that_observes_many_footholds_is_refused():
    feedback = LinearFeedback("steep")
    feedback.scene = make_scene("steep", terrain=gpw.rough(1e-3), terrain_lookahead=3)
    strides = gpw.stride_map(controller=feedback)
    with pytest.raises(ValueError, match="at most 2 footholds"):
        mesh_passage(strides, feedback.gait.state, gpw.rough(1e-3))


class Remembers:
    """Does nothing, and remembers it."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """Idle actions and a memory."""
        return 0.0 * observation[:, :1], (np.ones(1),)


@pytest.mark.parametrize(
    ("controller", "scene", "match"),
    [
        (Remembers(), "lab", "Remembers remembers"),
        ("lab-ppo", {"walker": "lab", "slope": SLOPE, "action_delay": 1}, "action_delay=1"),
    ],
)
def test_a_stride_must_depend_on_its_beginning_alone(controller, scene, match):
    with pytest.raises(ValueError, match=match):
        gpw.robustness(controller, scene, first_passage="mesh", starts=2)


def test_robustness_takes_the_mean_of_a_mesh():
    found = gpw.robustness("lab", slope=SLOPE, first_passage="mesh", strides=30, starts=8)
    assert isinstance(found.first_passage, MeshPassage)
    share = 1.0 - 1.0 / found.first_passage.mean
    np.testing.assert_allclose(found.survivors, share ** np.arange(1, 31))
    assert f"{found.first_passage} there" in str(found)
    with pytest.raises(ValueError, match='"sampled" or "mesh"'):
        gpw.robustness("lab", slope=SLOPE, first_passage="meshed")  # type: ignore[arg-type]


def test_actions_without_derivatives_are_those_with():
    policy = gpw.load_policy("rough-ppo")
    seen = np.random.default_rng(0).normal(size=(20, policy._size))
    np.testing.assert_array_equal(policy.mean_actions(seen), policy.linearize(seen)[0])
