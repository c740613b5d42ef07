"""Each public function rejects invalid input with a message that names the argument.

python -m tests.test_refusals     Write the messages, `tests/refusals.json`, again.
"""

import json
import re
import shutil
from math import inf, nan
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker._tools.arguments import shown
from gym_passive_walker.gaits.control.baselines import Passive
from gym_passive_walker.gaits.scenes.scene import make_scene
from tests.equations.examples import LONG_GAITS

STATE = LONG_GAITS["lab"].state
LONG = "x" * 5000
NO_NUMBERS = ("no", None, [], {}, object(), True, b"x", 1j, [[0.1, 0.2]])
NO_TRUTHS = ("no", None, 0, 1.0, nan, [], object())
NO_COUNTS = (*NO_NUMBERS, nan, inf, -1, 0.5, 10**30, LONG)
NO_TOLERANCES = (*NO_NUMBERS, nan, inf, -1.0, 0.0, 1e-300, 0.5)
NO_ANGLES = (*NO_NUMBERS, nan, inf, -inf, 2.0, -2.0, 1e300)
NO_OBJECTS = ("no", None, 3, nan, [], {}, object(), LONG)
NO_STATES = ("no", 3.0, [], {}, [nan] * 6, [0.1] * 7, object(), LONG)
ON_A_WALK = {"walker": "lab", "slope": 0.036, "state": STATE}
ON_A_GAIT = {"walker": "E", "slope": 0.01}
OVER_SLOPES = {"walker": "E", "slope_min": 0.01, "slope_max": 0.02}
OVER_MASSES = ON_A_GAIT | {"parameter": "hip_mass", "low": 0.0, "high": 1.0}
TO_THE_CRISIS = {"walker": "D", "low": 0.018, "high": 0.02}
OF_A_DESIGN = {
    "walker": "C", "objective": "speed", "parameters": ["hip_mass"], "bounds": [(0.0, 1.0)],
    "slope": 0.03,
}  # fmt: skip
LEGS = {"thigh": [gpw.Part(1.0, 0.1, 0.0, 0.01)], "shank": [gpw.Part(1.0, 0.1, 0.0, 0.01)]}
LEGS |= {"thigh_length": 0.4, "shank_length": 0.4, "foot_radius": 0.1, "knee_angle": 0.0}
PASSIVE = {"policy": Passive(), "scene": "lab"}


def scene(**arguments):
    return make_scene("level", **arguments)


def many(**arguments):
    return gym.make_vec("PassiveWalker-v0", **({"num_envs": 2} | arguments))


A_DIAGRAM = {"walker": "E", "values": 0.01}
OF_WALKERS = [
    (gpw.as_walker, {}), (gpw.tune, {}), (gpw.stride, ON_A_WALK), (gpw.find_gait, ON_A_GAIT),
    (gpw.gait_family, OVER_SLOPES), (gpw.basin_of_attraction, ON_A_GAIT), (gpw.stride_map, {}),
    (gpw.export, {"path": "x.xml"}), (gpw.optimize_walker, OF_A_DESIGN),
]  # fmt: skip
ON_SLOPES = [
    (gpw.simulate, ON_A_WALK), (gpw.find_gait, ON_A_GAIT), (gpw.nearest_gait, ON_A_GAIT),
    (gpw.basin_of_attraction, ON_A_GAIT), (gpw.largest_push, ON_A_GAIT),
    (gpw.tune_to_walk, {"walker": "C"}), (gpw.optimize_walker, OF_A_DESIGN),
]  # fmt: skip
OF_STATES = [gpw.stride, gpw.simulate, gpw.reality_check, gpw.stride_jacobian]


def given(values):
    """Those values that are not None, which is the default."""
    return [x for x in values if x is not None]


REFUSALS = [
    *((function, valid, "walker", NO_OBJECTS) for function, valid in OF_WALKERS),
    *((function, valid, "slope", NO_ANGLES) for function, valid in ON_SLOPES),
    *((function, ON_A_WALK, "state", NO_STATES) for function in OF_STATES),
    *((gpw.stride, ON_A_WALK, name, ("no", nan, inf, {}, object()))
      for name in ("hip_torque", "ankle_torque", "push_off", "height_change")),
    (gpw.stride, ON_A_WALK, "slope", ("no", nan, inf, 2.0, -2.0, object())),
    (gpw.stride_map, {"walker": "C"}, "slope", given(NO_ANGLES)),
    (gpw.stride_map, {"walker": "C"}, "terrain", ("no", 3, {}, object())),
    (gpw.stride_map, {"walker": "C"}, "tolerance", NO_TOLERANCES),
    (gpw.stride_map, {}, "scene", (3, [], object(), LONG)),
    (gpw.find_gaits, ON_A_GAIT, "period", (*NO_COUNTS, 0)),
    (gpw.find_gaits, ON_A_GAIT, "guess", NO_STATES),
    (gpw.basin_of_attraction, ON_A_GAIT, "strides", (*NO_COUNTS, 0)),
    (gpw.bifurcation_diagram, A_DIAGRAM, "n_transient", NO_COUNTS),
    (gpw.bifurcation_diagram, A_DIAGRAM, "longest_period", NO_COUNTS),
    (gpw.bifurcation_diagram, A_DIAGRAM, "tolerance", NO_TOLERANCES),
    (gpw.bifurcation_diagram, A_DIAGRAM, "parameter", NO_OBJECTS),
    (gpw.lyapunov_exponents, A_DIAGRAM, "values", (*NO_ANGLES, -0.1)),
    (gpw.lyapunov_exponents, A_DIAGRAM, "n_transient", NO_COUNTS),
    (gpw.lyapunov_exponents, A_DIAGRAM, "tolerance", NO_TOLERANCES),
    (gpw.doubling_cascade, {"walker": "D", "low": 0.01, "high": 0.02}, "low", NO_ANGLES),
    (gpw.doubling_cascade, {"walker": "D", "low": 0.01, "high": 0.02}, "high", NO_ANGLES),
    (gpw.crisis, TO_THE_CRISIS, "kind", NO_OBJECTS),
    (gpw.footholds, {"heights": [0.0]}, "heights", ("no", nan, inf, {}, object(), [])),
    (gpw.footholds, {"heights": [0.0]}, "slopes", ("no", nan, inf, {}, object(), [4.0])),
    (gpw.rough, {"height_std": 0.01}, "height_std", (*NO_NUMBERS, nan, -1.0)),
    (gpw.stairs, {}, "rise", (*NO_NUMBERS, nan, inf, 1e9)),
    (gpw.compare, {"controller": "lab"}, "timesteps", ("no", [], {}, nan, object())),
    (gpw.compare, {"controller": "lab"}, "softness", ("no", {}, nan, [0.0], object())),
    (gpw.compare, {"controller": "lab"}, "strides", (*NO_COUNTS, 0)),
    (gpw.compare, {"controller": "lab"}, "simulator", ("no", 3, None, [], object())),
    (gpw.evaluate, {"controller": "passive"}, "episodes", (*NO_COUNTS, 0)),
    (gpw.evaluate, {"controller": "passive"}, "seed", (*NO_NUMBERS, nan, -1)),
    (gpw.evaluate, {"controller": "passive"}, "max_episode_steps", given((*NO_COUNTS, 0))),
    (gpw.gauntlet, {"controller": "passive"}, "walkers", (*NO_COUNTS, 0)),
    (gpw.robustness, {"controller": "lab", "slope": 0.036}, "walkers", given((*NO_COUNTS, 0))),
    (gpw.export, {"walker": "lab", "path": "x.xml"}, "timestep", given((*NO_NUMBERS, nan, 0.0))),
    (gpw.export, {"walker": "lab", "path": "x.xml"}, "format", given(NO_OBJECTS)),
    (gpw.optimal_gait, {"scene": "level"}, "reward", ("no", object(), [], 3.0)),
    (gpw.optimal_gait, {"scene": "level", "speed": 0.1}, "time_limit", (*NO_NUMBERS, nan, 0.0)),
    (gpw.assemble, LEGS, "hip_mass", (*NO_NUMBERS, nan, inf, -1.0)),
    (gpw.stride, ON_A_WALK, "end_on_toe_stub", NO_TRUTHS),
    (gpw.stride, ON_A_WALK, "threads", [x for x in (*NO_COUNTS, 0) if x is not None]),
    (gpw.stride, ON_A_WALK, "max_stride_time", (*NO_NUMBERS, nan, inf, 0.0, -1.0)),
    (gpw.stride, ON_A_WALK, "slope_change", ("no", nan, inf, 4.0, -1e300)),
    (gpw.stride, ON_A_WALK, "backend", ("no", None, 3)),
    (gpw.stride, ON_A_WALK, "tolerance", NO_TOLERANCES),
    (gpw.simulate, ON_A_WALK, "strides", (*NO_COUNTS, 0, 10**9)),
    (gpw.simulate, ON_A_WALK, "samples", (*NO_COUNTS, 1, 10**9)),
    (gpw.simulate, ON_A_WALK, "terrain_seed", (*NO_COUNTS, 2**64)),
    (gpw.simulate, ON_A_WALK, "terrain", ("no", 3, {}, object())),
    *((gpw.simulate, ON_A_WALK, name, ("no", {}, nan, inf, [1.0, 2.0], object()))
      for name in ("hip_torque", "ankle_torque", "push_off")),
    (gpw.stride_jacobian, ON_A_WALK, "wrt", (*NO_OBJECTS, nan)),
    (gpw.reality_check, ON_A_WALK, "hip_torque",
     [x for x in (*NO_NUMBERS, nan, [0.1]) if x is not None]),
    (gpw.reality_check, ON_A_WALK, "strides", [x for x in (*NO_COUNTS, 0) if x is not None]),
    (gpw.reality_check, ON_A_WALK, "friction", (*NO_NUMBERS, nan, -0.1)),
    (gpw.find_gait, ON_A_GAIT, "guess", NO_STATES),
    (gpw.find_gait, ON_A_GAIT, "period", (*NO_COUNTS, 0)),
    (gpw.find_gait, ON_A_GAIT, "kind", NO_OBJECTS),
    (gpw.gait_family, OVER_SLOPES, "slope_min", NO_ANGLES),
    (gpw.gait_family, OVER_SLOPES, "slope_max", NO_ANGLES),
    (gpw.gait_family, OVER_SLOPES, "start",
     [x for x in NO_OBJECTS if x is not None]),
    (gpw.gait_family, OVER_SLOPES, "resolution",
     (*NO_NUMBERS, nan, inf, 0.0, 1e-300, -1.0)),
    (gpw.parameter_family, OVER_MASSES,
     "parameter", NO_OBJECTS),
    (gpw.parameter_family, OVER_MASSES,
     "low", (*NO_NUMBERS, nan, inf, -inf)),
    (gpw.parameter_family, OVER_MASSES,
     "high", (*NO_NUMBERS, nan, inf, 1e30)),
    (gpw.parameter_family, OVER_MASSES,
     "resolution", (*NO_NUMBERS, nan, inf, 0.0, 1e-300)),
    (gpw.basin_of_attraction, ON_A_GAIT, "resolution", (*NO_COUNTS, 0, 10**9)),
    (gpw.basin_of_attraction, ON_A_GAIT, "stance_angles", ("no", {}, [], nan, [inf], object())),
    (gpw.basin_of_attraction, ON_A_GAIT, "stance_rates", ("no", {}, [], nan, [inf], object())),
    (gpw.basin_of_attraction, ON_A_GAIT, "ratios", ("no", {}, [], nan, ["a", "b"], [nan, 1.0])),
    (gpw.basin_of_attraction, ON_A_GAIT, "atol", (*NO_NUMBERS, nan, inf, 0.0)),
    (gpw.largest_push, ON_A_GAIT, "gait", [x for x in NO_OBJECTS if x is not None]),
    (gpw.largest_push, ON_A_GAIT, "accuracy", (*NO_NUMBERS, nan, inf, 0.0, 1e-17, -1.0)),
    (gpw.largest_push, ON_A_GAIT, "tolerance", NO_TOLERANCES),
    (gpw.largest_push, ON_A_GAIT, "strides", (*NO_COUNTS, 0)),
    (gpw.bifurcation_diagram, {"walker": "E", "values": 0.01}, "values", (*NO_ANGLES, -0.1)),
    (gpw.bifurcation_diagram, {"walker": "E", "values": 0.01}, "sweep", NO_TRUTHS),
    (gpw.bifurcation_diagram, {"walker": "E", "values": 0.01}, "n_recorded", (*NO_COUNTS, 0,
    10**9)),
    (gpw.bifurcation_diagram, {"walker": "E", "values": 0.01}, "start", (*NO_STATES, [STATE] * 3)),
    (gpw.bifurcation_diagram, {"walker": "E", "values": 0.01, "start": STATE}, "kind", NO_OBJECTS),
    (gpw.lyapunov_exponents, {"walker": "E", "values": 0.01}, "count", (*NO_COUNTS, 0, 9)),
    (gpw.lyapunov_exponents, {"walker": "E", "values": 0.01}, "strides", (*NO_COUNTS, 0)),
    (gpw.crisis, TO_THE_CRISIS, "low", NO_ANGLES),
    (gpw.crisis, TO_THE_CRISIS, "high", NO_ANGLES),
    (gpw.crisis, TO_THE_CRISIS, "tolerance", NO_TOLERANCES),
    (gpw.crisis, TO_THE_CRISIS, "accuracy",
     (*NO_NUMBERS, nan, inf, 0.0, 1e-300)),
    (gpw.crisis, TO_THE_CRISIS, "walkers", (*NO_COUNTS, 10**9)),
    (gpw.crisis, TO_THE_CRISIS, "strides", NO_COUNTS),
    (gpw.doubling_cascade, {"walker": "D", "low": 0.01, "high": 0.02}, "doublings",
     (*NO_COUNTS, 0)),
    (gpw.collision_matrix, {"walker": "lab"}, "stance_angle", (*NO_ANGLES, 5.0)),
    (gpw.foot_velocity, {"walker": "lab"}, "state", (*NO_STATES, None)),
    (gpw.measures, {}, "gait", NO_OBJECTS),
    (gpw.nearest_gait, {"walker": "E", "slope": 0.01}, "keep", ("both", "", 1, [], object())),
    (gpw.tune_to_walk, {"walker": "C", "slope": 0.03}, "radius", (*NO_NUMBERS, nan, inf, 0.0)),
    (gpw.interpolate, {"a": "C", "b": "lab"}, "fraction", (*NO_NUMBERS, nan, inf, -inf)),
    *((gpw.assemble, LEGS, name, (*NO_NUMBERS, nan, inf))
      for name in ("thigh_length", "shank_length", "foot_radius", "knee_angle", "gravity")),
    (gpw.assemble, LEGS, "knees", NO_TRUTHS),
    (gpw.Terrain, {}, "repeats", NO_TRUTHS),
    (gpw.Terrain, {}, "height_std", (*NO_NUMBERS, nan, inf, -1.0, 1e9)),
    (gpw.Terrain, {}, "slope_std", (*NO_NUMBERS, nan, inf, -1.0, 2.0)),
    (gpw.waves, {"height": 0.01, "strides": 5}, "height", (*NO_NUMBERS, nan, inf, 1e9)),
    (gpw.waves, {"height": 0.01, "strides": 5}, "strides", (*NO_COUNTS, 1, 2, 10**9)),
    (gpw.closed_loop_gait, PASSIVE, "policy", NO_OBJECTS),
    (gpw.closed_loop_gait, PASSIVE, "guess", (nan, "no", [nan] * 6, [1.0] * 5, {}, object())),
    (gpw.closed_loop_gait, PASSIVE, "period", (*NO_COUNTS, 0)),
    (gpw.robustness, {"controller": "lab", "slope": 0.036}, "roughness",
     (*NO_NUMBERS, nan, inf, -1.0, 1e9)),
    (gpw.sweep, {"analysis": "gait", "out": "."}, "branch", NO_TRUTHS),
    (gpw.sweep, {"analysis": "gait", "out": "."}, "retry", NO_TRUTHS),
    (gpw.robustness, {"controller": "lab", "slope": 0.036}, "seed",
     (*NO_NUMBERS, nan, inf, -1, 0.5, 2**128)),
    (gpw.robustness, {"controller": "lab", "slope": 0.036}, "strides", (*NO_COUNTS, 10**9)),
    (gpw.robustness, {"controller": "lab", "slope": 0.036}, "starts", (*NO_COUNTS, 1, 10**9)),
    (gpw.robustness, {"controller": "lab", "slope": 0.036}, "initial_error", (*NO_NUMBERS, nan,
    0.0, 1.0)),
    (gpw.optimal_gait, {"scene": "level"}, "speed",
     [x for x in (*NO_NUMBERS, nan, inf, 0.0, 3.0) if x is not None]),
    (gpw.optimal_gait, {"scene": "level", "speed": 0.1}, "start", ("no", 3, [0.1], object())),
    (gpw.optimal_gaits, {"scene": "level"}, "speeds", ("no", 3, {}, [nan], ["a"], None, LONG)),
    (gpw.optimize_walker, OF_A_DESIGN, "objective", NO_OBJECTS),
    (gpw.optimize_walker, OF_A_DESIGN, "parameters", (*NO_OBJECTS, [3], ["no"], "hip_mass")),
    (gpw.optimize_walker, OF_A_DESIGN, "bounds", (*NO_OBJECTS, [3], [(1, 2, 3)])),
    (gpw.optimize_walker, OF_A_DESIGN, "constraints", ("no", 3, [1], {"speed": (1, 2, 3)})),
    (gpw.optimize_walker, OF_A_DESIGN, "maximize", NO_TRUTHS),
    (gpw.optimize_walker, OF_A_DESIGN, "iterations", (*NO_COUNTS, 0)),
    (scene, {}, "action_delay", (*NO_COUNTS, 10**9)),
    (scene, {"terrain": {"stairs": {"rise": 0.0}}}, "terrain_lookahead", (*NO_COUNTS, 10**9)),
    (scene, {}, "actions", ([], {}, 3, ["no"], [["hip"]], ["hip", "hip"])),
    (scene, {}, "start", ("no", 3, [nan] * 6, STATE[:5], {}, LONG)),
    (scene, {}, "end_on_toe_stub", ("no", 0, 1.0, nan, [])),
    (many, {}, "num_envs", (*NO_COUNTS, 0, 10**9)),
    (many, {}, "render_mode", ("no", 3, nan, [], {}, object(), LONG)),
]  # fmt: skip


CASES = {f"{row[0].__name__} {row[2]}": row for row in REFUSALS}
assert len(CASES) == len(REFUSALS)
SENTENCES = Path(__file__).with_name("refusals.json")


def sentences(function, valid, name, values):
    """The different messages that refuse values of an argument, with ... for the value."""
    found = {}
    for value in values:
        with pytest.raises(ValueError, match=rf"\b{name}\b") as refused:
            function(**{**valid, name: value})
        said = str(refused.value)
        assert len(said) < 1000, value
        for word in ("no", "not"):
            said = said.replace(f"{word} {shown(value)}", f"{word} ...")
        found[re.sub("0x[0-9a-f]+", "0x...", said)] = None
    return [*found]


@pytest.mark.parametrize("case", CASES)
def test_nonsense_is_refused_by_the_name_of_its_argument(case):
    known = json.loads(SENTENCES.read_text("utf-8"))
    assert sentences(*CASES[case]) == known[case], "run python -m tests.test_refusals if meant"


@pytest.mark.parametrize("seed", [-1, 0.5, "no", nan, [], b"x"], ids=repr)
@pytest.mark.parametrize("make", [lambda: gym.make("PassiveWalker-v0"), many], ids=["one", "two"])
def test_a_seed_is_a_whole_number(make, seed):
    with pytest.raises(ValueError, match="seed"):
        make().reset(seed=seed)


@pytest.mark.parametrize(
    "look",
    [
        lambda name: gpw.tune(name),
        lambda name: gpw.load_policy(name),
        lambda name: make_scene(name),
        lambda name: gpw.Walker(**{name: 1.0}),
        lambda name: make_scene("level", terrain={name: {}}),
    ],
)
def test_a_name_of_5000_characters_is_no_name(look):
    with pytest.raises(ValueError, match=r"^no |has no ") as refused:
        look(LONG)
    assert len(str(refused.value)) < 1000


@pytest.fixture
def copy(tmp_path):
    folder = tmp_path / "policy"
    shutil.copytree(gpw.envs.policies.policy_folder("level-ppo"), folder)
    return folder


@pytest.mark.parametrize(
    "changes",
    [
        {"algo": ["ppo"]},
        {"activation": {}},
        {"normalizer": [1]},
        {"normalizer": {"epsilon": "no", "clip": 10.0}},
        {"normalizer": {"epsilon": 1e-8, "clip": nan}},
        {"scene": [["level"]]},
        {"env": ["walker"]},
        {"env": {"walker": {"preset": {"preset": "lab"}}}},
        {"env": {"slope": {"slope": 0.1}}},
        {"trained": "yes"},
    ],
    ids=json.dumps,
)
def test_a_policys_description_of_another_shape_is_refused(changes, copy):
    path = copy / "policy.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps(content | changes), encoding="utf-8")
    with pytest.raises(gpw.PolicyError, match=re.escape(str(copy))):
        gpw.load_policy(copy)


def test_a_policys_description_that_nests_without_end_is_refused(copy):
    (copy / "policy.json").write_text("[" * 100_000, encoding="utf-8")
    with pytest.raises(gpw.PolicyError, match="damaged"):
        gpw.load_policy(copy)


@pytest.mark.parametrize("number", [nan, inf])
def test_a_policy_with_weights_that_are_no_numbers_is_refused(number, copy):
    path = copy / "policy.safetensors"
    written = bytearray(path.read_bytes())
    written[-4:] = np.float32(number).tobytes()
    path.write_bytes(written)
    with pytest.raises(gpw.PolicyError, match="must be finite numbers"):
        gpw.load_policy(copy)


if __name__ == "__main__":
    said = {case: sentences(*row) for case, row in CASES.items()}
    SENTENCES.write_text(json.dumps(said, indent=1, ensure_ascii=False) + "\n", "utf-8")
