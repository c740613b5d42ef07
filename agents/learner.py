"""Build algorithms from a configuration; write policies to files and read them.

No file is unpickled. An algorithm is built from its YAML, and only numbers are read from disk
(tensors with `weights_only`, arrays without pickles).
"""

from __future__ import annotations

import inspect
import io
import json
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import asdict
from operator import attrgetter
from pathlib import Path
from typing import Any, get_args

import numpy as np
import torch
from gymnasium.spaces import Dict, flatdim
from numpy.typing import NDArray
from safetensors.torch import save as as_safetensors
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.save_util import load_from_zip_file, recursive_getattr
from stable_baselines3.common.vec_env import VecEnv, VecNormalize
from torch import nn

from agents.config import Config, ConfigError
from agents.envs import scene_of, training_envs
from agents.files import CONFIG, read_arrays, reading
from agents.first_order import SHAC
from agents.learned_steps import LearnedSHAC
from agents.networks import POLICIES
from agents.ppo_fast import FastPPO
from gym_passive_walker._tools.arguments import unknown
from gym_passive_walker._tools.files import replacing
from gym_passive_walker._tools.loading import reason
from gym_passive_walker.envs.policies import DESCRIPTION, TENSORS, TrainedPolicy, shipped_policies
from gym_passive_walker.envs.policies import load_policy as load_exported
from gym_passive_walker.envs.policies.network import ACTIVATIONS, PLACES, Network
from gym_passive_walker.envs.policies.onnx_file import write_onnx
from gym_passive_walker.envs.policies.tensors import read_tensors
from gym_passive_walker.envs.privileged import PrivilegedCriticPolicy
from gym_passive_walker.envs.seeds import training_seeds
from gym_passive_walker.gaits.control.policy import Policy

MODEL, NORMALIZER = "model.zip", "normalizer.npz"
_CLASSES: dict[str, type[BaseAlgorithm]] = {
    "ppo": PPO, "ppo-fast": FastPPO, "sac": SAC, "shac": SHAC, "shac-learned": LearnedSHAC,
}  # fmt: skip
_MOMENTS = ("obs_rms", "ret_rms")
_PLAIN = (bool, int, float, str, type(None))
_GPU_FROM = 32_768
"""Frames of an update from which PPO on tensors uses a GPU: smaller ones are faster on a CPU."""
_OURS = ("env", "venv", "seed", "device")  # arguments that other parts of a configuration set


def build(config: Config, envs: VecEnv, **overrides: Any) -> BaseAlgorithm:
    """Build an untrained algorithm; its environments are wrapped in VecNormalize if configured.

    Overrides are arguments of the algorithm that replace the configured ones.

    Raises:
        ConfigError: if a hyperparameter is unknown or invalid.
    """
    of, arguments = _CLASSES[config.algo], config.hyperparams | overrides
    _check(of, arguments)
    _check(VecNormalize, config.normalize or {})
    try:
        if config.normalize is not None:
            gamma = arguments.get("gamma", 0.99)
            envs = VecNormalize(envs, gamma=gamma, **config.normalize)
        arguments["learning_rate"] = schedule(arguments["learning_rate"])
        arguments["policy"] = POLICIES.get(arguments["policy"], arguments["policy"])
        if isinstance(envs.observation_space, Dict):
            arguments["policy"] = _with_privileged_critic(config.algo, arguments["policy"])
        arguments["policy_kwargs"] = _with_activation(arguments.get("policy_kwargs"))
        # Networks this small are faster on the CPU, and reproducible there. FastPPO also keeps its
        # walkers in tensors, so large updates use a GPU if there is one.
        frames = arguments.get("n_steps", 1) * envs.num_envs
        device = "auto" if of is FastPPO and frames >= _GPU_FROM else "cpu"
        model = of(env=envs, seed=config.seed, device=device, **arguments)
    except Exception as error:  # an invalid value may raise any error in the library
        raise ConfigError(
            f"{config.algo.upper()} cannot be built as its configuration says: {reason(error)}"
        ) from None
    envs.seed(training_seeds(config.seed, envs.num_envs))  # type: ignore[arg-type]
    return model


def _with_privileged_critic(algo: str, policy: Any) -> Any:
    """The policy of an algorithm of which the critic sees more than the actor.

    Raises:
        ValueError: if the algorithm has none.
    """
    if algo not in ("ppo", "ppo-fast") or policy not in ("MlpPolicy", "MultiInputPolicy"):
        raise ValueError(
            "an observation for policy and critic is learned by ppo and ppo-fast with MlpPolicy, "
            f"not by {algo} with {getattr(policy, '__name__', policy)}"
        )
    return PrivilegedCriticPolicy


def _check(of: type, arguments: Mapping[str, Any]) -> None:
    """Check the arguments of a class of stable-baselines3: their names, and types of plain values.

    Without this check, most invalid values would raise an error only during the first update.

    Raises:
        ConfigError: if an argument is unknown or has the wrong type.
    """
    known = {
        k: v for k, v in inspect.signature(of, eval_str=True).parameters.items() if k not in _OURS
    }
    if said := unknown(arguments, tuple(known), of.__name__):
        raise ConfigError(said)
    for name, value in arguments.items():
        allowed = known[name].annotation
        kinds = {*(get_args(allowed) or [allowed])}
        kinds |= {int} if float in kinds else set()
        kinds |= {str} if name == "learning_rate" else set()  # "lin_1e-3"
        if kinds.intersection(_PLAIN) and isinstance(value, _PLAIN) and type(value) not in kinds:
            allowed = inspect.formatannotation(allowed)
            raise ConfigError(f"{name} of {of.__name__} must be {allowed}, not {value!r}")


def schedule(rate: float | str) -> float | Callable[[float], float]:
    """A learning rate from rl_zoo3's notation: a number, or "lin_1e-3", which decreases to 0."""
    if not isinstance(rate, str):
        return rate
    start = float(rate.removeprefix("lin_"))
    return lambda remaining: remaining * start


def _with_activation(policy: dict[str, Any] | None) -> dict[str, Any] | None:
    """A policy's arguments, with the torch class in place of an activation's name ("nn.ReLU").

    They are a copy, because algorithms modify their arguments and a preset is shared.
    """
    if policy is None or "activation_fn" not in policy:
        return deepcopy(policy)
    name = str(policy["activation_fn"]).removeprefix("nn.")
    if name not in ACTIVATIONS:
        raise ConfigError(f"no activation {name!r}: choose from {', '.join(ACTIVATIONS)}")
    return deepcopy(policy) | {"activation_fn": getattr(nn, name)}


def begin_with(model: BaseAlgorithm, name: str, *, trust: bool = False) -> None:
    """Give an untrained algorithm the actor and the normalizer of a policy, a name or a folder.

    Its critic and the noise of its actions stay as they are. A policy of SAC fits SAC alone, since
    a tanh follows its last layer. `trust` allows a policy of a scene of the user's own.

    Raises:
        ConfigError: if there is no such policy, or its layers are not those of the algorithm.
    """
    config, policy = learned(name, trust=trust)
    network = on_numpy(policy, config)
    squashed = isinstance(model, SAC)
    hidden, last = PLACES["sac" if squashed else "ppo"]
    modules = [*attrgetter(hidden)(model.policy), attrgetter(last)(model.policy)]
    layers = [module for module in modules if isinstance(module, nn.Linear)]
    found = [tuple(weight.shape) for weight, _ in network.layers]
    own = [tuple(layer.weight.shape) for layer in layers]
    if network.squashed != squashed or found != own:
        raise ConfigError(
            f"{name} cannot be continued: it is of {config.algo.upper()} with layers {found}, and "
            f"this training needs {'SAC' if squashed else 'PPO or SHAC'} with layers {own}"
        )
    with torch.no_grad():
        for layer, (weight, bias) in zip(layers, network.layers, strict=True):
            layer.weight.copy_(torch.tensor(weight))
            layer.bias.copy_(torch.tensor(bias))
    normalizer = model.get_vec_normalize_env()
    if normalizer is not None and network.moments is not None:
        mean, spread, _ = network.moments
        running = _moments(normalizer)["obs_rms"]
        running.mean, running.var = mean.copy(), spread**2 - normalizer.epsilon
        running.count = float(config.steps)


def restore_weights(model: BaseAlgorithm, path: Path) -> None:
    """Load the tensors of a stable-baselines3 file into an algorithm of the same architecture.

    Raises:
        ConfigError: if the file is damaged, or of another architecture.
    """
    with reading(path):
        _, parameters, variables = load_from_zip_file(path, load_data=False, device="cpu")
        model.set_parameters(parameters, exact_match=True, device="cpu")
        # SAC's temperature, and the model of learned steps.
        for name, value in (variables or {}).items():
            recursive_getattr(model, name).data.copy_(value.data)


def save_model(path: Path, model: BaseAlgorithm) -> None:
    """Write an algorithm in the format of stable-baselines3.

    Raises:
        OSError: if it cannot be written; torch alone would raise another error.
    """
    written = io.BytesIO()
    model.save(written)
    path.write_bytes(written.getbuffer())


def moments(normalizer: VecNormalize) -> dict[str, Any]:
    """Means, variances and counts of a VecNormalize, as arrays by name."""
    return {
        f"{name}.{key}": np.asarray(getattr(running, key))
        for name, running in _moments(normalizer).items()
        for key in ("mean", "var", "count")
    }


def _moments(normalizer: VecNormalize) -> dict[str, Any]:
    """Running moments of a VecNormalize by name; "obs_rms" are those of what the actor sees."""
    found: dict[str, Any] = {}
    for name in _MOMENTS:
        running = getattr(normalizer, name, {})
        if isinstance(running, dict):
            found |= {name if g == "policy" else f"{name}_{g}": x for g, x in running.items()}
        else:
            found[name] = running
    return found


def restore_moments(normalizer: VecNormalize, saved: Any) -> None:
    """Restore the arrays of `moments`."""
    for name, running in _moments(normalizer).items():
        running.mean, running.var = saved[f"{name}.mean"], saved[f"{name}.var"]
        running.count = float(saved[f"{name}.count"])


class LearnedPolicy:
    """A trained policy that takes raw observations of the environment.

    A policy with a privileged critic takes what the actor sees.
    """

    def __init__(self, model: BaseAlgorithm, name: str) -> None:
        self.model, self.name = model, name

    def predict(
        self,
        observation: NDArray,
        state: tuple[NDArray, ...] | None = None,
        episode_start: NDArray | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray, tuple[NDArray, ...] | None]:
        """Actions for one observation or a batch, with the signature of stable-baselines3."""
        normalizer, space = self.model.get_vec_normalize_env(), self.model.observation_space
        seen: Any = np.asarray(observation)
        if isinstance(space, Dict):
            rows, size = seen.shape[:-1], flatdim(space["critic"])
            seen = {"policy": seen, "critic": np.zeros((*rows, size))}  # the actor sees one alone
        if normalizer is not None:
            seen = normalizer.normalize_obs(seen)
        return self.model.predict(seen, state, episode_start, deterministic)

    def save(self, run: Path) -> None:
        """Write all of the policy's files into a run's folder, or none."""
        normalizer = self.model.get_vec_normalize_env()
        with replacing(run / MODEL) as path:
            save_model(path, self.model)
            if normalizer is not None:  # both files are written before one is moved into place
                with replacing(run / NORMALIZER) as beside:
                    np.savez(beside, **moments(normalizer))


def load_policy(run: Path, config: Config | None = None) -> LearnedPolicy:
    """The saved policy in a run's folder.

    Raises:
        ConfigError: if the folder holds no trained policy.
    """
    config = config or Config.load(run / CONFIG)
    if not (run / MODEL).is_file():
        raise ConfigError(f"{run} has no {MODEL}: train it first, by --resume {run}")
    # Small buffers, because a policy that only acts stores no steps.
    short = {"n_steps": 2, "batch_size": 2}
    memory = {"buffer_size": 1} if config.algo == "sac" else short
    model = build(config, training_envs(config, 1), **memory)
    restore_weights(model, run / MODEL)
    normalizer = model.get_vec_normalize_env()
    if normalizer is not None:
        with reading(run / NORMALIZER):
            restore_moments(normalizer, read_arrays(run / NORMALIZER))
    return LearnedPolicy(model, config.algo.upper())


def learned(name: str | Path, *, trust: bool = False) -> tuple[Config, Policy]:
    """A trained policy, and the configuration that it was trained with.

    Args:
        name: Folder of a run or of an exported policy, or the name (text) of a policy of the
            package.
        trust: Whether to allow a scene of the user's own: importing its module runs its code.

    Raises:
        ConfigError: if there is no such policy, its files are inconsistent, or its scene is not
            trusted.
    """
    folder, kept = Path(name), None
    shipped = isinstance(name, str) and name in shipped_policies()
    if not shipped and (folder / CONFIG).is_file():
        kept = Config.load(folder / CONFIG, trust=trust)
        if not (folder / TENSORS).is_file():
            return kept, load_policy(folder, kept)
    try:
        if kept is not None:  # the former format of exported policies: tensors and YAML
            return kept, _network(read_tensors(folder / TENSORS), kept)
        policy = load_exported(name, trust=trust)
        if not isinstance(policy, TrainedPolicy):
            raise ValueError("its file lacks the configuration of its training")
        return Config(**policy.trained).trusted(trust), policy
    except ImportError:
        raise
    except Exception as error:  # a damaged file may raise anything
        raise ConfigError(
            f"{name} is neither a run nor an exported policy: {reason(error)}"
        ) from None


def _network(tensors: Mapping[str, NDArray], config: Config) -> Network:
    """A policy on NumPy, as its configuration says."""
    scene = scene_of(config)
    return Network(tensors, **_acting(config), least=[scene.least(each) for each in scene.actions])


def _acting(config: Config) -> dict[str, Any]:
    """Architecture and input scaling of a policy, with stable-baselines3's defaults written out."""
    usual = "nn.ReLU" if config.algo == "sac" else "nn.Tanh"
    activation = config.hyperparams.get("policy_kwargs", {}).get("activation_fn", usual)
    scaling = None
    if config.normalize is not None and config.normalize.get("norm_obs", True):
        usual_scaling = {"epsilon": 1e-8, "clip_obs": 10.0} | config.normalize
        scaling = {"epsilon": usual_scaling["epsilon"], "clip": usual_scaling["clip_obs"]}
    return {
        "algo": config.algo,
        "activation": str(activation).removeprefix("nn."),
        "normalizer": scaling,
    }


def export(policy: LearnedPolicy, config: Config, folder: Path) -> None:
    """Write a policy as a folder that `gym_passive_walker.load_policy` reads."""
    with replacing(folder / TENSORS) as path:
        path.write_bytes(as_safetensors(_tensors(policy)))
    about = {"scene": config.scene, "env": config.env, "trained": asdict(config)}
    text = json.dumps(_acting(config) | about, indent=1)
    with replacing(folder / DESCRIPTION) as path:
        path.write_text(text + "\n", encoding="utf-8")


def export_onnx(policy: Policy, config: Config, path: Path) -> None:
    """Write a policy as an ONNX file, with its observation normalizer; see `to_onnx`."""
    network, name = on_numpy(policy, config), config.algo.upper()
    write_onnx(network, path, scene=config.scene, env=config.env, algorithm=name)


def on_numpy(policy: Policy, config: Config) -> Network:
    """A copy of a policy that runs on NumPy; an exported one does already.

    A prediction for 20 walkers takes 25 µs, with torch 230 µs. Actions agree to rounding.

    Raises:
        ValueError: if a weight is not finite.
    """
    if isinstance(policy, Network):
        return policy
    assert isinstance(policy, LearnedPolicy)
    arrays = {name: tensor.cpu().numpy() for name, tensor in _tensors(policy).items()}
    return _network(arrays, config)


def _tensors(policy: LearnedPolicy) -> dict[str, torch.Tensor]:
    """Tensors that determine a policy's actions; those of the critic do not."""
    tensors = {
        name: tensor.detach().contiguous()
        for name, tensor in policy.model.policy.state_dict().items()
        if "critic" not in name and "value" not in name
    }
    normalizer = policy.model.get_vec_normalize_env()
    if normalizer is not None:
        tensors |= {
            f"normalizer.{name}": torch.as_tensor(np.atleast_1d(array))
            for name, array in moments(normalizer).items()
            if "critic" not in name
        }
    return tensors
