"""Each option of learners, presets, runs and `train.py` has an effect."""

from __future__ import annotations

import argparse
import dataclasses
import inspect
from pathlib import Path

import pytest

pytest.importorskip("stable_baselines3")

import torch
from stable_baselines3.common.logger import Logger

import train
from agents import benchmark, commands, envs, evaluation, results
from agents.config import ALGORITHMS, Config, configure, presets
from agents.exploration import Ladder, Schedule, explorers
from agents.first_order import SHAC
from agents.learned_steps import LearnedSHAC
from agents.learner import build
from agents.ppo_fast import FastPPO
from agents.training import Run
from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv
from gym_passive_walker.gaits.scenes.scene import SCENES
from tests.agents.runs import short_arena, weights
from tests.options.effects import Call, To, cases, check, missing, plain


@pytest.fixture(scope="module", autouse=True)
def _one_thread():
    """Limit torch to one thread, as `train.py` does; more threads only wait for each other."""
    train.keep_to_one_thread()


class Enough(Exception):
    """Raised when a test has its result."""


# Learners: what is learned in two updates of a few walkers.

WALKERS = 4


def learned(of, **options):
    """A learner, after two updates."""
    torch.manual_seed(0)
    env = PassiveWalkerVecEnv(WALKERS, max_episode_steps=9)
    model = of("MlpPolicy", env, device="cpu", **options)
    if hasattr(model, "policy"):
        model.learn(2 * WALKERS * model.n_steps)
    return model


def what(model):
    """Results in which an option may have an effect: weights, rollouts and logs."""
    return weights(model), model._stats_window_size, model.verbose


TWO = dict(n_steps=16, batch_size=32, n_epochs=2, learning_rate=1e-2, seed=1)
SAME_OF_BOTH = dict(
    learning_rate=1e-3, n_steps=32, batch_size=64, n_epochs=3, gamma=0.9, gae_lambda=0.5,
    max_grad_norm=1e-3, stats_window_size=7, policy_kwargs={"net_arch": [8]}, seed=2, verbose=1,
)  # fmt: skip
ELSEWHERE = {
    "policy": "names the networks",
    "env": "walkers",
    "device": "where networks are; see `test_ppo_fast`",
    "tensorboard_log": "of the test below",
    "_init_setup_model": "of the test below",
}
ITS_OWN = {
    FastPPO: {"clip_range": 0.01, "farthest": 0.5, "vf_coef": 0.01},
    SHAC: {"reach": 0.5},
    LearnedSHAC: {"reach": 0.5},
}
LEARNERS = {
    of.__name__: Call(
        lambda of=of, **options: what(learned(of, **options)),
        TWO,
        {**SAME_OF_BOTH, **own},
        ELSEWHERE,
        of,
    )
    for of, own in ITS_OWN.items()
}


@pytest.mark.parametrize("name, option", cases(LEARNERS))
def test_an_option_of_a_learner_is_heard(name, option):
    check(LEARNERS[name], option)


def test_every_option_of_every_learner_is_tested():
    assert not missing(LEARNERS, {"FastPPO", "SHAC", "LearnedSHAC"})


@pytest.mark.parametrize("of", [FastPPO, SHAC, LearnedSHAC])
def test_a_learner_logs_where_it_is_asked_to_and_builds_when(of, tmp_path):
    learned(of, **TWO, tensorboard_log=str(tmp_path))
    assert list(tmp_path.rglob("events.out.tfevents.*"))
    assert not hasattr(learned(of, **TWO, _init_setup_model=False), "policy")


class Lines:
    """A callback that counts steps, and stops after some."""

    def __init__(self, most=10**9):
        self.most, self.steps = most, 0

    def __call__(self, *_):
        """Count a step."""
        self.steps += 1
        return self.steps < self.most


def taught(**options):
    """Results of a second round of learning."""
    model = learned(FastPPO, **TWO)
    dumped = []
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Logger, "dump", lambda _, step=0: dumped.append(step))
        model.learn(**options)
    return weights(model), model.num_timesteps, dumped


def test_every_option_of_learning_is_heard(tmp_path):
    call = Call(
        taught,
        dict(total_timesteps=64),
        dict(
            total_timesteps=128,
            callback=Lines(3),
            log_interval=None,
            reset_num_timesteps=False,
            progress_bar=To(True, same=True),
        ),
        {"tb_log_name": "names the folder of logs"},
        FastPPO.learn,
    )
    assert not missing({"FastPPO.learn": call}, {"FastPPO.learn"})
    for option in call.other:
        check(call, option)
    model = learned(FastPPO, **TWO, tensorboard_log=str(tmp_path))
    model.learn(64, tb_log_name="elsewhere")
    assert list(tmp_path.glob("elsewhere_*"))


# Presets.

CASES = [(algo, scene) for algo in ALGORITHMS for scene in presets(algo)]
SHORT = {"sac": {"buffer_size": 100}}


@pytest.mark.parametrize("algo, scene", CASES)
def test_all_that_a_preset_says_reaches_the_learner(algo, scene):
    preset = dict(presets(algo)[scene])
    if scene not in SCENES:
        return  # for rl_zoo3, or of a control: the same as those of scenes
    config = configure(algo, scene)
    assert (config.n_envs, config.steps) == (preset.pop("n_envs"), preset.pop("n_timesteps"))
    wrapper = preset.pop("env_wrapper", {}).get("gymnasium.wrappers.TimeLimit", {})
    training = envs.training_envs(config)
    limit = wrapper.get("max_episode_steps", 4000)
    assert training.batch.rules["step_limit"][0] == limit
    for name, value in preset.pop("env_kwargs", {}).items():
        assert getattr(training.scene, name) == value != getattr(envs.scene_of(config), name)
    reported = preset.pop("callback", None)
    exploring = explorers(algo, config.exploration)
    assert len(exploring) == (reported is not None)
    for explorer in exploring:
        ((_, arguments),) = reported.items()
        for name, value in arguments.items():
            if name == "log_std":
                assert dict(zip(explorer.shares, explorer.values, strict=True)) == value
            else:
                assert getattr(explorer, name) == value
    model = build(config, training, **SHORT.get(algo, {}))
    normalizer, asked = model.get_vec_normalize_env(), preset.pop("normalize", None)
    assert (normalizer is not None) == bool(asked)
    if isinstance(asked, str):
        for name, value in eval(asked).items():
            assert getattr(normalizer, name) == value
    if normalizer is not None:
        assert normalizer.gamma == model.gamma
    rate = preset.pop("learning_rate")
    falls = isinstance(rate, str)
    first = float(str(rate).removeprefix("lin_"))
    assert model.lr_schedule(1.0) == first
    for left in (0.5, 0.0):
        assert model.lr_schedule(left) == pytest.approx(first * (left if falls else 1.0))
    kwargs = preset.pop("policy_kwargs", {})
    if isinstance(kwargs, str):
        kwargs = eval(kwargs, {"nn": torch.nn})
    for name, value in kwargs.items():
        if name == "log_std_init":
            assert model.policy.log_std.detach().numpy() == pytest.approx(value)
        elif name == "optimizer_kwargs":
            for key, setting in value.items():
                adam = model.policy.optimizer if algo != "sac" else model.actor.optimizer
                assert adam.defaults[key] == setting
        else:
            assert getattr(model.policy, name) == value
    preset.pop("policy")
    for name, value in preset.items():
        if name == "ent_coef" and isinstance(value, str):
            start = float(value.removeprefix("auto_"))
            assert model.log_ent_coef.exp().item() == pytest.approx(start)
        elif name == "clip_range" and algo == "ppo":
            assert model.clip_range(1.0) == value
        elif name == "train_freq":
            assert model.train_freq.frequency == value
        elif name != "buffer_size":
            assert getattr(model, name) == value, name
    if "buffer_size" in preset:
        assert model.buffer_size == SHORT["sac"]["buffer_size"]
        assert config.hyperparams["buffer_size"] == preset["buffer_size"]


# Configurations and runs.


def of_a_run(config):
    """The parts of a run that an option may affect: environments, learner and explorer."""
    training = envs.training_envs(config, 2)
    model = build(config, training, n_steps=32, batch_size=64)
    seen = training.scene, training.batch.rules["step_limit"], envs.scene_of(config)
    normalizer = model.get_vec_normalize_env()
    scales = normalizer and (normalizer.norm_obs, normalizer.norm_reward, normalizer.clip_obs)
    arms = [vars(x).get("values") for x in explorers(config.algo, config.exploration)]
    return seen, weights(model), scales, arms, model.gamma


def configured(**fields):
    base = dataclasses.asdict(configure("ppo", "level", n_envs=2, steps=64))
    return of_a_run(Config(**{**base, **fields}))


def test_every_field_of_a_configuration_is_heard():
    other = {
        "algo": "shac",
        "scene": "lab",
        "env": {"slope": 0.01},
        "seed": 1,
        "episode_steps": 7,
        "normalize": None,
        "hyperparams": {**configure("ppo", "level").hyperparams, "gamma": 0.5},
        "exploration": None,
        "training": {"reset_noise_scale": 0.3},
    }
    shac = {
        "normalize": {"norm_reward": False},
        "hyperparams": {"policy": "MlpPolicy", "learning_rate": 1e-3, "reach": 0.1},
    }
    for name, value in other.items():
        changed = configured(**({name: value} | (shac if name == "algo" else {})))
        assert plain(changed) != plain(configured()), f"{name} is not heard"
    # Of the tests below, of test_training, and of test_own_scenes.
    elsewhere = {"n_envs", "steps", "every", "start", "source"}
    assert {field.name for field in dataclasses.fields(Config)} == {*other, *elsewhere}


CONFIGURE = {
    "configure": Call(
        configure,
        dict(algo="ppo", scene="level"),
        dict(
            algo="sac",
            scene="steep",
            env={"slope": 0.02},
            steps=1000,
            n_envs=8,
            seed=To(3, expect=lambda a, b: b.seed == 3),
            every=To(7, expect=lambda a, b: b.every == 7),
            episode_steps=60,
            start=To("lab-ppo", expect=lambda a, b: b.start == "lab-ppo"),
        ),
    ),
    "evaluate_policy": Call(
        evaluation.evaluate_policy,
        dict(which="steep-ppo", episodes=1),
        dict(which="steep-sac", episodes=2, seed=3),
        dict(trust="see tests/agents/test_own_scenes.py"),
    ),
    "Schedule": Call(
        Schedule,
        dict(log_std={0.0: -1.0}),
        dict(log_std={0.0: -2.0}, energy="net", until=0.5),
    ),
    "Ladder": Call(Ladder, dict(lowest=0.1, highest=1.0), dict(lowest=0.2, highest=2.0)),
    "units": Call(
        benchmark.units,
        dict(scenes=["level"], agents=["ppo"], seeds=1),
        dict(scenes=["lab"], agents=["sac"], seeds=2),
    ),
}


@pytest.mark.parametrize("name, option", cases(CONFIGURE))
def test_an_option_of_what_is_around_learners_is_heard(name, option):
    check(CONFIGURE[name], option)
    assert not missing(CONFIGURE, set(CONFIGURE))


@pytest.fixture
def short_exams(monkeypatch):
    """Make evaluations during training short."""
    monkeypatch.setattr(envs, "arena", short_arena)


@pytest.mark.usefixtures("short_exams")
def test_a_run_evaluates_and_stops_when_its_configuration_says(tmp_path):
    config = dataclasses.replace(configure("ppo", "level", n_envs=4, steps=128, every=64))
    config.hyperparams.update(n_steps=16, batch_size=64)
    asked_for = {"a": (128, 64, 4), "b": (256, 64, 4), "c": (128, 128, 4), "d": (128, 64, 8)}
    for name, (steps, every, count) in asked_for.items():
        here = dataclasses.replace(config, steps=steps, every=every, n_envs=count)
        here.hyperparams.update(n_steps=64 // count)
        run = Run(here, tmp_path / name)
        assert run.model.n_envs == count
        assert run.train(progress=False) and run.steps == steps
        walked = [row["steps"] for row in run.notes["curve"] if row["steps"] >= every]
        assert walked == list(range(every, steps + 1, every))


@pytest.mark.usefixtures("short_exams")
def test_a_bar_and_logs_change_nothing_that_is_learned(tmp_path, capsys):
    def run(name, progress, tensorboard):
        config = configure("ppo", "level", n_envs=4, steps=128, every=128)
        config.hyperparams.update(n_steps=16, batch_size=64)
        run = Run(config, tmp_path / name, tensorboard=tensorboard)
        run.train(progress=progress)
        return weights(run.model), bool(list((tmp_path / name).rglob("events.out.*")))

    quiet, none = run("a", False, False)
    shown, _ = run("b", True, False)
    logged, there = run("c", False, True)
    assert plain(quiet) == plain(shown) == plain(logged) and there and not none


# The command line.


def asked(words, monkeypatch):
    """The configuration of a training from words of the command line."""
    found = {}

    class Noted:
        """A run that only says what it was asked for."""

        left_out = ()

        def __init__(self, config, folder, *, tensorboard=False, trust=False):
            found.update(config=config, folder=folder, tensorboard=tensorboard, trust=trust)

        def train(self, *, progress=True):
            found["progress"] = progress
            raise Enough

    monkeypatch.setattr(train, "Run", Noted)
    with pytest.raises(Enough):
        train.main(words.split())
    return found


CONFIG = {
    "algo": ("--algo sac", "sac"), "scene": ("--scene steep", "steep"),
    "steps": ("--steps 1000", 1000), "n_envs": ("--envs 8", 8), "seed": ("--seed 5", 5),
    "every": ("--every 9", 9), "episode_steps": ("--episode-steps 70", 70),
    "start": ("--from level-ppo", "level-ppo"),
}  # fmt: skip
ENV = {
    "walker": ("--walker lab", "lab"), "slope": ("--slope 0.01 0.02", [0.01, 0.02]),
    "control": ("--control stride", "stride"),
}  # fmt: skip
CALLS = {
    "out": ("--out there", "folder", Path("there")), "quiet": ("--quiet", "progress", False),
    "tensorboard": ("--tensorboard", "tensorboard", True), "trust": ("--trust", "trust", True),
}  # fmt: skip
WORDS = CONFIG | ENV | CALLS
"""Words for each option of a training, and the value that they ask for."""


@pytest.mark.parametrize("option", CONFIG)
def test_an_option_of_a_training_is_a_field_of_its_configuration(option, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words, value = CONFIG[option]
    before, after = (getattr(asked(w, monkeypatch)["config"], option) for w in ("", words))
    assert before != value == after


@pytest.mark.parametrize("option", ENV)
def test_an_option_of_a_training_is_an_argument_of_its_scene(option, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words, value = ENV[option]
    assert asked("", monkeypatch)["config"].env == {}
    assert asked(words, monkeypatch)["config"].env == {option: value}


@pytest.mark.parametrize("option", CALLS)
def test_an_option_of_a_training_reaches_its_run_alone(option, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words, name, value = CALLS[option]
    before, after = asked("", monkeypatch), asked(words, monkeypatch)
    assert before.pop(name) != value == after.pop(name)
    before.pop("folder", None), after.pop("folder", None)  # each run has a new one
    assert before == after


def test_a_search_is_asked_for_by_words(tmp_path, monkeypatch, capsys):
    pytest.importorskip("optuna")
    from agents import search

    found, parameters = {}, set(inspect.signature(search.search).parameters)

    def noted(config, folder, trials, **others):
        found.update(config=config, folder=folder, trials=trials, **others)
        return {}

    monkeypatch.setattr(search, "search", noted)
    assert train.main("--search 3 --out there --ray far --quiet --seed 4 --trust".split()) == 0
    assert found.pop("config").seed == 4
    assert found == {
        "trials": 3, "folder": Path("there"), "ray": "far", "progress": False, "trust": True,
    }  # fmt: skip
    assert train.main("--search 2 --ray".split()) == 0
    assert (found["trials"], found["ray"], found["progress"]) == (2, "here", True)
    assert {"config", *found} == parameters


def of_parser(run, monkeypatch):
    """The options of a command, which creates its parser when it runs."""
    found = []

    def noted(parser, *_, **__):
        found.append(parser)
        raise Enough

    with monkeypatch.context() as patched:
        patched.setattr(argparse.ArgumentParser, "parse_args", noted)
        with pytest.raises(Enough):
            run([])
    return {action.dest for action in found[0]._actions} - {"help"}


def test_every_option_of_every_command_is_tested(monkeypatch):
    trains = {action.dest for action in train.train_parser()._actions} - {"help"}
    assert trains == {*WORDS, "resume", "search", "ray"}  # `resume` in `test_command_line`
    found = {name: of_parser(run, monkeypatch) for name, run in commands.COMMANDS.items()}
    assert found == {
        # `trust` is tried in test_own_scenes.
        "evaluate": {"run", "policy", "episodes", "seed", "trust"},
        "optimal": {"scene", "again"},
        "gait": {"policy", "scene", "slope", "period", "out", "trust"},
        "benchmark": {"scenes", "agents", "seeds", "budget", "out", "tables", "document", "quiet"},
        "export": {"run", "output", "onnx", "last", "trust"},
    }


def printed(words, capsys):
    capsys.readouterr()
    assert train.main(words.split()) == 0
    return capsys.readouterr().out


def test_every_option_of_gait_is_heard(capsys, tmp_path, monkeypatch):
    base = printed("gait lqr --scene steep", capsys)
    for words in (
        "deadbeat --scene lab",
        "lqr --scene lab",
        "lqr --scene steep --slope 0.1101",
        "lqr --scene steep --slope 0.115 --period 2",
    ):
        assert printed(f"gait {words}", capsys) != base
    drawn = []
    monkeypatch.setattr(
        "gym_passive_walker.pictures.axes.save",
        lambda figure, path: (drawn.append(path.suffix), path.touch()),
    )
    printed(f"gait lqr --scene steep --out {tmp_path / 'g.svg'}", capsys)
    assert drawn == [".svg"] and (tmp_path / "g.svg").exists()


def test_every_option_of_a_benchmark_is_heard(capsys, tmp_path, monkeypatch):
    found, written = [], []

    def run(folder, todo, *, budget, progress):
        found.append((folder, todo, budget, progress))

    monkeypatch.setattr(benchmark, "run", run)
    monkeypatch.setattr(benchmark, "load_scores", lambda folder: [folder])
    monkeypatch.setattr(results, "read_csv", lambda path: [path])
    monkeypatch.setattr(results, "tables", str)
    monkeypatch.setattr(results, "write_csv", lambda path, scores: written.append(path))
    monkeypatch.setattr(results, "write_document", lambda path, text: written.append(path))
    for name in ("draw", "draw_learning"):
        monkeypatch.setattr(results, name, lambda path, *_: written.append(path))
    here = f"--out {tmp_path}"
    printed(
        f"benchmark --scenes lab --agents passive ppo --seeds 2 --budget 0.5 --quiet {here}", capsys
    )
    folder, todo, budget, progress = found.pop()
    assert (folder, budget, progress) == (tmp_path, 0.5, False)
    assert [str(unit) for unit in todo] == ["lab-passive-0", "lab-ppo-0", "lab-ppo-1"]
    assert written == [tmp_path / "scores.csv"]
    printed(f"benchmark {here}", capsys)
    _, todo, budget, progress = found.pop()
    assert budget == 1.0 and progress and {unit.seed for unit in todo} == set(range(10))
    printed(f"benchmark --tables {here}", capsys)
    assert not found
    written.clear()
    assert printed(f"benchmark --tables some.csv {here}", capsys) == f"{[Path('some.csv')]}\n"
    assert not found and not written
    page = tmp_path / "docs" / "page.md"
    page.parent.mkdir()
    page.write_text(f"{results.BEGIN}\n{results.END}\n")
    printed(f"benchmark --tables {here} --document {page}", capsys)
    assert page in written and len(written) == 5
    with pytest.raises(SystemExit):
        train.main(["benchmark", "--budget", "much"])
    assert train.main(["benchmark", "--budget", "0"]) == 2


def test_what_a_sweep_trains_with_is_heard(tmp_path, monkeypatch):
    from agents import sweep

    found = []

    class Noted:
        """A run that only says what it was asked for."""

        def __init__(self, config, folder):
            found.append((config, folder))
            raise Enough

    monkeypatch.setattr(sweep, "Run", Noted)

    def trained(**options):
        with pytest.raises(Enough):
            sweep.train(**options)
        config, folder = found.pop()
        return config, folder.parent == tmp_path

    call = Call(
        trained,
        dict(folder=str(tmp_path)),
        dict(
            algo="sac",
            scene="steep",
            steps=100,
            n_envs=8,
            seed=5,
            folder=To(None, expect=lambda a, b: a[1] and not b[1]),
        ),
        of=sweep.train,
    )
    assert not missing({"train": call}, {"train"})
    for option in call.other:
        check(call, option)
    assert trained(slope=0.01)[0].env == {"slope": 0.01}
