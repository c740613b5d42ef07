"""Arguments of constructors and methods have an effect: walkers, ground, policies."""

from __future__ import annotations

import importlib
import inspect
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import gym_passive_walker as gpw
from agents.benchmark import rough_strides
from examples.torso import TORSO
from examples.unequal_legs import UNEQUAL_LEGS
from gym_passive_walker._tools.shown import DRAWERS
from gym_passive_walker._tools.shown import picture as pictures
from gym_passive_walker.apps.sweeps.tasks import ANALYSES
from gym_passive_walker.engine.own.mechanics import Motion
from gym_passive_walker.gaits.control import baselines
from gym_passive_walker.gaits.control.feedback import gains
from gym_passive_walker.gaits.control.ticks import ticked_stride
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.gaits.section import Section
from gym_passive_walker.models.equations import hybrid
from gym_passive_walker.models.walkers import name_of
from gym_passive_walker.pictures.axes import OWN
from gym_passive_walker.pictures.portrait import phase_portrait
from gym_passive_walker.pictures.strobe import strobe
from tests.options.effects import Call, Later, To, cases, check, missing
from tests.own import statements
from tests.own.statements import COMPASS, DRIVEN

RESULTS = set(
    "Basin BifurcationDiagram BifurcationLocus Cascade Comparison Design Evaluation FootVelocity "
    "Gait GaitFamily Gauntlet GaitNotFound Impulse OptimalGait Outcome PolicyError RealityCheck "
    "Robustness StatementError Stride SweepResult TrainedPolicy Trajectory Transition TuningErrors "
    "TimedExtremum VelocityPerturbations WalkerError".split()
)
"""Classes of results, which users do not construct; the tests of functions cover their content."""

D, E = gpw.WALKERS["D"], gpw.WALKERS["E"]


@cache
def gait(walker="D", slope=0.009, **options):
    return gpw.find_gait(walker, slope, **options)


@cache
def closed():
    return gpw.closed_loop_gait(baselines.LinearFeedback("steep"), "steep")


def compared():
    """A comparison of two strides."""
    pytest.importorskip("mujoco")
    return gpw.compare("passive", {"walker": "lab", "slope": 0.036}, timesteps=[8e-3], strides=2)


def refused(function):
    """A function that returns the message with which another one refuses its arguments."""

    def message(**arguments):
        with pytest.raises(ValueError) as error:
            function(**arguments)
        return str(error.value)

    return message


def walks(**parameters):
    """The stride of a walker with these parameters."""
    return gpw.stride(gpw.Walker(**parameters), 0.03, [0.3, -0.3, -0.4, -1.3, -0.6, -0.3])


def drives(**parameters):
    drive = gpw.Actuation(**parameters)
    return gpw.stride("D", 0.009, gait().state, **drive._asdict())


def stands(**parameters):
    """The ground of some walks."""
    return gpw.Terrain(**parameters).ground(7, np.arange(6))


def weighs(**parameters):
    one, other = gpw.Part(**parameters), gpw.Part(mass=1.0, com=0.3)
    sizes = dict(thigh_length=0.5, shank_length=0.5, foot_radius=0.1, knee_angle=0.0)
    return gpw.assemble([one, other], [one], **sizes)


def exported(path):
    """The files that an export writes."""
    pytest.importorskip("onnx")
    with TemporaryDirectory() as folder:
        gpw.load_policy("level-ppo").to_onnx(Path(folder) / path)
        return [each.name for each in Path(folder).iterdir()]


def acts(policy):
    """Actions of a policy after two heelstrikes and in between."""
    seen = np.array(
        [
            [0.1946, -0.1946, -0.1946, -0.203, -0.1878, -0.1878, 1.0, 0.0],
            [0.0, 0.1, 0.1, -0.2, -0.3, -0.3, 1.0, 0.02],
        ]
    )
    first, memory = policy.predict(seen[0])
    return first, policy.predict(seen[1], memory)[0]


MOTORS = {"actions": ("hip", "push_off"), "max_push_off": 0.1}
"""A scene with two actions."""


def made(of):
    return lambda **arguments: acts(of(**arguments))


def stated(**statement):
    """Results of a system: a stride, a fall, forces of controls, a guess for searches."""
    system = gpw.System(**statement)
    body, state = system.body, system.State(*COMPASS.start)
    still = system.hybrid.phases[0].accelerations
    walks = gpw.stride(system, 0.03, [COMPASS.start, (0.24, -0.24, -1.6, -0.17)])
    pushed = still(body, state, system.Control(1.0), hybrid.Ground(0.0, 1.0))
    largest = make_scene(system=system).largest(system.controls[0])
    shown = system.drawn(COMPASS.start)
    return system.name, system.State, system.Control, system.start, pushed, walks, largest, shown


LAB = dict(
    thigh_length=0.35, thigh_offset=0.0, thigh_mass=2.3, thigh_gyration=0.1, thigh_com=0.1,
    shank_length=0.46, shank_offset=0.02, shank_mass=1.0, shank_gyration=0.15, shank_com=0.24,
    foot_radius=0.2, foot_angle=0.2,
)  # fmt: skip
OTHER = dict(
    thigh_length=0.4, thigh_offset=0.01, thigh_mass=2.4, thigh_gyration=0.12, thigh_com=0.12,
    shank_length=0.5, shank_offset=0.03, shank_mass=1.1, shank_gyration=0.16, shank_com=0.25,
    foot_radius=0.1, foot_angle=0.1, hip_mass=0.5, hip_stiffness=0.5, hip_friction=0.01,
    knee_stiffness=0.1, knees=False, gravity=1.6,
)  # fmt: skip
TICKS = dict(
    walker=D,
    slope=0.009,
    point=Later(lambda: Section(walker=D).points_at(gait().state)[0]),
    torques=np.zeros(3),
    tick=1.0,
)

OPTIONS = {
    "GaitFamily.at": Call(
        lambda value: gpw.gait_family("D", 0.005, 0.01).at(value)[0].stance_angle,
        dict(value=0.006),
        dict(value=0.007),
        of=gpw.GaitFamily.at,
    ),
    "Trajectory.within": Call(
        lambda times: gpw.simulate("D", 0.009, gait().state).within(times).states,
        dict(times=np.array([[0.5]])),
        dict(times=np.array([[0.6]])),
        of=gpw.Trajectory.within,
    ),
    "Walker.titled": Call(
        lambda title: name_of(gpw.WALKERS["lab"].titled(title)),
        dict(title="mine"),
        dict(title="theirs"),
        of=gpw.Walker.titled,
    ),
    "Link": Call(
        lambda **parts: [part[1:3] for part in Motion([gpw.Link(**parts)], (0.1, 0.2)).parts],
        dict(mass=1.0, x=0.5, y=0.5, inertia=0.1, angle=0.2),
        dict(mass=2.0, x=0.6, y=0.6, inertia=0.2, angle=0.3),
        besides={"_cls": "the class itself"},
        of=gpw.Link.__new__,
    ),
    **{
        f"{name}.equations": Call(
            lambda using, of=of: of.equations(using).name,
            {"using": ()},
            {"using": ("height_change",)},
            of=type(of).equations,
        )
        for name, of in {"System": COMPASS, "Walker": gpw.WALKERS["lab"]}.items()
    },
    **{
        f"{kind.__name__}.{method}": Call(getattr(of, method), {}, {}, of=getattr(kind, method))
        for kind, of in ((gpw.System, COMPASS), (gpw.Walker, gpw.WALKERS["lab"]))
        for method in ("constants", "mass_with", "units_with", "with_parameters")
    },
    "Walker.with_body": Call(
        gpw.WALKERS["lab"].with_body, {"values": {"hip_mass": 0.6}}, {"values": {"hip_mass": 0.7}}
    ),
    **{
        f"{kind.__name__}.checked_state": Call(
            refused(of.checked_state),
            {"state": [2.0, *[0.0] * (of.size - 1)], "name": "state"},
            {"state": [3.0, *[0.0] * (of.size - 1)], "name": "start"},
            of=kind.checked_state,
        )
        for kind, of in ((gpw.System, COMPASS), (gpw.Walker, gpw.WALKERS["lab"]))
    },
    **{
        f"{kind.__name__}.check_values": Call(
            refused(of.check_values),
            {"names": (names[0],), "values": np.array([[-1.0]])},
            {"names": (names[1],), "values": np.array([[-2.0]])},
            of=kind.check_values,
        )
        for kind, of, names in (
            (gpw.System, COMPASS, ("hip", "leg")),
            (gpw.Walker, gpw.WALKERS["lab"], ("hip_mass", "thigh_mass")),
        )
    },
    **{
        f"{kind.__name__}.{method}": Call(
            getattr(of, method), first, other, of=getattr(kind, method)
        )
        for kind, of in ((gpw.System, UNEQUAL_LEGS), (gpw.Walker, gpw.WALKERS["lab"]))
        for method, first, other in (
            ("swap", {"constants": np.arange(7.0)}, {"constants": np.arange(1.0, 8.0)}),
            ("counterpart", {"parameter": "stance_mass"}, {"parameter": "stance_length"}),
        )
    },
    "System.in_stride": Call(
        lambda number: UNEQUAL_LEGS.vary(swing_mass=6.0).in_stride(number).body,
        {"number": 0},
        {"number": 1},
        of=gpw.System.in_stride,
    ),
    "Walker.in_stride": Call(
        gpw.WALKERS["lab"].in_stride,
        {"number": 0},
        {"number": To(1, same=True)},
    ),
    "System.vary": Call(COMPASS.vary, {}, {}, of=gpw.System.vary),
    "System.with_body": Call(COMPASS.with_body, {"values": {"hip": 0.6}}, {"values": {"hip": 0.7}}),
    **{
        f"System.{method}": Call(
            getattr(COMPASS, method), {"state": COMPASS.start}, {"state": (0.3, -0.1, 0.0, 0.0)}
        )
        for method in ("centre_of_mass", "drawn")
    },
    "System.lines": Call(
        TORSO.lines,
        {"body": TORSO.body, "state": TORSO.State(*TORSO.start)},
        {"body": TORSO.body._replace(height=0.9), "state": TORSO.State(0.3, -0.1, *[0.0] * 4)},
    ),
    **{
        f"System.{method}": Call(
            getattr(COMPASS, method),
            {"coordinates": np.array([[0.3, -0.25]])},
            {"coordinates": np.array([[0.2, -0.25]])},
        )
        for method in ("with_both_feet_down", "exchanged")
    },
    "System.struck": Call(
        COMPASS.struck,
        {"states": np.array([[-0.3, 0.3, -1.0, -0.2]])},
        {"states": np.array([[-0.3, 0.3, -1.0, -0.1]])},
    ),
    "System.standing": Call(
        COMPASS.standing, {"state": COMPASS.start}, {"state": (-1.6, 0.0, 0.0, 0.0)}
    ),
    "System": Call(
        stated,
        {each.name: getattr(DRIVEN, each.name) for each in fields(DRIVEN) if each.init},
        dict(
            name="another",
            body=DRIVEN.body._replace(hip=0.5),
            State=statements.Renamed,
            links=lambda b, s: statements.links(b._replace(leg=2.0 * b.leg), s),
            landing=lambda b, s: (0.01 + DRIVEN.landing(b, s)[0], DRIVEN.landing(b, s)[1]),
            relabel=lambda b, s: (s.swing + 2.0 * np.pi, s.stance),
            falls={"fell_forward": lambda b, s: s.stance + 1.0},
            counts=(),
            potential=lambda b, s: 0.1 * (s.swing - s.stance) ** 2,
            dissipation=lambda b, s: 0.1 * (s.swing_rate - s.stance_rate) ** 2,
            forces=lambda b, s: (0.01, 0.0),
            Control=statements.Motor,
            travel=lambda s: statements.Hip(2.0 * (s.swing - s.stance)),
            start=(0.25, -0.25, -0.3, -0.2),
            limits={"hip": 0.2},
            pose=lambda b, s: [[(0.0, 0.0), (-s.stance, 1.0)]],
        ),
        besides={
            name: "of given equations alone: see tests/own/test_mass_matrix.py"
            for name in ("given", "mass", "centre")
        }
        | {"exchange": "of legs that differ: see tests/own/test_unequal_legs.py"},
        of=gpw.System.__init__,
    ),
    "Walker": Call(walks, LAB, OTHER, of=gpw.Walker.__init__),
    "Terrain": Call(
        stands,
        dict(rises=(0.0, 0.1), slopes=(0.0, 0.02)),
        dict(rises=(0.0, 0.2), slopes=(0.0, 0.03), repeats=False, height_std=0.01, slope_std=0.01),
        of=gpw.Terrain,
    ),
    "Terrain.ground": Call(
        gpw.rough(0.01, 0.01).ground, dict(keys=3, places=[1, 2]), dict(keys=4, places=[2, 3])
    ),
    "Actuation": Call(
        drives, {}, dict(hip_torque=0.001, ankle_torque=0.001, push_off=0.001), of=gpw.Actuation
    ),
    "Part": Call(
        weighs,
        dict(mass=1.0, com=0.1),
        dict(mass=2.0, com=0.2, offset=0.1, inertia=0.1),
        of=gpw.Part,
    ),
    "TrainedPolicy.predict": Call(
        lambda observation, **asked: gpw.load_policy("rolling-ppo").predict(observation, **asked),
        dict(observation=np.zeros(8)),
        dict(
            observation=np.full(8, 0.1),
            state=To((1,), look=lambda found: found[1]),
            episode_start=To([True], same=True),
            deterministic=False,
        ),
        of=gpw.TrainedPolicy.predict,
    ),
    "TrainedPolicy.to_onnx": Call(
        exported,
        dict(path="policy.onnx"),
        dict(path="other.onnx"),
        of=gpw.TrainedPolicy.to_onnx,
    ),
    **{
        f"TrainedPolicy.{method}": Call(
            getattr(gpw.load_policy(policy), method),
            dict(observation=np.zeros((1, 8))),
            dict(observation=np.full((1, 8), 0.1)),
            of=getattr(gpw.TrainedPolicy, method),
        )
        for method, policy in (("mean_actions", "rolling-ppo"), ("linearize", "level-ppo"))
    },
    "ConstantTorque": Call(
        made(baselines.ConstantTorque),
        dict(torque=0.01, scene="level"),
        dict(torque=0.02, scene="steep"),
        of=baselines.ConstantTorque,
    ),
    "Passive": Call(made(baselines.Passive), {}, {"scene": MOTORS}, of=baselines.Passive),
    "LinearFeedback": Call(
        made(baselines.LinearFeedback),
        dict(scene="lab"),
        dict(scene="steep", method="deadbeat", pieces=2, torque_weight=1.0),
        of=baselines.LinearFeedback,
    ),
    "Optimal": Call(
        made(baselines.Optimal),
        dict(scene="level"),
        dict(
            scene="lab", gait=Later(lambda: baselines.optimal.load("level")[0]), torque_weight=1.0
        ),
        of=baselines.Optimal,
    ),
    "Schedule": Call(
        made(baselines.Schedule),
        dict(scene="level", gait=Later(lambda: baselines.optimal.load("level")[0])),
        dict(
            scene=Later(lambda: make_scene("level", max_hip_torque=0.07)),
            gait=Later(lambda: baselines.optimal.load("level")[1]),
        ),
        of=baselines.Schedule,
    ),
    "Held": Call(
        made(baselines.Held),
        dict(scene="lab", held={"hip_torque": 0.1}),
        dict(scene=Later(lambda: make_scene("lab", max_hip_torque=0.07)), held=gpw.Actuation(0.2)),
        of=baselines.Held,
    ),
    "gains": Call(
        gains,
        dict(by_point=np.diag([1.5, 0.5]), by_torque=np.array([[1.0], [2.0]])),
        dict(
            by_point=np.diag([1.4, 0.5]),
            by_torque=np.array([[1.0], [3.0]]),
            method="deadbeat",
            torque_weight=1.0,
        ),
    ),
    "ticked_stride": Call(
        ticked_stride,
        TICKS,
        dict(
            walker=replace(D, hip_friction=0.01),
            slope=0.01,
            point=Later(lambda: 1.01 * TICKS["point"].value()),
            torques=np.full(3, 1e-3),
            tick=To(0.5, dict(torques=np.array([1e-3, 0.0, 0.0]))),
            push_off=0.01,
            end_on_toe_stub=To(True, same=True),  # see `test_ticks`
            tolerance=1e-5,
        ),
    ),
    "rough_strides": Call(
        rough_strides,
        dict(
            policy=Later(lambda: baselines.LinearFeedback("lab")),
            scene=Later(lambda: make_scene("lab")),
            walkers=3,
        ),
        dict(
            policy=Later(lambda: baselines.LinearFeedback("lab", torque_weight=0.1)),
            scene=Later(lambda: make_scene("lab", slope=0.02)),
            walkers=4,
            seed=1,
        ),
    ),
    "strobe": Call(
        strobe,
        dict(
            walker="lab",
            slope=0.036,
            state=Later(lambda: gait("lab", 0.036).state),
            strides=1,
            ax=OWN,
        ),
        dict(
            walker="C",
            slope=0.05,
            state=Later(lambda: 1.05 * gait("lab", 0.036).state),
            strides=2,
            flashes=3,
            hip_torque=0.5,
            terrain=gpw.stairs(-0.01),
            terrain_seed=To(1, dict(terrain=gpw.rough(0.01), strides=2)),
        ),
        dict(ax="of `test_strobe`", path="of `test_strobe`"),
    ),
    "phase_portrait": Call(
        phase_portrait,
        dict(walker="lab", slope=0.036, strides=1, state=Later(lambda: gait("lab", 0.036).state)),
        dict(
            walker="C",
            slope=0.05,
            state=Later(lambda: 1.05 * gait("lab", 0.036).state),
            strides=2,
            samples=3,
            hip_torque=0.5,
        ),
        dict(path="of `test_plots`"),
    ),
}


def _fold():
    family = gpw.gait_family("lab", 0.018, 0.06)
    return gpw.bifurcation_locus(family, family.folds[0], "shank_mass", 0.95, 1.05)


SHOWN = {  # for each class with a picture: an example, and what its picture can be asked for
    "Basin": (lambda: gpw.basin_of_attraction("D", 0.009, resolution=4, strides=20), {}),
    "BifurcationDiagram": (
        lambda: gpw.bifurcation_diagram("D", [0.012, 0.016], n_transient=50, n_recorded=40),
        {"markersize": 9.0},
    ),
    "BifurcationLocus": (_fold, {"linewidth": 9.0}),
    "Cascade": (lambda: gpw.doubling_cascade("D", 0.01, 0.0195, doublings=3), {"linewidth": 9.0}),
    "Evaluation": (lambda: gpw.evaluate("steep-ppo", episodes=2, max_episode_steps=9), {}),
    "Gait": (closed, {"optimum": Later(lambda: baselines.optimal.load("level")[0])}),
    "Gauntlet": (lambda: gpw.gauntlet("steep-ppo", walkers=2), {}),
    "GaitFamily": (
        lambda: gpw.gait_family("D", 0.008, 0.01),
        {"by": "froude_speed", "linewidth": 9.0},
    ),
    "OptimalGait": (lambda: baselines.optimal.load("level")[0], {"linewidth": 9.0}),
    "RealityCheck": (lambda: gpw.reality_check("lab", 0.036, gait("lab", 0.036).state), {}),
    "Robustness": (lambda: gpw.robustness("D", slope=0.009, walkers=8, strides=20, starts=8), {}),
    "Comparison": (compared, {}),
    "Stride": (lambda: gait().stride, {}),
    "Walker": (lambda: gpw.WALKERS["lab"], {}),
    "Trajectory": (lambda: gpw.simulate("D", 0.009, gait().state, 2), {"of": "forces"}),
}


@pytest.mark.parametrize("name, option", cases(OPTIONS))
def test_an_option_of_an_object_is_heard(name, option):
    check(OPTIONS[name], option)


def public():
    """Classes that users construct, and methods with arguments of all classes of the package."""
    found = set()
    for name in gpw.__all__:
        of = getattr(gpw, name)
        if not inspect.isclass(of):
            continue
        found |= set() if name in RESULTS else {name}
        for method, function in inspect.getmembers(of, inspect.isfunction):
            ours = function.__module__.startswith("gym_passive_walker")
            several = len(inspect.signature(function).parameters) > 1
            if ours and not method.startswith("_") and several:
                found.add(f"{name}.{method}")
    of_tables = "save", "to_csv", "to_dataframe"  # see tests/gaits/test_over_time.py
    return {name for name in found if name.partition(".")[2] not in ("plot", *of_tables)}


def test_every_argument_of_every_public_object_is_tested():
    of_baselines = (each for each in vars(baselines).values() if inspect.isclass(each))
    found = {
        each.__name__
        for each in of_baselines
        if hasattr(each, "predict") and each.__module__ == baselines.__name__
    } - {"StrideFeedback"}
    of_functions = {"gains", "ticked_stride", "rough_strides", "strobe", "phase_portrait"}
    assert not missing(OPTIONS, public() | found | of_functions)


@cache
def shown_by(name):
    return SHOWN[name][0]()


@pytest.mark.parametrize("name", SHOWN)
def test_what_a_picture_is_asked_for_is_drawn(name):
    from matplotlib.figure import Figure

    shown, options = shown_by(name), SHOWN[name][1]
    into = Call(lambda **asked: shown.plot(OWN, **asked), {}, options)
    for option in options:
        check(into, option)
    axes = Figure().subplots()
    assert shown.plot(ax=axes) is axes and axes.has_data()


@pytest.mark.parametrize("name", SHOWN)
def test_each_plot_without_axes_is_a_new_figure(name):
    pyplot = pytest.importorskip("matplotlib.pyplot")
    shown, (figure, own) = shown_by(name), pyplot.subplots()
    empty = pyplot.figure()  # current, and not used
    made = [np.ravel(shown.plot())[0].get_figure(root=True) for _ in range(2)]
    assert len({figure.number, empty.number, *(each.number for each in made)}) == 4
    assert not own.has_data() and not empty.axes


def test_every_picture_is_tested():
    for drawer in DRAWERS:
        importlib.import_module(drawer)
    known = {of.__name__ for of in pictures.registry if of is not object}
    assert known == {*SHOWN, "SweepResult"}  # of `tests/sweeps`
    assert known == {name for name in gpw.__all__ if hasattr(getattr(gpw, name), "plot")}
    for name, (_, options) in SHOWN.items():
        asked = inspect.signature(pictures.dispatch(getattr(gpw, name))).parameters
        plain = {x for x, p in asked.items() if p.kind is not p.VAR_KEYWORD}
        assert plain - {next(iter(asked)), "ax"} <= set(options)
        assert any(p.kind is p.VAR_KEYWORD for p in asked.values()) == bool(set(options) - plain)


LEVEL = {"walker": D, "slope": 0.009}
OF_E = {"walker": E, "controller": "constant"}
OF_LAB = {"walker": gpw.WALKERS["lab"], "slope": 0.036}
PLAYED = {"control": "stride", "max_hip_torque": 0.0025}  # all of it
STAIRS = {"stairs": {"rise": -1e-4}}
WALKED = dict(walkers=4, strides=10, starts=8, initial_error=0.1)
SWEPT = {
    "gait": Call(
        ANALYSES["gait"],
        LEVEL,
        dict(
            walker=E,
            slope=0.01,
            kind="short",
            period=To(2, dict(slope=0.016)),
            hip_torque=0.001,
            ankle_torque=0.001,
            push_off=0.001,
            controller=To("constant", dict(walker=E)),
            scene=To({**PLAYED, "max_hip_torque": 0.001}, OF_E),
            terrain=STAIRS,
        ),
    ),
    "family": Call(
        ANALYSES["family"],
        dict(walker=D, slope_min=0.01, slope_max=0.016),
        dict(
            walker=E,
            slope_min=0.011,
            slope_max=0.015,
            kind="short",
            controller=To("constant", dict(walker=E, scene=PLAYED)),
            scene=To({**PLAYED, "max_hip_torque": 0.001}, OF_E),
            terrain=STAIRS,
        ),
    ),
    "bifurcation": Call(
        ANALYSES["bifurcation"],
        dict(walker=D, slope=0.0153, n_transient=5, n_recorded=40),
        dict(
            walker=E,
            slope=0.0165,
            n_transient=6,
            n_recorded=50,
            kind=To("short", dict(n_transient=0)),
            controller=To("constant", dict(**OF_LAB, scene=PLAYED)),
            scene=To({**PLAYED, "max_hip_torque": 0.001}, dict(**OF_LAB, controller="constant")),
            terrain=STAIRS,
        ),
    ),
    "basin": Call(
        ANALYSES["basin"],
        dict(walker=D, slope=0.009, resolution=6, strides=10),
        dict(
            walker=gpw.WALKERS["C"],
            slope=0.018,
            resolution=9,
            strides=100,
            controller=To("lqr", dict(walker=E, resolution=20)),
            scene=To({**PLAYED, "max_hip_torque": 1e-4}, dict(OF_E, controller="lqr")),
            terrain=To({"stairs": {"rise": -0.003}}, dict(resolution=20)),
        ),
    ),
    "check": Call(
        ANALYSES["check"],
        dict(walker=gpw.WALKERS["lab"], slope=0.036),
        dict(
            walker=gpw.WALKERS["lab-straight"],
            slope=0.02,
            kind=To("short", dict(walker=gpw.WALKERS["C"], slope=0.001)),
            friction=0.01,
            controller=To("constant", dict(walker=E, slope=0.009, friction=0.0), same=True),
            scene=To({"max_hip_torque": 0.03}, dict(controller="lab-ppo"), same=True),
        ),
    ),
    "robustness": Call(
        ANALYSES["robustness"],
        dict(changes=LEVEL, roughness=1e-4, **WALKED),
        dict(
            changes={"walker": D, "slope": 0.01},
            controller=To("constant", dict(changes={"slope": 0.036, "walker": gpw.WALKERS["lab"]})),
            scene=To(
                "push-off", dict(controller="passive", changes={**LEVEL, "reset_noise_scale": 0.0})
            ),
            roughness=4e-4,
            first_passage="mesh",
            walkers=To(9, dict(roughness=4e-4)),
            strides=To(40, dict(roughness=2e-4, walkers=40)),
            initial_error=0.2,
            starts=16,
            seed=1,
        ),
    ),
    "optimal": Call(
        ANALYSES["optimal"],
        dict(changes={"tick": 2.0}, speed=0.18),
        dict(changes={"tick": 1.5}, speed=0.19, scene="lab"),
    ),
    "evaluation": Call(
        ANALYSES["evaluation"],
        dict(changes={}, controller="steep-ppo", episodes=2),
        dict(
            changes={"slope": 0.112},
            controller="passive",
            scene=To("rough", dict(controller="passive")),
            episodes=3,
            seed=1,
        ),
    ),
}


@pytest.mark.parametrize("name, option", cases(SWEPT))
def test_an_argument_of_an_analysis_that_can_be_swept_is_heard(name, option):
    check(SWEPT[name], option)


def test_every_argument_of_every_analysis_that_can_be_swept_is_tested():
    assert not missing(SWEPT, set(ANALYSES))
