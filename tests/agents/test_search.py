"""Searches for hyperparameters: what is drawn, counted, saved and printed."""

from dataclasses import replace

import pytest
import yaml

from agents import search as searching
from agents.config import ALGORITHMS, ConfigError, configure
from agents.envs import training_envs
from agents.learner import build
from agents.search import BEST, search


class Trial:
    """A trial that draws the lower or the upper end of each range."""

    def __init__(self, number, end):
        self.number, self.end, self.attributes, self.asked = number, end, {}, []

    def suggest_float(self, name, low, high, *, log=False):
        """A number."""
        self.asked.append(name)
        assert 0.0 < low < high or (low < high and not log)
        return (low, high)[self.end]

    def suggest_int(self, name, low, high):
        """A whole number."""
        self.asked.append(name)
        return (low, high)[self.end]

    def suggest_categorical(self, name, choices):
        """One of some values."""
        self.asked.append(name)
        return choices[-self.end]

    def set_user_attr(self, name, value):
        """Keep a value."""
        self.attributes[name] = value


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_the_first_trial_has_the_hyperparameters_that_were_given_and_later_ones_draw(algo):
    config = configure(algo, "level", seed=4, n_envs=8)
    first = Trial(0, 0)
    drawn = searching._drawn(config, first)
    assert drawn == {"config": config, "number": 0} and not first.asked
    drawn["config"].hyperparams["policy_kwargs"]["net_arch"] = None
    assert config == configure(algo, "level", seed=4, n_envs=8)  # it is a copy
    trials = Trial(3, 0), Trial(8, 1)
    found = [searching._drawn(config, trial) for trial in trials]
    for trial, each in zip(trials, found, strict=True):
        made = each["config"]
        assert each["number"] == trial.number
        assert trial.attributes == {"hyperparams": made.hyperparams}
        assert replace(made, hyperparams=config.hyperparams) == config
        names = {"gamma" if name == "1 - gamma" else name for name in trial.asked}
        assert names == set(searching._SPACES[algo])
        others = made.hyperparams.keys() - names
        assert {n: made.hyperparams[n] for n in others} == {
            n: config.hyperparams[n] for n in others
        }
        assert 0.9 < made.hyperparams["gamma"] < 1.0
        build(made, training_envs(made))  # raises if a value is invalid
    low, high = (each["config"].hyperparams for each in found)
    assert all(low[name] != high[name] for name in searching._SPACES[algo])


def given(monkeypatch, returns):
    """Replace trainings by these returns; numbers of the trials made so far."""
    pytest.importorskip("optuna")
    made = []

    def trained(folder, config, number, *, trust):
        made.append(number)
        found = returns[number]
        if found is None:
            raise KeyboardInterrupt
        return found

    monkeypatch.setattr(searching, "_trained", trained)
    return made


def test_the_best_trial_is_kept_as_a_preset_that_makes_its_configuration(
    tmp_path, monkeypatch, capsys
):
    given(monkeypatch, [1.0, 3.25, 2.0])
    config = configure("ppo", "steep", n_envs=4, steps=320)
    best = search(config, tmp_path / "new" / "study", 3)
    said = capsys.readouterr().out
    assert said == "trial 0: return 1.000\ntrial 1: return 3.250\ntrial 2: return 2.000\n"
    presets = yaml.safe_load((tmp_path / "new" / "study" / BEST).read_text())
    assert list(presets) == ["steep"]
    monkeypatch.setattr("agents.config.presets", lambda algo: presets)
    assert configure("ppo", "steep") == replace(config, hyperparams=best)


def test_a_search_that_goes_on_makes_only_the_trials_that_are_left(tmp_path, monkeypatch):
    made, config = given(monkeypatch, [1.0, 3.0, 2.0]), configure("ppo", "level")
    search(config, tmp_path, 1, progress=False)
    assert made == [0]
    best = search(config, tmp_path, 3, progress=False)
    assert made == [0, 1, 2]
    assert best != config.hyperparams  # the second trial's are
    assert search(config, tmp_path, 3, progress=False) == best and made == [0, 1, 2]


@pytest.mark.parametrize(
    ("other", "line"),
    [
        ({"steps": 640}, "steps: 320 here, 640 asked for"),
        ({"env": {"slope": (0.0, 0.02)}}, "env.slope: None here, [0.0, 0.02] asked for"),
        ({"scene": "steep"}, "scene: 'level' here, 'steep' asked for"),
    ],
)
def test_a_folder_has_trials_of_one_configuration(tmp_path, monkeypatch, other, line):
    made, config = given(monkeypatch, [1.0, 3.0]), {"scene": "level", "n_envs": 4, "steps": 320}
    search(configure("ppo", **config), tmp_path, 1, progress=False)
    with pytest.raises(ConfigError) as refusal:
        search(configure("ppo", **config | other), tmp_path, 2, progress=False)
    assert line in str(refusal.value) and made == [0]
    search(configure("ppo", **config), tmp_path, 2, progress=False)
    assert made == [0, 1]


def test_a_search_is_determined_by_its_seed_and_prints_nothing_if_quiet(
    tmp_path, monkeypatch, capsys
):
    given(monkeypatch, [0.0, 1.0])
    found = [
        search(configure("sac", "level", seed=s), tmp_path / name, 2, progress=False)
        for name, s in (("a", 1), ("b", 1), ("c", 2))
    ]
    assert found[0] == found[1] != found[2]
    assert capsys.readouterr().out == ""


def test_trials_that_were_interrupted_do_not_count(tmp_path, monkeypatch):
    made = given(monkeypatch, [None, 2.0, 1.0])
    config = configure("ppo", "level")
    with pytest.raises(KeyboardInterrupt):
        search(config, tmp_path, 2, progress=False)
    search(config, tmp_path, 2, progress=False)
    assert made == [0, 1, 2]


def test_a_trial_is_a_training_in_its_own_folder_that_counts_only_if_it_ends(tmp_path, monkeypatch):
    made, ends = [], [True]

    class Made:
        """A training with a best return."""

        def __init__(self, config, folder, *, trust):
            made.append((config, folder, trust))
            self.notes = {"best": 7}

        def train(self, *, progress):
            return ends[0] and not progress

    monkeypatch.setattr(searching, "Run", Made)
    assert searching._trained(tmp_path, "config", 12, trust=True) == 7.0
    assert made == [("config", tmp_path / "trial-12", True)]
    ends[0] = False
    with pytest.raises(KeyboardInterrupt):
        searching._trained(tmp_path, "config", 0, trust=False)


@pytest.mark.parametrize(
    ("module", "ray", "words"),
    [("optuna", None, r"Optuna.*\[search\]"), ("ray", "here", r"Ray Tune.*\[ray\]")],
)
def test_a_missing_library_is_named_with_its_extra(module, ray, words, tmp_path, monkeypatch):
    pytest.importorskip("optuna")
    monkeypatch.setitem(__import__("sys").modules, module, None)
    with pytest.raises(ConfigError, match=words):
        search(configure(), tmp_path, 1, ray=ray)


def test_a_damaged_study_is_named(tmp_path):
    pytest.importorskip("optuna")
    (tmp_path / searching.STUDY).write_text("{}\n")
    with pytest.raises(ConfigError, match=r"study\.log"):
        search(configure(), tmp_path, 1)
