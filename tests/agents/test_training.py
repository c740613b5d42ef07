"""Training runs: uninterrupted, resumed, stopped, and with damaged files."""

import dataclasses
import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import cloudpickle
import gymnasium
import numpy as np
import pytest
import stable_baselines3
import torch
import yaml

import gym_passive_walker as gpw
import train
from agents import checkpoint, envs, files, training
from agents.callbacks import Milestones
from agents.config import ALGORITHMS, Config, ConfigError
from agents.learner import LearnedPolicy, build, export, learned, load_policy, on_numpy
from agents.training import Run
from benchmarks.kills import kill
from gym_passive_walker._tools.files import replacing
from gym_passive_walker.envs.evaluation.walks import simulate_episodes
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from tests.agents.runs import SEEN, short_arena, small, weights


@pytest.fixture(autouse=True)
def _short_exams(monkeypatch):
    """Make evaluations during training short."""
    monkeypatch.setattr(envs, "arena", short_arena)


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """Finished runs of PPO and SAC; no test changes their folders."""
    runs = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(envs, "arena", short_arena)
        for algo in ("ppo", "sac"):
            runs[algo] = Run(small(algo), tmp_path_factory.mktemp(algo), tensorboard=True)
            assert runs[algo].train(progress=False)
    return runs


def varied(steps):
    """SAC in short episodes of varied walkers, with a small replay buffer and random actions."""
    config = dataclasses.replace(
        small("sac", steps),
        episode_steps=7,
        training={"domain_randomization": {"foot_radius": 0.2}},
    )
    config.hyperparams.update({"buffer_size": 160, "learning_starts": 300})
    return config


UNINTERRUPTED = {
    "ppo-rolling": lambda steps: small("ppo", steps, "rolling"),
    "sac-level": lambda steps: small("sac", steps, "level"),
    "ppo-steep": lambda steps: small("ppo", steps, "steep"),
    "sac-varied": varied,
    "shac-level": lambda steps: small("shac", steps, "level"),
    "ppo-fast-rolling": lambda steps: small("ppo-fast", steps, "rolling"),
    "ppo-pushed": lambda steps: small("ppo", steps, "pushed"),
    "shac-learned-level": lambda steps: small("shac-learned", steps, "level"),
}


@pytest.mark.parametrize("config", UNINTERRUPTED.values(), ids=UNINTERRUPTED)
def test_a_resumed_run_goes_on_as_if_uninterrupted(tmp_path, config):
    whole = Run(config(384), tmp_path / "whole")
    assert whole.train(progress=False)
    part = Run(config(256), tmp_path / "parts")
    assert part.train(progress=False)
    # What else the process does in between must not matter.
    np.random.seed(5)  # noqa: NPY002
    torch.manual_seed(5)
    rest = Run(config(384), tmp_path / "parts")
    assert rest.resumed and rest.steps == 256
    assert np.array_equal(weights(rest.model), weights(part.model))
    assert rest.train(progress=False)
    assert rest.steps == whole.steps
    assert np.array_equal(weights(rest.model), weights(whole.model))
    curves = [(tmp_path / name / "learning_curve.csv").read_text() for name in ("whole", "parts")]
    steps = [[line.split(",")[0] for line in curve.splitlines()] for curve in curves]
    assert steps[0] == steps[1]
    normalizers = [run.model.get_vec_normalize_env() for run in (whole, rest)]
    assert np.array_equal(normalizers[0].obs_rms.mean, normalizers[1].obs_rms.mean)
    assert np.array_equal(normalizers[0].returns, normalizers[1].returns)


def draws(run):
    """The next numbers of each random generator of a training."""
    envs = run.model.env.unwrapped
    return [
        torch.rand(3).tolist(), np.random.random(3).tolist(),  # noqa: NPY002
        *([run.model.action_space.sample().item() for _ in range(3)]),
        *(source.random() for source in envs.envs.np_random),
    ]  # fmt: skip


@pytest.mark.parametrize("algo", ["ppo", "ppo-fast", "sac", "shac", "shac-learned"])
def test_a_checkpoint_brings_back_every_source_of_random_numbers(tmp_path, algo):
    run = Run(small(algo), tmp_path)
    run.train(progress=False)
    expected = draws(run)
    assert draws(run) != expected
    assert draws(Run(small(algo), tmp_path)) == expected


def test_a_checkpoint_brings_back_all_that_an_agent_remembers(tmp_path):
    """The replay buffer is full, of episodes that ended by a fall or by the time limit."""
    run = Run(varied(256), tmp_path)
    run.train(progress=False)
    again = Run(varied(256), tmp_path)
    theirs, ours = run.model.replay_buffer, again.model.replay_buffer
    assert theirs.full and theirs.timeouts.any()
    for name, value in vars(theirs).items():
        if isinstance(value, np.ndarray):
            assert np.array_equal(getattr(ours, name), value), name
    assert (ours.pos, ours.full) == (theirs.pos, theirs.full)


def exams(monkeypatch, rewards, record):
    """Replace evaluations by given results, and record each."""
    left = iter(rewards)

    def reported(policy, arena, *, seed):
        walks = simulate_episodes(policy, arena, seed=seed)
        reward = float(next(left))
        record(policy, walks, reward)
        return dataclasses.replace(walks, reward=np.full(len(walks), reward))

    monkeypatch.setattr(training, "simulate_episodes", reported)


def test_training_keeps_the_policy_that_did_best_in_its_evaluations(tmp_path, monkeypatch):
    """At any time of the training, and also after an interruption."""
    acted = {}

    def record(policy, walks, reward):
        acted[reward] = policy.predict(SEEN)[0]

    exams(monkeypatch, [1.0, 5.0, 3.0, 4.0], record)
    for steps in (256, 384):
        Run(small(steps=steps), tmp_path).train(progress=False)
    assert list(acted) == [1.0, 5.0, 3.0, 4.0]
    kept = load_policy(tmp_path).predict(SEEN)[0]
    assert kept == pytest.approx(acted[5.0], abs=1e-6)
    assert kept != pytest.approx(acted[4.0], abs=1e-6)


def test_shac_keeps_its_last_policy(tmp_path, monkeypatch):
    exams(monkeypatch, [5.0, *[3.0] * 9], lambda policy, walks, reward: None)
    run = Run(small("shac"), tmp_path)
    run.train(progress=False)
    assert run.notes["best"] == 3.0 and len(run.notes["curve"]) > 1
    last = on_numpy(LearnedPolicy(run.model, "SHAC"), run.config)
    assert load_policy(tmp_path).predict(SEEN)[0] == pytest.approx(last.predict(SEEN)[0], abs=1e-6)


def test_all_evaluations_of_a_run_are_of_the_same_episodes(tmp_path, monkeypatch):
    starts = []
    exams(monkeypatch, range(10), lambda policy, walks, reward: starts.append(walks))
    Run(small(scene="rolling"), tmp_path).train(progress=False)
    assert len(starts) == 3
    for walks in starts:
        assert np.array_equal(walks.slopes, starts[0].slopes)
        assert np.array_equal(walks.seeds, starts[0].seeds)


def test_seconds_of_training_add_up(tmp_path, monkeypatch):
    run = Run(small(), tmp_path)
    for spent in (2.0, 3.0, 5.0):
        run._evaluate(spent)
    assert [row["seconds"] for row in run.notes["curve"]] == [2.0, 5.0, 10.0]


@pytest.mark.parametrize("algo", ["ppo", "ppo-fast"])
def test_the_same_seed_learns_the_same(tmp_path, algo):
    runs = []
    for i, seed in enumerate((1, 1, 2)):
        runs.append(Run(small(algo, seed=seed), tmp_path / str(i)))
        runs[-1].train(progress=False)
    first, second, other = (weights(run.model) for run in runs)
    assert np.array_equal(first, second) and not np.array_equal(first, other)


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_trainings_with_other_seeds_have_other_walkers_and_no_evaluation_s(algo):
    met = []
    for seed in (1, 2, 1000, training.EXAM_SEED):
        config = dataclasses.replace(small(algo), seed=seed)
        model = build(config, envs.training_envs(config))
        native = model.get_env().unwrapped
        native.reset()
        met.append({*map(tuple, native.envs.states.tolist())})
    arena = PassiveWalkerVectorEnv(100, envs.scene_of(small(algo)))
    for seed in (1, training.EXAM_SEED, 1000):
        arena.reset(seed=seed)
        met.append({*map(tuple, arena.states.tolist())})
    assert len(set.union(*met)) == sum(map(len, met)) == 4 * 8 + 3 * 100


def test_only_the_newest_checkpoint_stays(ran):
    run = ran["ppo"]
    left = list((run.folder / "checkpoints").iterdir())
    assert left == [files.checkpoint_path(run.folder, run.steps)]


def test_a_kill_while_saving_costs_one_interval_at_most(tmp_path, monkeypatch):
    def killed(path, model, notes):
        if model.num_timesteps > 128:
            with replacing(path) as folder:
                folder.mkdir()
                (folder / "model.zip").write_bytes(b"half")
                raise KeyboardInterrupt
        whole(path, model, notes)

    whole = checkpoint.save
    monkeypatch.setattr(checkpoint, "save", killed)
    with pytest.raises(KeyboardInterrupt):
        Run(small(), tmp_path).train(progress=False)
    monkeypatch.setattr(checkpoint, "save", whole)
    run = Run(small(), tmp_path)
    assert run.steps == 128
    assert run.train(progress=False) and run.steps == 256


def test_a_wish_to_stop_saves_and_the_rest_can_follow(tmp_path, monkeypatch):
    exploring = {"exploration": {"log_std": {0: -1, 1: -3}, "energy": "positive", "until": 0.3}}
    often, seldom = (
        dataclasses.replace(small(every=every), **exploring) for every in (128, 10_000)
    )
    whole = Run(often, tmp_path / "whole")
    whole.train(progress=False)
    part = Run(seldom, tmp_path / "part")
    on_step = Milestones._on_step

    def wish(self):
        if self.model.num_timesteps == 64:  # in the middle of an update
            os.kill(os.getpid(), signal.SIGINT)
        return on_step(self)

    monkeypatch.setattr(Milestones, "_on_step", wish)
    assert part.train(progress=False) is False
    assert files.newest_checkpoint(tmp_path / "part") == files.checkpoint_path(
        tmp_path / "part", 128
    )
    rest = Run(seldom, tmp_path / "part")
    assert rest.train(progress=False)
    assert np.array_equal(weights(rest.model), weights(whole.model))


def test_policies_are_loaded_without_unpickling(ran, monkeypatch):
    def refuse(*arguments, **options):
        raise AssertionError("something was unpickled")

    monkeypatch.setattr(pickle, "loads", refuse)
    monkeypatch.setattr(cloudpickle, "loads", refuse)
    policy = load_policy(ran["ppo"].folder)
    action, _ = policy.predict(np.zeros((3, 8), np.float32))
    assert action.shape == (3, 1) and np.all(np.abs(action) <= 1.0)
    action, _ = policy.predict(np.zeros(8, np.float32))
    assert action.shape == (1,)


def test_the_model_is_one_that_stable_baselines3_loads_by_itself(ran):
    loaded = stable_baselines3.PPO.load(ran["ppo"].folder / "model.zip", device="cpu")
    assert loaded.n_envs == ran["ppo"].config.n_envs


def test_a_folder_without_a_policy_is_refused(tmp_path):
    config = small()
    config.save(tmp_path / files.CONFIG)
    with pytest.raises(ConfigError, match="--resume"):
        load_policy(tmp_path)


def test_files_of_another_shape_are_refused(ran):
    folder, other = ran["ppo"].folder, small()
    other.hyperparams["policy_kwargs"] = {"net_arch": [16]}
    with pytest.raises(ConfigError, match=r"model\.zip is damaged, or does not fit"):
        load_policy(folder, other)
    with pytest.raises(ConfigError, match=r"is another run:\n  hyperparams\.policy_kwargs"):
        Run(other, folder)


@pytest.mark.slow
def test_ctrl_c_saves_evaluates_and_ends_well(tmp_path):
    script = Path(train.__file__)
    command = [sys.executable, str(script), "--out", str(tmp_path / "run"), "--every", "8192"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=tmp_path)
    while not list((tmp_path / "run" / "checkpoints").glob("[0-9]*[1-9]*")):
        assert process.poll() is None
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=300)
    assert process.returncode == 0
    assert "Stopped after" in said and "passive" in said
    assert (tmp_path / "run" / "gait.png").stat().st_size > 0


@pytest.mark.learning
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of Ray's own
@pytest.mark.filterwarnings("ignore::FutureWarning")
@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.parametrize("ways", [("", ""), ("", "--ray"), ("--ray", "")])
def test_a_search_keeps_the_best_and_can_go_on(ways, tmp_path, capsys):
    pytest.importorskip("optuna")
    if any(ways):
        pytest.importorskip("ray.tune", exc_type=ImportError)
    line = ["--scene", "steep", "--steps", "128", "--envs", "8", "--every", "64", "--quiet"]
    for trials, way in enumerate(ways, 1):
        asked = ["--search", str(trials), "--out", str(tmp_path), *filter(None, [way])]
        assert train.main([*line, *asked]) == 0
    assert sorted(path.name for path in tmp_path.glob("trial-*")) == ["trial-0", "trial-1"]
    best = yaml.safe_load((tmp_path / "best.yml").read_text())["steep"]
    assert best["n_envs"] == 8 and "learning_rate" in best
    assert "best.yml" in capsys.readouterr().out


@pytest.mark.learning
def test_a_training_that_is_killed_twice_ends_as_if_it_had_not_been(tmp_path):
    found = kill(tmp_path, 2)
    assert found.differ == 0 and found.compared > 100_000


@pytest.mark.learning
def test_a_killed_training_loses_one_interval_at_most(tmp_path):
    folder, every = tmp_path / "run", 8192
    script = Path(train.__file__)
    command = [sys.executable, str(script), "--out", str(folder), "--every", str(every), "--quiet"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, cwd=tmp_path)
    while not list((folder / "checkpoints").glob("[0-9]*[1-9]*")):
        assert process.poll() is None
        time.sleep(0.05)
    time.sleep(0.5)
    process.kill()
    process.wait()
    curve = (folder / "learning_curve.csv").read_text().splitlines()
    config = dataclasses.replace(Config.load(folder / files.CONFIG), every=every)
    resumed = Run(config, folder)
    assert resumed.resumed and resumed.steps > 0
    assert int(curve[-1].split(",")[0]) - resumed.steps <= every
    load_policy(folder)


@pytest.mark.parametrize("algo", ["ppo", "sac"])
def test_an_exported_policy_acts_as_it_did(algo, ran, tmp_path):
    """As tensors and JSON; earlier versions wrote the configuration as YAML."""
    run, own = ran[algo], LearnedPolicy(ran[algo].model, algo)
    export(own, run.config, tmp_path)
    assert {path.suffix for path in tmp_path.iterdir()} == {".safetensors", ".json"}
    config, back = learned(tmp_path)
    assert (config.algo, config.hyperparams) == (algo, run.config.hyperparams)
    assert own.predict(SEEN)[0] == pytest.approx(back.predict(SEEN)[0], abs=1e-6)
    (tmp_path / "policy.json").unlink()
    run.config.save(tmp_path / files.CONFIG)
    config, back = learned(tmp_path)
    assert config == run.config
    assert own.predict(SEEN)[0] == pytest.approx(back.predict(SEEN)[0], abs=1e-6)


@pytest.mark.parametrize("algo", ["ppo", "sac"])
def test_the_last_policy_is_exported_although_an_earlier_one_is_kept(algo, tmp_path, capsys):
    run, out = Run(small(algo), tmp_path / "run"), str(tmp_path / "last")
    words = ["export", "--last", str(tmp_path / "run"), out]
    assert train.main(words) != 0
    assert "has no checkpoint yet" in capsys.readouterr().err
    run.notes["best"] = 1e9  # no evaluation is as good, so no policy is kept
    run.train(progress=False)
    assert not (tmp_path / "run" / "model.zip").exists()
    assert train.main(words) == 0
    own, found = LearnedPolicy(run.model, algo), gpw.load_policy(out)
    assert own.predict(SEEN)[0] == pytest.approx(found.predict(SEEN)[0], abs=1e-6)


@pytest.mark.parametrize("algo", ["ppo", "sac"])
def test_a_run_is_exported_as_an_onnx_file_with_its_normalizer(algo, ran, tmp_path, capsys):
    pytest.importorskip("onnxruntime")
    folder = ran[algo].folder
    own = load_policy(folder)
    for name, words in {"one.onnx": [], "two/policy.onnx": ["--onnx"]}.items():
        out = str(tmp_path / name.removesuffix("/policy.onnx"))
        assert train.main(["export", str(folder), out, *words]) == 0
        assert capsys.readouterr().out == f"Saved in {tmp_path / name}\n"
        policy = gpw.load_policy(tmp_path / name)
        assert policy.scene == envs.scene_of(ran[algo].config)
        assert policy.predict(SEEN)[0] == pytest.approx(own.predict(SEEN)[0], abs=2e-6)


def test_a_shipped_policy_is_exported_as_an_onnx_file_that_has_a_gait(tmp_path, capsys):
    pytest.importorskip("onnxruntime")
    file = tmp_path / "shipped.onnx"
    assert train.main(["export", "steep-ppo", str(file)]) == 0
    shipped, found = gpw.load_policy("steep-ppo"), gpw.load_policy(file)
    assert found.predict(SEEN)[0] == pytest.approx(shipped.predict(SEEN)[0], abs=2e-6)
    assert train.main(["gait", str(file)]) == 0
    assert "speed" in capsys.readouterr().out


def test_a_run_s_file_of_stable_baselines3_lacks_the_normalizer_beside_it(ran):
    with pytest.raises(gpw.PolicyError, match=r"normalizer.*train.py export"):
        gpw.load_policy(ran["ppo"].folder / "model.zip")


@pytest.mark.parametrize(("algo", "scene", "name"), [
    ("ppo-fast", "level", "lab-ppo"), ("ppo", "level", "level-ppo"),
    ("shac", "lab", "level-ppo"), ("sac", "steep", "steep-sac"),
])  # fmt: skip
def test_a_training_begins_with_the_policy_it_is_given(algo, scene, name, tmp_path):
    config = small(algo, scene=scene, start=name)
    run, policy = Run(config, tmp_path), gpw.load_policy(name)
    begun = LearnedPolicy(run.model, algo.upper())
    mean, spread, _ = policy.moments
    seen = np.random.default_rng(0).normal(mean, spread, (64, len(mean))).astype(np.float32)
    expected = policy.predict(seen)[0]
    assert np.ptp(expected) > 0.5
    np.testing.assert_allclose(begun.predict(seen)[0], expected, atol=1e-5)
    assert run.train(progress=False)
    assert not np.allclose(begun.predict(seen)[0], expected, atol=1e-5)
    # A resumed run continues with its own weights.
    more = dataclasses.replace(config, steps=config.steps + 128)
    np.testing.assert_array_equal(weights(Run(more, tmp_path).model), weights(run.model))


def test_a_training_begins_with_the_policy_of_another_run(ran, tmp_path):
    folder = ran["ppo"].folder
    first, second = load_policy(folder), Run(small(seed=1, start=str(folder)), tmp_path)
    seen = gymnasium.make_vec(envs.ID, num_envs=4, scene="level").reset(seed=0)[0]
    here = LearnedPolicy(second.model, "PPO").predict(seen)[0]
    np.testing.assert_allclose(here, first.predict(seen)[0], atol=1e-5)


@pytest.mark.parametrize(("algo", "scene", "words"), [
    ("ppo-fast", "anywhere", "with layers"), ("sac", "level", "this training needs SAC"),
])  # fmt: skip
def test_a_policy_that_does_not_fit_a_training_leaves_no_folder(
    algo, scene, words, tmp_path, capsys
):
    line = ["--algo", algo, "--scene", scene, "--from", "level-ppo", "--out", str(tmp_path / "run")]
    assert train.main(line) == 2
    said = capsys.readouterr().err
    assert "level-ppo cannot be continued" in said and words in said
    assert not (tmp_path / "run").exists()


def test_an_exported_policy_with_other_layers_is_refused(ran, tmp_path):
    for algo, run in ran.items():
        export(LearnedPolicy(run.model, algo.upper()), run.config, tmp_path / algo)
    (tmp_path / "sac" / "policy.safetensors").replace(tmp_path / "ppo" / "policy.safetensors")
    with pytest.raises(ConfigError, match="action_net"):
        learned(tmp_path / "ppo")


@pytest.mark.parametrize(("algo", "scene"), [
    ("ppo", "level"), ("ppo-fast", "level"), ("sac", "level"), ("sac", "push-off"),
    ("shac", "level"), ("shac-learned", "level"),
])  # fmt: skip
def test_evaluations_during_a_training_run_the_same_policy_on_numpy(algo, scene, tmp_path):
    run = Run(small(algo, scene=scene), tmp_path)
    policy, seen = LearnedPolicy(run.model, algo), run.exam.observation_space.sample()
    copied = on_numpy(policy, run.config)
    np.testing.assert_allclose(copied.predict(seen)[0], policy.predict(seen)[0], atol=2e-6)


def test_a_training_says_when_it_first_walked(tmp_path):
    run = Run(small(), tmp_path)
    names = ("steps", "seconds", "reached_time_limit", "hundred_strides", "distance")
    rows = [(64, 0.5, 0.4, 0.4, 2.0), (1024, 1.5, 0.5, 0.5, 12.34), (2048, 2.5, 0.9, 0.9, 60.0)]
    run.notes["curve"] = [dict(zip(names, row, strict=True)) for row in rows]
    assert "1.5 s of training (1,024 steps)" in run.first_walks()
    assert "12.3 leg lengths" in run.first_walks()
    assert run.first_to_walk["steps"] == 1024
    del run.notes["curve"][1:]
    assert run.first_walks().startswith("At no time")


def test_each_evaluation_is_kept_beside_what_exploring_walks_earned(ran):
    """In the learning curve, and in tensorboard's logs where they are asked for."""
    run, folder = ran["ppo"], ran["ppo"].folder
    first, last = run.notes["curve"][0], run.notes["curve"][-1]
    assert np.isnan(first["exploring_reward"])  # no episode has ended yet
    episodes = [episode["r"] for episode in run.model.ep_info_buffer]
    assert episodes and last["exploring_reward"] == pytest.approx(np.mean(episodes))
    assert last["exploring_reward"] != last["reward"]
    header = (folder / "learning_curve.csv").read_text().splitlines()[0].split(",")
    assert {"reward", "distance", "exploring_reward"} <= set(header)
    written = b"".join(path.read_bytes() for path in (folder / "tensorboard").rglob("*tfevents*"))
    assert b"eval/reward" in written and b"rollout/ep_rew_mean" in written


@pytest.mark.parametrize(
    ("algo", "env", "last"),
    [
        ("ppo-fast", {}, True),
        ("ppo-fast", {"reward": {"distance": 1.0}}, False),
        ("ppo", {}, False),
    ],
)
def test_the_last_policy_is_kept_or_the_best_where_the_reward_is_what_counts(
    tmp_path, algo, env, last
):
    run = Run(small(algo, 128, every=128, env=env), tmp_path)
    assert run.train(progress=False)
    run.notes["best"], before = np.inf, (tmp_path / "model.zip").read_bytes()
    with torch.no_grad():
        next(run.model.policy.parameters()).add_(1.0)
    run._evaluate(0.0)
    assert ((tmp_path / "model.zip").read_bytes() != before) == last
