"""Single updates of learners, and what a checkpoint keeps, field by field."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
import torch

from agents import checkpoint, envs
from agents.config import configure
from agents.learner import build
from agents.networks import _UNITS, Perceptron
from agents.ppo_fast import Rollout, _bring_up


def made(algo="ppo-fast", *, normalize=None, **changes):
    """An untrained agent of four walkers."""
    config = dataclasses.replace(
        configure(algo, "level", n_envs=4), normalize=normalize, exploration=None
    )
    sizes = {"n_steps": 12, "batch_size": 16, "n_epochs": 3}
    model = build(config, envs.training_envs(config), **(sizes | changes))
    callback = model._setup_learn(100, None)[1]
    return model, callback


@pytest.mark.parametrize("unit", _UNITS)
@pytest.mark.parametrize("sizes", [(5, 2), (5, 4, 1), (5, 7, 3, 2)])
def test_gradients_without_autograd_are_those_of_autograd_batch_after_batch(unit, sizes):
    torch.manual_seed(0)
    layers = []
    for before, after in pairwise(sizes):
        layers += [torch.nn.Linear(before, after), unit()]
    net = torch.nn.Sequential(*layers[:-1])
    for parameter in net.parameters():
        parameter.grad = torch.full_like(parameter, 9.0)  # what was there is replaced
    perceptron = Perceptron(net, 6)
    for _ in range(2):
        seen, slope = torch.randn(6, 5), torch.randn(6, sizes[-1])
        expected = net(seen.clone())
        wanted = torch.autograd.grad((expected * slope).sum(), list(net.parameters()))
        with torch.no_grad():
            found = perceptron.forward(seen)
            torch.testing.assert_close(found, expected.detach())
            perceptron.backward(slope.clone())
        for parameter, gradient in zip(net.parameters(), wanted, strict=True):
            torch.testing.assert_close(parameter.grad, gradient, rtol=1e-4, atol=1e-5)


def test_an_update_learns_from_each_step_once_an_epoch_in_shuffled_whole_rows():
    model, _ = made()
    numbers = torch.arange(48.0).view(12, 4)
    rows = Rollout(
        seen=numbers[..., None] + torch.zeros(8), actions=numbers[..., None] + 1000.0,
        chances=numbers + 2000.0, advantages=numbers + 3000.0, returns=numbers + 4000.0,
    )  # fmt: skip
    batches, rates = [], []

    def noted(seen, actions, before, gains, returns):
        batches.append(seen[:, 0].clone())
        parts = (actions, before, gains, returns)
        for k, part in enumerate(parts, 1):
            assert part.shape == (16, 1)
            assert torch.equal(part[:, 0] - 1000.0 * k, seen[:, 0])
        assert seen.shape == (16, 8) and (seen == seen[:, :1]).all()
        model.gradient.zero_()
        model.gradient[0] = 1e-3
        return gains, returns

    model.differentiate = noted
    model._update_current_progress_remaining(25, 100)
    model.policy.optimizer.step = lambda: rates.append(model.policy.optimizer.param_groups[0]["lr"])
    model.update(rows)
    assert len(batches) == 9 and model._n_updates == 3
    epochs = [torch.cat(batches[k : k + 3]) for k in (0, 3, 6)]
    for epoch in epochs:
        assert torch.equal(epoch.sort().values, torch.arange(48.0))
        assert not torch.equal(epoch, torch.arange(48.0))
    assert not torch.equal(epochs[0], epochs[1])
    assert rates == [pytest.approx(model.lr_schedule(0.75))] * 9
    logged = model.logger.name_to_value
    assert logged["train/gain"] == pytest.approx(float(batches[-1].mean()) + 3000.0)
    assert logged["train/value_loss"] == pytest.approx(float(batches[-1].mean()) + 4000.0)
    assert logged["train/std"] == pytest.approx(float(model.policy.log_std.detach().exp().mean()))


def test_rows_are_added_to_running_moments_as_if_all_had_been_seen_at_once():
    from stable_baselines3.common.running_mean_std import RunningMeanStd

    rng = np.random.default_rng(0)
    parts = [rng.normal(k, 1.0 + k, (20 + 7 * k, 3)) for k in range(3)]
    moments, whole = RunningMeanStd(1e-8, (3,)), np.concatenate(parts)
    for part in parts:
        _bring_up(moments, torch.from_numpy(part))
    np.testing.assert_allclose(moments.mean, whole.mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(moments.var, whole.var(axis=0), rtol=1e-6)
    assert moments.count == pytest.approx(len(whole))


@pytest.mark.parametrize("norm_reward", [True, False])
@pytest.mark.parametrize("norm_obs", [True, False])
def test_rewards_are_scaled_by_their_discounted_sums_only_if_asked(norm_obs, norm_reward):
    options = {"norm_obs": norm_obs, "norm_reward": norm_reward, "clip_reward": 1.5}
    model, _ = made(normalize=options, gamma=0.9)
    normalizer = model.get_vec_normalize_env()
    normalizer.returns = np.array([1.0, 2.0, 3.0, 4.0])
    rng = np.random.default_rng(2)
    raw, rewards = rng.normal(2.0, 1.0, (12, 4, 8)), rng.normal(0.5, 1.0, (12, 4))
    ended = rng.random((12, 4)) < 0.3
    before = {
        name: (r.mean.copy(), r.var.copy(), r.count)
        for name in ("obs_rms", "ret_rms") if (r := getattr(normalizer, name, None)) is not None
    }  # fmt: skip
    totals, running = [], normalizer.returns.copy()
    for t in range(12):
        running = 0.9 * running + rewards[t]
        totals.append(running.copy())
        running[ended[t]] = 0.0
    found = model._learn_scales(
        torch.tensor(raw, dtype=torch.float32), torch.tensor(rewards, dtype=torch.float32),
        torch.from_numpy(ended),
    )  # fmt: skip
    if norm_obs:
        mean, _, count = before["obs_rms"]
        mean = (count * mean + raw.reshape(-1, 8).sum(axis=0)) / (count + 48)
        np.testing.assert_allclose(normalizer.obs_rms.mean, mean, rtol=1e-4)
        assert normalizer.obs_rms.count == pytest.approx(before["obs_rms"][2] + 48)
    if not norm_reward:
        np.testing.assert_allclose(found, rewards, rtol=1e-6)
        np.testing.assert_array_equal(normalizer.returns, [1.0, 2.0, 3.0, 4.0])
        return
    np.testing.assert_allclose(normalizer.returns, running, rtol=1e-5, atol=1e-6)
    var = normalizer.ret_rms.var
    assert var == pytest.approx(np.var(totals), rel=0.01)
    scale = np.sqrt(var + normalizer.epsilon)
    wanted = np.clip(rewards / scale, -1.5, 1.5)
    np.testing.assert_allclose(found, wanted, rtol=1e-5, atol=1e-6)


def test_observations_are_scaled_and_clipped_as_the_library_does():
    model, _ = made(normalize={"clip_obs": 0.75, "epsilon": 0.2})
    normalizer, rng = model.get_vec_normalize_env(), np.random.default_rng(0)
    normalizer.obs_rms.mean, normalizer.obs_rms.var = rng.normal(size=8), rng.uniform(0.5, 2.0, 8)
    raw = rng.normal(size=(30, 8)).astype(np.float32)
    found = model._scaling()(torch.from_numpy(raw))
    np.testing.assert_allclose(found, normalizer.normalize_obs(raw), rtol=1e-5, atol=1e-6)
    assert found.abs().max() == 0.75
    for normalize in (None, {"norm_obs": False}):
        plain, _ = made(normalize=normalize)
        assert torch.equal(plain._scaling()(found), found)


@pytest.mark.parametrize("farthest", [0.5, 2.0])
def test_an_advantage_counts_no_more_than_some_usual_ones(farthest):
    """A fall, which is rare, does not set the scale of all others."""
    model, callback = made(n_steps=100, batch_size=100, farthest=farthest)
    rollout = model.walk(callback)
    with torch.no_grad():
        raw = rollout.returns - model.value(rollout.seen)
    assert float(model.most) == pytest.approx(farthest * float(raw.abs().median()), rel=1e-5)
    assert 0 < (raw.abs() > model.most).sum() < 400
    near = raw.clamp(-model.most, model.most)
    wanted = (near - near.mean()) / near.std()
    torch.testing.assert_close(rollout.advantages, wanted, rtol=1e-3, atol=1e-4)


def test_the_critic_moves_by_a_far_return_as_by_one_just_too_far():
    model, _ = made()
    seen, far = torch.randn(16, 8), torch.full((16, 1), 100.0)
    model.most = torch.tensor(0.25)
    with torch.no_grad():
        near = model.critic.forward(seen).clone() + 0.25
        found = []
        for returns in (far, near):
            model._differentiate_critic(seen, returns)
            found.append(model.gradient.clone())
    assert found[0].abs().sum() > 0.0
    torch.testing.assert_close(*found, rtol=1e-4, atol=1e-6)


def test_values_of_a_rollout_are_each_those_of_its_observation():
    model, _ = made()
    seen = torch.randn(12, 4, 8)
    with torch.no_grad():
        net = model.policy
        wanted = net.value_net(net.mlp_extractor.value_net(seen))[..., 0]
        found = model.value(seen)
    torch.testing.assert_close(found, wanted, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("algo", ["ppo", "ppo-fast", "sac", "shac"])
def test_a_checkpoint_keeps_each_counter_each_moment_and_each_episode(algo, tmp_path):
    config = dataclasses.replace(configure(algo, "level", n_envs=4), exploration=None)
    sizes = {"buffer_size": 40} if algo == "sac" else {"n_steps": 12, "batch_size": 16}
    one, other = (build(config, envs.training_envs(config), **sizes) for _ in "ab")
    for model in (one, other):
        model._setup_learn(100, None)
    one.num_timesteps, one._n_updates, one._episode_num = 123, 45, 67
    infos = [{"r": 1.5, "l": 20, "t": 3.25}, {"r": -2.0, "l": 7, "t": 4.5}]
    one.ep_info_buffer.extend(infos)
    normalizer, theirs = one.get_vec_normalize_env(), other.get_vec_normalize_env()
    rng = np.random.default_rng(0)
    normalizer.returns = rng.normal(size=4)
    for name in ("obs_rms", "ret_rms"):
        running = getattr(normalizer, name, None)
        if running is not None:
            running.mean = rng.normal(size=np.shape(running.mean))
            running.var = rng.uniform(1.0, 2.0, np.shape(running.var))
            running.count = 77.5
    one._last_obs = rng.normal(size=(4, 8)).astype(np.float32)
    one._last_episode_starts = np.array([True, False, True, False])
    row = {"steps": 1, "seconds": 0.5, "reward": 2.0, "distance": 1.0, "hundred_strides": 0.0}
    curve = [row | {"reached_time_limit": 0.5}]
    notes = {"best": 3.5, "seconds": 12.25, "curve": curve, "more": 1}
    checkpoint.save(tmp_path / "kept", one, notes)
    found = checkpoint.restore(tmp_path / "kept", other)
    assert found == {name: notes[name] for name in ("best", "seconds", "curve")}
    for name in ("num_timesteps", "_n_updates", "_episode_num"):
        assert getattr(other, name) == getattr(one, name)
    assert list(other.ep_info_buffer) == infos
    assert other.ep_info_buffer.maxlen == one.ep_info_buffer.maxlen
    assert len(other.ep_success_buffer) == 0
    for name in ("_last_obs", "_last_episode_starts", "_last_original_obs"):
        ours, kept = getattr(one, name), getattr(other, name)
        assert (ours is None and kept is None) or np.array_equal(ours, kept), name
    np.testing.assert_array_equal(theirs.returns, normalizer.returns)
    for name in ("obs_rms", "ret_rms"):
        for part in ("mean", "var", "count"):
            if hasattr(normalizer, name):
                ours, kept = (getattr(getattr(env, name), part) for env in (normalizer, theirs))
                np.testing.assert_array_equal(ours, kept, err_msg=f"{name}.{part}")
    ours, kept = (model.policy.state_dict() for model in (one, other))
    assert all(torch.equal(ours[name], kept[name]) for name in ours)
    assert not any(path.name.startswith(".") for path in tmp_path.iterdir())


@pytest.mark.parametrize(("updates", "heard"), [(0, 0.0), (15, 0.5), (30, 1.0), (10**6, 1.0)])
def test_shac_fits_each_state_once_an_epoch_to_an_action_along_its_gradient(updates, heard):
    model, callback = made("shac", reach=0.3)
    model.collect_rollouts(model.env, callback, model.rollout_buffer, 12)
    rows, rng = 48, np.random.default_rng(0)
    gains, costates = rng.normal(size=(12, 4, 1)), rng.normal(size=(12, 4, 6))
    shown = np.tile(np.eye(8, 6), (12, 4, 1, 1))
    gains[0, 0] = 1e4  # an action no farther than its bound
    seen = torch.as_tensor(model.rollout_buffer.observations).clone()
    returns = model.rollout_buffer.returns.copy()
    before = model.action(seen).detach().numpy()
    batches = []
    model._gradients = lambda observations: (gains, costates, shown)
    model._fit = lambda *batch: batches.append([x.clone() for x in batch])
    model._n_updates = updates
    model.train()
    assert model._n_updates == updates + 3 and [len(b[0]) for b in batches] == [16] * 9
    index = {tuple(row.tolist()): k for k, row in enumerate(seen.reshape(rows, -1))}
    shares = []
    for epoch in (batches[:3], batches[3:6], batches[6:]):
        places = []
        for observations, actions, values, slopes, directions, falls in epoch:
            own = [index[tuple(row.tolist())] for row in observations]
            places += own
            np.testing.assert_allclose(values, returns.reshape(-1)[own], rtol=1e-6)
            np.testing.assert_allclose(slopes, costates.reshape(rows, 6)[own], rtol=1e-6)
            np.testing.assert_array_equal(directions[0], np.eye(8, 6))
            assert falls.shape == values.shape and ((falls >= 0.0) & (falls <= 1.0)).all()
            moved = actions.numpy()[:, 0] - before.reshape(-1)[own]
            small = np.abs(gains.reshape(-1)[own]) < 100.0
            shares += (moved / (0.3 * gains.reshape(-1)[own]))[small].tolist()
            assert actions.abs().max() <= np.float32(1.2)
        assert sorted(places) == list(range(rows)) and places != sorted(places)
    assert np.ptp(shares) < 1e-3  # one share for all
    assert np.mean(shares) == pytest.approx(heard, abs=1e-3)  # over the first ten horizons
