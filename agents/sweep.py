"""Training as the analysis of a sweep: `analysis: agents.sweep:train`."""

from __future__ import annotations

import hashlib
import json
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from agents.config import DEFAULT_SCENE, configure
from agents.training import Run


def train(
    algo: str = "ppo",
    scene: str = DEFAULT_SCENE,
    *,
    steps: int | None = None,
    n_envs: int | None = None,
    seed: int = 0,
    folder: str | None = None,
    **env: Any,
) -> dict[str, Any]:
    """Train a policy, and return the results of its last evaluation.

    Args:
        algo: Name of the algorithm.
        scene: Name of the scene.
        steps: Environment steps; the preset's when None.
        n_envs: Number of parallel environments; the preset's when None.
        seed: Seed of environments, initial weights and exploration.
        folder: Parent folder of the run's folder, which is named by the arguments. A run that is
            there resumes from its last checkpoint. None saves nothing. A scene, a walker and a
            terrain from files are named by their content.
        **env: Arguments of the environment that differ from the scene's own.

    Returns:
        The last row of the learning curve without "seconds", and "walks_after": the steps until
        half of the evaluation walks made a hundred strides, NaN if they never did.

    Raises:
        ConfigError: if a name or a number is out of range, or the code of a scene has changed
            since the run in the folder began.
        KeyboardInterrupt: if the training was interrupted.
    """
    config = configure(algo, scene, env=env, steps=steps, n_envs=n_envs, seed=seed)
    with ExitStack() as stack:
        if folder is None:
            kept = Path(stack.enter_context(TemporaryDirectory()))
        else:
            rest = json.dumps([steps, n_envs, config.env], sort_keys=True)
            digest = hashlib.sha256(rest.encode()).hexdigest()[:8]
            named = config.scene.replace(":", ".")
            kept = Path(folder) / f"{algo}-{named}-{seed}-{digest}"
        run = Run(config, kept)
        if not run.train(progress=False):
            raise KeyboardInterrupt  # an unfinished training has no results; it is resumed later
    last = {name: value for name, value in run.notes["curve"][-1].items() if name != "seconds"}
    first = run.first_to_walk
    return {**last, "walks_after": float("nan") if first is None else float(first["steps"])}
