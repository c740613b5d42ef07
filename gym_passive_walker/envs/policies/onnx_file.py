"""Policies as ONNX files: written with the observation normalizer inside, and read."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import shown
from gym_passive_walker._tools.extras import extra
from gym_passive_walker._tools.files import replacing
from gym_passive_walker._tools.loading import parse_json, reason
from gym_passive_walker.envs.explain import as_rows
from gym_passive_walker.envs.policies.tensors import PolicyError, reading
from gym_passive_walker.gaits.scenes.scene import make_scene, seen_by_policy

if TYPE_CHECKING:
    from gym_passive_walker.envs.policies.network import Network

EXTRA = "onnx"
_OPSET, _IR = 17, 8  # of 2022, which runtimes since then can read
_TYPES = {"tensor(float)": np.float32, "tensor(double)": np.float64}
_REAL = re.compile(r"tensor\((float|float16|double|u?int\d+)\)")
_ACTIVATIONS = {"ReLU": "Relu", "Tanh": "Tanh", "ELU": "Elu"}


def write_onnx(
    network: Network,
    path: str | Path,
    *,
    scene: str,
    env: Mapping[str, Any],
    algorithm: str,
) -> None:
    """Write the mean action of a policy as an ONNX file, with its observation normalizer.

    The input "observation" has shape (n, size), the output "action" shape (n, actions). Both are
    float32 and n is free. Actions are in [-1, 1].

    Args:
        network: The policy.
        path: The file.
        scene: Name of the scene that the policy was trained in.
        env: Arguments of `Scene` that replace the scene's own, representable as JSON.
        algorithm: Name of the algorithm.

    Raises:
        ImportError: if onnx is not installed.
        OSError: if the file cannot be written.
        ValueError: if the scene's observations or actions are not the policy's.
    """
    with extra(EXTRA):
        import onnx
        from onnx import TensorProto, helper, numpy_helper

    seen = seen_by_policy(make_scene(scene, trust=True, **env))  # a run's, which was trusted
    tables = as_rows(seen)
    nodes: list[Any] = []
    constants: list[Any] = []

    def constant(value: ArrayLike, name: str) -> str:
        constants.append(numpy_helper.from_array(np.asarray(value, np.float32), name))
        return name

    def add(operator: str, name: str, *inputs: str, **attributes: Any) -> str:
        nodes.append(helper.make_node(operator, [*inputs], [name], name=f"{name}_", **attributes))
        return name

    x = "observation"
    if network.moments is not None:
        mean, spread, clip = network.moments
        # The mean as two numbers in single precision: a small spread magnifies its rounding.
        near = mean.astype(np.float32)
        x = add("Sub", "deviation", x, constant(near, "mean"))
        x = add("Sub", "exact_deviation", x, constant(mean - near, "mean_remainder"))
        x = add("Div", "normalized", x, constant(spread, "spread"))
        if np.isfinite(clip):
            bounds = constant(-clip, "lowest_observation"), constant(clip, "highest_observation")
            x = add("Clip", "clipped", x, *bounds)
    for i, (weight, bias) in enumerate(network.layers):
        tensors = constant(weight, f"weight_{i}"), constant(bias, f"bias_{i}")
        x = add("Gemm", f"layer_{i}", x, *tensors, transB=1)
        if i == len(network.layers) - 1:
            continue
        if network.activation == "SiLU":
            x = add("Mul", f"hidden_{i}", x, add("Sigmoid", f"sigmoid_{i}", x))
        else:
            x = add(_ACTIVATIONS[network.activation], f"hidden_{i}", x)
    if network.squashed:
        middle, half = network.scale
        x = add("Mul", "scaled", add("Tanh", "share", x), constant(half, "half_range"))
        add("Add", "action", x, constant(middle, "middle"))
    else:
        bounds = constant(-1.0, "lowest_action"), constant(1.0, "highest_action")
        add("Clip", "action", x, *bounds)

    def described(name: str, rows: list[dict[str, Any]], size: int) -> Any:
        if len(rows) != size:
            raise ValueError(f"the policy has {size} numbers in its {name}, its scene {len(rows)}")
        about = "; ".join(
            f"{row[name]} ({row['unit']})" if row.get("unit") else row[name] for row in rows
        )
        return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", size], about)

    graph = helper.make_graph(
        nodes, "policy",
        [described("observation", tables["observation"], network.layers[0][0].shape[1])],
        [described("action", tables["action"], len(network.layers[-1][1]))],
        constants,
    )  # fmt: skip
    model = helper.make_model(
        graph, ir_version=_IR, opset_imports=[helper.make_opsetid("", _OPSET)],
        producer_name="gym_passive_walker",
    )  # fmt: skip
    names = {
        key: json.dumps([row[key] for row in tables[key]]) for key in ("observation", "action")
    }
    about = {"scene": scene, "env": json.dumps(dict(env)), "algorithm": algorithm, **names}
    helper.set_model_props(model, about)
    onnx.checker.check_model(model, full_check=True)
    with replacing(path) as aside:
        aside.write_bytes(model.SerializeToString())


class OnnxPolicy:
    """A policy in an ONNX file, evaluated by onnxruntime.

    The file has one input, observations (n, size), and returns actions (n, actions) by its output
    "action", "actions", or the first. Observations are those of the environment.

    Args:
        path: The file.
        trust: Whether to allow a scene that is "module:function".

    Attributes:
        name: Name of the file.
        scene: The scene that the file names, as `to_onnx` writes it; None without one.
        path: The file.

    Raises:
        ImportError: if onnxruntime is not installed.
        PolicyError: if there is no such file, or it is not such a policy.
    """

    def __init__(self, path: str | Path, *, trust: bool = False) -> None:
        self.path, self.name = Path(path).absolute(), Path(path).name
        self._open()
        found = self._session.get_modelmeta().custom_metadata_map
        self.scene: Any = None
        if "scene" in found:
            with reading(self.path, "names an invalid scene"):
                env = parse_json(found.get("env", "{}"))
                self.scene = seen_by_policy(make_scene(found["scene"], trust=trust, **env))

    def _open(self) -> None:
        """Prepare the evaluation."""
        with reading(self.path), self.path.open("rb"):
            pass
        with extra(EXTRA):
            import onnxruntime
        options = onnxruntime.SessionOptions()
        # For networks of this size, a second thread only waits.
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        with reading(self.path, "is not a readable ONNX file"):
            # By its path, because its tensors may be in another file beside it.
            self._session = onnxruntime.InferenceSession(
                str(self.path), options, providers=["CPUExecutionProvider"]
            )
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        if len(inputs) != 1 or inputs[0].type not in _TYPES or len(inputs[0].shape) != 2:
            has = ", ".join(f"{x.name} {x.type} {x.shape}" for x in inputs)
            raise PolicyError(
                f"{self.path} must have one input, floating-point observations (n, size), not {has}"
            )
        (given,), names = inputs, [x.name for x in outputs]
        self._input, self._shape, self._dtype = given.name, given.shape, _TYPES[given.type]
        self._output = next((x for x in ("action", "actions") if x in names), names[0])
        kind = outputs[names.index(self._output)].type
        if not _REAL.fullmatch(kind):
            raise PolicyError(
                f"{self.path} must return actions as real numbers by its output {self._output}, "
                f"not {kind}"
            )

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_session"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._open()

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Return actions, as stable-baselines3's `predict` does.

        Args:
            observation: Observations of the environment, (size,) or (n, size).
            state: Returned unchanged: the policy has no memory.
            episode_start: Ignored.
            deterministic: Ignored: the file has the mean action alone.

        Returns:
            Actions, (actions,) or (n, actions), and the state.

        Raises:
            ValueError: if the observations have another shape, or the actions are not (n, actions)
                or not finite.
        """
        seen = np.asarray(observation, self._dtype)
        batch, size = self._shape
        if seen.ndim not in (1, 2) or (isinstance(size, int) and seen.shape[-1] != size):
            raise ValueError(
                f"{self.name} takes observations of shape ({size},) or (n, {size}), "
                f"not {seen.shape}"
            )
        rows = np.atleast_2d(seen)
        # A file that was traced with one observation takes no others.
        count = batch if isinstance(batch, int) else len(rows)
        parts = [rows[i : i + count] for i in range(0, len(rows), max(count, 1))]
        if any(len(part) != count for part in parts):
            raise ValueError(f"{self.name} takes {batch} observations at once, not {len(rows)}")
        actions = np.concatenate([self._run(part) for part in parts or [rows]])
        return actions[0] if seen.ndim == 1 else actions, state

    def _run(self, rows: NDArray) -> NDArray[np.float32]:
        """Return the actions for observations (n, size)."""
        try:
            found: Any = self._session.run([self._output], {self._input: rows})[0]
        except Exception as error:  # onnxruntime's errors have no common class
            raise ValueError(
                f"{self.name} fails for observations of shape {rows.shape}: {reason(error)}"
            ) from None
        with np.errstate(over="ignore"):  # of numbers in double precision
            actions = np.asarray(found, np.float32)
        if actions.ndim != 2 or len(actions) != len(rows):
            raise ValueError(
                f"{self.name} must return actions of shape (n, actions), here with n = "
                f"{len(rows)}, not {actions.shape}"
            )
        wrong = ~np.isfinite(actions).all(axis=1) & np.isfinite(rows).all(axis=1)
        if wrong.any():
            raise ValueError(
                f"{self.name} must return finite actions, not {shown(actions[wrong][0].tolist())}"
            )
        return actions
