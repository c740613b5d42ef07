"""Reader of stable-baselines3's files: the actor's tensors, and nothing that is unpickled."""

from __future__ import annotations

import io
import re
import zipfile
from pathlib import Path
from typing import Any

from gym_passive_walker._tools.extras import extra
from gym_passive_walker._tools.loading import parse_json
from gym_passive_walker.envs.policies.network import ACTIVATIONS, Network
from gym_passive_walker.envs.policies.tensors import PolicyError, reading

_ALIKE = (("action_net.weight", "ppo", "Tanh"), ("actor.log_std.weight", "sac", "ReLU"))
_CRITIC = ("value_net.", "mlp_extractor.value_net.", "critic.", "critic_target.")
_ACTOR = ("mlp_extractor.policy_net.", "action_net.", "log_std", "actor.")
_LIBRARIES = ("stable_baselines3.", "sb3_contrib.", "gym_passive_walker.envs.privileged")
_ACTIVATION = r"<class 'torch\.nn\.modules\.activation\.(\w+)'>"
_ADVICE = (
    "; give a file of PPO, A2C or SAC with MlpPolicy, or an ONNX file, and do not load this one by "
    "other means unless you trust its source, since it can hold code"
)


class Sb3Policy(Network):
    """The actor of a file of stable-baselines3, evaluated by NumPy.

    PPO, A2C and SAC with "MlpPolicy" are read, and PPO with `PrivilegedCriticPolicy`. A file
    contains no observation normalizer, so the policy takes observations as the network was trained
    with them.

    Args:
        path: The file, as `model.save` writes it.

    Attributes:
        name: Name of the file.
        scene: None: the file names none.

    Raises:
        ImportError: if torch is not installed.
        PolicyError: if there is no such file, or its policy is another one.
    """

    def __init__(self, path: str | Path) -> None:
        path = Path(path)
        self.name, self.scene = path.name, None
        if path.with_name("normalizer.npz").is_file():
            raise PolicyError(
                f"the normalizer of {path} is in another file: write both by `python train.py "
                f"export {path.parent} FOLDER`, and give the folder"
            )
        with extra("train"):
            import torch
        with reading(path, "is not a policy that this package can read", _ADVICE):
            with zipfile.ZipFile(path) as file:
                about = parse_json(file.read("data"))
                weights = io.BytesIO(file.read("policy.pth"))
            tensors = torch.load(weights, map_location="cpu", weights_only=True)
            arrays = {
                name: tensor.numpy()
                for name, tensor in tensors.items()
                if not name.startswith(_CRITIC)
            }
            if other := [name for name in arrays if not name.startswith(_ACTOR)]:
                raise ValueError(f"it has other layers, as {other[0]}")
            found = [each[1:] for each in _ALIKE if each[0] in arrays]
            if not found:
                raise ValueError("it is none of PPO, A2C and SAC")
            algo, usual = found[0]
            activation, least = _checked(about, usual)
            super().__init__(arrays, algo=algo, activation=activation, normalizer=None, least=least)


def _checked(about: dict[str, Any], usual: str) -> tuple[str, list[float]]:
    """Return the activation function's name and the smallest actions, after a check of the rest.

    Raises:
        ValueError: if something is not as in MlpPolicy.
    """
    where = str(about["policy_class"].get("__module__"))
    if not where.startswith(_LIBRARIES):
        raise ValueError(f"its policy is a class of {where}")
    if about.get("use_sde"):
        raise ValueError("it explores with noise that depends on the state, use_sde=True")
    low, high = (
        [float(x) for x in re.findall(r"[-+.\de]+", about["action_space"][end])]
        for end in ("low", "high")
    )
    if not (low and min(low) >= -1.0 and {*high} == {1.0}):
        raise ValueError(f"its actions are from {low} to {high}, not from -1 or above to 1")
    options = about.get("policy_kwargs") or {}
    if other := options.keys() & {"features_extractor_class", "squash_output"}:
        raise ValueError(f"it has {', '.join(sorted(other))}")
    if "activation_fn" not in options:
        return usual, low
    named = re.fullmatch(_ACTIVATION, str(options["activation_fn"]))
    if named is None or named[1] not in ACTIVATIONS:
        raise ValueError(f"its activation function is none of {', '.join(ACTIVATIONS)} of torch.nn")
    return named[1], low
