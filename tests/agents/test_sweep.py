"""Trainings as tasks of a sweep."""

import math

import pytest

import gym_passive_walker as gpw
from agents import sweep
from agents.config import configure
from agents.sweep import train


@pytest.mark.learning
def test_a_seed_is_a_training_and_its_folder_goes_on_with_it(tmp_path):
    given = {"algo": "ppo", "scene": "level", "steps": 256, "n_envs": 2, "slope": 0.001}
    here = train(**given, seed=3, folder=str(tmp_path))
    assert here == pytest.approx(train(**given, seed=3), rel=0.0, abs=0.0, nan_ok=True)
    (run,) = tmp_path.iterdir()
    assert run.name.startswith("ppo-level-3-") and (run / "learning_curve.csv").exists()
    assert here["steps"] >= 256
    assert here == pytest.approx(
        train(**given, seed=3, folder=str(tmp_path)), rel=0.0, abs=0.0, nan_ok=True
    )


@pytest.fixture
def made(monkeypatch):
    """Trainings that return an invented learning curve; their configurations and folders."""
    found = []

    class Made:
        """A training of two evaluations."""

        first_to_walk, finished = None, True

        def __init__(self, config, folder):
            found.append((config, folder))
            assert folder.parent.is_dir()
            curve = [{"steps": 1, "seconds": 2.0}, {"steps": 8, "seconds": 3.0, "reward": 5.0}]
            self.notes = {"curve": curve}

        def train(self, *, progress):
            assert progress is False
            return self.finished

    monkeypatch.setattr(sweep, "Run", Made)
    return found, Made


def test_the_results_are_the_last_evaluation_and_when_it_first_walked(made):
    found = train(scene="lab", seed=2)
    assert math.isnan(found.pop("walks_after"))
    assert found == {"steps": 8, "reward": 5.0}  # seconds differ from run to run
    made[1].first_to_walk = {"steps": 1}
    again = train(scene="lab", seed=2)
    assert again["walks_after"] == 1.0 and type(again["walks_after"]) is float
    for config, folder in made[0]:
        assert config == configure("ppo", "lab", seed=2) and not folder.exists()


def test_an_interrupted_training_has_no_results(made):
    made[1].finished = False
    with pytest.raises(KeyboardInterrupt):
        train(scene="lab", seed=2)


def test_a_folder_is_named_by_all_arguments_in_any_order(made, tmp_path):
    for changes in (
        {"slope": 0.01, "walker": "C"}, {"walker": "C", "slope": 0.01}, {"walker": "C"},
        {"slope": 0.01, "walker": "C", "steps": 9}, {"slope": 0.01, "walker": "C", "n_envs": 9},
    ):  # fmt: skip
        train("sac", "level", seed=7, folder=str(tmp_path), **changes)
    names = [folder.name for _, folder in made[0]]
    assert all(name.startswith("sac-level-7-") and len(name) == 20 for name in names)
    assert names[0] == names[1] and len(set(names)) == 4
    assert {folder.parent for _, folder in made[0]} == {tmp_path}


def test_runs_of_task_files_and_of_walkers_are_named_by_their_content(made, tmp_path):
    task = tmp_path / "task.yaml"
    for weight in (1.0, 2.0):
        task.write_text(f"energy_weight: {weight}\n")
        train("sac", str(task), folder=str(tmp_path))
    for walker in ("lab", "C"):
        train("sac", walker=gpw.WALKERS[walker], folder=str(tmp_path))
    folders = [folder for _, folder in made[0]]
    assert len({*folders}) == 4 and {each.parent for each in folders} == {tmp_path}
