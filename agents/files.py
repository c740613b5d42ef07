"""Files of a run, each written atomically by `gym_passive_walker._tools.files.replacing`.

A damaged file raises an error that names the file.

A run's folder holds:

    config.yml            the configuration;
    checkpoints/<steps>/  the newest checkpoint, from which the run resumes;
    model.zip             the best policy so far, in stable-baselines3's format;
    normalizer.npz        the moments of its VecNormalize;
    learning_curve.csv    one row for each evaluation; learning_curve.png draws them;
    evaluation.csv        the final evaluation, one row an episode; evaluation.txt is its table;
    gait.png              stroboscopic picture of the learned gait.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.config import ConfigError
from gym_passive_walker._tools.files import remove
from gym_passive_walker._tools.loading import parse_json, reason

CONFIG = "config.yml"
RUNS = Path("runs")


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn any error while a file is read into a `ConfigError` that names the file.

    Raises:
        ConfigError: if the file is missing, or its content is invalid.
    """
    try:
        yield
    except ConfigError:
        raise
    except Exception as error:  # random bytes raise anything
        raise ConfigError(
            f"{path} is damaged, or does not fit the run's {CONFIG} ({reason(error)}): restore a "
            "whole copy, or start again elsewhere"
        ) from None


def read_arrays(path: Path) -> dict[str, NDArray]:
    """All arrays of an NPZ file; nothing is unpickled.

    Raises:
        ConfigError: if it is damaged.
    """
    with reading(path), path.open("rb") as file:
        if not zipfile.is_zipfile(file):  # numpy's error would mention pickles
            raise ValueError("it is not an NPZ file")
        with np.load(file) as arrays:
            return dict(arrays)


def read_json(path: Path) -> Any:
    """The content of a JSON file.

    Raises:
        ConfigError: if it is damaged.
    """
    with reading(path):
        return parse_json(path.read_bytes())


def new_run(folder: Path | None, name: str) -> Path:
    """Create the folder of a new run: the given one, or the first free number under `runs`.

    Raises:
        ConfigError: if the given folder is not empty, or is a file.
    """
    if folder is None:
        free = (RUNS / f"{name}-{number}" for number in count(1))
        folder = next(path for path in free if not path.exists())
    elif folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ConfigError(
            f"{folder} contains a run: continue it with --resume {folder}, or choose another --out"
        )
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def latest_run() -> Path:
    """The folder under `runs` that was written last.

    Raises:
        ConfigError: if there is no run.
    """
    found = [path for path in RUNS.glob("*") if (path / CONFIG).is_file()]
    if not found:
        raise ConfigError(f"there is no run to resume under {RUNS.resolve()}")
    return max(found, key=lambda path: max(p.stat().st_mtime for p in [path, *path.iterdir()]))


def checkpoint_path(run: Path, steps: int) -> Path:
    """Path of the checkpoint after a number of steps."""
    return run / "checkpoints" / f"{steps:012d}"


def newest_checkpoint(run: Path) -> Path | None:
    """The newest complete checkpoint of a run; None if there is none yet."""
    return max((p for p in (run / "checkpoints").glob("[0-9]*") if p.is_dir()), default=None)


def drop_older_checkpoints(newest: Path) -> None:
    """Remove the checkpoints before `newest`, and those that an abrupt end left unfinished."""
    for path in newest.parent.iterdir():
        if path != newest and (path.name.startswith(".") or path.name < newest.name):
            remove(path)
