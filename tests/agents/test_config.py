"""Configuration of a run: presets, and the user's changes."""

import copy
import dataclasses
import importlib
import sys

import numpy as np
import pytest
import yaml

import agents
from agents import envs
from agents.config import ALGORITHMS, Config, ConfigError, configure, presets
from agents.learner import _acting, build, moments, restore_moments
from gym_passive_walker._tools.loading import reason
from gym_passive_walker.envs.registration import MAX_EPISODE_STEPS
from gym_passive_walker.gaits.scenes.scene import make_scene

SCENES = ("level", "steep", "rolling", "lab")


def test_a_scene_of_a_run_is_read_without_stable_baselines3(monkeypatch):
    """RLlib's environment, which has another Gymnasium, does not have it."""
    monkeypatch.setattr(agents, "envs", envs)  # restored afterwards
    for name in ("agents.envs", "gym_passive_walker.envs.sb3"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    for name in [*sys.modules, "stable_baselines3"]:
        if name.partition(".")[0] == "stable_baselines3":
            monkeypatch.setitem(sys.modules, name, None)
    read = importlib.import_module("agents.envs").scene_of(configure("ppo", "lab"))
    assert read == make_scene("lab")


@pytest.mark.parametrize("algo", ALGORITHMS)
@pytest.mark.parametrize("scene", SCENES)
def test_each_scene_has_a_preset(algo, scene):
    config = configure(algo, scene)
    assert config.steps >= 100_000 and config.n_envs >= 8


def test_the_default_is_large_batch_ppo_on_the_level():
    config = configure()
    assert (config.algo, config.scene, config.n_envs) == ("ppo", "level", 64)
    assert config.hyperparams["n_steps"] * config.n_envs in (4096, 8192)
    assert config.hyperparams["batch_size"] == 2048
    assert config.hyperparams["policy_kwargs"]["log_std_init"] == -1.0


def test_a_stride_of_one_torque_starts_with_less_noise():
    assert configure("ppo", "steep").hyperparams["policy_kwargs"]["log_std_init"] == -2.0


def test_a_control_of_ones_own_brings_its_preset():
    config = configure("ppo", "level", env={"control": "stride", "walker": None})
    assert config.env == {"control": "stride"}
    assert config.hyperparams == configure("ppo", "steep").hyperparams


def test_a_training_that_begins_with_a_policy_goes_through_the_last_part_of_its_schedules():
    usual, begun = (configure("ppo-fast", "level", start=start) for start in (None, "level-ppo"))
    schedule = usual.exploration
    *_, (last, loud), (end, quiet) = sorted(schedule["log_std"].items())
    assert last > schedule["until"] and end == 1.0
    assert begun.exploration == {"log_std": {0.0: loud, 1.0: quiet}}  # braking is not free again
    rates = (float(x.hyperparams["learning_rate"].removeprefix("lin_")) for x in (usual, begun))
    assert np.divide(*rates) == pytest.approx(1.0 / (1.0 - last))
    rolling = configure("ppo-fast", "rolling", start="rolling-ppo").exploration["log_std"]
    assert rolling == {0.0: pytest.approx(-1.3), 1.0: -2.5}  # its last segment begins before
    with_sac = (configure("sac", "level", start=start) for start in (None, "level-ppo"))
    same_noise, its_noise = (config.exploration for config in with_sac)
    assert same_noise == its_noise


@pytest.mark.parametrize("n_envs", [1, 5, 7, 64, 1000, 5000])
def test_an_update_is_a_number_of_whole_batches(n_envs):
    config = configure(n_envs=n_envs)
    assert config.hyperparams["n_steps"] * n_envs % config.hyperparams["batch_size"] == 0
    assert config.hyperparams["batch_size"] >= 2


def test_presets_name_the_gymnasium_id_too_for_rl_zoo3():
    for algo in ALGORITHMS:
        assert presets(algo)["PassiveWalker-v0"] == presets(algo)["level"]


@pytest.mark.parametrize("algo", ALGORITHMS)
@pytest.mark.parametrize("scene", SCENES)
def test_a_configuration_is_made_again_from_its_preset(algo, scene, monkeypatch):
    config = configure(algo, scene, seed=2)
    written = yaml.safe_load(yaml.safe_dump({scene: config.preset()}))
    monkeypatch.setattr("agents.config.presets", lambda algo: written)
    assert configure(algo, scene, seed=2) == config


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_a_preset_with_a_callback_of_another_algorithm_is_refused(algo, monkeypatch):
    other = configure("ppo" if algo == "sac" else "sac", "level").preset()
    monkeypatch.setattr("agents.config.presets", lambda algo: {"level": other})
    with pytest.raises(ConfigError, match=f"{algo.upper()} has no callback"):
        configure(algo, "level")


def test_what_is_asked_for_is_what_is_done():
    config = configure("sac", "lab", steps=1000, every=70, seed=3)
    assert (config.steps, config.every, config.seed) == (1000, 70, 3)
    assert configure(steps=1000).every == 50


def test_training_episodes_have_the_length_that_is_asked_for():
    assert configure("ppo-fast", "level").episode_steps == 400
    assert configure("ppo-fast", "level", episode_steps=60).episode_steps == 60
    with pytest.raises(ConfigError, match="episode_steps"):
        configure("ppo-fast", "level", episode_steps=0)


def test_agents_learn_in_short_episodes_from_hard_starts_and_are_evaluated_in_neither():
    config = configure("ppo", "lab", env={"control": "stride", "reset_noise_scale": 0.01}, n_envs=3)
    learning, evaluated = envs.training_envs(config), envs.arena(config, 3)
    learning.reset(), evaluated.reset()
    done = [learning.step(np.zeros((3, 1)))[2] for _ in range(config.episode_steps)]
    assert not np.any(done[:-1]) and np.all(done[-1])
    assert not any(evaluated.step(np.zeros((3, 1)))[3].any() for _ in range(500))
    level = configure("ppo", "level", env={"slope": 0.001})
    assert envs.training_envs(level, 1).scene.reset_noise_scale == 0.15
    assert envs.arena(level, 1).scene == make_scene("level", slope=0.001)
    assert envs.single(level).unwrapped.scene == make_scene("level", slope=0.001)


def test_what_befalls_walkers_stands_in_a_run_s_file(tmp_path):
    given = {
        "pushes": {"rate": 0.1, "impulse": [-0.01, 0.02]}, "observation_noise": 0.01,
        "action_delay": 1,
        "action_noise": 0.05, "command": [0.1, 0.2], "constraints": {"friction": "end"},
        "friction": 0.6,
    }  # fmt: skip
    configure("ppo", "lab", env=given).save(tmp_path / "config.yml")
    scene = envs.scene_of(Config.load(tmp_path / "config.yml"))
    assert scene.command == (0.1, 0.2) and scene.pushes["impulse"] == (-0.01, 0.02)
    assert scene == make_scene("lab", **given)
    given["action_delay"] = -1
    with pytest.raises(ConfigError, match="action_delay must be a whole number from 0 on"):
        envs.scene_of(configure("ppo", "lab", env=given))


@pytest.mark.parametrize("text", ["", "[1, 2]", "algo: ppo", "a: {", "colour: red"])
def test_a_file_that_is_no_configuration_is_refused(tmp_path, text):
    (tmp_path / "config.yml").write_text(text)
    with pytest.raises(ConfigError, match=r"config\.yml"):
        Config.load(tmp_path / "config.yml")


def test_a_policy_in_the_notation_of_rl_zoo3_is_read_without_running_it():
    policy = configure().hyperparams["policy_kwargs"]
    assert policy == {"log_std_init": -1.0, "net_arch": [64, 64], "activation_fn": "nn.ReLU"}


def test_presets_explore_where_ticks_are_many():
    assert configure("ppo", "level").exploration["energy"] == "positive"
    assert configure("ppo", "steep").exploration is None
    assert configure("sac", "level").exploration["highest"] == 1.0
    assert configure("sac", "steep").exploration is None


def test_seeds_reach_up_to_those_of_the_libraries():
    assert configure(seed=2**31 - 1).seed == 2**31 - 1
    with pytest.raises(ConfigError, match=rf"seed must be a whole number from 0 to {2**31 - 1}"):
        configure(seed=2**31)


OTHER = {
    "algo": "sac", "scene": "lab", "env": {"slope": [0.01, 0.02], "walker": "C"}, "n_envs": 3,
    "steps": 77, "seed": 12, "every": 11, "episode_steps": 9, "normalize": {"clip_obs": 5.0},
    "hyperparams": {"gamma": 0.9, "policy_kwargs": {"net_arch": [3, 4]}},
    "exploration": {"lowest": 0.1, "highest": 0.2}, "training": {"reset_noise_scale": 0.3},
    "start": "lab-ppo",
}  # fmt: skip


@pytest.mark.parametrize("name", OTHER)
def test_each_field_survives_its_file_and_is_a_difference_by_its_name(name, tmp_path):
    usual = configure("ppo-fast", "level", seed=1)
    other = dataclasses.replace(usual, **{name: OTHER[name]})
    other.save(tmp_path / "config.yml")
    assert Config.load(tmp_path / "config.yml") == other
    said = usual.differences(other)
    here, there = ({name: getattr(x, name)} for x in (usual, other))
    if isinstance(here[name], dict) and isinstance(there[name], dict):
        here, there = ({f"{name}.{key}": v for key, v in x[name].items()} for x in (here, there))
    assert sorted(said) == sorted(
        f"{line}: {here.get(line)!r} here, {there.get(line)!r} asked for"
        for line in here | there if here.get(line) != there.get(line)
    )  # fmt: skip
    assert usual.differences(other, ignore=(name,)) == []


def test_a_normalizer_differs_from_none_in_one_line():
    usual = configure("ppo", "level")
    plain = dataclasses.replace(usual, normalize=None)
    (line,) = usual.differences(plain)
    assert line == f"normalize: {usual.normalize!r} here, None asked for"
    assert plain.differences(usual) == [f"normalize: None here, {usual.normalize!r} asked for"]


@pytest.mark.parametrize("name", OTHER)
def test_a_file_that_lacks_a_field_or_has_another_is_refused_by_its_name(name, tmp_path):
    path = tmp_path / "config.yml"
    values = dataclasses.asdict(configure("ppo", "level"))
    lacking = {key: value for key, value in values.items() if key != name}
    path.write_text(yaml.safe_dump(lacking))
    with pytest.raises(ConfigError, match=rf"it lacks {name}: was it cut off"):
        Config.load(path)
    path.write_text(yaml.safe_dump(values | {name + "s": 1}))
    with pytest.raises(ConfigError, match=f"{name}s"):
        Config.load(path)


def test_a_file_that_repeats_a_field_is_refused(tmp_path):
    path = tmp_path / "config.yml"
    configure("ppo", "level").save(path)
    path.write_text(path.read_text() + "seed: 3\n")
    with pytest.raises(ConfigError, match="'seed' is given twice"):
        Config.load(path)


WRONG = {
    "algo": [None, 1, "dqn"], "scene": [None, 1, ["level"]], "env": [None, [], "level"],
    "n_envs": [0, 1.5, "2", True, None], "steps": [0, -1, 1.5, None], "seed": [-1, 2**31, 0.5],
    "every": [0, None, "1"], "episode_steps": [0, -3, 1.5, "1"], "normalize": [True, "{}", 1],
    "hyperparams": [None, []], "exploration": [[], 0.1], "training": [None, "x"],
    "start": [1, ["level-ppo"]],
}  # fmt: skip


@pytest.mark.parametrize(("name", "value"), [(n, v) for n, each in WRONG.items() for v in each])
def test_a_value_of_the_wrong_kind_is_refused_by_its_name(name, value):
    with pytest.raises(ConfigError, match="'dqn'.*ppo, ppo-fast, sac" if value == "dqn" else name):
        dataclasses.replace(configure("ppo", "level"), **{name: value})


def test_a_folder_that_is_no_run_is_named(tmp_path):
    with pytest.raises(ConfigError, match=rf"{tmp_path.name} is not a run.*config\.yml"):
        Config.load(tmp_path / "config.yml")


@pytest.mark.parametrize(
    ("entry", "found"),
    [
        (True, {}), (False, None), (None, None), ("{'norm_obs': False}", {"norm_obs": False}),
        ({"clip_obs": 3.0}, {"clip_obs": 3.0}), ("dict", None),
    ],
)  # fmt: skip
def test_the_normalizer_is_read_in_each_notation_of_rl_zoo3(entry, found, monkeypatch):
    preset = configure("ppo", "level").preset() | {"normalize": entry}
    monkeypatch.setattr("agents.config.presets", lambda algo: {"level": preset})
    if entry == "dict":
        with pytest.raises(ValueError, match="malformed"):
            configure("ppo", "level")
    else:
        assert configure("ppo", "level").normalize == found


@pytest.mark.parametrize("algo", ALGORITHMS)
@pytest.mark.parametrize("n_envs", [1, 3, 4, 16, 200])
def test_only_ppo_s_update_depends_on_the_number_of_environments(algo, n_envs):
    usual, other = configure(algo, "level"), configure(algo, "level", n_envs=n_envs)
    assert other.n_envs == n_envs
    ours, theirs = (dict(config.hyperparams) for config in (usual, other))
    if algo in ("ppo", "ppo-fast"):
        update, batch = ours.pop("n_steps") * usual.n_envs, ours.pop("batch_size")
        steps, parts = theirs.pop("n_steps") * n_envs, theirs.pop("batch_size")
        assert steps == pytest.approx(update, rel=0.1 if update % n_envs else 0.0)
        assert steps / parts == update / batch
    assert ours == theirs


def test_options_that_are_none_are_the_scene_s_own_and_presets_are_not_changed():
    before = copy.deepcopy(presets("ppo"))
    config = configure("ppo", "level", env={"slope": None, "walker": "C"})
    assert config.env == {"walker": "C"}
    config.hyperparams["policy_kwargs"]["net_arch"].append(5)
    config.hyperparams["gamma"] = 0.0
    assert presets("ppo") == before
    assert configure("ppo", "level").hyperparams["gamma"] != 0.0
    assert configure(steps=19).every == 1


def test_a_control_without_a_preset_is_refused_with_those_there_are(monkeypatch):
    monkeypatch.setattr("agents.config.presets", lambda algo: {"lab": {}, "steep": {}})
    with pytest.raises(ConfigError, match=r"no preset for 'stride' in ppo\.yml: it has lab, steep"):
        configure("ppo", "lab", env={"control": "stride"})


def test_reasons_are_one_line_and_name_the_key_that_is_missing():
    assert reason(ValueError("two\n  lines")) == "two lines"
    assert reason(KeyError("best")) == "'best' is missing"
    assert reason(RuntimeError()) == "RuntimeError"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "level: walker C, slope 0 rad, ticks of 0.1 √(l/g), hip up to {hip:g} m g l"),
        ({"slope": (0.01, 0.02)}, "slopes 0.01 to 0.02 rad"),
        ({"control": "stride"}, "one action a stride, hip"),
        ({"actions": ["hip", "push_off"], "max_push_off": 0.03}, "push-off up to 0.03 m √(g l)"),
        ({"walker": "E", "actions": ["ankle"], "max_ankle_torque": 0.2},
         "walker E, slope 0 rad, ticks of 0.1 √(l/g), ankle up to 0.2 m g l"),
    ],
)  # fmt: skip
def test_a_scene_is_described_with_its_walker_its_ground_and_its_motors(changes, words):
    config = configure("ppo", "level", env=changes)
    scene = envs.scene_of(config)
    said = envs.describe(config)
    words = words.format(hip=scene.max_hip_torque).replace("0.1 √", f"{scene.tick:g} √")
    assert words in said and said.startswith("level: walker ")


def test_a_scene_in_which_no_episode_can_begin_is_refused():
    with pytest.raises(ConfigError, match="slope"):
        envs.check(configure("ppo", "level", env={"slope": 2.0}))
    envs.check(configure("ppo", "level"))


def test_training_has_the_environments_that_were_asked_for_and_the_usual_limit():
    config = configure("ppo", "level", n_envs=3)
    plain = dataclasses.replace(config, episode_steps=None, training={})
    assert envs.training_envs(config).num_envs == 3
    assert envs.training_envs(config, 5).num_envs == 5
    limits = [envs.training_envs(c, 1).batch.rules["step_limit"] for c in (config, plain)]
    assert limits == [config.episode_steps, MAX_EPISODE_STEPS]
    assert envs.training_envs(plain, 1).scene == envs.scene_of(plain)
    with pytest.raises(ConfigError, match="wings"):
        envs.scene_of(plain, wings=2)


# How an algorithm is built.


@pytest.mark.parametrize(
    ("algo", "arguments", "words"),
    [
        ("ppo", {"gammas": 0.9}, "gammas"), ("sac", {"gammas": 0.9}, "gammas"),
        ("shac", {"gammas": 0.9}, "gammas"), ("shac-learned", {"gammas": 0.9}, "gammas"),
        ("ppo-fast", {"ent_coef": 0.0}, "ent_coef"),
        ("ppo-fast", {"n_steps": 100, "batch_size": 300},
         "batch_size must divide the 200 steps of a rollout"), ("ppo", {"device": "cpu"}, "device"),
        ("sac", {"seed": 3}, "seed"), ("ppo", {"env": None}, "env"),
        ("ppo", {"gamma": "0.9"}, "gamma of PPO must be float, not '0.9'"),
        ("ppo", {"n_epochs": 1.5}, "n_epochs of PPO must be int, not 1.5"),
        ("sac", {"tau": None}, "tau of SAC must be float, not None"),
        ("ppo", {"n_epochs": True}, "n_epochs of PPO must be int, not True"),
        ("ppo", {"learning_rate": "fast"}, "PPO cannot be built.*fast"),
        ("ppo", {"policy_kwargs": {"activation_fn": "nn.Sine"}}, "no activation 'Sine'.*ReLU"),
    ],
)  # fmt: skip
def test_hyperparameters_that_no_algorithm_takes_are_refused(algo, arguments, words):
    config = configure(algo, "level", n_envs=2)
    with pytest.raises(ConfigError, match=words):
        build(config, envs.training_envs(config), **arguments)


def test_arguments_of_the_normalizer_are_checked_by_name_and_kind():
    for wrong, words in (({"clip": 1.0}, "clip"), ({"epsilon": "1"}, "epsilon of VecNormalize")):
        config = dataclasses.replace(configure("ppo", "level", n_envs=2), normalize=wrong)
        with pytest.raises(ConfigError, match=words):
            build(config, envs.training_envs(config))


def test_a_whole_number_may_stand_for_a_number_and_a_rate_may_be_constant():
    config = configure("ppo", "level", n_envs=2)
    model = build(config, envs.training_envs(config), gamma=1, learning_rate=0.25)
    assert model.gamma == 1 and model.lr_schedule(0.1) == 0.25
    assert model.get_vec_normalize_env().gamma == 1


@pytest.mark.parametrize("normalize", [None, {}, {"norm_obs": False}, {"norm_reward": False}])
def test_moments_are_kept_and_put_back_one_by_one(normalize):
    config = dataclasses.replace(configure("ppo", "level", n_envs=2), normalize=normalize)
    one, other = (build(config, envs.training_envs(config)) for _ in range(2))
    ours, theirs = (model.get_vec_normalize_env() for model in (one, other))
    if normalize is None:
        assert ours is None
        return
    names = [n for n in ("obs_rms", "ret_rms") if normalize.get(f"norm_{RMS[n]}", True)]
    rng = np.random.default_rng(0)
    for name in names:
        running = getattr(ours, name)
        running.mean, running.var = (rng.uniform(1.0, 2.0, np.shape(running.mean)) for _ in "ab")
        running.count = rng.uniform(5.0, 9.0)
    kept = moments(ours)
    parts = {f"{name}.{part}" for name in names for part in ("mean", "var", "count")}
    assert parts <= set(kept)
    restore_moments(theirs, kept)
    for name in names:
        for part in ("mean", "var", "count"):
            value = getattr(getattr(theirs, name), part)
            np.testing.assert_array_equal(value, getattr(getattr(ours, name), part))
            np.testing.assert_array_equal(value, kept[f"{name}.{part}"])
        assert type(getattr(theirs, name).count) is float


RMS = {"obs_rms": "obs", "ret_rms": "reward"}


@pytest.mark.parametrize(
    ("algo", "hyperparams", "normalize", "acting"),
    [
        ("ppo", {}, None, ("Tanh", None)), ("sac", {}, None, ("ReLU", None)),
        ("shac", {"policy_kwargs": {"activation_fn": "nn.SiLU"}}, {"norm_obs": False},
         ("SiLU", None)),
        ("ppo", {"policy_kwargs": {}}, {"clip_obs": 3.0}, ("Tanh", {"epsilon": 1e-8, "clip": 3.0})),
        ("ppo-fast", {}, {"epsilon": 0.5}, ("Tanh", {"epsilon": 0.5, "clip": 10.0})),
    ],
)  # fmt: skip
def test_an_exported_policy_writes_out_the_library_s_defaults(algo, hyperparams, normalize, acting):
    config = configure(algo, "level")
    config = dataclasses.replace(config, hyperparams=hyperparams, normalize=normalize)
    activation, normalizer = acting
    found = {"algo": algo, "activation": activation, "normalizer": normalizer}
    assert _acting(config) == found


def test_a_change_of_one_configuration_changes_no_other():
    config = configure("shac", "level")
    noise = config.training["reset_noise_scale"]
    config.training.update(reset_noise_scale=2.0 * noise)
    assert configure("shac", "level").training["reset_noise_scale"] == noise
