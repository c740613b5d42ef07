"""What is wrong with a statement is said in one sentence that names the function.

python -m tests.own.test_statements     Write the sentences, `sentences.json`, again.
"""

import json
import math
import random
import re
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.five_links import FIVE_LINKS
from examples.torso import TORSO
from gym_passive_walker.models.math import cos, sin, sqrt, where
from gym_passive_walker.pictures.screen import Screen
from tests.numbers import alike
from tests.own.statements import COMPASS, DRIVEN, Hip, links

SENTENCES = Path(__file__).with_name("sentences.json")


def falling(body, state):
    """A landing that chooses by `if`."""
    if state.swing > state.stance:
        return sin(state.swing) - sin(state.stance), cos(state.stance) - cos(state.swing)
    return 0.0, cos(state.stance) - cos(state.swing)


def anything(body, state):
    """Another number each time."""
    return random.random()


def forgotten(body, state):
    """A potential energy without its return."""
    0.5 * state.stance**2


class Timed(NamedTuple):
    """A state with the name of another column of tables."""

    stance: float
    speed: float
    stance_rate: float
    swing_rate: float


class Pushed(NamedTuple):
    """A body with a name that compiled code knows."""

    hip: float = 1.0
    push_off: float = 2.0


class Same(NamedTuple):
    """A control with the name of a coordinate."""

    stance: float


class Nothing(NamedTuple):
    """A state without rates."""

    angle: float


def upright(body, state):
    """Positive while the stance leg stands."""
    return state.stance + 1.5


WRONG = {
    "links": {
        "a negative mass": (lambda b, s: [gpw.Link(-1.0, *links(b, s)[0][1:])], "negative mass"),
        "a negative inertia": (
            lambda b, s: [*links(b, s), gpw.Link(0.01, 0.0, 1.0, -0.001, s.stance)],
            "negative mass or inertia",
        ),
        "a position that is missing": (lambda b, s: [(1.0, s.stance)], "missing"),
        "an error": (lambda b, s: 1 / 0, "ZeroDivisionError"),
        "not a number": (lambda b, s: [gpw.Link(1.0, math.nan, s.stance)], "finite"),
        "a number": (lambda b, s: 1.0, "list of gpw.Link"),
        "a leg without mass": (lambda b, s: links(b, s)[:2], "without inertia"),
        "a mass that grows": (
            lambda b, s: [*links(b, s)[:2], links(b, s)[2]._replace(mass=0.2 + s.swing**2)],
            "masses and moments of inertia that do not depend on the state",
        ),
        "a place by a rate": (
            lambda b, s: [*links(b, s), gpw.Link(0.1, 0.1 * s.stance_rate, 1.0)],
            "places and angles that do not depend on the rates",
        ),
    },
    "landing": {
        "a foot that never falls": (lambda b, s: (sin(s.swing), 1.0), "never falls"),
        "one number": (lambda b, s: (0.0,), "2 numbers"),
        "a foot in the air": (lambda b, s: (s.swing, 3.0 + cos(s.stance)), "near none"),
        "no function": (None, "must be a function"),
        "an `if`": (falling, "fails in line"),
        "a sine of NumPy": (
            lambda b, s: (np.sin(s.swing) - np.sin(s.stance), np.cos(s.stance) - np.cos(s.swing)),
            "np.sin has no compiled form; see gpw.math",
        ),
        "no return": (forgotten, "add its return"),
        "a text": (lambda b, s: ("1.5", "2.5"), "must give numbers"),
        "a place by a rate": (
            lambda b, s: (s.swing - s.stance + s.stance_rate, cos(s.stance) - cos(s.swing)),
            "must not depend on the rates",
        ),
    },
    "relabel": {
        "another each time": (lambda b, s: (s.swing, s.stance + anything(b, s)), "each time"),
        "no return": (forgotten, "add its return"),
        "legs that keep their roles": (lambda b, s: (s.stance, s.swing), "same motion"),
        "three coordinates": (lambda b, s: (s.swing, s.stance, 0.0), "2 numbers"),
        "a leg turned over": (lambda b, s: (s.swing, s.stance + 0.1), "same"),
    },
    "falls": {
        "none": ({}, "has fallen"),
        "an unknown one": ({"tumbled": lambda b, s: s.stance}, "fell_forward"),
        "text": ({"fell_forward": lambda b, s: "x"}, "numbers"),
        "a constant": ({"fell_forward": lambda b, s: 1.0}, "never falls"),
        "a list": ([upright], "a mapping"),
        "no function": ({"fell_forward": 1.0}, "must be a function"),
        "another each time": (
            {"fell_forward": lambda b, s: s.stance + 2.0 + anything(b, s)},
            "each time",
        ),
        "a condition": ({"fell_forward": lambda b, s: s.stance < 1.5}, "numbers"),
        "fallen at the start": ({"fell_forward": lambda b, s: -1.0 - s.stance**2}, "at its start"),
    },
    "counts": {
        "an attribute that is missing": ((lambda b, s: s.knee,), "AttributeError"),
        "never": ((lambda b, s: -1.0,), "never positive"),
        "one function": (lambda b, s: 1.0, "list of functions"),
        "numbers": ((1.0,), "list of functions"),
        "another each time": ((lambda b, s: 1.0 + anything(b, s) - s.stance,), "each time"),
    },
    "limits": {"a list": ([1.0], "a mapping")},
    "pose": {
        "another each time": (lambda b, s: [[(0.0, 0.0), (anything(b, s), 1.0)]], "each time"),
        "a number": (1.0, "must be a function"),
        "a line of one point": (lambda b, s: [(0.0, 0.0)], "points"),
        "a line of numbers": (lambda b, s: [[1.0, 2.0]], "points"),
        "points of three numbers": (lambda b, s: [[(0.0, 0.0, 0.0)]], "points"),
        "not a number": (lambda b, s: [[(0.0, math.nan)]], "finite"),
    },
    "travel": {"no function": (None, "must be a function")},
    "potential": {
        "another each time": (lambda b, s: anything(b, s) * s.stance**2, "each time"),
        "no return": (forgotten, "add its return"),
        "a complex number": (lambda b, s: 1j, "numbers"),
        "a complex number of NumPy": (lambda b, s: np.complex128(1j), "numbers"),
        "text": (lambda b, s: "1.5", "numbers"),
        "a number beyond floats": (lambda b, s: 10**400, "numbers"),
        "another for symbols": (
            lambda b, s: 1.0 if isinstance(s.stance, float) else 0.0,
            "depend on their type",
        ),
        "infinity": (lambda b, s: math.inf, "finite"),
        "of rates": (lambda b, s: s.stance_rate, "rates"),
        "of one leg": (lambda b, s: s.stance**2, "act alike on both legs"),
    },
    "name": {
        "a number": (3, "text"),
        "empty": ("", "text"),
        "blank": (" ", "text"),
        "a walker of the package": ("lab", "choose another"),
    },
    "Control": {
        "a tuple": (tuple, "named tuple"),
        "a name of the state": (Same, "field stance of State"),
    },
    "dissipation": {
        "a gain": (lambda b, s: -(s.stance_rate**2), "negative"),
        "a gain on the way back": (lambda b, s: -0.1 * s.stance_rate, "negative"),
        "of angles": (lambda b, s: s.stance**2, "does not depend on the rates"),
        "another each time": (lambda b, s: anything(b, s) * s.stance_rate**2, "each time"),
    },
    "forces": {
        "one of two": (lambda b, s: (0.0,), "2 numbers"),
        "another each time": (lambda b, s: (anything(b, s) * s.stance_rate, 0.0), "each time"),
    },
    "State": {
        "no rates": (Nothing, "1 to 8 coordinates"),
        "a tuple": (tuple, "named tuple"),
        "a column of tables": (Timed, "field speed"),
    },
    "body": {
        "a name of the package": (Pushed(), "field push_off"),
        "a list": ([1.0], "named tuple"),
        "text": (Nothing("x"), "numbers"),  # type: ignore[arg-type]
    },
    "start": {
        "too short": ((0.1, 0.2), "4 numbers"),
        "not a number": ((math.nan, 0.1, 0.2, 0.3), "finite"),
    },
}


def test_a_pose_of_points_of_several_sizes_is_refused():
    with pytest.raises(gpw.StatementError, match="pose"):  # with a sentence of NumPy
        replace(COMPASS, pose=lambda b, s: [[(0.0, 0.0), (1.0,)]])


CASES = [(name, what) for name, several in WRONG.items() for what in several]


def sentence(name, what):
    """What is said of a wrong statement."""
    with pytest.raises(gpw.StatementError) as error:
        replace(COMPASS, **{name: WRONG[name][what][0]})
    said = re.sub(r" in line \d+", " in line 0", str(error.value))
    return re.sub(r" at 0x\w+", "", said)


@pytest.mark.parametrize(("name", "what"), CASES)
def test_a_statement_that_is_wrong_is_refused_by_the_name_of_its_function(name, what):
    """In one sentence, which is as it was, with its numbers."""
    said, part = sentence(name, what), WRONG[name][what][1]
    assert part in said and name in said and "\n" not in said
    kept = json.loads(SENTENCES.read_text("utf-8"))
    assert len(kept) == len(CASES) and alike(kept[f"{name}: {what}"], said, 1e-4, 1e-9)


def test_an_error_of_a_function_names_its_line_and_one_of_given_equations_its_phase():
    with pytest.raises(gpw.StatementError, match=rf"{falling.__code__.co_firstlineno + 2} of test"):
        replace(COMPASS, landing=falling)
    with pytest.raises(gpw.StatementError, match=r"travel of system 'compass' fails in line"):
        replace(DRIVEN, travel=lambda s: Hip(s.swing if s.swing > 0.0 else s.stance))
    equations = COMPASS.hybrid
    (phase,) = equations.phases
    guard = phase.guards[0]._replace(falls=lambda body, state, ground: math.cos(state.swing))
    wrong = phase._replace(guards=(guard, *phase.guards[1:]))
    with pytest.raises(gpw.StatementError, match=r"guard HEELSTRIKE of phase LOCKED of .*in line"):
        gpw.System.of(
            equations._replace(phases=(wrong,)), COMPASS.body, centre=lambda b, s: (0.0, s.stance)
        )


@pytest.mark.parametrize(
    ("travel", "said"),
    [
        (lambda s: Hip(0.0), "of the control 'hip' does not depend on the coordinates"),
        (lambda s: Hip(s.swing_rate), "of the control 'hip' must not depend on the rates"),
    ],
)
def test_a_control_that_cannot_work_is_refused(travel, said):
    with pytest.raises(gpw.StatementError, match=f"travel of system 'compass' {said}"):
        replace(DRIVEN, travel=travel)


def test_a_body_without_dampers_may_have_a_dissipation():
    assert FIVE_LINKS.vary(damping=0.0).total_mass == pytest.approx(FIVE_LINKS.total_mass)


def test_a_spring_may_have_a_value_that_is_not_chosen_where_it_has_no_root_or_quotient():
    def potential(body, state):
        opened = (state.swing - state.stance) ** 2
        return where(opened > 0.5, sqrt(opened - 0.5) + 0.001 / opened, 0.0)

    assert replace(COMPASS, potential=potential).total_mass == COMPASS.total_mass


def test_equations_that_differ_have_names_that_differ():
    slower = replace(TORSO, dissipation=None)
    assert slower.hybrid.name != TORSO.hybrid.name
    assert replace(TORSO).hybrid.name == TORSO.hybrid.name


ANALYSES = {
    "ratios of a basin": lambda: gpw.basin_of_attraction(COMPASS, 0.03, ratios=(1.0, 1.0)),
    "an actuation": lambda: gpw.stride_map(COMPASS, controller=gpw.Actuation(hip_torque=0.1)),
}


def test_analyses_that_need_legs_with_parameters_say_so():
    for analysis in ANALYSES.values():
        with pytest.raises(ValueError, match="McGeer's parameters"):
            analysis()


def test_a_start_may_be_an_array():
    system = replace(COMPASS, start=np.array(COMPASS.start))
    assert system.start == COMPASS.start
    assert Screen(system).draw(system.start, 0.03).shape == (450, 800, 3)


def test_a_search_without_a_start_asks_for_one():
    with pytest.raises(ValueError, match="has no start"):
        gpw.find_gait(replace(COMPASS, start=None), 0.03)
    with pytest.raises(gpw.GaitNotFound, match="guess near the gait"):
        gpw.find_gait(COMPASS, -0.1)


def test_a_compass_doubles_its_period_on_steeper_slopes():
    assert gpw.gait_family(COMPASS, 0.02, 0.08).period_doublings
    diagram = gpw.bifurcation_diagram(COMPASS, [0.03, 0.075], n_transient=300, n_recorded=64)
    assert diagram.period.tolist() == [1, 2]


def test_the_named_tuple_of_a_link_has_a_point_mass_by_default():
    assert gpw.Link(1.0, 2.0, 3.0) == (1.0, 2.0, 3.0, 0.0, 0.0)


if __name__ == "__main__":
    found = {f"{name}: {what}": sentence(name, what) for name, what in CASES}
    SENTENCES.write_text(json.dumps(found, indent=0, ensure_ascii=False) + "\n", "utf-8")
