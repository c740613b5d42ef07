"""SHAC on learned derivatives: the model of steps, and its derivatives beside the engine's."""

from itertools import pairwise

import numpy as np
import pytest
import torch

from agents import envs
from agents.config import ConfigError, configure
from agents.first_order import Taped, backwards
from agents.learned_steps import LearnedSteps, StepModel, Watched, stands
from agents.learner import build, restore_weights
from gym_passive_walker import load_policy
from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv
from gym_passive_walker.gaits.scenes.scene import SceneError
from gym_passive_walker.torch.linearization import StepRecorder
from tests.own.statements import DRIVEN

WALKERS, STEPS = 32, 32


def cubic(rng, inputs, outputs):
    """A random function of degree 3, as a form of (1, inputs)."""
    form = rng.normal(size=(*[1 + inputs] * 3, outputs))

    def function(x):
        ones = torch.cat([torch.ones_like(x[:, :1]), x], 1)
        return torch.einsum("abco,na,nb,nc->no", torch.from_numpy(form), ones, ones, ones)

    return function


def test_a_model_learns_the_derivatives_of_cubic_functions_one_for_each_kind():
    rng = np.random.default_rng(0)
    functions = {1: cubic(rng, 3, 2), 6: cubic(rng, 3, 2)}
    model = StepModel(3, 2)
    for _ in range(5):
        inputs = torch.from_numpy(rng.normal(0.4, 0.5, size=(200, 3)))
        kinds = torch.from_numpy(rng.choice([1, 6], 200))
        outputs = torch.where(kinds[:, None] == 1, functions[1](inputs), functions[6](inputs))
        model.learn(kinds, torch.cat([inputs, outputs], 1))
    assert model.counts.tolist() == [0, *model.counts[[1]].tolist(), 0, 0, 0, 0, *model.counts[6:]]
    assert model.counts.sum() == 1000
    at = torch.from_numpy(rng.normal(0.4, 0.5, size=(50, 3)))
    for kind, function in functions.items():
        expected = torch.stack([torch.autograd.functional.jacobian(function, x[None]) for x in at])
        found = model.derivatives(torch.full((50,), kind), at)
        torch.testing.assert_close(found, expected[:, 0, :, 0], rtol=5e-3, atol=5e-3)


def test_kinds_of_few_steps_have_no_derivative_yet():
    rows = torch.from_numpy(np.random.default_rng(0).normal(size=(40, 5)))
    kinds = torch.tensor([2] * 30 + [3] * 10)
    model = StepModel(3, 2)
    model.learn(kinds, rows)
    assert model.counts.tolist() == [0, 0, 30, 0, 0, 0, 0, 0]
    slopes = model.derivatives(kinds, rows[:, :3])
    assert slopes[:30].abs().min() > 0.0 and not slopes[30:].any()


def walked(scene, horizons, noise=0.2, **changes):
    """Learned and exact derivatives of the last of some horizons, and their environments."""
    native = PassiveWalkerVecEnv(WALKERS, scene, max_episode_steps=60, seed=7, **changes)
    taped, exact = Watched(native), StepRecorder(native)
    policy, rng, seen = load_policy("level-ppo"), np.random.default_rng(0), taped.reset()
    for _ in range(horizons):
        taped.clear()
        exact.clear()
        for _ in range(STEPS):
            actions = policy.predict(seen)[0] + noise * rng.normal(size=(WALKERS, 1))
            exact.record(actions)
            seen, *_ = taped.step(actions.astype(np.float32))
        learned = taped.recorder.linearize()
    return learned, exact.linearize(), taped


def observed(derivatives):
    """Derivatives of and by the state without what is not observed of it, the distance so far."""
    of_states = derivatives.ndim == 4 and derivatives.shape[2] > 1
    return derivatives[:, :, :6] if of_states else derivatives


@pytest.mark.parametrize("energy", ["absolute", "positive", "net"])
def test_learned_derivatives_are_the_engine_s(energy):
    learned, exact, taped = walked("level", 6, energy=energy)
    assert not np.stack(taped.fell).any() and np.stack(taped.ended).any()
    kinds = taped.recorder.model.counts
    assert (kinds[[0, 2, 5, 6]] > 100).all() and kinds.sum() == 6 * WALKERS * STEPS
    for name in ("states_by_action", "rewards_by_action"):
        ours, theirs = observed(getattr(learned, name)), observed(getattr(exact, name))
        errors, size = np.abs(ours - theirs), np.std(theirs)
        assert np.median(errors) < 5e-3 * size and np.quantile(errors, 0.97) < 0.05 * size, name
    # With a locked knee, thigh and shank have the same angle in all states of the training.
    along = np.random.default_rng(1).normal(size=6)
    along[[2, 5]] = along[[1, 4]]
    for name in ("states_by_state", "rewards_by_state"):
        ours, theirs = (observed(getattr(each, name))[..., :6] @ along for each in (learned, exact))
        errors = np.abs(ours - theirs)
        assert np.median(errors) < 0.1 * np.std(theirs), name


def test_falls_have_no_derivative_and_the_strides_before_them_no_distance():
    learned, exact, taped = walked("level", 3, noise=3.0)
    fell, begins = np.stack(taped.fell), np.stack([step[2] for step in taped.recorder._steps])
    assert fell.sum() > 3
    for slopes in learned[:4]:
        assert not slopes[fell].any() and slopes[~fell].any()
    doomed = ~stands(fell, begins) & ~fell
    assert doomed.sum() > 20
    # The price of the torque remains. Distance would add some 0.1 by the stance leg's rate.
    found, none = [], np.zeros((*fell.shape, 1, 6))
    for linear in (learned, exact):
        given = linear, none, none[:, :, 0], np.stack(taped.ended)
        found.append(backwards(*given, gamma=1.0, gae_lambda=1.0))
    (ours, our_costates), (theirs, costates) = found
    assert np.median(np.abs(our_costates - costates)[doomed][:, 3]) < 0.01
    assert np.median(np.abs(ours - theirs)[doomed]) < 0.05 * np.std(theirs)


def test_a_stride_stands_unless_it_ends_in_a_fall():
    rng = np.random.default_rng(1)
    fell, begins = rng.random((40, 7)) < 0.1, rng.random((40, 7)) < 0.3
    found = stands(fell, begins)
    for lane in range(7):
        starts = [0, *(k for k in range(1, 40) if begins[k, lane]), 40]
        for first, end in pairwise(starts):
            for k in range(first, end):
                assert found[k, lane] == (not fell[k:end, lane].any())


def test_each_step_is_learned_once():
    _, _, taped = walked("level", 1)
    model = taped.recorder.model
    sums, counts = model.sums.clone(), model.counts.clone()
    again = taped.recorder.linearize()
    assert torch.equal(model.sums, sums) and torch.equal(model.counts, counts)
    assert again.states_by_action.any()


def test_a_walker_with_other_actions_is_refused():
    config = configure("shac-learned", "level", n_envs=2, env={"actions": ["hip", "push_off"]})
    with pytest.raises(ConfigError, match="driven by the hip alone"):
        build(config, envs.training_envs(config))
    with pytest.raises(SceneError, match="not of a System: choose shac"):
        LearnedSteps(PassiveWalkerVecEnv(2, system=DRIVEN, slope=0.02))


def test_steps_of_another_scene_are_refused():
    envs = PassiveWalkerVecEnv(2, "level")
    recorder = LearnedSteps(envs)
    envs.reset()
    recorder.record(np.zeros(2))
    envs.set_scene(max_hip_torque=0.1)
    envs.reset()
    with pytest.raises(SceneError, match="set_scene has changed it"):
        recorder.record(np.zeros(2))


def test_a_saved_model_has_what_was_learned_of_steps(tmp_path):
    config = configure("shac-learned", "level", n_envs=16)
    models = [build(config, envs.training_envs(config)) for _ in range(2)]
    models[0].learn(16 * config.hyperparams["n_steps"])
    models[0].save(tmp_path / "model.zip")
    restore_weights(models[1], tmp_path / "model.zip")
    learned, restored = (model.env.recorder.model for model in models)
    assert isinstance(models[0].env, Taped) and isinstance(models[0].env.recorder, LearnedSteps)
    for name in ("sums", "scales", "counts"):
        assert torch.equal(getattr(learned, name), getattr(restored, name)), name
    assert learned.counts.sum() > 0
