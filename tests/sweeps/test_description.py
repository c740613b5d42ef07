"""A description determines the tasks, or raises an error with the reason."""

import json

import pytest

import gym_passive_walker as gpw
from gym_passive_walker.apps.sweeps.description import Description
from gym_passive_walker.apps.sweeps.run import _described
from gym_passive_walker.apps.sweeps.tasks import task


def test_a_grid_is_every_combination_and_a_list_goes_row_by_row():
    over = {"slope": [0.02, 0.03], "seed": [7, 8]}
    tasks = Description(analysis="gait", over=over).tasks
    pairs = [(given["slope"], given["seed"]) for given in tasks]
    assert pairs == [(0.02, 7), (0.02, 8), (0.03, 7), (0.03, 8)]
    rows = Description(analysis="gait", over=over, how="list").tasks
    assert [(given["slope"], given["seed"]) for given in rows] == [(0.02, 7), (0.03, 8)]


def test_each_of_n_slices_of_a_parameter_holds_one_of_n_latin_samples():
    given = Description(
        analysis="gait", over={"foot_radius": [0.1, 0.3], "slope": [0.01, 0.05]},
        how="latin-hypercube", samples=50, seed=3,
    ).tasks  # fmt: skip
    for name, low, high in (("foot_radius", 0.1, 0.3), ("slope", 0.01, 0.05)):
        slices = [int(50 * (each[name] - low) / (high - low)) for each in given]
        assert sorted(slices) == list(range(50))


def sampled(how, samples, **options):
    """Tasks of a sample of slopes."""
    over = {"slope": [0.01, 0.05]}
    return Description(analysis="gait", over=over, how=how, samples=samples, **options).tasks


@pytest.mark.parametrize("how", ["sobol", "latin-hypercube"])
def test_another_seed_draws_another_sample(how):
    drawn = [[given["slope"] for given in sampled(how, 8, seed=seed)] for seed in (0, 1, 1)]
    assert drawn[1] == drawn[2] and not set(drawn[0]) & set(drawn[1])


def test_the_first_half_of_a_sobol_sample_is_the_smaller_sample():
    few, many = sampled("sobol", 16), sampled("sobol", 32)
    assert many[:16] == few and len({each["slope"] for each in many}) == 32


def test_a_walker_in_a_description_is_its_parameters():
    found = Description(analysis="gait", over={"slope": [0.03]}, given={"walker": gpw.WALKERS["C"]})
    call = task("gait", found.tasks[0])
    assert call.keywords == {"walker": gpw.WALKERS["C"], "slope": 0.03}


@pytest.mark.parametrize(
    ("analysis", "given", "said"),
    [
        ("gaits", {}, "choose from gait,"),
        ("nowhere:nothing", {}, "cannot be found"),
        ("gait", {"slope": 0.03}, "gait needs a walker, or a controller"),
        ("gait", {"walker": "lab"}, "gait needs a slope, or a controller"),
        ("family", {"walker": "lab"}, "family needs slope_min, slope_max"),
        ("gait", {"slope": 0.03, "foot_radius": 0.1}, "foot_radius needs a walker"),
        ("gait", {"walker": "lab", "slop": 0.03}, "slop \\(slope\\?\\)"),
        ("evaluation", {"controller": "level-ppo", "max_hip": 1}, "max_hip_torque\\?"),
    ],
)
def test_what_an_analysis_does_not_take_is_refused_in_a_sentence(analysis, given, said):
    with pytest.raises(ValueError, match=said):
        task(analysis, given)


def test_a_controller_that_is_swept_is_that_of_the_stride_map():
    of_policy = {"controller": "steep-ppo", "slope": 0.111}
    found = gpw.find_gait(gpw.stride_map(controller="steep-ppo"), 0.111)
    row = task("gait", of_policy)()
    assert row["found"] and row["multiplier"] == pytest.approx(abs(found.multipliers[0]))
    with pytest.raises(ValueError, match="steep-ppo determines the actuation"):
        task("gait", {**of_policy, "hip_torque": 0.01})()


def test_a_seed_that_is_given_to_all_tasks_is_theirs_and_the_sweep_s_draws_the_sample():
    reported = sampled("sobol", 4, seed=3, given={"seed": 11})
    assert {each["seed"] for each in reported} == {11}
    plain = sampled("sobol", 4, seed=3)
    assert {each["seed"] for each in plain} == {3}
    assert [each["slope"] for each in reported] == [each["slope"] for each in plain]


def test_what_is_said_besides_a_description_replaces_what_it_says(tmp_path):
    content = {"analysis": "gait", "over": {"slope": [0.02, 0.03]}, "given": {"walker": "lab"}}
    for description in (content, tmp_path / "few.json", Description(**content)):
        (tmp_path / "few.json").write_text(json.dumps(content))
        found = _described(description, {"over": {"slope": [0.04]}})
        assert [each["slope"] for each in found.tasks] == [0.04]
        assert found.given == {"walker": "lab"}


def test_the_seed_of_a_sweep_has_63_bits():
    given = {"analysis": "gait", "over": {"slope": [0.01]}}
    assert Description(**given, seed=2**63 - 1).seed == 2**63 - 1
    with pytest.raises(ValueError, match=rf"seed must be a whole number from 0 to {2**63 - 1}"):
        Description(**given, seed=2**63)
