"""Each reader of files refuses each fault of a file, by one sentence of its own error."""

import io
import json
import pickle
import re
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker._tools.loading import HOLDS_CODE
from gym_passive_walker.apps.sweeps import store
from gym_passive_walker.apps.sweeps.description import Description
from gym_passive_walker.envs.policies import DESCRIPTION, TENSORS, policy_folder
from gym_passive_walker.envs.policies.tensors import read_tensors
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.terrain import terrain_from

ONE = "checkpoints/000000000007"
"""A checkpoint in the folder of a run."""

TEXTS = {
    "300 levels": "[" * 300 + "]" * 300,
    "20,000 levels": "[" * 20_000 + "]" * 20_000,
    "a float that overflows": "1.0e+400",
    "an integer that overflows": "1" + "0" * 400,
    "an integer of 5,000 digits": "9" * 5000,
    "a complex number": '"1+2j"',
    "text": '"much"',
    "a list": "[1.0]",
    "NaN": "NaN",
}
"""What stands in the place of a number, in the text of a file."""

ARRAYS: dict[str, Callable[[np.ndarray], Any]] = {
    "complex numbers": lambda a: a + 1j,
    "text": lambda a: a.astype(str),
    "NaN": lambda a: a * np.nan,
    "overflow": lambda a: a * 0.0 + 1e300,
    "another shape": lambda a: a[..., None],
}
"""What stands in the place of an array of floats."""


class Reader(NamedTuple):
    """A reader of files.

    Attributes:
        make: Writes a good file into a folder.
        read: Reads it.
        error: Name of the error that it raises.
        name: The file in the folder.
        number: Pattern of a number in the file.
        member: The damaged member of an archive.
    """

    make: Callable[[Path], Any]
    read: Callable[[Path], Any]
    error: str
    name: str
    number: str = ""
    member: str | None = None

    def damage(self, folder: Path, change: Callable[[bytes], bytes]) -> None:
        """Change the content of the file."""
        path = folder / self.name
        if self.member is None:
            path.write_bytes(change(path.read_bytes()))
        else:
            in_archive(path, self.member, change)

    def refuses(self, folder: Path) -> str:
        """Return the message with which the file is refused."""
        with pytest.raises((ValueError, RuntimeError)) as refused:
            self.read(folder)
        said = str(refused.value)
        assert type(refused.value).__name__ == self.error, said
        assert "\n" not in said
        return said


def in_archive(path, member, change):
    """Change a member of a zip file."""
    with zipfile.ZipFile(path) as file:
        parts = {name: file.read(name) for name in file.namelist()}
    parts[member] = change(parts[member])
    with zipfile.ZipFile(path, "w") as file:
        for name, content in parts.items():
            file.writestr(name, content)


def written(name, text):
    return lambda folder: (folder / name).write_text(text)


def text_of(folder, name):
    return (folder / name).read_bytes().decode("latin-1")


def exported(folder):
    shutil.copytree(policy_folder("level-ppo"), folder, dirs_exist_ok=True)


def of_sb3(folder):
    sb3 = pytest.importorskip("stable_baselines3")
    env = gymnasium.make("PassiveWalker-v0")
    sb3.SAC("MlpPolicy", env, buffer_size=9, device="cpu").save(folder / "model.zip")


SWEPT = Description(analysis="gait", over={"slope": [0.02, 0.03]}, given={"walker": "D"})


def swept(folder):
    pytest.importorskip("pyarrow")
    made = store.Store(folder / "out", SWEPT, "1")
    row = {"task": 0, "seed": 0, "slope": 0.02, "status": "done", "error": None, "seconds": 1.5}
    made.add(row, {"speed": 0.25})
    made.add(row | {"task": 1, "slope": 0.03}, {"speed": 0.25})
    made.close()


def continued(folder):
    found = store.Store(folder / "out", SWEPT, "1")
    found.close()


def run(folder):
    pytest.importorskip("stable_baselines3")
    from agents import checkpoint, config, envs, learner

    made = config.configure("ppo", "level", n_envs=2)
    made.save(folder / "config.yml")
    model = learner.build(made, envs.training_envs(made))
    names = ("steps", "seconds", "reward", "distance", "hundred_strides", "reached_time_limit")
    notes = {"best": 1.25, "seconds": 2.5, "curve": [dict.fromkeys(names, 0.125)]}
    checkpoint.save(folder / ONE, model, notes)


def resumed(folder):
    from agents import checkpoint

    return checkpoint.last_policy(folder)


def configured(folder):
    from agents.config import Config

    return Config.load(folder / "config.yml")


def env_of_two():
    env = PassiveWalkerVectorEnv(2)
    env.reset(seed=0)
    return env


def restored(**entries):
    """Put a state with some other entries back."""
    env = env_of_two()
    env.set_state(env.get_state() | entries)


ROUGH = '{"rough": {"height_std": 0.25}}'
OF_TEXT = {
    "JSON": Reader(
        written("a.json", ROUGH), lambda folder: terrain_from(folder / "a.json"), "ValueError",
        "a.json", "0.25",
    ),
    "YAML": Reader(
        written("a.yaml", ROUGH), lambda folder: terrain_from(folder / "a.yaml"), "ValueError",
        "a.yaml", "0.25",
    ),
    "TOML": Reader(
        written("a.toml", "rough = {height_std = 0.25}"),
        lambda folder: terrain_from(folder / "a.toml"), "ValueError", "a.toml", "0.25",
    ),
    "a terrain as text": Reader(
        written("a", ROUGH), lambda folder: terrain_from(text_of(folder, "a")), "ValueError",
        "a", "0.25",
    ),
    "a terrain by its arguments": Reader(
        written("a", "rough:height_std=0.25"),
        lambda folder: terrain_from(text_of(folder, "a")), "ValueError", "a", "0.25",
    ),
    "a walker": Reader(
        written("a.json", '{"preset": "C", "gravity": 9.5}'),
        lambda folder: gpw.as_walker(folder / "a.json"), "WalkerError", "a.json", "9.5",
    ),
    "a policy's description": Reader(
        exported, gpw.load_policy, "PolicyError", DESCRIPTION, "1e-08",
    ),
    "a policy's header": Reader(
        exported, gpw.load_policy, "PolicyError", TENSORS, r"\d+(?=\])",
    ),
    "a file of stable-baselines3": Reader(
        of_sb3, lambda folder: gpw.load_policy(folder / "model.zip"), "PolicyError", "model.zip",
        r'(?s)(?<="action_space": )\{.*?\}', "data",
    ),
    "a sweep's manifest": Reader(
        swept, lambda folder: store.read_manifest(folder / "out"), "ValueError", "out/sweep.json",
        '(?<="speed": )"[^"]*"',
    ),
    "a sweep's description": Reader(
        swept, lambda folder: store.read_description(folder / "out"), "ValueError",
        "out/sweep.json", '(?<="seed": )0',
    ),
    "a sweep's journal": Reader(
        swept, continued, "ValueError", "out/journal.jsonl", '(?<="task": )0',
    ),
    "a run's configuration": Reader(
        run, configured, "ConfigError", "config.yml", r"(?<=n_envs: )\d+",
    ),
    "a checkpoint's notes": Reader(run, resumed, "ConfigError", f"{ONE}/notes.json", "1.25"),
    "a checkpoint's walkers": Reader(
        run, resumed, "ConfigError", f"{ONE}/envs.json", r"(?<=\"gravity\": )[\d.]+",
    ),
    "a saved state's scene": Reader(
        lambda folder: (folder / "a").write_text(str(env_of_two().get_state()["scene"])),
        lambda folder: restored(scene=text_of(folder, "a")), "StateError",
        "a", r"(?<=tick\": )[\d.]+",
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """Good files of the readers, each written once."""
    made = {}

    def folder(name):
        if name not in made:
            folders = [tmp_path_factory.mktemp("good") for _ in range(2)]
            OF_TEXT[name].make(folders[0])
            shutil.copytree(*folders, dirs_exist_ok=True)
            OF_TEXT[name].read(folders[1])
            made[name] = folders[0]
        return made[name]

    return folder


@pytest.mark.parametrize("fault", [*TEXTS, "cut short", "other bytes"])
@pytest.mark.parametrize("name", OF_TEXT)
def test_a_fault_in_the_text_of_a_file_is_refused_by_the_reader_s_own_error(
    name, fault, good, tmp_path
):
    if (name, fault) == ("a sweep's journal", "cut short"):
        return  # its last line may be torn: tests/sweeps/test_damage.py
    reader = OF_TEXT[name]
    shutil.copytree(good(name), tmp_path, dirs_exist_ok=True)

    def change(content):
        if fault == "cut short":
            return content[: len(content) // 2]
        if fault == "other bytes":
            return bytes(range(255, 127, -1)) + content
        text = TEXTS[fault].encode()
        changed, count = re.subn(reader.number.encode(), lambda _: text, content, count=1)
        assert count == 1
        if name == "a policy's header":  # its length is in front of it
            size = int.from_bytes(content[:8], "little") + len(changed) - len(content)
            changed = size.to_bytes(8, "little") + changed[8:]
        return changed

    reader.damage(tmp_path, change)
    assert len(reader.refuses(tmp_path)) < 1000


def as_safetensors(arrays):
    """Content of a safetensors file; types are named as others name them."""
    kinds = {"f4": "F32", "f8": "F64", "c16": "C64"}
    header, data = {}, b""
    for name, array in arrays.items():
        kind = kinds.get(array.dtype.str[1:], "STR")
        header[name] = {
            "dtype": kind,
            "shape": array.shape,
            "data_offsets": [len(data), len(data) + array.nbytes],
        }
        data += array.tobytes()
    text = json.dumps(header).encode()
    return len(text).to_bytes(8, "little") + text + data


def in_safetensors(folder, change):
    exported(folder)
    arrays = read_tensors(folder / TENSORS)
    arrays["action_net.weight"] = change(arrays["action_net.weight"].astype(float))
    (folder / TENSORS).write_bytes(as_safetensors(arrays))
    gpw.load_policy(folder)


def in_sb3(folder, change):
    torch = pytest.importorskip("torch")
    of_sb3(folder)

    def changed(content):
        tensors = torch.load(io.BytesIO(content), weights_only=True)
        found = change(tensors["actor.mu.weight"].double().numpy())
        text = found.dtype.kind == "U"  # torch has none
        tensors["actor.mu.weight"] = found.tolist() if text else torch.tensor(found)
        written = io.BytesIO()
        torch.save(tensors, written)
        return written.getvalue()

    in_archive(folder / "model.zip", "policy.pth", changed)
    gpw.load_policy(folder / "model.zip")


def in_onnx(folder, change):
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    actions = change(np.ones((2, 1)))
    if actions.dtype.kind == "U":
        actions = actions.astype(object)
    kind = onnx.helper.np_dtype_to_tensor_dtype(actions.dtype)
    given = onnx.helper.make_tensor_value_info("observation", 1, ["n", 8])
    returned = onnx.helper.make_tensor_value_info("action", kind, actions.shape)
    constant = onnx.numpy_helper.from_array(actions)
    node = onnx.helper.make_node("Constant", [], ["action"], value=constant)
    graph = onnx.helper.make_graph([node], "other", [given], [returned])
    opset = [onnx.helper.make_opsetid("", 17)]
    model = onnx.helper.make_model(graph, ir_version=8, opset_imports=opset)
    onnx.save(model, folder / "policy.onnx")
    gpw.load_policy(folder / "policy.onnx").predict(np.zeros((2, 8)))


def in_checkpoint(file, name):
    def read(folder, change):
        run(folder)
        path = folder / ONE / file
        with np.load(path) as arrays:
            parts = dict(arrays)
        parts[name] = change(parts[name] + 0.0)
        np.savez(path, **parts)
        resumed(folder)

    return read


def in_state(folder, change):
    restored(records=change(np.ones(2)))


OF_ARRAYS = {
    "a policy": (in_safetensors, "PolicyError"),
    "a file of stable-baselines3": (in_sb3, "PolicyError"),
    "an ONNX file": (in_onnx, "ValueError|PolicyError"),
    "a checkpoint's arrays": (in_checkpoint("arrays.npz", "obs_rms.mean"), "ConfigError"),
    "a saved state": (in_state, "StateError"),
}


@pytest.mark.parametrize("fault", ARRAYS)
@pytest.mark.parametrize("name", OF_ARRAYS)
def test_a_fault_in_an_array_of_a_file_is_refused_by_the_reader_s_own_error(name, fault, tmp_path):
    if (name, fault) == ("a checkpoint's arrays", "overflow"):
        return  # they have double precision
    read, error = OF_ARRAYS[name]
    with pytest.raises(ValueError) as refused:
        read(tmp_path, ARRAYS[fault])
    assert re.fullmatch(error, type(refused.value).__name__), str(refused.value)
    assert "\n" not in str(refused.value)


class Code:
    """An object with a pickle that calls a harmless function."""

    def __reduce__(self):
        return str.upper, ("run",)


DANGEROUS = re.compile(
    r"weights_only|allow_pickle|\.load\(|unsafe_load|pickle\.|by its own library"
)


@pytest.mark.parametrize(
    ("reader", "name", "member", "content"),
    [
        ("a file of stable-baselines3", "model.zip", "policy.pth", pickle.dumps(Code())),
        ("a checkpoint's notes", f"{ONE}/model.zip", "policy.pth", pickle.dumps(Code())),
        ("a checkpoint's notes", f"{ONE}/arrays.npz", "torch.npy", None),
        ("YAML", "a.yaml", None, b"!!python/object/apply:builtins.str [run]"),
        ("a run's configuration", "config.yml", None, b"!!python/name:builtins.str"),
    ],
    ids=["SB3", "model", "arrays", "YAML", "configuration"],
)
def test_a_file_that_holds_code_is_refused_and_no_way_to_run_it_is_named(
    reader, name, member, content, tmp_path
):
    reader = OF_TEXT[reader]
    reader.make(tmp_path)
    if content is None:
        np.save(tmp_path / "code.npy", np.array([Code()]))
        content = (tmp_path / "code.npy").read_bytes()
    reader._replace(name=name, member=member).damage(tmp_path, lambda _: content)
    said = reader.refuses(tmp_path)
    assert HOLDS_CODE in said and not DANGEROUS.search(said)


def test_no_message_names_a_way_to_load_a_file_that_runs_its_code():
    root = Path(gpw.__file__).parents[1]
    files = [*root.glob("gym_passive_walker/**/*.py"), *root.glob("agents/*.py"), root / "train.py"]
    for path in files:
        text = path.read_text(encoding="utf-8")
        assert not re.search(
            r"weights_only ?= ?False|allow_pickle ?= ?True|(PPO|SAC)\.load\(", text
        )
