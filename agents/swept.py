"""A training as a task of a sweep: `analysis: agents.swept:train`."""

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
    """Train a policy, and say what its last evaluation found.

    Args:
        algo: The algorithm.
        scene: Name of the scene.
        steps: Environment steps; the preset's when None.
        n_envs: Environments side by side; the preset's when None.
        seed: Of everything.
        folder: Below which the run is kept, in a folder by what it was given, and goes on from its
            last checkpoint; nowhere if None.
        **env: Arguments of the environment that differ from the scene's own.

    Raises:
        ConfigError: if a name or a number is out of range.
    """
    config = configure(algo, scene, env=env, steps=steps, n_envs=n_envs, seed=seed)
    with ExitStack() as stack:
        if folder is None:
            kept = Path(stack.enter_context(TemporaryDirectory()))
        else:
            rest = json.dumps([steps, n_envs, env], sort_keys=True)
            digest = hashlib.sha256(rest.encode()).hexdigest()[:8]
            kept = Path(folder) / f"{algo}-{scene}-{seed}-{digest}"
        run = Run(config, kept)
        run.train(progress=False)
    last = {name: value for name, value in run.notes["curve"][-1].items() if name != "seconds"}
    first = run.first_to_walk
    return {**last, "walks_after": float("nan") if first is None else float(first["steps"])}
