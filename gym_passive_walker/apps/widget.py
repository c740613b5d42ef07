"""The player of web pages as a widget of notebooks."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from gym_passive_walker._tools.extras import extra
from gym_passive_walker.apps.shown import LIBRARY, PLAYER, STYLE, Setup, content_of
from gym_passive_walker.devices.web.build import PACKAGE
from gym_passive_walker.envs.policies import TrainedPolicy
from gym_passive_walker.gaits.scenes.checks import bounded
from gym_passive_walker.models.walkers import Walker

with extra("notebook"):
    import anywidget
    import traitlets

_MOST_PUSH = 10.0  # m sqrt(g l), as in an environment


def _module() -> str:
    """Return one ES module with the library, the player and the widget."""
    library, player = ((PACKAGE / name).read_text(encoding="utf-8") for name in (LIBRARY, PLAYER))
    lines = [line for line in player.splitlines() if not line.endswith(f'from "./{LIBRARY}";')]
    widget = Path(__file__).with_name("widget.js").read_text(encoding="utf-8")
    return "\n".join([library, *lines, widget])


class PlayerWidget(anywidget.AnyWidget):
    """A walker in a notebook, with pushes and changes of its parameters; `play` makes it.

    Angles are in rad and states in the walker's own units. A change of `slope`, `hip_torque`,
    `speed` or `running` acts on the walker; the page reports the other attributes about ten times a
    second.

    Args:
        walker: The walker, or a `System`.
        slope: Slope in rad.
        controller: A trained policy, or a constant hip torque in m g l; 0 for a `System`.
        start: State on the Poincaré section to start from, (6,), or (2 m,) of a `System`; None is
            a periodic gait.

    Attributes:
        state: Angles and angular velocities at the last control step, 6 or 2 m numbers; empty until
            the widget is displayed.
        strides: Strides since the walk began.
        outcome: How the walk ended: a name of `Outcome`; empty while it continues.
        policy: Name of the policy that works the motors; empty without one.
        slope: Slope in rad.
        hip_torque: Constant hip torque, in m g l; 0 under a policy and of a `System`.
        speed: Speed of the picture; 1 is the walker's own pace.
        running: Whether the walk continues; False is a pause.

    Raises:
        ValueError: if the walker has no such start.
        ImportError: if anywidget is not installed.
        WebError: if the WebAssembly modules cannot be compiled here.
    """

    _esm = _module()
    _css = (PACKAGE / STYLE).read_text(encoding="utf-8")
    files = traitlets.Dict().tag(sync=True)
    given = traitlets.Dict().tag(sync=True)
    parameters = traitlets.Dict().tag(sync=True)
    state = traitlets.List(traitlets.Float()).tag(sync=True)
    strides = traitlets.Int().tag(sync=True)
    outcome = traitlets.Unicode().tag(sync=True)
    policy = traitlets.Unicode().tag(sync=True)
    slope = traitlets.Float(min=-0.5 * math.pi, max=0.5 * math.pi).tag(sync=True)
    hip_torque = traitlets.Float().tag(sync=True)
    speed = traitlets.Float(1.0, min=2.0**-6, max=4.0).tag(sync=True)
    running = traitlets.Bool(True).tag(sync=True)

    def __init__(
        self,
        walker: Walker,
        slope: float,
        controller: TrainedPolicy | float = 0.0,
        start: ArrayLike | None = None,
    ) -> None:
        self._walker = walker
        content, given = content_of(Setup(walker, slope, controller, start))
        super().__init__(
            files=content, given=given, parameters=walker.parameters,
            policy=given.get("policy", ""), slope=slope,
            hip_torque=controller if isinstance(controller, float) else 0.0,
        )  # fmt: skip

    @traitlets.validate("hip_torque")
    def _acting(self, proposal: Any) -> float:
        """Refuse a torque where another controller works the motor, or there is none."""
        if proposal["value"] and (self.policy or "system" in self.given):
            other = f"the policy {self.policy} works it" if self.policy else "a System has none"
            raise traitlets.TraitError(f"hip_torque is that of a held motor, and {other}: leave 0")
        return proposal["value"]

    @property
    def walker(self) -> Any:
        """The walker with its parameters now."""
        return self._walker.with_parameters(**self.parameters)

    def push(self, impulse: float) -> None:
        """Push the hip, or a system's centre of mass, by an impulse in m sqrt(g l), downhill.

        Raises:
            ValueError: if the impulse is not a number from -10 to 10.
        """
        self.send({"push": bounded("impulse", impulse, -_MOST_PUSH, _MOST_PUSH)})

    def begin(self) -> None:
        """Begin again, at the periodic gait of the current settings."""
        self.send({"again": True})
