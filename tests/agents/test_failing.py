"""A file that cannot be read or written raises one sentence, and existing files stay unchanged."""

import json
import os
import shutil
from contextlib import contextmanager

import numpy as np
import pytest
import yaml

import train
from agents import files

MORE = ["--steps", "256", "--quiet"]
CHECKPOINT = "checkpoints/000000000128"


@pytest.fixture
def run(steep_run, tmp_path):
    """A copy of a finished run."""
    return shutil.copytree(steep_run, tmp_path / "run")


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def refused(capsys, *arguments):
    """The one sentence of the error, after other output."""
    capsys.readouterr()
    assert train.main([str(argument) for argument in arguments]) == 2
    said = capsys.readouterr()
    assert said.err.startswith("train.py: error: ") and said.err.count("\n") == 1
    return said.err, said.out


@contextmanager
def full_disk(size):
    """Limit the size of files to some bytes."""
    resource = pytest.importorskip("resource", reason="limits of files are POSIX")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize(
    "damage",
    [
        lambda whole: b"",
        lambda whole: whole[: len(whole) // 2],
        lambda whole: np.random.default_rng(0).bytes(len(whole)),
    ],
    ids=["empty", "half", "random"],
)
@pytest.mark.parametrize(
    "name",
    [
        "config.yml", "model.zip", "normalizer.npz",
        *(f"{CHECKPOINT}/{name}" for name in (
            "model.zip", "arrays.npz", "envs.npz", "replay.npz", "notes.json", "envs.json",
        )),
    ],
)  # fmt: skip
def test_a_damaged_file_is_named_and_everything_left_as_it_is(run, name, damage, capsys):
    (run / name).write_bytes(damage((run / name).read_bytes()))
    before = contents(run)
    command = ["--resume", run, *MORE] if name.startswith(CHECKPOINT) else ["evaluate", run]
    said, printed = refused(capsys, *command)
    assert str(run / name) in said and not printed
    assert contents(run) == before


def rewritten(path, change):
    """Change the content of a file of arrays or of JSON, as a valid file."""
    if path.suffix == ".json":
        content = json.loads(path.read_text())
        change(content)
        path.write_text(json.dumps(content))
    else:
        with np.load(path) as arrays:
            content = dict(arrays)
        change(content)
        np.savez(path, **content)


def field(array, name, value):
    def change(content):
        content[array][name] = value

    return change


def entry(name, value):
    def change(content):
        content[name] = value(content[name]) if callable(value) else value

    return change


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("envs.npz", field("records", "phase", 1 << 40), "records['phase'] of environment 0"),
        ("envs.npz", field("ledger", "outcome", -1), "ledger['outcome'] of environment 0"),
        ("envs.npz", field("records", "state", np.nan), "records['state'] of environment 0"),
        ("envs.npz", entry("records", lambda a: a[:3]), "of 3 walkers, and here are 8"),
        ("envs.npz", entry("scene", "{}"), "of another"),
        ("envs.json", entry("walkers", []), "a row of 8 walkers"),
        ("envs.json", entry("random", [{}] * 8), "no state of a PCG64"),
        ("arrays.npz", entry("_last_obs", np.zeros((2, 8), np.float32)), "_last_obs must be"),
        ("arrays.npz", entry("_last_obs", lambda a: a * np.nan), "_last_obs must be finite"),
        ("arrays.npz", entry("obs_rms.var", lambda a: -a), "obs_rms.var is below 0"),
        ("arrays.npz", entry("obs_rms.mean", np.zeros(3)), "obs_rms.mean must be float64"),
        ("arrays.npz", entry("torch", lambda a: a[:9]), "arrays.npz"),
        ("arrays.npz", entry("numpy", np.zeros(3, np.uint32)), "notes.json"),
        ("replay.npz", entry("position", 10**9), "beyond"),
        ("replay.npz", entry("position", 3), "must be float32 of shape (3, "),
        ("replay.npz", entry("rewards", lambda a: a * np.inf), "rewards must be finite"),
        ("notes.json", entry("numpy", ["MT19937", 10**6, 0, 0.0]), "numpy's place"),
        ("notes.json", entry("counters", {"num_timesteps": -1}), "num_timesteps must be a whole"),
        ("notes.json", entry("counters", {}), "'num_timesteps' is missing"),
        ("notes.json", entry("notes", {}), "'best' is missing"),
        ("notes.json", entry("action_space", {}), "notes.json"),
    ],
)  # fmt: skip
def test_a_checkpoint_that_was_tampered_with_is_refused_by_its_file(
    run, name, change, words, capsys
):
    rewritten(run / CHECKPOINT / name, change)
    before = contents(run)
    said, printed = refused(capsys, "--resume", run, *MORE)
    assert words in said and str(run / CHECKPOINT) in said and not printed
    assert contents(run) == before


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        ("n_envs", "a", "n_envs must be a whole number from 1 on, not 'a'"),
        ("n_envs", 1.5, "n_envs must be a whole number"),
        ("steps", "many", "steps must be a whole number from 1 on, not 'many'"),
        ("every", None, "every must be a whole number"),
        ("seed", -1, "seed must be a whole number from 0 on"),
        ("algo", ["sac"], "algo must be the name of one"),
        ("scene", 3, "scene must be the name of one"),
        ("env", "steep", "env must map names to values"),
        ("env", {"scene": 3}, "scene"),
        ("training", {"reset_noise": 0.1}, "a scene has no reset_noise (reset_noise_scale?)"),
        ("normalize", {"norm_ob": True}, "VecNormalize has no norm_ob (norm_obs?)"),
        ("normalize", {"clip_obs": "a"}, "clip_obs of VecNormalize must be float, not 'a'"),
        ("exploration", {"lowest": 0.0, "highest": 1.0}, "lowest must be a number above 0"),
        ("hyperparams.learning_rat", 1e-3, "SAC has no learning_rat (learning_rate?)"),
        ("hyperparams.learning_rate", "lin_x", "could not convert string to float: 'x'"),
        ("hyperparams.tau", "a", "tau of SAC must be float, not 'a'"),
        ("hyperparams.device", "cuda", "SAC has no device"),
        ("hyperparams.policy_kwargs", {"colour": "red"}, "unexpected keyword argument 'colour'"),
        ("colour", "red", "a run has no colour; it has algo, scene"),
    ],
)
def test_a_configuration_that_is_none_is_answered_with_what_is_allowed(
    run, place, value, words, capsys
):
    config = yaml.safe_load((run / files.CONFIG).read_text())
    *folders, name = place.split(".")
    inner = config[folders[0]] if folders else config
    inner[name] = value
    (run / files.CONFIG).write_text(yaml.safe_dump(config))
    before = contents(run)
    said, _ = refused(capsys, "--resume", run, *MORE)
    assert words in said
    assert contents(run) == before


@pytest.mark.parametrize("room", [100, 1000, 20_000])
def test_a_training_on_a_full_disk_stops_and_goes_on_when_there_is_room(run, room, capsys):
    before = contents(run)
    with full_disk(room):
        said, _ = refused(capsys, "--resume", run, *MORE)
    assert "File too large" in said and (room < 500 or f"--resume {run}" in said)
    kept = contents(run)
    assert set(kept) == set(before)
    for name in ("model.zip", "normalizer.npz", f"{CHECKPOINT}/arrays.npz"):
        assert kept[run / name] == before[run / name]
    assert train.main(["--resume", str(run), *MORE]) == 0
    assert files.newest_checkpoint(run) == files.checkpoint_path(run, 256)


def test_an_evaluation_that_cannot_be_kept_is_printed_first(run, capsys):
    before = contents(run)
    with full_disk(0):
        said, printed = refused(capsys, "evaluate", run)
    assert "passive" in printed and "stubbed toe" in printed
    assert str(run / "evaluation.txt") in said
    assert contents(run) == before


def test_an_evaluation_in_a_read_only_folder_is_printed_first(run, capsys):
    run.chmod(0o500)
    try:
        if os.access(run, os.W_OK):
            pytest.skip("the superuser may write everywhere")
        said, printed = refused(capsys, "evaluate", run)
    finally:
        run.chmod(0o700)
    assert "passive" in printed and "Permission denied" in said


def test_a_damaged_learning_curve_is_drawn_from_the_checkpoint(run):
    (run / "learning_curve.csv").write_bytes(b"")
    (run / "learning_curve.png").unlink()
    assert train.main(["--resume", str(run), "--quiet"]) == 0
    assert (run / "learning_curve.png").exists()
