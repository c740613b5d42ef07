"""Columns of sweeps have labels with their units."""

import pytest

from gym_passive_walker.apps.sweeps.quantities import label
from gym_passive_walker.apps.sweeps.tasks import task

LABELS = {
    "found": "found", "stable": "stable", "multiplier": "modulus of the largest multiplier",
    "stance_angle": "stance angle θ (rad)", "step_period": "step period / √(l/g)",
    "step_length": "step length / l", "cost_of_transport": "cost of transport",
    "gaits": "gaits", "first_end": "first end (rad)", "first_reason": "first reason",
    "last_end": "last end (rad)", "last_reason": "last reason", "folds": "folds",
    "period_doubling": "period doubling (rad)", "stable_from": "stable from (rad)",
    "stable_to": "stable to (rad)", "fastest": "fastest / √(g l)",
    "walks": "walks", "period": "period", "least_angle": "least angle (rad)",
    "greatest_angle": "greatest angle (rad)", "settles": "settles",
    "first_passage": "first passage (strides)", "recovery": "recovery (strides)",
    "step_up": "step up / l", "step_down": "step down / l",
    "push_forward": "push forward / (m √(g l))", "push_backward": "push backward / (m √(g l))",
    "distance": "distance / l", "roughness": "roughness / l", "seconds": "run time (s)",
    "hip_mass": "hip mass / m", "hip_stiffness": "hip stiffness / (m g l)",
    "hip_friction": "hip friction / (m l √(g l))", "push_off": "push off / (m √(g l))",
    "hip_torque": "hip torque / (m g l)", "ankle_torque": "ankle torque / (m g l)",
    "foot_radius": "foot radius / l", "foot_angle": "foot angle (rad)",
    "gravity": "gravity", "status": "status",
}  # fmt: skip


@pytest.mark.parametrize("name", LABELS)
def test_a_column_has_a_label_with_its_unit(name):
    assert label(name) == LABELS[name]


def test_columns_that_are_also_axes_of_other_pictures_have_their_labels():
    from gym_passive_walker.pictures.axes import ANGLE, SLOPE, SPEED

    assert label("slope") == SLOPE != label("speed") == label("froude_speed") == SPEED
    assert label("stance_angle") == ANGLE
    assert len({label(name) for name in LABELS}) == len(LABELS)


def test_what_is_no_function_of_a_module_is_refused():
    with pytest.raises(ValueError, match=r"'math:pi' is not a function"):
        task("math:pi", {})
    with pytest.raises(ValueError, match=r"'math:pie' cannot be found"):
        task("math:pie", {})
