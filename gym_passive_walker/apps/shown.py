"""What a player is given to show, and the files of its page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gym_passive_walker._tools.arguments import check_state, one_slope
from gym_passive_walker.devices.web import page_data
from gym_passive_walker.devices.web.build import DATA, PACKAGE, files, system_module
from gym_passive_walker.envs.policies import TENSORS, PolicyError, TrainedPolicy, load_policy
from gym_passive_walker.gaits.actuation import PASSIVE, Actuation
from gym_passive_walker.gaits.control.maps import stride_map
from gym_passive_walker.gaits.find.fixed_point import find_gait
from gym_passive_walker.gaits.gait import GaitNotFound
from gym_passive_walker.gaits.given import GaitLike, walk_of
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.gaits.scenes.starts import REFERENCE_SLOPES, Start
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.models.walkers import Walker

LIBRARY, PLAYER, STYLE = "passive-walker.js", "player.js", "player.css"
"""Files of the JavaScript package that draw and control a walker."""

PAGE = Path(__file__).with_name("page.html")
"""The page on which `play` shows a walker."""

_READ = (".json", ".wasm", ".safetensors")  # endings of the files that the player reads
_SYSTEM = "own"  # name of a user's system among the files


class Setup(NamedTuple):
    """A walker with what the player is given beside it.

    Attributes:
        walker: The walker, or a `System`.
        slope: Slope in rad, positive downhill.
        controller: A trained policy, or a constant hip torque in units of m g l; 0 for a `System`.
        start: State on the Poincaré section to start from, in the walker's own units, (6,), or
            (2 m,) of a `System`. None is a periodic gait.
    """

    walker: Walker
    slope: float
    controller: TrainedPolicy | float = 0.0
    start: ArrayLike | None = None

    @classmethod
    def of(
        cls,
        walker: GaitLike | None,
        slope: float | None,
        policy: TrainedPolicy | str | Path | None,
        start: ArrayLike | None,
    ) -> Setup:
        """Return what arguments of `play` mean.

        Raises:
            ValueError: if an argument is out of its range, or the player has no such controller.
        """
        if isinstance(policy, str | Path):
            loaded = load_policy(policy)
            if not isinstance(loaded, TrainedPolicy):
                raise ValueError(
                    "play shows policies of the package and exported folders, and gpw.simulate "
                    f"those of other files, not {policy}"
                )
            policy = loaded
        if walker is None:
            walker = "lab" if policy is None else policy.scene.walker
        walker, slope, start, motors, _, strides = walk_of(walker, slope, start)
        controller: Any = policy
        if policy is None:
            held = motors.hip_torque / walker.units.torque
            controller = held if strides is None else strides.controller
            smooth = strides is None or strides.terrain is None
            shown = smooth and isinstance(controller, TrainedPolicy | float)
            if not shown or motors[1:] != PASSIVE[1:]:
                raise ValueError(
                    "play shows gaits on smooth ground that are passive, or under a constant hip "
                    "torque or a trained policy"
                )
        elif strides is not None or motors != PASSIVE:
            raise ValueError(
                "play shows one controller on smooth ground: leave out policy, or give a passive "
                "gait or a walker beside it"
            )
        if slope is None:
            slope = _gentle_slope(walker) if policy is None else float(np.mean(policy.scene.slope))
        setup = cls(walker, one_slope(slope), controller, start)
        setup.first_state()
        if strides is not None:
            there: Any = setup.stride_map()
            if there.scene != make_scene(strides.scene, slope=setup.slope):
                raise ValueError(
                    "play shows a trained policy in its own scene, and this gait is of another: "
                    "give a gait of stride_map(walker, slope, controller=policy)"
                )
        return setup

    def first_state(self) -> Start | None:
        """Return the start with angular velocities in sqrt(g/l).

        Raises:
            ValueError: if it is no state of an upright walker.
        """
        if self.start is None:
            return None
        state = check_state(self.start, "start", self.walker)
        return self.walker.checked_state(state.tolist(), "start")

    def stride_map(self) -> StrideMap:
        """Return the stride map of the walker under the controller, on smooth ground."""
        acts: Any = self.controller
        if isinstance(acts, float):
            acts = Actuation(hip_torque=acts * self.walker.units.torque) if acts else None
        return stride_map(self.walker, self.slope, controller=acts)


def content_of(setup: Setup) -> tuple[dict[str, bytes], dict[str, Any]]:
    """Return what shows a setup in a page.

    Returns:
        The files that the player reads, by their paths; and the options of its `play`, without
        slope and torque.

    Raises:
        ValueError: if a page cannot show the controller, or the start is no state of the walker.
        WebError: if the WebAssembly modules cannot be compiled here.
    """
    walker, controller, start = setup.walker, setup.controller, setup.first_state()
    given: dict[str, Any] = {} if start is None else {"start": list(start)}
    if not isinstance(walker, Walker):
        content = {f"systems/{_SYSTEM}.wasm": system_module(walker)}
        return content, {"system": _SYSTEM} | given
    content = {name: file for name, file in files().items() if name.endswith(_READ)}
    preset, changes = page_data.as_changes(walker)
    given |= {"walker": preset, "changes": changes}
    if isinstance(controller, TrainedPolicy):
        policy = page_data.of_policy(controller.folder)
        if lacking := [name for name in page_data.IN_PYTHON if policy["scene"].get(name)]:
            raise PolicyError(
                f"{controller.folder}: a page has no {', '.join(lacking)}, which this policy's "
                "scene has: draw it by picture= or video="
            )
        given["policy"] = name = controller.folder.name
        data = json.loads(content[DATA])
        data["policies"][name] = policy
        content[DATA] = json.dumps(data).encode()
        content[f"policies/{name}.safetensors"] = (controller.folder / TENSORS).read_bytes()
    return content, given


def page_of(setup: Setup) -> dict[str, bytes]:
    """Return all files of a page that shows a setup, by their paths; "index.html" is the page.

    Raises:
        ValueError: if a page cannot show the controller, or the start is no state of the walker.
        WebError: if the WebAssembly modules cannot be compiled here.
    """
    content, given = content_of(setup)
    given["slope"] = setup.slope
    if isinstance(setup.controller, float) and setup.controller:
        given["torque"] = setup.controller
    content |= {name: (PACKAGE / name).read_bytes() for name in (LIBRARY, PLAYER, STYLE)}
    settings = json.dumps(given, allow_nan=False).encode()
    return content | {"index.html": PAGE.read_bytes(), "settings.json": settings}


def _gentle_slope(walker: Walker) -> float:
    """Return the first reference slope in rad at which a stable gait is found, else the first."""
    for slope in REFERENCE_SLOPES:
        try:
            if find_gait(walker, slope).stable:
                return slope
        except (GaitNotFound, ValueError):  # or a system without a start of its own
            pass
    return REFERENCE_SLOPES[0]
