"""Each option of each public function has an effect, or none where it must not."""

from __future__ import annotations

import inspect
import json
import shutil
from contextlib import redirect_stdout
from dataclasses import replace
from functools import cache
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.torso import TORSO
from gym_passive_walker.gaits.control.baselines import LinearFeedback
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.models.walkers import as_walker, describe, name_of
from tests.equations.examples import LONG_GAITS
from tests.options.effects import Call, Later, To, cases, check, missing

LAB, C, D, F = (gpw.WALKERS[name] for name in ("lab", "C", "D", "F"))


@cache
def gait(walker="lab", slope=0.036, kind="long", **options):
    return gpw.find_gait(walker, slope, kind, **options)


@cache
def family(walker="D", low=0.003, high=0.012, kind="long"):
    return gpw.gait_family(walker, low, high, kind)


FOLDED = Later(lambda: family("lab", 0.018, 0.06))
STATE = Later(lambda: 1.01 * gait().state)
OF_D = Later(lambda: gait("D", 0.009).state)
OF_LAB = {"walker": Later(lambda: gpw.stride_map("lab", 0.036)), "values": [0.036, 0.038]}
D_AT_A_SLOPE = Later(lambda: gpw.stride_map("D", 0.0185))
TORQUES = {"parameter": "hip_torque", "high": 0.05}
PART = gpw.Part(mass=1.0, com=0.1, inertia=0.01)
STEEP = Later(lambda: LinearFeedback("steep"))


OF_TORSO = {"walker": TORSO}
ON_A_SLOPE = {"walker": "lab", "slope": 0.036}


def exported(path, walker, **options):
    """The text of an exported file, without the walker's name."""
    with TemporaryDirectory() as folder:
        gpw.export(walker, Path(folder, path), **options)
        text, name = Path(folder, path).read_text("utf-8"), name_of(as_walker(walker))
    return text.replace(f'"{name}"', "it").replace(f"'{name}'", "it")


def compared(**options):
    """The columns of a comparison."""
    pytest.importorskip("mujoco")
    return gpw.compare(**options).columns()


def explained(env):
    """The printed output."""
    with redirect_stdout(StringIO()) as said:
        gpw.explain(env)
    return said.getvalue()


def shown_by_play(video=None, picture=None, **options):
    """The last frame of a walk, and the names of the files that were asked for."""
    with TemporaryDirectory() as folder:
        named = {"video": video, "picture": picture}
        paths = {name: Path(folder, file) for name, file in named.items() if file}
        last = paths.get("picture", Path(folder, "last.png"))
        gpw.play(**options, **paths | {"picture": last})
        files = [path.name for path in paths.values() if path.exists()]
        return plt.imread(last), files


def loaded(name_or_folder, **trust):
    """The walker of a policy's scene; the scene of "own" is a function of a user's."""
    with TemporaryDirectory() as folder:
        if name_or_folder == "own":
            name_or_folder = shutil.copytree(gpw.load_policy("level-ppo").folder, f"{folder}/own")
            file = Path(name_or_folder) / "policy.json"
            text = json.loads(file.read_text()) | {"scene": "examples.five_links:downhill"}
            file.write_text(json.dumps(text))
        try:
            return describe(gpw.load_policy(name_or_folder, **trust).scene.walker)
        except ValueError as error:
            return str(error).partition(": ")[2]


def mapped(**options):
    """A stride of a map, from the initial state of walks."""
    strides = gpw.stride_map(**options)
    start = gpw.find_gait(strides.walker, 0.036).state
    return strides.slope, strides.apply(strides.points_at(start))


def shorter(before, after):
    return after < before


OPTIONS = {
    "as_walker": Call(gpw.as_walker, dict(walker="lab"), dict(walker="C")),
    "play": Call(
        shown_by_play,
        dict(walker="lab", slope=0.036, seconds=0.3),
        dict(
            walker="C",
            slope=0.03,
            policy="level-ppo",
            start=0.99 * LONG_GAITS["lab"].state,
            seconds=0.7,
            video=To("walk.gif", expect=lambda _, b: b[1] == ["walk.gif"]),
            picture=To("other.png", expect=lambda a, b: a[1] == [] and b[1] == ["other.png"]),
        ),
        of=gpw.play,
    ),
    "export": Call(
        exported,
        dict(walker="lab", path="walker.xml"),
        dict(
            walker="C",
            path=To("walker.urdf", expect=lambda _, b: b.startswith("<robot")),
            format=To("sdf", expect=lambda _, b: b.startswith("<sdf")),
            slope=0.02,
            timestep=1e-4,
            unit_length=To(0.9, OF_TORSO | {"unit_mass": 2.0, "unit_length": 0.8}),
            unit_mass=To(3.0, OF_TORSO | {"unit_mass": 2.0, "unit_length": 0.8}),
        ),
        of=gpw.export,
    ),
    "compare": Call(
        compared,
        dict(controller="passive", scene=ON_A_SLOPE, timesteps=[8e-3], strides=2),
        dict(
            controller="constant",
            scene=ON_A_SLOPE | {"slope": 0.04},
            simulator=To("gazebo", refused="simulator must be 'mujoco'"),
            timesteps=To([4e-3]),
            softness=To([None]),
            strides=3,
        ),
        of=gpw.compare,
    ),
    "gauntlet": Call(
        gpw.gauntlet,
        dict(controller="steep-ppo", walkers=2),
        dict(controller="steep-sac", scene={"control": "stride", "slope": 0.1}, walkers=3),
    ),
    "evaluate": Call(
        gpw.evaluate,
        dict(controller="steep-ppo", episodes=2, max_episode_steps=9, time_limit=0.0),
        dict(
            controller="steep-sac",
            scene={"control": "stride", "slope": 0.1},
            episodes=3,
            seed=7,
            max_episode_steps=8,
            beside=To(["lqr"]),
            time_limit=To(
                60.0,
                dict(controller="lqr", scene={"control": "stride", "slope": 0.02}, episodes=2),
            ),
        ),
    ),
    "explain": Call(explained, dict(env="level"), dict(env="rough")),
    "combine": Call(gpw.combine, dict(parts=[PART]), dict(parts=[PART, PART])),
    "assemble": Call(
        gpw.assemble,
        dict(
            thigh=[PART],
            shank=[PART],
            thigh_length=0.4,
            shank_length=0.4,
            foot_radius=0.1,
            knee_angle=0.1,
        ),
        dict(
            thigh=[PART, PART._replace(com=0.2)],
            shank=[PART, PART._replace(com=0.2)],
            thigh_length=0.5,
            shank_length=0.5,
            foot_radius=0.2,
            knee_angle=0.2,
            hip_mass=To(2.0, expect=lambda a, b: (a.hip_mass, b.hip_mass) == (0.0, 2.0)),
            knees=To(False, expect=lambda a, b: a.knees and not b.knees),
            gravity=To(1.0, expect=lambda a, b: b.gravity == 1.0),
        ),
    ),
    "basin_of_attraction": Call(
        gpw.basin_of_attraction,
        dict(walker="D", slope=0.009, resolution=5, strides=30),
        dict(
            walker="E",
            slope=0.012,
            stance_angles=[0.1, 0.2, 0.3],
            stance_rates=[-0.2, -0.3],
            resolution=To(6, expect=lambda a, b: b.settled.shape == (6, 6)),
            ratios=(0.5, 0.5),
            strides=To(3, expect=lambda a, b: b.strides.max() <= 3 < a.strides.max()),
            atol=To(0.01, expect=lambda a, b: b.strides.sum() < a.strides.sum()),
            tolerance=To(0.1, dict(walker="lab", slope=0.036, atol=1e-7)),
        ),
    ),
    "bifurcation_diagram": Call(
        gpw.bifurcation_diagram,
        dict(walker="D", values=[0.012, 0.0165], n_transient=10, n_recorded=9, longest_period=4),
        dict(
            walker="E",
            values=[0.012, 0.016],
            n_transient=20,
            n_recorded=To(10, expect=lambda a, b: b.stance_angle.shape == (2, 10)),
            start=Later(lambda: 1.01 * gait("D", 0.009).state),
            kind=To("short", dict(n_transient=0)),
            sweep=True,
            longest_period=To(1, dict(n_transient=300), look=lambda found: found.period),
            tolerance=1e-5,
            parameter=To("hip_mass", OF_LAB),
            slope=To(0.038, OF_LAB | {"parameter": "hip_mass"}),
        ),
    ),
    "interpolate": Call(
        gpw.interpolate,
        dict(a="lab", b="C", fraction=0.5),
        dict(a=gpw.tune("lab"), b=gpw.tune("lab"), fraction=0.25),
    ),
    "closed_loop_gait": Call(
        gpw.closed_loop_gait,
        dict(policy=STEEP, scene="steep"),
        dict(
            policy=Later(lambda: LinearFeedback("steep", torque_weight=1.0)),
            scene=Later(lambda: make_scene("steep", max_hip_torque=0.02)),
            slope=0.1101,
            period=To(2, dict(slope=0.115), expect=lambda a, b: (a.period, b.period) == (1, 2)),
            guess=To(
                Later(lambda: gpw.closed_loop_gait(STEEP.value(), "steep").state * 1.001),
                look=lambda found: found.state,
            ),
        ),
    ),
    "collision_matrix": Call(
        gpw.collision_matrix,
        dict(walker="lab", stance_angle=0.3),
        dict(walker="C", stance_angle=0.2),
    ),
    "crisis": Call(
        gpw.crisis,
        dict(walker="D", low=0.0185, high=0.0195, strides=200, walkers=4, accuracy=1e-5),
        dict(
            walker=To("F", dict(low=0.005, high=0.03)),
            low=0.0184,
            high=0.0196,
            start=To(
                Later(lambda: gait("D", 0.0185).state), dict(strides=40, walkers=1, accuracy=1e-6)
            ),
            strides=50,
            walkers=To(64, dict(strides=50, accuracy=1e-6)),
            kind=To("short", refused="falls at slope"),
            accuracy=1e-7,
            tolerance=1e-4,
            parameter=To("hip_torque", refused="slope must be one number"),
            slope=To(0.0165, dict(walker=D_AT_A_SLOPE, low=0.0, accuracy=1e-3) | TORQUES),
        ),
    ),
    "bifurcation_locus": Call(
        gpw.bifurcation_locus,
        dict(
            family=FOLDED,
            at=Later(lambda: FOLDED.value().folds[1]),
            parameter="shank_mass",
            low=1.0,
            high=1.02,
        ),
        dict(
            family=To(Later(family), refused="not 0.0530371: it has none"),
            at=Later(lambda: FOLDED.value().folds[0]),
            parameter=To("shank_length", dict(low=0.44, high=1.03)),
            low=1.005,
            high=1.03,
            resolution=0.005,
        ),
    ),
    "doubling_cascade": Call(
        gpw.doubling_cascade,
        dict(walker="D", low=0.01, high=0.0195, doublings=1),
        dict(
            walker=To("F", dict(low=0.005, high=0.05)),
            low=0.0149,
            high=0.0152,
            parameter=To("hip_torque", refused="slope must be one number"),
            slope=To(
                0.014, dict(walker=Later(lambda: gpw.stride_map("D", 0.0145)), low=0.0) | TORQUES
            ),
            kind=To("short", refused="short-step"),
            doublings=To(2, expect=lambda a, b: len(b.periods) == len(a.periods) + 1),
        ),
    ),
    "find_gait": Call(
        gpw.find_gait,
        dict(walker="D", slope=0.009),
        dict(
            walker="E",
            slope=0.01,
            kind=To("short", expect=lambda a, b: b.kind == "short"),
            period=To(2, dict(slope=0.016), expect=lambda a, b: b.period == 2),
            guess=Later(lambda: 1.001 * gait("D", 0.009).state),
        ),
    ),
    "find_gaits": Call(
        gpw.find_gaits,
        dict(walker="D", slope=0.009),
        dict(
            walker="E",
            slope=0.01,
            period=To(2, dict(slope=0.016)),
            guess=Later(lambda: 1.001 * gait("D", 0.009).state),
        ),
    ),
    "foot_velocity": Call(
        gpw.foot_velocity,
        dict(walker="lab", state=[-0.2, 0.2, 0.2, -1.1, -0.9, -0.9]),  # before heelstrike
        dict(walker="D", state=[-0.3, 0.3, 0.3, -1.1, -0.9, -0.9]),
    ),
    "footholds": Call(
        gpw.footholds,
        dict(heights=[0.0, 0.1], slopes=[0.0, 0.01]),
        dict(heights=[0.0, 0.2], slopes=[0.0, 0.02]),
    ),
    "gait_family": Call(
        gpw.gait_family,
        dict(walker="D", slope_min=0.008, slope_max=0.01),
        dict(
            walker="E",
            slope_min=0.0085,
            slope_max=0.0095,
            kind="short",
            start=Later(lambda: gait("D", 0.0085)),
            resolution=To(0.02, expect=lambda a, b: len(b) > len(a)),
        ),
    ),
    "lab_walker_from_parts": Call(gpw.lab_walker_from_parts, {}, {}),
    "largest_push": Call(
        gpw.largest_push,
        dict(walker="D", slope=0.009, strides=40, accuracy=1e-3),
        dict(
            walker="E",
            slope=0.01,
            gait=Later(lambda: gait("D", 0.009, "short")),
            strides=To(1, expect=lambda a, b: b.forward > a.forward),
            accuracy=0.03,
            tolerance=To(0.1, dict(accuracy=1e-7)),
        ),
    ),
    "load_policy": Call(
        loaded,
        dict(name_or_folder="level-ppo"),
        dict(name_or_folder="lab-ppo", trust=To(True, dict(name_or_folder="own"))),
        of=gpw.load_policy,
    ),
    "lyapunov_exponents": Call(
        gpw.lyapunov_exponents,
        dict(walker="D", values=[0.012, 0.018], strides=20, n_transient=5),
        dict(
            walker="E",
            values=[0.012, 0.017],
            count=To(2, expect=lambda a, b: np.shape(b)[-1] == 2),
            strides=30,
            n_transient=6,
            start=OF_D,
            kind="short",
            tolerance=1e-5,
            parameter=To("hip_mass", OF_LAB),
            slope=To(0.038, OF_LAB | {"parameter": "hip_mass"}),
        ),
    ),
    "measures": Call(
        gpw.measures, dict(gait=Later(gait)), dict(gait=Later(lambda: gait("C", 0.03)))
    ),
    "nearest_gait": Call(
        gpw.nearest_gait,
        dict(walker="lab", slope=0.04),
        dict(
            walker="E",
            slope=To(0.001, expect=lambda a, b: 0.018 < b.slope < 0.02),
            kind=To("short", expect=lambda a, b: b.kind == "short"),
            keep=To("slope", dict(slope=0.1), expect=lambda a, b: b.slope == 0.1 != a.slope),
        ),
    ),
    "optimal_gait": Call(
        gpw.optimal_gait,
        dict(scene=Later(lambda: make_scene("level", tick=2.0)), speed=0.15),
        dict(
            scene=Later(lambda: make_scene("level", tick=1.5)),
            speed=0.16,
            reward=lambda step: step.distance,
            start=Later(lambda: gpw.optimal_gait(make_scene("level", tick=2.0), 0.14)),
            time_limit=To(1e-6, refused="no optimal gait at speed .* was found in 1e-06 s"),
        ),
    ),
    "optimal_gaits": Call(
        gpw.optimal_gaits,
        dict(scene=Later(lambda: make_scene("level", tick=2.0)), speeds=[0.15]),
        dict(scene=Later(lambda: make_scene("level", tick=1.5)), speeds=[0.16]),
    ),
    "optimize_walker": Call(
        gpw.optimize_walker,
        dict(
            walker="C",
            objective="cost_of_transport",
            parameters=["slope"],
            bounds=[(0.02, 0.04)],
            slope=0.03,
        ),
        dict(
            walker="lab",
            objective="step_period",
            parameters=To(["foot_radius"], dict(bounds=[(0.01, 0.3)])),
            bounds=To([(0.025, 0.04)], look=lambda found: found.gait.slope),
            slope=To(0.031, look=lambda found: found.start.slope),
            kind=To("short", look=lambda found: found.start.kind),
            constraints=To({"froude_speed": (0.2, None)}, look=lambda found: found.gait.speed),
            maximize=To(True, expect=lambda a, b: a.gait.slope < 0.021 < 0.039 < b.gait.slope),
            iterations=To(
                1,
                look=lambda found: found.tried,
                expect=lambda before, after: after < before,
                among=dict(
                    walker="lab",
                    slope=0.036,
                    objective="step_period",
                    parameters=["foot_radius", "hip_mass"],
                    bounds=[(0.1, 0.3), (0.0, 0.5)],
                ),
            ),
        ),
    ),
    "parameter_family": Call(
        gpw.parameter_family,
        dict(walker="E", parameter="thigh_length", low=0.49, high=0.51, slope=0.02),
        dict(
            walker="B",
            parameter="shank_length",
            low=0.495,
            high=0.505,
            slope=0.021,
            kind="short",
            resolution=To(0.01, expect=lambda a, b: len(b) > len(a)),
        ),
    ),
    "reality_check": Call(
        gpw.reality_check,
        dict(walker="lab", slope=0.036, state=Later(lambda: gait().state)),
        dict(
            walker="lab-straight",
            slope=0.037,
            state=STATE,
            strides=2,
            friction=To(
                0.01, look=lambda found: found.passed, expect=lambda before, after: after != before
            ),
            hip_torque=0.01,
            tolerance=1e-6,
        ),
    ),
    "robustness": Call(
        gpw.robustness,
        dict(
            controller="D",
            slope=0.009,
            walkers=8,
            strides=20,
            starts=8,
            initial_error=0.1,
            roughness=1e-4,
        ),
        dict(
            controller=replace(D, hip_friction=0.001),
            scene=Later(lambda: make_scene("level", walker="D", tolerance=1e-5)),
            slope=0.01,
            roughness=To(0.004, expect=lambda a, b: b.survivors.sum() < a.survivors.sum()),
            first_passage=To("mesh", dict(roughness=3e-4)),
            walkers=9,
            strides=To(30, expect=lambda a, b: len(b.survivors) == len(a.survivors) + 10),
            initial_error=0.3,
            starts=9,
            seed=To(
                1,
                dict(starts=200, roughness=4e-4, walkers=50),
                expect=lambda a, b: (
                    a.recovered != b.recovered and np.any(a.survivors != b.survivors)
                ),
            ),
        ),
    ),
    "robustness, with a policy": Call(
        gpw.robustness,
        dict(
            controller=Later(lambda: LinearFeedback("steep")),
            scene="steep",
            roughness=1e-3,
            walkers=8,
            strides=20,
            starts=16,
        ),
        dict(
            controller=Later(lambda: LinearFeedback("steep", torque_weight=10.0)),
            scene=Later(lambda: make_scene("steep", max_hip_torque=0.02)),
            slope=0.1101,
            roughness=0.004,
            first_passage="mesh",
            walkers=9,
            strides=30,
            initial_error=0.3,
            starts=40,
            seed=To(
                1,
                dict(starts=200, walkers=50, roughness=4e-3),
                expect=lambda a, b: (
                    a.recovered != b.recovered and np.any(a.survivors != b.survivors)
                ),
            ),
        ),
    ),
    "rough": Call(gpw.rough, dict(height_std=0.02), dict(height_std=0.01, slope_std=0.01)),
    "simulate": Call(
        gpw.simulate,
        dict(walker="D", slope=0.009, state=OF_D, strides=2, samples=5),
        dict(
            walker="E",
            slope=0.01,
            state=Later(lambda: 1.01 * gait("D", 0.009).state),
            strides=3,
            samples=6,
            hip_torque=0.001,
            ankle_torque=0.001,
            push_off=0.001,
            terrain=gpw.rough(0.001),
            terrain_seed=To(1, dict(terrain=gpw.rough(0.001))),
            tolerance=1e-6,
        ),
    ),
    "stairs": Call(gpw.stairs, dict(rise=0.1), dict(rise=0.2)),
    "stride": Call(
        gpw.stride,
        dict(walker="lab", slope=0.036, state=STATE),
        dict(
            walker="lab-straight",
            slope=0.04,
            state=Later(lambda: gait().state),
            hip_torque=0.1,
            ankle_torque=To(0.001, dict(walker="D", slope=0.009, state=OF_D)),
            push_off=0.01,
            height_change=-0.001,
            slope_change=0.001,
            tolerance=1e-5,
            max_stride_time=To(
                0.5,
                expect=lambda a, b: (
                    (a.outcome, b.outcome) == (gpw.Outcome.HEELSTRIKE, gpw.Outcome.STALLED)
                ),
            ),
            end_on_toe_stub=To(
                True,
                dict(state=Later(lambda: gait().state), hip_torque=-0.04 * LAB.units.torque),
                look=lambda found: found.outcome,
            ),
            threads=To(2, same=True),
            backend=lambda *_, **__: None,
        ),
    ),
    "stride_jacobian": Call(
        gpw.stride_jacobian,
        dict(walker="D", slope=0.009, state=OF_D),
        dict(
            walker=replace(D, hip_friction=0.01),
            slope=0.01,
            state=Later(lambda: 1.01 * gait("D", 0.009).state),
            hip_torque=0.001,
            ankle_torque=0.001,
            push_off=0.001,
            wrt="slope",
            tolerance=1e-6,
        ),
    ),
    "stride_map": Call(
        mapped,
        dict(walker="lab", slope=0.036),
        dict(
            walker="C",
            slope=0.03,
            controller=gpw.Actuation(0.1),
            scene=To("lab", dict(walker=None, slope=None, controller="constant")),
            tolerance=1e-6,
            terrain="stairs:rise=-0.001",
        ),
        of=gpw.stride_map,
    ),
    "stride_map, under a policy": Call(
        mapped,
        dict(walker="C", slope=0.0, controller="constant"),
        dict(
            walker=To(replace(C, foot_radius=0.18)),
            slope=0.001,
            controller="optimal",
            scene=Later(lambda: make_scene("level", max_hip_torque=0.01)),
            tolerance=1e-6,
            terrain="stairs:rise=-0.001",
        ),
        of=gpw.stride_map,
    ),
    "tune": Call(gpw.tune, dict(walker="lab"), dict(walker="C")),
    "tune_to_walk": Call(
        gpw.tune_to_walk,
        dict(walker="lab", slope=0.036),
        dict(walker="lab-straight", slope=0.03, radius=0.7),
    ),
    "tuning_errors": Call(gpw.tuning_errors, dict(walker="lab"), dict(walker="lab-straight")),
    "waves": Call(gpw.waves, dict(height=0.1, strides=4), dict(height=0.2, strides=5)),
}


@pytest.mark.parametrize("name, option", cases(OPTIONS))
def test_an_option_of_a_function_is_heard(name, option):
    check(OPTIONS[name], option)


def test_every_option_of_every_public_function_is_tested():
    public = {x for x in gpw.__all__ if inspect.isfunction(getattr(gpw, x))}
    assert not missing(OPTIONS, public - {"sweep"})  # see `tests/sweeps/test_options.py`
