"""Walks in MuJoCo beside exact ones: errors, what goes wrong without its loop, and run time.

    python -m benchmarks.simulators [walks] [contacts] [traps] [speed]

The tables are written to docs/simulators.md.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

import gym_passive_walker as gpw
from benchmarks.report import command, machine, table
from benchmarks.tables import DOCS, keep
from examples.rimless_wheel import RIMLESS_WHEEL, closed_form
from gym_passive_walker._tools import console
from gym_passive_walker.bridge.loop import Loop
from gym_passive_walker.bridge.mjcf import STIFF
from gym_passive_walker.bridge.mujoco import PassiveWalkerMujocoEnv
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.walkers import name_of

PAGE = DOCS / "simulators.md"
TIMESTEPS = (4e-3, 2e-3, 1e-3, 1e-4)
STRIDES = 20
WHEEL_SLOPE = 0.08
MACHINE = ("mujoco", "gymnasium")


def compared() -> dict[str, gpw.Comparison]:
    """Walks of each kind, in MuJoCo and here."""
    both = {"timesteps": TIMESTEPS, "strides": STRIDES}
    optimum = gpw.optimal_gait("level", 0.10)
    return {
        "lab, slope 0.036, passive": gpw.compare(gpw.find_gait("lab", 0.036), **both),
        "lab, with MuJoCo's own contacts": gpw.compare(
            gpw.find_gait("lab", 0.036), softness=[None], **both
        ),
        "A, slope 0.02, passive": gpw.compare(gpw.find_gait("A", 0.02), **both),
        "C, level, optimal torques, open loop": gpw.compare(optimum, "level", **both),
        "C, level, `level-ppo`": gpw.compare("level-ppo", **both),
        "lab, slope 0.036, `lab-ppo`": gpw.compare("lab-ppo", **both),
    }


def walks() -> None:
    """Write the errors of walks."""
    rows = []
    for name, found in compared().items():
        exact = found.exact["step_period"], found.exact["stance_angle"]
        exact += found.exact["speed"], found.exact["cost_of_transport"]
        rows.append((name, "exact", *(f"{x:.5g}" for x in exact), "", ""))
        for i, step in enumerate(found.timestep):
            errors = (found.error[each][i] for each in (
                "step_period", "stance_angle", "speed", "cost_of_transport"))  # fmt: skip
            depth, count = f"{found.penetration[i]:.0e}", str(found.strides[i])
            ended = "" if found.outcome[i] == "no fall" else f", {found.outcome[i]}"
            cells = (f"{error:+.3%}" for error in errors)
            rows.append(("", f"{1e3 * step:g} ms", *cells, depth, count + ended))
    heads = ("walk", "timestep", "step period", "stance angle", "speed", "cost of transport",
             "depth / l", "strides")  # fmt: skip
    keep("walks", f"{table(heads, rows)}\n\n{machine(*MACHINE)}.", PAGE)


def wheel(timestep: float, constant: float | None) -> Any:
    """A rimless wheel in MuJoCo, on a slope, with point feet; `constant` is that of contacts in s.

    Neither contacts are filtered nor steps shortened, as a wheel needs nothing of that.
    """
    body, count = RIMLESS_WHEEL.body, round(math.pi / RIMLESS_WHEEL.body.half)
    turns = body.half * (2.0 * np.arange(count) + 1.0)
    places = (f"{math.sin(turn)!r} 0 {-math.cos(turn)!r}" for turn in turns)
    spokes = "".join(f'<geom type="sphere" size="1e-6" pos="{place}"/>' for place in places)
    contact = "" if constant is None else f'solref="{constant!r} 1" solimp="{STIFF}"'
    return mujoco.MjModel.from_xml_string(f"""
        <mujoco>
          <option timestep="{timestep}" cone="elliptic" integrator="implicitfast"/>
          <compiler angle="radian"/>
          <default><geom contype="0" friction="5 0 0" {contact}/></default>
          <worldbody>
            <geom type="plane" size="0 0 1" euler="0 {WHEEL_SLOPE} 0" contype="1" conaffinity="0"/>
            <body>
              <joint type="slide" axis="1 0 0"/>
              <joint type="slide" axis="0 0 1"/>
              <joint type="hinge" axis="0 1 0"/>
              <inertial pos="0 0 0" mass="1" diaginertia="{" ".join(3 * [str(body.inertia)])}"/>
              {spokes}
            </body>
          </worldbody>
        </mujoco>""")


def wheel_period(model: Any) -> float:
    """Mean time between impacts of a wheel in MuJoCo, over the second half of 20, in s."""
    half, unit = RIMLESS_WHEEL.body.half, math.sqrt(1.0 / 9.81)
    rate = -closed_form(RIMLESS_WHEEL.body, WHEEL_SLOPE)[0] / unit
    data, spoke = mujoco.MjData(model), WHEEL_SLOPE - half  # both feet are on the ground
    data.qpos[:] = (
        math.cos(half) * math.sin(WHEEL_SLOPE), math.cos(half) * math.cos(WHEEL_SLOPE), WHEEL_SLOPE
    )  # fmt: skip
    data.qvel[:] = rate * math.cos(spoke), -rate * math.sin(spoke), rate
    times: list[float] = []
    while len(times) < STRIDES:
        time_before, turn_before = data.time, data.qpos[2].item()
        mujoco.mj_step(model, data)
        goal, turned = WHEEL_SLOPE + 2.0 * half * (len(times) + 1), data.qpos[2].item()
        if turned >= goal:
            share = (goal - turn_before) / (turned - turn_before)
            times.append(time_before + share * (data.time - time_before))
    return (times[-1] - times[STRIDES // 2 - 1]) / (STRIDES - STRIDES // 2)


def contacts() -> None:
    """Write the error of a rimless wheel's period by the time constant of contacts."""
    exact = gpw.find_gait(RIMLESS_WHEEL, WHEEL_SLOPE).step_period * math.sqrt(1.0 / 9.81)
    kinds: list[tuple[str, Callable[[float], float | None]]] = [
        ("MuJoCo's own, 20 ms", lambda step: None),
        ("20 ms, as stiff as here", lambda step: 0.02),
        *(
            (f"{many} timesteps", lambda step, many=many: many * step)  # type: ignore[misc]
            for many in (20, 10, 5, 2)
        ),
    ]
    rows = [
        (name, *(f"{wheel_period(wheel(h, constant(h))) / exact - 1.0:+.2%}" for h in TIMESTEPS))
        for name, constant in kinds
    ]
    heads = ("time constant of contacts", *(f"{1e3 * step:g} ms" for step in TIMESTEPS))
    keep("contacts", f"{table(heads, rows)}\n\n{machine(*MACHINE)}.", PAGE)


class LateRelease(Loop):
    """The trailing knee is free a step after the impact, instead of before it."""

    late = False

    def release_before_impact(self) -> None:
        """Note that it is still locked."""
        self.late = True

    def _impact(self) -> None:
        super()._impact()
        if self.late:
            self._latch(1 - self.stance, False)
            self.late = False


class JointLimit(Loop):
    """A limit of the joint alone holds the knees."""

    def _latch(self, leg: int, on: bool) -> None:
        pass


class NoFilter(Loop):
    """The swing foot meets the ground at any time."""

    def filter_contacts(self) -> None:
        """Leave both feet on."""
        self.model.geom_conaffinity[self._feet] = 1


class FeetCollide(NoFilter):
    """The feet meet each other, too; the swing foot still passes through the ground."""

    def changed(self, text: str) -> str:
        """Return feet that meet all that has a contact type: the ground, and other feet."""
        return text.replace('contype="0" conaffinity="1"', 'contype="2" conaffinity="3"')

    def filter_contacts(self) -> None:
        """Let the stance foot meet the ground."""
        for leg, foot in enumerate(self._feet):
            self.model.geom_conaffinity[foot] = 3 if leg == self.stance else 2


class ObservedBefore(Loop):
    """The state at a heelstrike is that before the impact."""

    def _rates_after_impact(self) -> Any:
        return self.data.qvel.copy()


class NoLanding(Loop):
    """Steps are equal: a foot is found below the ground by chance."""

    def _swing_foot(self, angles: tuple[float, ...]) -> tuple[float, float]:
        height, rate = super()._swing_foot(angles)
        return height, 0.0 if height > 0.0 else rate


def meshes(facets: int) -> type[Loop]:
    """A loop with feet that are meshes."""

    class Meshed(Loop):
        def changed(self, text: str) -> str:
            radius = self.walker.foot_radius
            turns = 2.0 * math.pi * (np.arange(facets) + 0.5) / facets
            points = [
                (radius * math.sin(turn), y, -radius * math.cos(turn))
                for turn in turns
                for y in (-0.01, 0.01)
            ]
            vertices = " ".join(f"{x!r} {y!r} {z!r}" for x, y, z in points)
            text = text.replace("<asset>", f'<asset><mesh name="foot" vertex="{vertices}"/>')
            return re.sub(
                r'(<geom name="\w+_foot" )type="sphere"(.*?) size="[^"]*"',
                r'\1type="mesh" mesh="foot"\2',
                text,
            )

        def __init__(self, *args: Any, **kwargs: Any) -> None:
            super().__init__(*args, **kwargs)
            self._radius = [self.walker.foot_radius] * 2

    return Meshed


def walk(kind: type[Loop], gait: gpw.Gait, timestep: float, strides: int) -> tuple[str, ...]:
    """Walk passively in a loop; returns the errors of period and angle, and how the walk ended."""
    softness = 2.0
    loop = kind(gait.walker, timestep, softness=softness)
    loop.reset(gait.state, gait.slope)
    found, outcome = [], Outcome.RUNNING
    while len(found) < strides:
        outcome = loop.advance(0.0, 20.0 * gait.walker.time_unit)
        if outcome is not Outcome.HEELSTRIKE:
            break
        found.append((loop.ended[0], loop.state[0]))
    if len(found) < strides:
        return "", "", f"{outcome.name.lower().replace('_', ' ')} in stride {len(found) + 1}"
    period, angle = np.mean(found[len(found) // 2 :], axis=0)
    errors = period / gait.step_period - 1.0, angle / gait.stance_angle - 1.0
    return *(f"{error:+.2%}" for error in errors), f"{strides} strides"


def hip_cost(name: str, kind: type[Loop], timestep: float, strides: int = STRIDES) -> float:
    """Mean hip cost of a policy; NaN if it falls."""
    policy = gpw.load_policy(name)
    start = tuple(gpw.closed_loop_gait(policy).dimensionless.state.tolist())
    env = PassiveWalkerMujocoEnv(
        policy.scene, timestep=timestep, start=start, reset_noise_scale=0.0
    )
    env.batch.kind = kind
    env.batch.loop = env.batch._loop(env.walker)
    observation, info = env.reset(seed=0)
    costs: list[float] = []
    while len(costs) < strides:
        action, _ = policy.predict(observation, deterministic=True)
        observation, _, ended, _, info = env.step(action)
        if ended:
            return math.nan
        if info["outcome"]:
            costs.append(info["hip_cost"])
    return float(np.mean(costs[strides // 2 :]))


def traps() -> None:
    """Write what each detail of the loop is worth."""
    lab, straight = gpw.find_gait("lab", 0.036), gpw.find_gait("A", 0.02)
    rows: list[tuple[str, ...]] = []
    cases: list[tuple[str, type[Loop], gpw.Gait]] = [
        ("none", Loop, lab),
        ("trailing knee released after the impact", LateRelease, lab),
        ("steps do not end on impacts", NoLanding, lab),
        ("a joint limit instead of latches", JointLimit, lab),
        ("feet collide with each other", FeetCollide, lab),
        ("swing foot meets the ground at any time", NoFilter, lab),
        ("swing foot meets the ground at any time", NoFilter, straight),
        *((f"feet are meshes of {n} facets", meshes(n), lab) for n in (24, 64, 256)),
    ]
    for name, kind, gait in cases:
        for step, count in ((1e-3, STRIDES), (1e-4, 10)):
            rows.append(
                (name, name_of(gait.walker), f"{1e3 * step:g} ms", *walk(kind, gait, step, count))
            )
    heads = ("what is wrong", "walker", "timestep", "step period", "stance angle", "walk")
    acting: list[tuple[str, type[Loop], str]] = [
        ("none", Loop, "lab-ppo"),
        ("observed before the impact", ObservedBefore, "lab-ppo"),
        ("none", Loop, "level-ppo"),
        ("swing foot meets the ground at any time", NoFilter, "level-ppo"),
    ]
    costs = [
        (name, f"`{policy}`", f"{1e3 * step:g} ms", "falls" if math.isnan(cost) else f"{cost:.5f}")
        for name, kind, policy in acting
        for step in (1e-3, 5e-4)
        for cost in (hip_cost(policy, kind, step),)
    ]
    exact = (gpw.closed_loop_gait(gpw.load_policy(name)) for name in ("lab-ppo", "level-ppo"))
    costs += [
        ("exact", f"`{name}`", "", f"{gait.hip_cost:.5f}")
        for name, gait in zip(("lab-ppo", "level-ppo"), exact, strict=True)
    ]
    costs_table = table(("what is wrong", "policy", "timestep", "hip cost"), costs)
    keep("traps", f"{table(heads, rows)}\n\n{costs_table}\n\n{machine(*MACHINE)}.", PAGE)


def steps_per_second(step: Callable[[], Any], count: int) -> float:
    """Control steps of an environment in a second of the CPU."""
    began = time.process_time()  # of this process alone, on a machine that others use too
    for _ in range(count):
        step()
    return count / (time.process_time() - began)


def speed() -> None:
    """Write run times beside errors, by turns in one run on one core."""
    import gymnasium as gym

    gait = gpw.find_gait("lab", 0.036)
    start = tuple(gait.dimensionless.state.tolist())
    quiet = {"scene": "lab", "start": start, "reset_noise_scale": 0.0}
    action = np.zeros(1, np.float32)

    def timed(env: Any, count: int) -> Callable[[], float]:
        env.reset(seed=0)
        return lambda: steps_per_second(lambda: env.step(action), count)

    exact = timed(gym.make("PassiveWalker-v0", **quiet).unwrapped, 10_000)
    soft = {step: timed(PassiveWalkerMujocoEnv(timestep=step, **quiet), 100) for step in TIMESTEPS}
    best: dict[float | None, float] = dict.fromkeys([None, *soft], 0.0)
    for _ in range(3):
        best[None] = max(best[None], exact())
        for step, job in soft.items():
            best[step] = max(best[step], job())
    found = gpw.compare(gait, timesteps=TIMESTEPS, strides=STRIDES)
    rows = [("`PassiveWalker-v0`", "tolerance 1e-08", "below 1e-8", f"{best[None]:.3g}", "1")]
    for i, step in enumerate(TIMESTEPS):
        error = max(abs(found.error[each][i]) for each in ("step_period", "stance_angle"))
        ratio = f"{best[None] / best[step]:.3g}"
        rows.append(
            (
                "`PassiveWalkerMujoco-v0`",
                f"{1e3 * step:g} ms",
                f"{error:.0e}",
                f"{best[step]:.3g}",
                ratio,
            )
        )
    heads = (
        "environment",
        "accuracy",
        "error of the gait",
        "control steps / CPU s",
        "times slower",
    )
    keep("speed", f"{table(heads, rows)}\n\nOne core. {machine(*MACHINE)}.", PAGE)


def main() -> None:
    """Print the tables and write them to the page."""
    command(__doc__, {"walks": walks, "contacts": contacts, "traps": traps, "speed": speed})


if __name__ == "__main__":
    raise SystemExit(console.run(main))
