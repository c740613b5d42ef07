"""A policy in NumPy acts as in stable-baselines3."""

import json
import pickle
import shutil

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.envs.policies import DESCRIPTION, TENSORS, policy_folder
from gym_passive_walker.envs.policies.network import ACTIVATIONS, Network
from gym_passive_walker.envs.policies.tensors import read_tensors
from gym_passive_walker.gaits.scenes.scene import make_scene

ROUNDING = 2e-6
"""Tolerance of actions: some roundings in single precision."""


@pytest.fixture(scope="module")
def observations():
    """Observations of walkers, and some numbers beyond."""
    rng = np.random.default_rng(3)
    seen = rng.normal(0.0, 1.0, (200, 8)).astype(np.float32)
    seen[:5] *= 50.0
    return seen


@pytest.fixture
def exported(tmp_path):
    """Export an untrained policy, and load it from its files."""
    pytest.importorskip("stable_baselines3")
    torch = pytest.importorskip("torch")
    from agents.config import configure
    from agents.envs import training_envs
    from agents.learner import LearnedPolicy, build, export

    def make(algo, activation="nn.ReLU", normalize=None, layers=(32, 16)):
        config = configure(algo, "level", n_envs=2, seed=5)
        kwargs = {"net_arch": list(layers), "activation_fn": activation}
        config.hyperparams["policy_kwargs"] = kwargs
        if normalize is not None:  # what SHAC earns is left as it is
            normalize = {"norm_reward": False} | normalize
        object.__setattr__(config, "normalize", normalize)
        model = build(config, training_envs(config))
        with torch.no_grad():  # an untrained network of PPO hardly acts
            for name, weights in model.policy.named_parameters():
                if "action_net" in name or "mu" in name:
                    weights.mul_(3.0 if algo == "sac" else 40.0)
        normalizer = model.get_vec_normalize_env()
        if normalizer is not None and normalizer.norm_obs:
            rng = np.random.default_rng(0)
            normalizer.obs_rms.mean = rng.normal(0.0, 0.3, 8)
            normalizer.obs_rms.var = rng.uniform(0.01, 2.0, 8)
        original = LearnedPolicy(model, algo.upper())
        export(original, config, tmp_path / algo)
        return original, gpw.load_policy(tmp_path / algo)

    return make


@pytest.mark.parametrize("algo", ["ppo", "ppo-fast", "sac", "shac", "shac-learned"])
@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize(
    "normalize", [None, {}, {"norm_obs": False}, {"clip_obs": 2.0, "epsilon": 0.1}]
)
def test_it_acts_as_stable_baselines3_does(exported, observations, algo, activation, normalize):
    original, policy = exported(algo, f"nn.{activation}", normalize)
    expected, _ = original.predict(observations)
    actions, state = policy.predict(observations)
    assert state is None and actions.dtype == expected.dtype == np.float32
    assert actions.shape == expected.shape == (200, 1)
    assert np.max(np.abs(actions - expected)) < ROUNDING
    assert 0.05 < np.mean(np.abs(actions) < 0.99)  # not all at their bounds
    exact, change = policy.linearize(observations)
    assert np.max(np.abs(exact - actions)) < ROUNDING
    seen, step = observations.astype(float), 1e-7
    for i in range(8):
        way = step * np.eye(8)[i]
        difference = (policy.linearize(seen + way)[0] - policy.linearize(seen - way)[0]) / (
            2.0 * step
        )
        scale = 1.0 + np.abs(change[:, :, i])
        off = np.abs(change[:, :, i] - difference) / scale > 1e-5
        assert off.mean() <= 0.01, i  # where a unit or a bound is just met, there are two slopes
    alone, _ = policy.predict(observations[7])
    assert alone.shape == (1,) and abs(alone[0] - expected[7, 0]) < ROUNDING


@pytest.mark.parametrize("algo", ["ppo", "ppo-fast", "sac", "shac", "shac-learned"])
@pytest.mark.parametrize("layers", [(), (4,), (8, 8, 8), (8,) * 7])
def test_networks_may_be_of_any_depth(exported, observations, algo, layers):
    original, policy = exported(algo, layers=layers)
    expected, actions = (each.predict(observations)[0] for each in (original, policy))
    assert np.max(np.abs(actions - expected)) < ROUNDING


@pytest.mark.parametrize("algo", ["ppo", "ppo-fast", "sac", "shac", "shac-learned"])
def test_noise_is_drawn_as_stable_baselines3_draws_it(exported, observations, algo):
    original, policy = exported(algo)
    policy.random = np.random.default_rng(0)
    calm = np.argmin(np.abs(original.predict(observations)[0][5:])) + 5
    many = np.tile(observations[calm], (20_000, 1))
    theirs, ours = (each.predict(many, deterministic=False)[0] for each in (original, policy))
    assert np.std(ours) > 0.01 and np.max(np.abs(ours)) <= 1.0
    for share in (10, 25, 50, 75, 90):
        drawn = [np.percentile(actions, share) for actions in (theirs, ours)]
        assert drawn[0] == pytest.approx(drawn[1], abs=0.03)


@pytest.mark.parametrize("size", [0.1, 10.0])
def test_sac_s_noise_has_bounds(size):
    """However far from anything seen: from nothing at all to a deviation of exp(2)."""
    tensors = read_tensors(policy_folder("steep-sac") / TENSORS)
    tensors["actor.log_std.weight"] = np.zeros_like(tensors["actor.log_std.weight"])
    tensors["actor.mu.weight"] = np.zeros_like(tensors["actor.mu.weight"])
    tensors["actor.mu.bias"] = np.zeros(1, np.float32)
    tensors["actor.log_std.bias"] = np.full(1, 20.0 * size, np.float32)
    policy = Network(tensors, algo="sac", activation="ReLU", normalizer=None)
    policy.random = np.random.default_rng(0)
    drawn, _ = policy.predict(np.zeros((4000, 8)), deterministic=False)
    # Half of a normal distribution's draws lie within 0.674 deviations.
    assert np.median(np.abs(drawn)) == pytest.approx(np.tanh(0.6745 * np.exp(2.0)), abs=1e-3)
    assert np.mean(np.abs(drawn) < np.tanh(1.0)) == pytest.approx(0.1077, abs=0.02)


def test_its_memory_is_what_it_was_given_and_its_noise_has_a_seed():
    policy, seen = gpw.load_policy("level-ppo"), np.zeros(8)
    assert policy.predict(seen, state=("mine",), episode_start=np.ones(1, bool))[1] == ("mine",)
    drawn = []
    for _ in range(2):
        policy.random = np.random.default_rng(1)
        drawn.append(policy.predict(seen, deterministic=False)[0])
    assert drawn[0] == drawn[1]


def test_a_policy_can_go_to_another_process():
    policy, seen = gpw.load_policy("steep-ppo"), np.full((2, 8), 0.1)
    there = pickle.loads(pickle.dumps(policy))
    assert np.array_equal(there.predict(seen)[0], policy.predict(seen)[0])


@pytest.mark.parametrize("shape", [(), (7,), (3, 9), (2, 2, 8)])
def test_observations_have_eight_numbers(shape):
    with pytest.raises(ValueError, match=r"\(n, 8\)"):
        gpw.load_policy("level-ppo").predict(np.zeros(shape))


def test_tensors_are_those_that_the_formats_own_library_reads():
    library = pytest.importorskip("safetensors.numpy")
    path = policy_folder("steep-sac") / TENSORS
    theirs, ours = library.load_file(path), read_tensors(path)
    assert theirs.keys() == ours.keys()
    for name, tensor in theirs.items():
        assert ours[name].dtype == tensor.dtype and np.array_equal(ours[name], tensor)


def test_tensors_of_every_kind_are_those_that_the_formats_own_library_writes(tmp_path):
    library = pytest.importorskip("safetensors.numpy")
    values = np.random.default_rng(0).integers(-9, 9, (3, 5))
    kinds = (np.float16, np.float32, np.float64, np.int32, np.int64)
    written = {kind.__name__: (values / 2).astype(kind) for kind in kinds}
    library.save_file(written, tmp_path / "kinds.safetensors")
    for name, tensor in read_tensors(tmp_path / "kinds.safetensors").items():
        assert tensor.dtype == written[name].dtype and np.array_equal(tensor, written[name])


def test_a_policy_knows_its_scene_and_how_it_was_trained(tmp_path):
    pytest.importorskip("stable_baselines3")
    from agents.config import configure
    from agents.envs import training_envs
    from agents.learner import LearnedPolicy, build, export

    config = configure("ppo", "lab", env={"slope": 0.05, "walker": "C"}, n_envs=2, seed=8)
    export(LearnedPolicy(build(config, training_envs(config)), "PPO"), config, tmp_path)
    policy = gpw.load_policy(tmp_path)
    assert policy.scene == make_scene("lab", slope=0.05, walker="C")
    assert policy.trained["seed"] == 8 and policy.trained["steps"] == config.steps


@pytest.fixture
def copy(tmp_path):
    """A copy of a policy's folder, to be damaged."""
    return shutil.copytree(policy_folder("level-ppo"), tmp_path / "copy")


@pytest.mark.parametrize("left", [0, 4, 8, 100, 20_000])
def test_a_file_that_was_cut_short_is_refused(copy, left):
    whole = (copy / TENSORS).read_bytes()
    (copy / TENSORS).write_bytes(whole[:left])
    with pytest.raises(gpw.PolicyError, match="damaged"):
        gpw.load_policy(copy)


@pytest.mark.parametrize(
    "header", ["[1]", '{"a": 1}', '{"a": {"dtype": "F32"}}', "nonsense", '"text"',
               '{"a": {"dtype": "F9", "shape": [1], "data_offsets": [0, 4]}}',
               '{"a": {"dtype": "F32", "shape": [-1], "data_offsets": [4, 0]}}'],
)  # fmt: skip
def test_a_header_that_says_nonsense_is_refused(copy, header):
    text = header.encode()
    (copy / TENSORS).write_bytes(len(text).to_bytes(8, "little") + text + bytes(8))
    with pytest.raises(gpw.PolicyError, match="damaged"):
        gpw.load_policy(copy)


def test_a_missing_file_is_named(copy):
    (copy / TENSORS).unlink()
    with pytest.raises(gpw.PolicyError, match=TENSORS):
        gpw.load_policy(copy)
    (copy / DESCRIPTION).unlink()
    with pytest.raises(gpw.PolicyError, match=DESCRIPTION):
        gpw.load_policy(copy)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"algo": "dqn"}, "ppo, ppo-fast, sac"),
        ({"algo": "sac"}, "actor"),
        ({"activation": "Sine"}, "ReLU"),
        ({"scene": "moon"}, "moon"),
        ({"normalizer": {"clip": 10.0}}, "epsilon"),
        ({"env": {"wings": 2}}, "wings"),
    ],
)
def test_a_description_that_does_not_fit_is_refused(copy, changes, words):
    description = json.loads((copy / DESCRIPTION).read_text())
    (copy / DESCRIPTION).write_text(json.dumps(description | changes))
    with pytest.raises(gpw.PolicyError, match=words):
        gpw.load_policy(copy)


@pytest.mark.parametrize("text", ["", "{", "[]", "{}"])
def test_a_description_that_is_none_is_refused(copy, text):
    (copy / DESCRIPTION).write_text(text)
    with pytest.raises(gpw.PolicyError, match="copy"):
        gpw.load_policy(copy)


@pytest.mark.parametrize(
    ("name", "shape"),
    [
        ("mlp_extractor.policy_net.2.weight", (64, 63)),
        ("mlp_extractor.policy_net.0.bias", (63,)),
        ("action_net.weight", (1, 63)),
        ("log_std", (2,)),
        ("normalizer.obs_rms.mean", (7,)),
    ],
)
def test_tensors_that_do_not_fit_together_are_refused(name, shape):
    tensors = read_tensors(policy_folder("level-ppo") / TENSORS)
    tensors[name] = np.zeros(shape, np.float32)
    with pytest.raises(ValueError, match=r"fit|match|noise|observations"):
        Network(tensors, algo="ppo", activation="ReLU", normalizer={"epsilon": 1e-8, "clip": 10.0})


def test_tensors_with_metadata_in_their_header_are_read(tmp_path):
    """Files of the safetensors library may have such an entry, which is no tensor."""
    numbers = np.arange(6, dtype="<f4").reshape(2, 3)
    header = {
        "__metadata__": {"format": "pt"},
        "weights": {"dtype": "F32", "shape": [2, 3], "data_offsets": [0, 24]},
    }
    text = json.dumps(header).encode()
    path = tmp_path / "some.safetensors"
    path.write_bytes(len(text).to_bytes(8, "little") + text + numbers.tobytes())
    found = read_tensors(path)
    assert list(found) == ["weights"]
    np.testing.assert_array_equal(found["weights"], numbers)
