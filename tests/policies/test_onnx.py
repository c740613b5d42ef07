"""An ONNX file acts like its policy; files of other programs act as they do there."""

import json
import pickle
import sys

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.envs.policies import shipped_policies
from gym_passive_walker.envs.policies.network import ACTIVATIONS, Network
from gym_passive_walker.envs.policies.onnx_file import write_onnx

onnx = pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")

ROUNDING = 2e-6
"""Of actions: some roundings in single precision."""


def seen_by(size, slope=0.0):
    """Observations near those of a walk, far from them, and with the slope of training."""
    rng = np.random.default_rng(3)
    seen = rng.normal(0.0, 1.0, (600, size)).astype(np.float32)
    seen[:20] *= 50.0
    seen[200:] *= 0.1
    seen[400:, 7] = slope
    return seen


@pytest.mark.parametrize("name", shipped_policies())
def test_a_file_acts_as_the_shipped_policy(name, tmp_path):
    policy, path = gpw.load_policy(name), tmp_path / "policy.onnx"
    policy.to_onnx(path)
    size = policy.layers[0][0].shape[1]
    seen = seen_by(size, np.mean(policy.scene.slope))
    expected, _ = policy.predict(seen)
    session = onnxruntime.InferenceSession(path)
    (given,), (returned,) = session.get_inputs(), session.get_outputs()
    assert (given.name, given.type, given.shape) == ("observation", "tensor(float)", ["n", size])
    assert (returned.name, returned.type) == ("action", "tensor(float)")
    assert returned.shape == ["n", expected.shape[1]]
    for count in (1, 7, len(seen)):
        (actions,) = session.run(None, {"observation": seen[:count]})
        assert actions.shape == (count, expected.shape[1])
        assert np.max(np.abs(actions - expected[:count])) < ROUNDING
    assert np.max(np.abs(actions)) <= 1.0
    assert np.std(expected) > 0.01
    found = session.get_modelmeta().custom_metadata_map
    assert found["scene"] == name.rpartition("-")[0] and found["algorithm"] == policy.algorithm
    names = json.loads(found["observation"])
    assert len(names) == size and names[:2] == ["stance leg angle", "swing thigh angle"]
    assert len(json.loads(found["action"])) == expected.shape[1]


def test_a_file_computes_in_single_precision_with_operators_of_2022(tmp_path):
    gpw.load_policy("steep-sac").to_onnx(tmp_path / "policy.onnx")
    model = onnx.load(tmp_path / "policy.onnx")
    onnx.checker.check_model(model, full_check=True)
    assert {x.data_type for x in model.graph.initializer} == {onnx.TensorProto.FLOAT}
    assert model.opset_import[0].version <= 17 and model.ir_version <= 8
    assert "stance leg angle (rad)" in model.graph.input[0].doc_string


def random_network(algo, activation, normalizer, actions=1, layers=(16, 8), least=-1.0):
    """A policy of random numbers; some normalized observations are beyond the clip."""
    rng = np.random.default_rng(0)
    hidden, mean = ("actor.latent_pi", "actor.mu") if algo == "sac" else (
        "mlp_extractor.policy_net", "action_net")  # fmt: skip
    sizes = [8, *layers, actions]
    places = [*(f"{hidden}.{2 * i}" for i in range(len(layers))), mean]
    tensors = {}
    for place, before, after in zip(places, sizes, sizes[1:], strict=False):
        tensors[f"{place}.weight"] = rng.normal(0.0, 1.0 / np.sqrt(before), (after, before))
        tensors[f"{place}.bias"] = rng.normal(0.0, 0.1, after)
    if algo == "sac":
        for name in ("weight", "bias"):
            tensors[f"actor.log_std.{name}"] = tensors[f"actor.mu.{name}"]
    else:
        tensors["log_std"] = np.zeros(actions)
    tensors["normalizer.obs_rms.mean"] = rng.normal(0.0, 0.3, 8)
    tensors["normalizer.obs_rms.var"] = rng.uniform(0.01, 2.0, 8)
    tensors["normalizer.obs_rms.mean"][7], tensors["normalizer.obs_rms.var"][7] = 0.0361, 0.0
    return Network(tensors, algo=algo, activation=activation, normalizer=normalizer, least=least)


@pytest.mark.parametrize("algo", ["ppo", "ppo-fast", "sac", "shac", "shac-learned"])
@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize(
    "normalizer",
    [None, {"epsilon": 1e-8, "clip": 10.0}, {"epsilon": 0.1, "clip": 1.5},
     {"epsilon": 1e-8, "clip": np.inf}],
)  # fmt: skip
def test_networks_of_each_kind_are_written(algo, activation, normalizer, tmp_path):
    network, path = random_network(algo, activation, normalizer), tmp_path / "policy.onnx"
    write_onnx(network, path, scene="level", env={"slope": 0.0361}, algorithm=algo)
    policy, seen = gpw.load_policy(path), seen_by(8, 0.0361)
    if normalizer and np.isinf(normalizer["clip"]):
        seen = seen[400:]  # other slopes would be 10,000 deviations off
    expected, _ = network.predict(seen)
    assert np.max(np.abs(policy.predict(seen)[0] - expected)) < ROUNDING
    assert 0.2 < np.mean(np.abs(expected) < 0.99)
    assert policy.scene == gpw.gaits.scenes.scene.make_scene("level", slope=0.0361)


def test_a_policy_may_have_several_actions_or_no_hidden_layer(tmp_path):
    seen, path = seen_by(8), tmp_path / "policy.onnx"
    for layers in ((), (8, 8, 8)):
        network = random_network("ppo", "Tanh", None, 2, layers)
        env = {"walker": "E", "slope": 0.0, "actions": ["hip", "ankle"]}
        write_onnx(network, path, scene="level", env=env, algorithm="PPO")
        actions, _ = gpw.load_policy(path).predict(seen)
        assert actions.shape == (600, 2)
        assert np.max(np.abs(actions - network.predict(seen)[0])) < ROUNDING
    with pytest.raises(ValueError, match="2 numbers in its action, its scene 1"):
        write_onnx(network, path, scene="level", env={}, algorithm="PPO")


def test_squashed_actions_are_from_the_least_of_each(tmp_path):
    network = random_network("sac", "ReLU", None, 2, least=(-1.0, 0.0))
    env = {"walker": "D", "slope": 0.0, "actions": ["hip", "push_off"]}
    write_onnx(network, tmp_path / "policy.onnx", scene="level", env=env, algorithm="SAC")
    actions, _ = gpw.load_policy(tmp_path / "policy.onnx").predict(seen_by(8))
    assert np.max(np.abs(actions - network.predict(seen_by(8))[0])) < ROUNDING
    assert np.all(actions.min(axis=0) >= [-1.0, 0.0]) and actions[:, 1].min() < 0.4


def test_a_file_acts_in_every_analysis_as_its_policy(tmp_path):
    gpw.load_policy("steep-sac").to_onnx(tmp_path / "steep.onnx")
    path = str(tmp_path / "steep.onnx")
    gait, own = gpw.closed_loop_gait(path), gpw.closed_loop_gait("steep-sac")
    assert gait.froude_speed == pytest.approx(own.froude_speed, abs=1e-5)
    # The file is differentiated by differences in single precision, the policy exactly.
    assert abs(gait.multipliers[0]) == pytest.approx(abs(own.multipliers[0]), abs=0.02)
    score, expected = (gpw.gauntlet(which, walkers=8) for which in (path, "steep-sac"))
    # Rounding decides few of the walks.
    assert np.max(np.abs(score.survival - expected.survival)) <= 0.13
    assert score.episodes["own scene"].distance == pytest.approx(
        expected.episodes["own scene"].distance, rel=1e-3
    )


def test_it_takes_one_observation_or_many_and_goes_to_other_processes(tmp_path):
    gpw.load_policy("level-ppo").to_onnx(tmp_path / "policy.onnx")
    policy, seen = gpw.load_policy(tmp_path / "policy.onnx"), seen_by(8)
    actions, state = policy.predict(seen, state=("mine",))
    assert state == ("mine",) and actions.dtype == np.float32
    assert policy.predict(seen[300])[0] == pytest.approx(actions[300], abs=1e-6)
    assert policy.predict(seen[:0])[0].shape == (0, 1)
    there = pickle.loads(pickle.dumps(policy))
    assert np.array_equal(there.predict(seen)[0], actions) and there.scene == policy.scene
    for each in (policy, there):  # more threads would only wait
        options = each._session.get_session_options()
        assert (options.intra_op_num_threads, options.inter_op_num_threads) == (1, 1)
    for shape in [(), (7,), (3, 9), (2, 2, 8)]:
        with pytest.raises(ValueError, match=r"policy.onnx takes observations .*\(n, 8\), not"):
            policy.predict(np.zeros(shape))


def written(path, nodes, inputs, outputs, **constants):
    """An ONNX file as another program may write it."""
    helper = onnx.helper

    def named(places):
        return [helper.make_tensor_value_info(name, kind, shape) for name, kind, shape in places]

    stored = [onnx.numpy_helper.from_array(value, name) for name, value in constants.items()]
    graph = helper.make_graph(nodes, "other", named(inputs), named(outputs), stored)
    opset = [helper.make_opsetid("", 17)]
    onnx.save(helper.make_model(graph, ir_version=8, opset_imports=opset), path)
    return path


FLOAT, DOUBLE, INTEGER = 1, 11, 7
WEIGHT = np.linspace(-0.5, 0.5, 8, dtype=np.float32)[:, None]


def linear(path, batch="n", kind=FLOAT, size=8, outputs=("value", "action")):
    """Two linear functions of an observation: the weight's negative, and the weight."""
    node = onnx.helper.make_node
    dtype = np.float64 if kind == DOUBLE else np.float32
    nodes = [
        node("MatMul", ["obs", "minus"], [outputs[0]]),
        node("MatMul", ["obs", "weight"], [outputs[1]]),
    ]
    return written(
        path, nodes, [("obs", kind, [batch, size])], [(x, kind, [batch, 1]) for x in outputs],
        weight=WEIGHT[:size].astype(dtype), minus=-WEIGHT[:size].astype(dtype),
    )  # fmt: skip


@pytest.mark.parametrize("options", [{}, {"batch": 1}, {"batch": 3}, {"kind": DOUBLE}])
def test_files_of_other_programs_are_read(options, tmp_path):
    policy = gpw.load_policy(linear(tmp_path / "other.onnx", **options))
    seen = seen_by(8)
    assert policy.predict(seen)[0] == pytest.approx(seen @ WEIGHT, rel=1e-5, abs=1e-6)
    assert policy.scene is None and policy.name == "other.onnx"
    if options == {"batch": 3}:
        with pytest.raises(ValueError, match="takes 3 observations at once, not 4"):
            policy.predict(seen[:4])


def test_tensors_may_be_in_another_file(tmp_path, monkeypatch):
    path, seen = linear(tmp_path / "other.onnx"), seen_by(8)
    model = onnx.load(path)
    onnx.save(model, path, save_as_external_data=True, location="other.onnx.data", size_threshold=0)
    assert (tmp_path / "other.onnx.data").is_file()
    monkeypatch.chdir(tmp_path)
    policy = gpw.load_policy("other.onnx")
    monkeypatch.chdir("/")
    again = pickle.loads(pickle.dumps(policy))
    assert again.predict(seen)[0] == pytest.approx(seen @ WEIGHT, rel=1e-5, abs=1e-6)
    (tmp_path / "other.onnx.data").unlink()
    with pytest.raises(gpw.PolicyError, match="not a readable ONNX file"):
        gpw.load_policy(path)


def test_without_a_known_name_the_first_output_is_the_action(tmp_path):
    policy = gpw.load_policy(linear(tmp_path / "other.onnx", outputs=("mean", "value")))
    seen = seen_by(8)
    assert policy.predict(seen)[0] == pytest.approx(-seen @ WEIGHT, rel=1e-5, abs=1e-6)


def test_a_file_without_a_scene_needs_one(tmp_path):
    path = str(linear(tmp_path / "other.onnx"))
    with pytest.raises(ValueError, match="say in which scene"):
        gpw.gauntlet(path, walkers=2)
    assert gpw.gauntlet(path, "steep", walkers=2).controller_name == path
    assert gpw.stride_map(controller=path).scene == gpw.stride_map(controller="level-ppo").scene


def test_files_that_are_no_policies_are_refused(tmp_path, monkeypatch):
    path = tmp_path / "policy.onnx"
    with pytest.raises(gpw.PolicyError, match=r"policy.onnx cannot be read: No such file"):
        gpw.load_policy(path)
    path.write_bytes(b"no model")
    with pytest.raises(gpw.PolicyError, match="not a readable ONNX file"):
        gpw.load_policy(path)
    node = onnx.helper.make_node
    twice = [node("Add", ["a", "b"], ["action"])]
    written(path, twice, [(x, FLOAT, ["n", 8]) for x in "ab"], [("action", FLOAT, ["n", 8])])
    with pytest.raises(gpw.PolicyError, match=r"one input.*not a tensor.float. .*b tensor"):
        gpw.load_policy(path)
    for kind, shape in ((INTEGER, ["n", 8]), (FLOAT, [8]), (FLOAT, ["n", 2, 8])):
        same = [node("Identity", ["a"], ["action"])]
        written(path, same, [("a", kind, shape)], [("action", kind, shape)])
        with pytest.raises(gpw.PolicyError, match=r"observations \(n, size\)"):
            gpw.load_policy(path)
    summed = [node("ReduceSum", ["a"], ["action"], keepdims=0)]
    written(path, summed, [("a", FLOAT, ["n", 8])], [("action", FLOAT, [])])
    with pytest.raises(ValueError, match=r"actions of shape \(n, actions\).*not \(\)"):
        gpw.load_policy(path).predict(np.zeros((2, 8)))
    linear(path, size=7)
    with pytest.raises(ValueError, match=r"\(n, 7\), not \(64, 8\)"):
        gpw.gauntlet(path, "level")
    model = onnx.load(linear(path))
    onnx.helper.set_model_props(model, {"scene": "moon"})
    onnx.save(model, path)
    with pytest.raises(gpw.PolicyError, match="moon"):
        gpw.load_policy(path)


def test_a_missing_library_is_named(tmp_path, monkeypatch):
    path = linear(tmp_path / "policy.onnx")
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    monkeypatch.setitem(sys.modules, "onnx", None)
    for do in (lambda: gpw.load_policy(path), lambda: gpw.load_policy("level-ppo").to_onnx(path)):
        with pytest.raises(ImportError, match=r"gym-passive-walker\[onnx\]"):
            do()
