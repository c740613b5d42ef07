"""Policies against a network written plainly, and what else their files determine."""

import json
import shutil
from itertools import pairwise

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.envs.policies import (
    DESCRIPTION,
    TENSORS,
    TrainedPolicy,
    policy_folder,
    shipped_policies,
)
from gym_passive_walker.envs.policies.network import ACTIVATIONS, Network
from gym_passive_walker.envs.policies.tensors import read_tensors
from gym_passive_walker.gaits.scenes.scene import make_scene

SIZE, MOTORS = 5, 3
PLAIN = {
    "ReLU": lambda x: max(x, 0.0),
    "Tanh": np.tanh,
    "ELU": lambda x: x if x > 0.0 else np.exp(x) - 1.0,
    "SiLU": lambda x: x / (1.0 + np.exp(-x)),
}
NAMES = {True: ("actor.latent_pi", "actor.mu"), False: ("mlp_extractor.policy_net", "action_net")}


def tensors(squashed, sizes=(SIZE, 7, 4), seed=0, spread=1.0):
    """Random tensors of a network with several actions."""
    rng = np.random.default_rng(seed)
    hidden, mean = NAMES[squashed]
    found = {}
    for k, (before, after) in enumerate(pairwise(sizes)):
        found[f"{hidden}.{2 * k}.weight"] = rng.normal(size=(after, before))
        found[f"{hidden}.{2 * k}.bias"] = rng.normal(size=after)
    found[f"{mean}.weight"] = spread * rng.normal(size=(MOTORS, sizes[-1]))
    found[f"{mean}.bias"] = spread * rng.normal(size=MOTORS)
    if squashed:
        found["actor.log_std.weight"] = np.zeros((MOTORS, sizes[-1]))
        found["actor.log_std.bias"] = np.array([-3.0, -1.0, 0.0])
    else:
        found["log_std"] = np.array([-3.0, -1.0, 0.0])
    found = {name: np.asarray(value, np.float32) for name, value in found.items()}
    found["normalizer.obs_rms.mean"] = rng.normal(size=SIZE)  # in double precision in files too
    found["normalizer.obs_rms.var"] = rng.uniform(0.1, 2.0, SIZE)
    return found


def acted(arrays, squashed, activation, normalizer, seen, least=(-1.0,) * MOTORS):
    """The mean actions for one observation, number by number."""
    x = [float(value) for value in seen]
    if normalizer is not None:
        mean, var = (arrays[f"normalizer.obs_rms.{name}"] for name in ("mean", "var"))
        clip = normalizer["clip"]
        x = [
            min(max((x[i] - mean[i]) / np.sqrt(var[i] + normalizer["epsilon"]), -clip), clip)
            for i in range(SIZE)
        ]
    hidden, mean_layer = NAMES[squashed]
    places = [f"{hidden}.{2 * k}" for k in range(9) if f"{hidden}.{2 * k}.bias" in arrays]
    for place in [*places, mean_layer]:
        weight, bias = (arrays[f"{place}.{name}"].astype(float) for name in ("weight", "bias"))
        x = [sum(w * v for w, v in zip(row, x, strict=True)) + b
             for row, b in zip(weight, bias, strict=True)]  # fmt: skip
        if place != mean_layer:
            x = [PLAIN[activation](value) for value in x]
    if not squashed:
        return [min(max(v, -1.0), 1.0) for v in x]
    return [low + 0.5 * (np.tanh(v) + 1.0) * (1.0 - low) for v, low in zip(x, least, strict=True)]


@pytest.mark.parametrize("algo", ["ppo", "ppo-fast", "sac", "shac", "shac-learned"])
@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize("normalizer", [None, {"epsilon": 0.25, "clip": 1.5}])
def test_actions_are_those_of_the_network_written_plainly(algo, activation, normalizer):
    squashed = algo == "sac"
    arrays, least = tensors(squashed, spread=0.15), (-1.0, 0.0, -0.5)
    policy = Network(arrays, algo=algo, activation=activation, normalizer=normalizer, least=least)
    seen = np.random.default_rng(1).normal(0.0, 2.0, (40, SIZE))
    wanted = np.array([acted(arrays, squashed, activation, normalizer, row, least) for row in seen])
    np.testing.assert_allclose(policy.mean_actions(seen), wanted, rtol=1e-9, atol=1e-9)
    found, change = policy.linearize(seen)
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9)
    assert change.shape == (40, MOTORS, SIZE)
    np.testing.assert_allclose(policy.predict(seen)[0], wanted, atol=1e-5)
    alone = policy.predict(seen[3])[0]
    assert alone.shape == (MOTORS,) and alone.dtype == np.float32
    np.testing.assert_allclose(alone, wanted[3], atol=1e-5)
    inside = (np.abs(wanted) < 1.0).mean()
    assert 0.3 < inside  # and some are clipped where nothing squashes them
    width, off = 1e-6, []
    for i in range(SIZE):
        step = width * np.eye(SIZE)[i]
        slope = (policy.mean_actions(seen + step) - policy.mean_actions(seen - step)) / (2 * width)
        off.append(np.abs(slope - change[:, :, i]) > 1e-4 * (1.0 + np.abs(slope)))
    assert np.mean(off) < 0.01  # at a corner there are two slopes


@pytest.mark.parametrize("squashed", [False, True])
def test_noise_of_each_action_has_its_own_deviation(squashed):
    arrays = tensors(squashed, spread=0.0)
    algo = "sac" if squashed else "ppo"
    policy = Network(arrays, algo=algo, activation="Tanh", normalizer=None)
    policy.random = np.random.default_rng(0)
    drawn, _ = policy.predict(np.zeros((20_000, SIZE)), deterministic=False)
    small = np.abs(drawn) < 0.9
    assert small[:, 0].all()
    own = np.arctanh(drawn[:, 0]) if squashed else drawn[:, 0]
    assert np.std(own) == pytest.approx(np.exp(-3.0), rel=0.03)
    for k, deviation in ((1, np.exp(-1.0)), (2, 1.0)):
        limit = 0.5
        edge = np.arctanh(limit) if squashed else limit
        inside = np.mean(np.abs(drawn[:, k]) < limit)
        from scipy.stats import norm

        assert inside == pytest.approx(1.0 - 2.0 * norm.sf(edge / deviation), abs=0.015)
    assert abs(np.corrcoef(drawn[:, 0], drawn[:, 1])[0, 1]) < 0.03
    assert abs(np.corrcoef(drawn[:-1, 0], drawn[1:, 0])[0, 1]) < 0.03


BAD = {
    "epsilon": [-1.0, "x", np.nan, None], "clip": [0.0, -1.0, "x", np.nan, None],
}  # fmt: skip


@pytest.mark.parametrize(("name", "value"), [(n, v) for n, each in BAD.items() for v in each])
def test_a_number_of_the_normalizer_out_of_range_is_refused_by_its_name(name, value):
    normalizer = {"epsilon": 1e-8, "clip": 10.0} | {name: value}
    with pytest.raises(ValueError, match=name):
        Network(tensors(False), algo="ppo", activation="Tanh", normalizer=normalizer)


def test_infinite_clips_and_no_epsilon_are_allowed_and_a_variance_of_0_is_not():
    arrays, seen = tensors(False), np.full(SIZE, 300.0)
    free = Network(arrays, algo="ppo", activation="ReLU",
                   normalizer={"epsilon": 0.0, "clip": np.inf})  # fmt: skip
    wanted = acted(arrays, False, "ReLU", {"epsilon": 0.0, "clip": np.inf}, seen)
    np.testing.assert_allclose(free.predict(seen)[0], wanted, atol=1e-5)
    arrays["normalizer.obs_rms.var"][2] = 0.0
    with pytest.raises(ValueError, match="variances must be above 0"):
        Network(arrays, algo="ppo", activation="ReLU", normalizer={"epsilon": 0.0, "clip": 1.0})
    Network(arrays, algo="ppo", activation="ReLU", normalizer={"epsilon": 1e-8, "clip": 1.0})


@pytest.mark.parametrize("name", sorted(tensors(False)))
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_number_that_is_not_finite_is_refused_with_its_tensor(name, value):
    arrays = tensors(False)
    arrays[name].ravel()[-1] = value
    with pytest.raises(ValueError, match=rf"tensor {name} must be finite numbers"):
        Network(arrays, algo="ppo", activation="Tanh", normalizer=None)


@pytest.mark.parametrize("squashed", [False, True])
def test_each_tensor_is_needed(squashed):
    whole, algo = tensors(squashed), "sac" if squashed else "ppo"
    for name in whole:
        arrays = {key: value for key, value in whole.items() if key != name}
        with pytest.raises(KeyError, match=name.rsplit(".", 1)[0]):
            Network(arrays, algo=algo, activation="Tanh", normalizer={"epsilon": 0.1, "clip": 1.0})


def test_layers_are_in_their_order_and_the_caller_s_arrays_are_not_changed():
    arrays = tensors(False, (SIZE, *[4] * 7))
    backwards = dict(reversed(arrays.items()))
    before = {name: value.copy() for name, value in arrays.items()}
    seen = np.random.default_rng(0).normal(size=(6, SIZE))
    found = [Network(each, algo="ppo", activation="Tanh", normalizer={"epsilon": 0.1, "clip": 1.0})
             for each in (arrays, backwards)]  # fmt: skip
    np.testing.assert_array_equal(found[0].predict(seen)[0], found[1].predict(seen)[0])
    wanted = [acted(arrays, False, "Tanh", {"epsilon": 0.1, "clip": 1.0}, row) for row in seen]
    np.testing.assert_allclose(found[0].predict(seen)[0], wanted, atol=1e-5)
    assert [weight.shape for weight, _ in found[0].layers] == [(4, SIZE), *[(4, 4)] * 6, (3, 4)]
    kept = seen.copy()
    found[0].predict(seen, deterministic=False)
    np.testing.assert_array_equal(seen, kept)
    for name, value in before.items():
        np.testing.assert_array_equal(arrays[name], value)


@pytest.mark.parametrize("name", shipped_policies())
def test_a_shipped_policy_is_what_its_files_say(name):
    folder = policy_folder(name)
    about = json.loads((folder / DESCRIPTION).read_text())
    policy = gpw.load_policy(name)
    assert policy.folder == folder and policy.name == folder.name
    assert policy.algorithm == about["algo"].upper()
    assert policy.scene == make_scene(about["scene"], **about["env"])
    assert policy.trained == about["trained"] and repr(policy) == f"<TrainedPolicy {name}>"
    arrays = read_tensors(folder / TENSORS)
    size = policy.layers[0][0].shape[1]
    assert policy.squashed == (about["algo"] == "sac")
    if about["normalizer"] is not None:
        mean, spread, clip = policy.moments
        np.testing.assert_array_equal(mean, arrays["normalizer.obs_rms.mean"])
        var = arrays["normalizer.obs_rms.var"] + about["normalizer"]["epsilon"]
        np.testing.assert_allclose(spread**2, var)
        assert clip == about["normalizer"]["clip"] and mean.shape == (size,)


def test_policies_are_listed_in_order_and_found_by_name_or_folder(tmp_path):
    names = shipped_policies()
    assert names == sorted(names) and len(names) == len(set(names)) >= 10
    for name in names:
        assert policy_folder(name).name == name and (policy_folder(name) / TENSORS).is_file()
    copy = shutil.copytree(policy_folder("lab-ppo"), tmp_path / "mine")
    for given in (copy, str(copy)):
        assert policy_folder(given) == copy
        assert isinstance(gpw.load_policy(given), TrainedPolicy)
    for nobody in ("nobody", tmp_path, "", 3, None, "x" * 5000, "a\0b"):
        with pytest.raises(gpw.PolicyError, match=r"no policy.*anywhere-ppo, commanded-ppo"):
            gpw.load_policy(nobody)


@pytest.mark.parametrize("lacking", ["algo", "activation", "normalizer", "scene", "env"])
def test_a_description_that_lacks_an_entry_is_refused_by_its_name(lacking, tmp_path):
    copy = shutil.copytree(policy_folder("lab-ppo"), tmp_path / "copy")
    about = json.loads((copy / DESCRIPTION).read_text())
    del about[lacking]
    (copy / DESCRIPTION).write_text(json.dumps(about))
    with pytest.raises(gpw.PolicyError, match=rf"copy is not a policy: '{lacking}' is missing"):
        gpw.load_policy(copy)
    about[lacking] = 3
    (copy / DESCRIPTION).write_text(json.dumps(about))
    with pytest.raises(gpw.PolicyError, match="copy is not a policy"):
        gpw.load_policy(copy)


def test_the_configuration_of_the_training_may_be_missing_but_not_be_another_thing(tmp_path):
    copy = shutil.copytree(policy_folder("lab-ppo"), tmp_path / "copy")
    about = json.loads((copy / DESCRIPTION).read_text())
    del about["trained"]
    (copy / DESCRIPTION).write_text(json.dumps(about))
    assert gpw.load_policy(copy).trained == {}
    for name in ("trained", "env"):
        (copy / DESCRIPTION).write_text(json.dumps(about | {name: [1]}))
        with pytest.raises(gpw.PolicyError, match=f"{name} must map names to values, not"):
            gpw.load_policy(copy)


@pytest.mark.parametrize("place", ["first", "last"])
def test_tensors_are_cut_from_their_own_bytes(place, tmp_path):
    """Also those that lie behind others, and empty ones; not beyond the data."""
    one, two = np.arange(3, dtype="<f8"), np.arange(4, dtype="<i4").reshape(2, 2)
    header = {
        "one": {"dtype": "F64", "shape": [3], "data_offsets": [0, 24]},
        "two": {"dtype": "I32", "shape": [2, 2], "data_offsets": [24, 40]},
        "none": {"dtype": "F32", "shape": [0, 3], "data_offsets": [40, 40]},
        "number": {"dtype": "F64", "shape": [], "data_offsets": [8, 16]},
    }
    data, path = one.tobytes() + two.tobytes(), tmp_path / "some.safetensors"

    def write(header):
        text = json.dumps(header).encode()
        path.write_bytes(len(text).to_bytes(8, "little") + text + data)
        return path

    found = read_tensors(write(header))
    np.testing.assert_array_equal(found["one"], one)
    np.testing.assert_array_equal(found["two"], two)
    assert found["none"].shape == (0, 3) and found["number"] == 1.0
    offsets = {"first": [-8, 16], "last": [24, 41]}[place]
    wrong = header | {"one": header["one"] | {"data_offsets": offsets}}
    with pytest.raises(gpw.PolicyError, match=r"some\.safetensors is damaged.*does not fit"):
        read_tensors(write(wrong))
