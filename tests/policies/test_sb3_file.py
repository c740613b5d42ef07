"""Files of stable-baselines3 act like their models."""

import json
import shutil
import zipfile

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw

torch = pytest.importorskip("torch")
sb3 = pytest.importorskip("stable_baselines3")

from stable_baselines3.common.vec_env import VecNormalize  # noqa: E402

from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv  # noqa: E402

SHORT = {"PPO": {"n_steps": 8, "batch_size": 8}, "A2C": {}, "SAC": {"buffer_size": 9}}


def model_of(algo, scene="level", **options):
    """An untrained model."""
    env = gym.make("PassiveWalker-v0", scene=scene)
    model = getattr(sb3, algo)("MlpPolicy", env, seed=3, device="cpu", **SHORT[algo], **options)
    with torch.no_grad():
        for name, weights in model.policy.named_parameters():
            if "action_net" in name or "mu" in name:
                weights.mul_(3.0 if algo == "SAC" else 40.0)
    return model


@pytest.mark.parametrize("algo", SHORT)
@pytest.mark.parametrize("activation", [None, "ELU", "ReLU", "Tanh", "SiLU"])
def test_a_file_acts_as_its_model(algo, activation, tmp_path):
    kwargs = {"net_arch": [16, 8]}
    if activation:
        kwargs["activation_fn"] = getattr(torch.nn, activation)
    model = model_of(algo, policy_kwargs=kwargs)
    model.save(tmp_path / "model.zip")
    policy = gpw.load_policy(tmp_path / "model.zip")
    seen = np.random.default_rng(0).normal(0.0, 1.0, (200, 8)).astype(np.float32)
    expected, _ = model.predict(seen, deterministic=True)
    assert np.max(np.abs(policy.predict(seen)[0] - expected)) < 2e-6
    assert 0.05 < np.mean(np.abs(expected) < 0.99) and np.std(expected) > 0.05
    assert policy.name == "model.zip" and policy.scene is None


def test_a_file_of_sac_with_push_off_acts_as_its_model(tmp_path):
    model = model_of("SAC", {"walker": "D", "actions": ("hip", "push_off")})
    model.save(tmp_path / "model.zip")
    seen = np.random.default_rng(0).normal(0.0, 1.0, (200, 8)).astype(np.float32)
    expected, _ = model.predict(seen, deterministic=True)
    found, _ = gpw.load_policy(tmp_path / "model.zip").predict(seen)
    assert np.max(np.abs(found - expected)) < 2e-6
    assert found[:, 0].min() < -0.1 and 0.0 < found[:, 1].min() < 0.4


@pytest.mark.parametrize("scales", [True, False])
def test_a_model_walks_with_its_own_normalizer(scales):
    normalizer = VecNormalize(PassiveWalkerVecEnv(1, "lab"), norm_obs=scales)
    model = sb3.PPO("MlpPolicy", normalizer, seed=3, device="cpu", **SHORT["PPO"])
    if scales:
        normalizer.obs_rms.mean[:], normalizer.obs_rms.var[:] = 0.3, 0.01

    def acting(observation):
        return model.predict(normalizer.normalize_obs(observation), deterministic=True)[0]

    walks = {"episodes": 1, "max_episode_steps": 40, "beside": (), "time_limit": 0.0}
    found = (gpw.evaluate(x, "lab", **walks).summary().values() for x in (model, acting))
    (one,), (other,) = found
    assert one["reward"] == pytest.approx(other["reward"], rel=1e-12)


def test_a_file_acts_in_every_analysis_and_has_derivatives(tmp_path):
    model, path = model_of("PPO", "steep"), str(tmp_path / "model.zip")
    model.save(path)
    strides = gpw.stride_map(controller=path, scene="steep")
    assert strides.exact and strides.scene.control == "stride"
    score, expected = (gpw.gauntlet(which, "steep", walkers=4) for which in (path, model))
    assert np.max(np.abs(score.survival - expected.survival)) <= 0.25
    own = "own scene"
    assert score.episodes[own].distance == pytest.approx(expected.episodes[own].distance, rel=1e-3)
    with pytest.raises(ValueError, match="say in which scene"):
        gpw.gauntlet(path)
    with pytest.raises(ValueError, match=r"\(n, 8\), not \(64, 12\)"):
        gpw.gauntlet(path, "rough")


def changed(path, **values):
    """Change entries of a file's description."""
    with zipfile.ZipFile(path) as file:
        parts = {name: file.read(name) for name in file.namelist()}
    about = json.loads(parts["data"]) | values
    with zipfile.ZipFile(path, "w") as file:
        for name, content in (parts | {"data": json.dumps(about)}).items():
            file.writestr(name, content)


def test_files_that_say_too_little_are_refused(tmp_path):
    path = tmp_path / "model.zip"
    with pytest.raises(gpw.PolicyError, match=r"model.zip cannot be read: No such file"):
        gpw.load_policy(path)
    path.write_bytes(b"no file")
    with pytest.raises(gpw.PolicyError, match=r"not a zip file; give .*unless you trust"):
        gpw.load_policy(path)
    refused = {
        "noise that depends on the state": model_of("PPO", use_sde=True),
        "LeakyReLU|activation": model_of("PPO", policy_kwargs={"activation_fn": torch.nn.GELU}),
    }
    for words, model in refused.items():
        model.save(path)
        with pytest.raises(gpw.PolicyError, match=words):
            gpw.load_policy(path)
    for algo in ("SAC", "PPO"):  # of actions that a wrapper scales
        model_of(algo).save(path)
        changed(path, action_space={"low": "[-2.]", "high": "[2.]"})
        with pytest.raises(gpw.PolicyError, match=r"actions are from \[-2.0\] to \[2.0\]"):
            gpw.load_policy(path)
    sb3.TD3("MlpPolicy", gym.make("PassiveWalker-v0"), buffer_size=9).save(path)
    with pytest.raises(gpw.PolicyError, match=r"none of PPO, A2C and SAC|other layers"):
        gpw.load_policy(path)
    model_of("PPO").save(path)
    changed(path, policy_class={"__module__": "mine.networks"})
    with pytest.raises(gpw.PolicyError, match=r"a class of mine\.networks"):
        gpw.load_policy(path)
    model_of("PPO").save(path)
    changed(path, policy_kwargs={"activation_fn": "<class 'mine.ReLU'>"})
    with pytest.raises(gpw.PolicyError, match=r"function is none of ReLU.* of torch\.nn"):
        gpw.load_policy(path)


def test_a_normalizer_in_another_file_is_not_forgotten(tmp_path):
    (tmp_path / "run").mkdir()
    model_of("PPO").save(tmp_path / "run" / "model.zip")
    gpw.load_policy(tmp_path / "run" / "model.zip")
    (tmp_path / "run" / "normalizer.npz").touch()
    with pytest.raises(gpw.PolicyError, match=r"train.py export .*run FOLDER"):
        gpw.load_policy(tmp_path / "run" / "model.zip")
    shutil.copy(tmp_path / "run" / "model.zip", tmp_path / "alone.zip")
    gpw.load_policy(tmp_path / "alone.zip")
