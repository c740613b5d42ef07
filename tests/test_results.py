"""Results are those that they were, and take no more work: in `tests/results.json`.

python -m tests.test_results     Write the file again, for results that were meant to change.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import asdict
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import gymnasium
import numpy as np
import pytest

import gym_passive_walker as gpw
from agents.config import ALGORITHMS, configure
from examples.driven_torso import DRIVEN_TORSO
from examples.five_links import FIVE_LINKS
from examples.rimless_wheel import RIMLESS_WHEEL
from examples.torso import TORSO
from gym_passive_walker.envs.policies import shipped_policies
from gym_passive_walker.envs.registration import MUJOCO_ID
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.control.baselines import LinearFeedback, Optimal
from gym_passive_walker.gaits.scenes.scene import SCENES, make_scene
from gym_passive_walker.pictures.ground import ground_under
from tests.numbers import compare, numbers_in, work

KEPT = Path(__file__).with_name("results.json")
SLOPES = {"A": 0.03, "B": 0.03, "C": 0.02, "D": 0.009, "E": 0.009, "F": 0.009}


def walked(name: str, **changes: Any) -> dict[str, Any]:
    """Sums over some steps of a scene, with actions, ends and further episodes."""
    envs = PassiveWalkerVectorEnv(6, make_scene(name, **changes), autoreset_mode="SameStep")
    seen, infos = [envs.reset(seed=3)[0]], []
    rng, rewards, ends = np.random.default_rng(0), [], []
    for _ in range(60):
        actions = rng.uniform(-0.6, 0.8, envs.action_space.shape)
        observation, reward, terminated, truncated, info = envs.step(actions)
        seen.append(observation), rewards.append(reward), ends.append(terminated | truncated)
        infos += [np.asarray(x, float).ravel() for x in info.values() if np.ndim(x) == 1
                  and np.asarray(x).dtype.kind in "bif"]  # fmt: skip
    return {"seen": np.array(seen), "rewards": np.array(rewards), "ends": np.array(ends, float),
            "infos": np.concatenate(infos)}  # fmt: skip


def torus_family() -> gpw.GaitFamily:
    """A branch of gaits with a Neimark-Sacker bifurcation."""
    return gpw.parameter_family(DRIVEN_TORSO, "damping", 2e-4, 0.03, slope=0.03)


def on_waves() -> Any:
    """A stride map over three footholds."""
    return gpw.stride_map("lab", 0.036, terrain=gpw.waves(0.001, 3))


def lean(observation: np.ndarray) -> np.ndarray:
    """A torque as a function of the stance angle."""
    return 0.1 * observation[:, :1]


def policy(name: str) -> gpw.Gait:
    loaded = gpw.load_policy(name)
    return gpw.closed_loop_gait(loaded, loaded.scene)


def held(scene: Any, **given: Any) -> dict[str, Any]:
    feedback = LinearFeedback(scene, **given)
    return {
        "gait": feedback.gait.state,
        "closed": feedback.closed_loop,
        "rows": feedback.rows,
        "actions": feedback.actions,
        "robust": gpw.robustness(feedback, walkers=8, strides=8),
    }


def gauntlet_of(name: str) -> dict[str, Any]:
    found = gpw.gauntlet(name, walkers=4)
    numbers = {key: np.asarray(x, float) for key, x in found.columns().items()
               if np.asarray(x).dtype.kind in "bif"}  # fmt: skip
    return numbers | {"score": found.score}


def differentiated(scene: Any, actions: int, sees: int) -> dict[str, Any]:
    """Returns of walks on tensors, and their gradient by a policy's weights."""
    torch = pytest.importorskip("torch")
    from gym_passive_walker.torch import rollout

    torch.manual_seed(0)
    policy = torch.nn.Linear(sees, actions).double()
    with torch.no_grad():
        policy.weight *= 0.2
    walks = rollout(policy, make_scene(scene, reset_noise_scale=0.02), 60, count=5, seed=1)
    walks.returns.sum().backward()
    return {"walks": walks, "by": policy.weight.grad}


def configured() -> dict[str, Any]:
    """The numbers of all presets."""

    def numbers(given: Any, name: str) -> Any:
        if isinstance(given, dict):
            for key, value in given.items():
                yield from numbers(value, f"{name}.{key}")
        elif isinstance(given, int | float):
            yield name, float(given)

    presets = {f"{a} {s}": asdict(configure(a, s)) for a in ALGORITHMS for s in ("level", "steep")}
    return dict(numbers(presets, ""))


def at_speed(scene: Any, speed: float) -> dict[str, Any]:
    found = gpw.optimal_gait(scene, speed)
    return {"cost": found.motor_cost, "period": found.dimensionless.step_period,
            "speed": found.froude_speed}  # fmt: skip


def taken(controller: str, **given: Any) -> dict[str, Any]:
    """A stride under a policy from beside its gait, and derivatives on the gait."""
    strides = gpw.stride_map(controller=controller, **given)
    point = strides.apply(strides.beginning(strides.slope), strides=100).ends
    _, change = strides.linearize(point, by=("state", "slope", "foot_radius"))
    return {"stride": strides.apply(1.01 * point), "change": change}


def printed(scene: Any) -> str:
    """The explanation of a scene."""
    with redirect_stdout(StringIO()) as words:
        gpw.explain(scene)
    return words.getvalue()


def exported(model: Any, ending: str, **given: Any) -> str:
    """The words of the file of a model in the format of a simulator."""
    with TemporaryDirectory() as folder:
        path = Path(folder, f"model.{ending}")
        gpw.export(model() if callable(model) else model, path, **given)
        return " ".join(path.read_text("utf-8").split())


def in_mujoco(**given: Any) -> dict[str, Any]:
    """Steps of an environment of MuJoCo."""
    pytest.importorskip("mujoco")
    env = gymnasium.make(MUJOCO_ID, timestep=2e-3, **given)
    seen, rewards, infos = [env.reset(seed=3)[0]], [], []
    for action in np.random.default_rng(0).uniform(-0.6, 0.8, (80, 1)):
        observation, reward, ended, _, info = env.step(action)
        seen.append(observation), rewards.append(reward)
        infos.append([float(x) for x in info.values() if not isinstance(x, str)])
        if ended:
            break
    return {"seen": np.array(seen), "rewards": np.array(rewards), "infos": np.array(infos)}


def compared(controller: Any, **given: Any) -> gpw.Comparison:
    """Walks in MuJoCo beside the exact ones."""
    pytest.importorskip("mujoco")
    return gpw.compare(controller, timesteps=[4e-3, 2e-3], strides=4, **given)


def disturbed(walker: Any, slope: float) -> gpw.Stride:
    """A stride under all motors that a walker may have, on ground that changes."""
    body = gpw.as_walker(walker)
    units, point = body.units, body.foot_radius == 0.0
    return gpw.stride(
        walker, slope, gpw.find_gait(walker, slope).state, hip_torque=0.005 * units.torque,
        ankle_torque=-0.002 * units.torque * point, push_off=0.02 * units.impulse,
        height_change=0.001 * units.length, slope_change=0.002,
    )  # fmt: skip


RESULTS: dict[str, Callable[[], Any]] = {
    **{f"gaits of {w}": lambda w=w, s=s: gpw.find_gaits(w, s) for w, s in SLOPES.items()},
    "gaits of period 2": lambda: gpw.find_gaits("D", 0.0165, period=2),
    "gaits of period 3": lambda: gpw.find_gaits("D", 0.0125, period=3),
    "gaits uphill": lambda: gpw.find_gaits(
        gpw.stride_map("E", -0.01, controller=gpw.Actuation(push_off=0.15, hip_torque=0.1))
    ),
    **{f"gaits of {x.name}": lambda x=x: gpw.find_gaits(x, 0.03, guess=x.start)
       for x in (TORSO, FIVE_LINKS, DRIVEN_TORSO)},
    "gait of rimless wheel": lambda: gpw.find_gait(RIMLESS_WHEEL, 0.08),
    "family of the torso": lambda: gpw.gait_family(TORSO, 0.02, 0.04),
    **{f"{what} on waves": lambda do=do: do(on_waves()) for what, do in {
        "gaits": gpw.find_gaits,
        "stride": lambda waves: waves.stride(gpw.find_gait("lab", 0.036).state),
        "strides": lambda waves: gpw.simulate(waves, strides=4, samples=5),
        "Jacobian": lambda waves: gpw.stride_jacobian(gpw.find_gait(waves), wrt=("state", "slope")),
        "family": lambda waves: gpw.gait_family(waves, 0.035, 0.037),
    }.items()},
    "family of lab": lambda: gpw.gait_family("lab", 0.005, 0.1),
    "family of D": lambda: gpw.gait_family("D", 0.001, 0.0175),
    "short family of D": lambda: gpw.gait_family("D", 0.001, 0.02, kind="short"),
    "family in a mass": lambda: gpw.parameter_family("lab", "shank_mass", 0.6, 1.4, slope=0.036),
    "locus of folds": lambda: gpw.bifurcation_locus(
        lab := gpw.gait_family("lab", 0.003, 0.15), lab.folds[1], "shank_length", 0.3, 0.6
    ),
    "locus of doublings": lambda: gpw.bifurcation_locus(
        lab := gpw.gait_family("lab", 0.003, 0.15), lab.period_doublings[1], "foot_radius",
        0.15, 0.25,
    ),
    "locus of pairs": lambda: gpw.bifurcation_locus(
        torus := torus_family(), torus.neimark_sackers[0], "slope", 0.02, 0.05
    ),
    "family with a torus": torus_family,
    "family over stairs": lambda: gpw.parameter_family(
        lambda rise: gpw.stride_map("lab", 0.036, terrain=gpw.stairs(-rise)), "rise", 0.001, 0.004
    ),
    "sweep of a diagram": lambda: gpw.bifurcation_diagram(
        "D", [0.012, 0.016, 0.017], n_transient=50, sweep=True
    ),
    "doublings": lambda: gpw.doubling_cascade("D", 0.01, 0.02, doublings=3),
    "crisis": lambda: gpw.crisis(
        "D", 0.017, 0.022, strides=200, walkers=16, accuracy=1e-5
    ),
    "exponents": lambda: gpw.lyapunov_exponents("D", [0.009, 0.0165], strides=100),
    "diagram": lambda: gpw.bifurcation_diagram("D", [0.014, 0.0165], n_transient=300),
    "basin": lambda: gpw.basin_of_attraction("D", 0.009, resolution=24),
    "push": lambda: gpw.largest_push("lab", 0.036),
    "first passage": lambda: gpw.robustness(gpw.find_gait("D", 0.009), walkers=64, starts=8),
    "sensitivities": lambda: gpw.stride_jacobian(
        "lab", 0.036, wrt=("state", "slope", "hip_torque", "shank_mass", "foot_radius", "gravity")
    ),
    "Jacobian of E": lambda: gpw.stride_jacobian(
        "E", 0.009, wrt=("state", "ankle_torque", "push_off")
    ),
    "check": lambda: gpw.reality_check("lab", 0.036),
    "walk": lambda: gpw.simulate("C", 0.02, strides=3, samples=30),
    "rough walk": lambda: gpw.simulate("lab", 0.036, strides=5, terrain=gpw.rough(0.002)),
    "ground under a rough walk": lambda: ground_under(
        gpw.simulate("lab", 0.036, strides=3, terrain=gpw.rough(0.002, 0.01)), 3.0
    ),
    "stairs": lambda: gpw.simulate("lab", 0.036, strides=4, terrain=gpw.stairs(0.001)),
    "waves": lambda: gpw.simulate("lab", 0.036, strides=4, terrain=gpw.waves(0.002, 3)),
    "collisions": lambda: gpw.collision_matrix("lab", 0.036),
    "tuned": lambda: gpw.tuning_errors(gpw.tune("lab")),
    "between": lambda: gpw.tuning_errors(gpw.interpolate("C", "lab", 0.3)),
    "optimum": lambda: at_speed("level", 0.1),
    "optimum with push-off": lambda: at_speed("push-off", 0.12),
    "optimum uphill": lambda: at_speed(make_scene("steep", slope=-0.005), 0.1),
    **{f"policy {name}": lambda name=name: policy(name) for name in shipped_policies()
       if name != "anywhere-ppo"},
    **{f"scene {name}": lambda name=name: walked(name) for name in SCENES},
    **{f"level, {name}": lambda name=name, x=x: walked("level", **{name: x}) for name, x in {
        "slope": (0.0, 0.03), "control": "stride", "tick": 0.17, "actions": ("push_off", "hip"),
        "max_hip_torque": 0.07, "energy_weight": 3.0, "energy": "net", "end_on_toe_stub": False,
        "reset_noise_scale": 0.03, "domain_randomization": {"shank_mass": 0.1}, "tolerance": 1e-6,
        "observe_body": ("foot_radius",), "max_stride_time": 2.0,
        "observation_noise": 0.02, "action_noise": 0.1, "action_delay": 3, "command": 0.15,
        "command_weight": 3.0, "terrain": gpw.rough(0.001, 0.002),
        "pushes": {"rate": 1.0, "impulse": 0.01}, "reward": {"distance": 2.0, "alive": 0.1},
        "constraints": {"friction": "end", "scuffing": "report"}, "reward_terms": True,
    }.items()},
    **{f"feedback, {name}": lambda x=x: held(**x) for name, x in {
        "level": {"scene": "level"}, "deadbeat": {"scene": "steep", "method": "deadbeat"},
        "two": {"scene": "level", "pieces": 2},
        "two, deadbeat": {"scene": "level", "method": "deadbeat", "pieces": 2},
        "weight": {"scene": "lab", "torque_weight": 3.0},
    }.items()},
    **{f"{w} under a function": lambda w=w: gpw.find_gait(gpw.stride_map(
        controller=lean, scene={"walker": w, "slope": 0.02}
    )) for w in ("A", "D", "E")},
    "optimal feedback": lambda: gpw.closed_loop_gait(Optimal("level"), "level"),
    "gauntlet": lambda: gauntlet_of("level-ppo"),
    "robustness of a policy": lambda: gpw.robustness("push-off-ppo", walkers=8, strides=10),
    "rollout": lambda: differentiated("level", 1, 8),
    "rollout with push-off": lambda: differentiated("push-off", 1, 8),
    **{f"stride of {w} under motors": lambda w=w, s=s: disturbed(w, s)
       for w, s in {**SLOPES, "lab": 0.036, "lab-straight": 0.05}.items()},
    **{f"stride under {name}": lambda name=name: taken(name)
       for name in ("level-ppo", "push-off-ppo", "rough-ppo")},
    "family under torques": lambda: gpw.gait_family(
        gpw.stride_map("C", 0.0, controller=gpw.Actuation(hip_torque=0.05)), -0.05, 0.01
    ),
    "diagram under a policy": lambda: gpw.bifurcation_diagram(
        gpw.stride_map(controller="steep-ppo"), [0.0, 0.001], n_transient=40
    ),
    "exponents of lab": lambda: gpw.lyapunov_exponents("lab", [0.036], count=3, strides=50),
    "basin of lab": lambda: gpw.basin_of_attraction("lab", 0.036, resolution=12),
    "measures": lambda: gpw.measures(gpw.find_gait("lab", 0.036)),
    "nearest gaits": lambda: [
        gpw.nearest_gait("lab", 0.2, keep=keep) for keep in ("slope", "walker")
    ],
    "foot": lambda: gpw.foot_velocity(gpw.find_gait("lab", 0.036)),
    "design": lambda: gpw.optimize_walker(
        "lab", "cost_of_transport", ("thigh_com", "shank_com"), [(0.08, 0.13), (0.1, 0.25)],
        slope=0.036, constraints={"spectral_radius": (None, 0.8)}, iterations=20,
    ),
    "evaluation": lambda: gpw.evaluate("lab-ppo", episodes=3, max_episode_steps=400),
    **{f"explanation of {name}": lambda name=name: printed(name) for name in SCENES},
    **{f"file of {name}, {ending}": lambda x=x, ending=ending, given=given: exported(
        x, ending, **given
    ) for name, x, given in (
        ("lab", "lab", {"slope": 0.036}), ("E", "E", {}),
        ("torso", TORSO, {"unit_length": 0.8, "unit_mass": 32.0}),
        ("five links", FIVE_LINKS, {"unit_length": 0.8, "unit_mass": 32.0}),
        ("a gait", lambda: gpw.find_gait("lab", 0.036), {}),
        ("a gait of a system", lambda: gpw.find_gait(TORSO, 0.03),
         {"unit_length": 0.8, "unit_mass": 32.0}),
        ("held knees and springs", lambda: gpw.WALKERS["lab"].with_parameters(
            hip_mass=1.5, hip_stiffness=0.5, hip_friction=0.01, knee_stiffness=0.3, knees="held"
        ), {}),
    ) for ending in ("xml", "urdf", "sdf")},
    "comparison with MuJoCo": lambda: compared(gpw.find_gait("lab", 0.036)),
    "comparison of a policy with MuJoCo": lambda: compared("level-ppo"),
    **{f"{name} in MuJoCo": lambda given=given: in_mujoco(**given) for name, given in {
        "level": {}, "steep": {"scene": "steep"}, "straight legs": {"walker": "A", "slope": 0.02},
    }.items()},
    "presets": configured,
    "level, a pool of walkers": lambda: walked(
        "level", domain_randomization={"shank_mass": 0.1}, randomization_pool=2
    ),
    "scene with everything": lambda: walked(
        "level", slope=(-0.01, 0.02), pushes={"rate": 0.5, "impulse": (-0.02, 0.02)},
        observation_noise=0.01, action_noise=0.02, action_delay=1, command=(0.1, 0.2),
        terrain=gpw.rough(0.001), terrain_lookahead=2, actions=("hip", "push_off"),
        constraints=dict.fromkeys(("contact", "friction", "scuffing"), "report"),
        domain_randomization={"thigh_mass": 0.02}, energy="positive",
    ),
}  # fmt: skip


def found(name: str) -> dict[str, str]:
    """The numbers of a result, and the work for it."""
    with work() as counts:
        result = RESULTS[name]()
    fields = result if isinstance(result, dict) else {"": result}
    ours = type(result).__module__.startswith("gym_passive_walker")
    if ours and type(result).__str__ is not object.__str__:
        fields = {**fields, "text": str(result)}
    if "seen" in fields or "robust" in fields or isinstance(result, gpw.Robustness):
        counts = {}  # gaits from which an environment starts are kept from one to the next
    return counts | dict(x for key, value in fields.items() for x in numbers_in(value, key))


def test_the_file_holds_these_results_and_no_others() -> None:
    assert json.loads(KEPT.read_text("utf-8")).keys() == RESULTS.keys()


@pytest.mark.parametrize("name", RESULTS)
def test_a_result_is_what_it_was_for_no_more_work(name: str) -> None:
    compare(json.loads(KEPT.read_text("utf-8"))[name], found(name))


if __name__ == "__main__":
    kept = {name: found(name) for name in RESULTS}
    KEPT.write_text(json.dumps(kept, indent=0, ensure_ascii=False) + "\n", "utf-8")
