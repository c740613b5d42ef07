"""Trained policies: those of the package need only NumPy.

A policy is a folder of two files:

    policy.safetensors  tensors of the network, and moments of the observation normalizer
    policy.json         scene, algorithm and network options, and the training configuration

Policies of other programs are read from ONNX files and from files of stable-baselines3.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

from gym_passive_walker._tools.arguments import boolean, near, shown
from gym_passive_walker._tools.console import cut
from gym_passive_walker._tools.loading import parse_json
from gym_passive_walker.envs.policies.network import Network
from gym_passive_walker.envs.policies.onnx_file import OnnxPolicy, write_onnx
from gym_passive_walker.envs.policies.sb3_file import Sb3Policy
from gym_passive_walker.envs.policies.tensors import PolicyError, read_tensors, reading
from gym_passive_walker.gaits.scenes.named import check_source, outside
from gym_passive_walker.gaits.scenes.scene import Scene, make_scene, seen_by_policy
from gym_passive_walker.models.walkers import WALKERS

TENSORS, DESCRIPTION = "policy.safetensors", "policy.json"
_SHIPPED = Path(__file__).parent


class TrainedPolicy(Network):
    """A trained policy and the scene that it was trained for.

    Attributes:
        name: Name of its folder: that of a policy of the package, such as "level-ppo".
        algorithm: Name of the algorithm, in capitals.
        scene: Scene of the training, with what the policy observes alone.
        folder: Folder of the policy's files.
        trained: Complete configuration of the training run; empty if the files do not include it.
    """

    def __init__(self, folder: Path, *, trust: bool = False) -> None:
        self.folder, path = folder, folder / DESCRIPTION
        with reading(path):
            description = parse_json(path.read_bytes())
            if not isinstance(description, dict):
                raise ValueError("it does not describe a policy")
        with reading(folder, "is not a policy"):
            acting = {name: description[name] for name in ("algo", "activation", "normalizer")}
            self.name, self.algorithm = folder.resolve().name, str(acting["algo"]).upper()
            self._trained_in = description["scene"], _names(description["env"], "env")
            name, env = self._trained_in
            self.trained: dict[str, Any] = _names(description.get("trained", {}), "trained")
            if trust:
                check_source(outside(name, env), self.trained.get("source"))
            self.scene: Scene = seen_by_policy(make_scene(name, trust=trust, **env))
            acting["least"] = [self.scene.least(action) for action in self.scene.actions]
            super().__init__(read_tensors(folder / TENSORS), **acting)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}>"

    def to_onnx(self, path: str | Path) -> None:
        """Write the policy as an ONNX file, with its observation normalizer.

        The input "observation" has shape (n, size), the output "action" shape (n, actions). Both
        are float32 and n is free. Actions are the mean actions, in [-1, 1]; they agree with those
        of `predict` to rounding. The file's metadata name the scene, the observations and the
        actions.

        Example:
            >>> import gym_passive_walker as gpw
            >>> gpw.load_policy("level-ppo").to_onnx("level-ppo.onnx")
            >>> gpw.load_policy("level-ppo.onnx").scene == gpw.load_policy("level-ppo").scene
            True

        Args:
            path: The file.

        Raises:
            ImportError: if onnx is not installed: pip install "gym-passive-walker[onnx]".
            OSError: if the file cannot be written.
        """
        scene, env = self._trained_in
        write_onnx(self, path, scene=scene, env=env, algorithm=self.algorithm)


def shipped_policies() -> list[str]:
    """Return the names of the policies that come with the package."""
    return sorted(path.parent.name for path in _SHIPPED.glob(f"*/{DESCRIPTION}"))


def policy_folder(name: str | Path) -> Path:
    """Return the folder of a policy, from a name in the package or a path.

    Raises:
        PolicyError: if there is no such policy.
    """
    if isinstance(name, str | Path):
        for folder in (_SHIPPED / name, Path(name)):
            with suppress(OSError, ValueError):  # invalid file names
                if (folder / DESCRIPTION).is_file():
                    return folder
    if isinstance(name, str) and name in WALKERS:
        raise PolicyError(
            f"no policy {name!r}, which is a walker: it walks without one by the controller "
            f"'passive', with walker={name!r} or --walker {name}"
        )
    known = shipped_policies()
    raise PolicyError(
        f"no policy {cut(str(name))!r}{near(name, known)}: choose from {', '.join(known)}; or give "
        f"a folder with {TENSORS} and {DESCRIPTION}, as `python train.py export RUN FOLDER` writes "
        f"it; or an ONNX file (.onnx), or a file of stable-baselines3 (.zip)"
    )


def policy_files(name: str) -> list[Path]:
    """Return the files that `load_policy` reads for a policy; none if there is no such policy."""
    path = Path(name)
    if path.suffix.lower() in READERS:
        return [path] if path.is_file() else []
    with suppress(PolicyError):
        return [
            file
            for part in (DESCRIPTION, TENSORS)
            if (file := policy_folder(name) / part).is_file()
        ]
    return []


def load_policy(
    name_or_folder: str | Path, *, trust: bool = False
) -> TrainedPolicy | OnnxPolicy | Sb3Policy:
    """Load a trained policy; those of the package and exported ones require NumPy alone.

    Example:
        >>> import gym_passive_walker as gpw
        >>> policy = gpw.load_policy("level-ppo")
        >>> gait = gpw.closed_loop_gait(policy, policy.scene)
        >>> gait.stable, round(gait.froude_speed, 2)
        (True, 0.15)

    Args:
        name_or_folder: Name of a policy that comes with the package: "level-ppo", "steep-ppo",
            "steep-sac", "rolling-ppo", "lab-ppo", "rough-ppo", "pushed-ppo", "push-off-ppo",
            "commanded-ppo" or "anywhere-ppo". Or the folder of an exported policy, an ONNX file
            (.onnx), or a file of stable-baselines3 (.zip).
        trust: Whether to allow a scene that is "module:function": importing that module runs its
            code.

    Returns:
        The policy. Its method `predict(observation, state, episode_start, deterministic)` is that
        of stable-baselines3, and takes the environment's observations without normalization. Its
        attribute `scene` is None where the file names no scene.

    Raises:
        PolicyError: if there is no such policy, its files are damaged, or its scene is not
            trusted.
        ImportError: if an ONNX file is read without onnxruntime (extra "onnx"), or a file of
            stable-baselines3 without torch (extra "train").
        ValueError: if trust is not True or False.
    """
    trust = boolean(trust, "trust")
    if isinstance(name_or_folder, str | Path):
        suffix = Path(name_or_folder).suffix.lower()
        if suffix in READERS:
            reader = READERS[suffix]  # the file of another library names no scene
            return reader(name_or_folder, **{"trust": trust} if reader is OnnxPolicy else {})
    return TrainedPolicy(policy_folder(name_or_folder), trust=trust)


READERS: dict[str, type[OnnxPolicy | Sb3Policy]] = {".onnx": OnnxPolicy, ".zip": Sb3Policy}
"""Readers of policies in one file, by the ending of its name."""


def _names(value: Any, name: str) -> dict[str, Any]:
    """Return a mapping from a policy's JSON file.

    Raises:
        ValueError: if the value is not a mapping.
    """
    if not isinstance(value, dict):
        raise ValueError(f"{name} must map names to values, not {shown(value)}")
    return value
