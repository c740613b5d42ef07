"""Trainings as tasks of a sweep."""

import pytest

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
