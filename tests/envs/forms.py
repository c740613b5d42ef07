"""Forms of users' functions, as text, and their values in plain Python."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

import gym_passive_walker as gpw
from gym_passive_walker.envs.transitions import BOOLEANS, SEVERAL
from gym_passive_walker.envs.views import Shape
from gym_passive_walker.gaits.scenes.transition import Transition
from gym_passive_walker.models.equations.hybrid import State

PLAIN = SimpleNamespace(
    exp=math.exp, tanh=math.tanh, sqrt=math.sqrt, sin=math.sin, cos=math.cos,
    minimum=lambda a, b: a if a < b else b,
    maximum=lambda a, b: a if a > b else b,
    where=lambda condition, yes, no: yes if condition else no,
)  # fmt: skip
"""The functions of `gpw.math` for Python's numbers."""

_STATES = [f"s.{part}.{name}" for part in ("before", "state") for name in State._fields]
NUMBERS = [
    *(f"s.{name}" for name in Transition._fields if name not in (*BOOLEANS, *SEVERAL)),
    *_STATES, "s.action[0]", "s.last_action[0]",
]  # fmt: skip
"""All numbers of a transition."""

CONDITIONS = [
    *(f"s.{name}" for name in BOOLEANS), "(s.distance > 0.01)", "(s.steps == 3)",
    "(s.state.stance != s.before.stance)",
]  # fmt: skip

OF_NUMBERS = [
    "{x}",
    "-{x}",
    "2.5 * {x} - 1",
    "m.where({x} > 0.01, {x}, -1.0)",
    "m.where({x}, 2, 3)",
]
OF_CONDITIONS = [
    "{b}", "-{b}", "+{b}", "1 - {b}", "{b} - 1", "{b} + 1", "{b} - {c}", "{b} + {c}", "{b} + {b}",
    "2 * {b}", "{b} * 0.1", "{b} * {c}", "{b} / 2", "{b} / 0.3", "{b} ** 2", "{b} ** 0",
    "abs({b})", "abs(-{b})", "{b} * s.step_length", "s.distance - 100.0 * {b}",
    "s.distance + {b}", "{b} / (1.0 + s.time)", "{b} == True", "{b} == {c}", "{b} != {c}",
    "{b} < 1", "{b} <= {c}", "{b} > {c}", "{b} >= 0.5", "{b} & {c}", "{b} | {c}", "{b} ^ {c}",
    "True & {b}",
    "{b} | False", "True ^ {b}", "sum([{b}, {c}, {b}])", "m.where({b}, 1, 0.1)",
    "m.where({b}, {c}, True)", "m.where({b}, {c}, s.time)", "m.where({b} == 0, -1, 1)",
    "m.exp({b})", "m.tanh({b})", "m.sqrt({b})", "m.sin({b})", "m.cos({b})", "m.minimum({b}, 0.5)",
    "m.maximum({b}, {c})", "m.exp({b} & {c})", "{b} * ({c} - 1) ** 3",
]  # fmt: skip
NEGATED = {
    "~{b}": "not {b}",
    "~{b} & {c}": "(not {b}) & {c}",
    "1.5 * ~({b} | {c})": "1.5 * (not ({b} | {c}))",
    "~m.where({b}, {c}, False)": "not m.where({b}, {c}, False)",
    "3 - ~{b}": "3 - (not {b})",
    "~(~{b} ^ {c})": "not ((not {b}) ^ {c})",
}
"""Forms with `~`, which of Python's booleans negates the bits, and their plain values."""

_X, _Y = "s.state.stance", "s.before.thigh_rate"
_OPERATORS = ("+", "-", "*", "/", "==", "!=", "<", "<=", ">", ">=")
OF_OPERATORS = [
    form
    for op in _OPERATORS
    for form in (f"{_X} {op} {_Y}", f"{_X} {op} 0.3", f"0.3 {op} {_X}", f"{_X} {op} 2",
                 f"{_X} {op} np.float64(0.3)", f"np.float64(0.3) {op} {_X}")
]  # fmt: skip
OF_OPERATORS += [f"{_X} ** {n}" for n in (*range(-4, 9), 16, -2.0, 2.0, True, 31, "np.float64(3)")]
OF_OPERATORS += ["abs(s.time) ** 0.5", f"pow({_X}, 3)", "(s.time + 1) ** 2 / s.time ** 0"]
OF_FUNCTIONS = [
    f"m.{name}({x})"
    for name in ("exp", "tanh", "sin", "cos")
    for x in (_X, "0.1 * s.steps / 9", "s.state.stance_rate - 1", "0.7")
]
OF_FUNCTIONS += [f"m.sqrt({x})" for x in ("s.time", f"{_X} ** 2", f"1 + abs({_Y})", "2")]
OF_FUNCTIONS += [
    f"m.{name}({a}, {b})"
    for name in ("minimum", "maximum")
    for a, b in ((_X, _Y), (_X, "0.1"), ("0.1", _X), ("1", "2"), ("np.float64(0.1)", _X))
]
OF_NUMPY = [
    f"np.{f}({_X}, {_Y})" for f in ("add", "subtract", "multiply", "divide", "less", "equal")
]
OF_NUMPY += [f"np.{f}({_X})" for f in ("negative", "positive", "abs", "square")]
OF_NUMPY += [f"np.sum([{_X}, {_Y}])", "np.sum([s.fell, s.heelstrike, s.knee_locked])",
             f"np.dot([1.0, 2.0], [{_X}, {_Y}])"]  # fmt: skip
IN_PLACE = [
    f"x = {x}\n    x {op} {y}"
    for op, x, y in (
        ("+=", _X, "s.fell"), ("-=", _X, "s.knee_locked"), ("*=", _X, "s.heelstrike"),
        ("/=", _X, "2"), ("**=", _X, "3"), ("+=", "s.fell", "1"), ("-=", "s.fell", "s.heelstrike"),
        ("*=", "s.knee_locked", "0.1"), ("&=", "s.knee_locked", "s.heelstrike"),
        ("|=", "s.fell", "s.heelstrike"), ("^=", "s.knee_locked", "True"), ("+=", "0.5", _X),
    )
]  # fmt: skip


def _compiled() -> dict[str, str]:
    """Texts of forms that are compiled, and of their plain values."""
    others = CONDITIONS[1:] + CONDITIONS[:1]
    pairs = list(zip(CONDITIONS, others, strict=True))
    same = [form.format(x=x) for x in NUMBERS for form in OF_NUMBERS]
    same += [form.format(b=b, c=c) for b, c in pairs for form in OF_CONDITIONS]
    same += [*OF_OPERATORS, *OF_FUNCTIONS, *OF_NUMPY, *IN_PLACE]
    forms = {form: form for form in same}
    for b, c in pairs:
        forms |= {x.format(b=b, c=c): y.format(b=b, c=c) for x, y in NEGATED.items()}
    return forms


COMPILED = _compiled()
"""Forms that are compiled, and how plain Python evaluates them."""

CALLED = {
    form: symbol
    for symbol, forms in {
        "%": ["s.steps % 2", "7 % (1 + s.steps)", "s.fell % 2"],
        "//": ["s.steps // 2", "7 // (1 + s.steps)"],
        "divmod()": ["divmod(s.time, 0.3)[1]", "divmod(5, 1 + s.time)[0]"],
        "round()": ["round(s.time)", "round(s.time, 1)"],
        "int()": ["int(s.time)", "math.trunc(s.time)"],
        "math.floor()": ["math.floor(s.time)"],
        "math.ceil()": ["math.ceil(s.time)"],
        "float()": ["float(s.time)", "math.sin(s.time)", "np.array([s.time], float)[0]"],
        "complex()": ["complex(s.time).real"],
        "an index": ["[1.0, 2.0][s.fell]"],
        "**": ["(1 + s.time) ** 0.3", "s.time ** 65", "2.0 ** s.time", "(1 + s.time) ** s.slope"],
        "`if`": [
            "1.0 if s.fell else s.time", "1.0 if s.fell == 1 else 0.0", "min(s.time, 3.0)",
            "max(s.time, s.steps)", "s.fell or s.heelstrike", "s.time > 2 and s.knee_locked",
            "not s.fell", "1.0 < s.time < 3.0", "1.0 * (s.steps in (1.0, 2.0, 3.0))",
            "sorted([s.time, s.slope])[0]",
        ],
        "np.sin": ["np.sin(s.time)"],
        "np.exp": ["np.exp(-s.time)"],
        "np.maximum": ["np.maximum(s.time, 2.0)"],
        "np.floor": ["np.floor(s.time)"],
        "known already": ["np.where(s.time > 2, 1.0, 3.0)", "np.clip(s.time, 1, 2)"],
        "has no": ["s.time.is_integer()"],
        "Expression": ["f'{s.time:.3f}' > '2'"],
        "&, | and ^": ["(s.steps == 3) & 1", "s.fell | 2"],
    }.items()
    for form in forms
}  # fmt: skip
"""Forms that are called after each step, and what the warning names."""


def function(form: str, plain: bool = False) -> Callable[[Any], Any]:
    """The function of a form, of `gpw.math` or in plain Python."""
    names = {"np": np, "math": math, "m": PLAIN if plain else gpw.math}
    body = form if "\n" in form else f"x = {form}"
    exec(f"def own(s):\n    {body}\n    return x", names)
    return names["own"]


def several(forms: Any) -> Callable[[Any], Any]:
    """A function of the values of many forms."""
    functions = [function(form) for form in forms]
    return lambda s: [each(s) for each in functions]


def plain_step(note: np.ndarray, shape: Shape) -> Transition:
    """A recorded transition as Python's floats and booleans."""
    count = len(shape.State._fields) // 2
    parts = {name: note[name].tolist() for name in Transition._fields}
    for name in ("before", "state"):
        each, room = parts[name], shape.layout.links
        parts[name] = shape.State(*each[:count], *each[room : room + count])
    for name in BOOLEANS:
        parts[name] = bool(parts[name])
    return Transition(**parts)


def plain_values(forms: Any, notes: np.ndarray, shape: Shape) -> np.ndarray:
    """Values (n, forms) of recorded transitions (n,) in plain Python, walker by walker."""
    functions = [function(COMPILED.get(form, form), plain=True) for form in forms]
    steps = [plain_step(note, shape) for note in notes]
    return np.array([[float(each(step)) for each in functions] for step in steps])
