"""The result of a control step, the argument of users' rewards, observations and terminations."""

from __future__ import annotations

from typing import Any, NamedTuple


class Transition(NamedTuple):
    """The result of one control step of an environment, dimensionless.

    Each field is a number; for a batch of n walkers it is an array or a tensor (n,). A condition,
    such as `fell`, counts as 1.0 or 0.0 in arithmetic. Lengths are in leg lengths l, times in
    sqrt(l/g), energies and torques in m g l.

    Attributes:
        before: State as the step began: angles `stance`, `thigh` and `shank` in rad, angular
            velocities `stance_rate`, `thigh_rate` and `shank_rate`; of a `System` its own `State`.
        state: State as it ended; after a heelstrike the legs have exchanged their roles.
        knee_locked: Whether the swing leg is straight.
        distance: Displacement of the hip along the slope in the step. At a fall, minus the distance
            of the unfinished stride before the step.
        duration: Duration of the step; a heelstrike ends it before `tick`.
        time: Time since the episode began.
        energy: Energy that the reward charges in the step: work of hip and ankle of the scene's
            kind ("absolute", "positive" or "net"), and the work of the push-off.
        hip_work: Net work of the hip torque in the step; of a `System`, of its first control.
        hip_work_absolute: Integral of the absolute power of the hip torque over the step.
        ankle_work: Net work of the ankle torque; of a `System`, of its second control.
        ankle_work_absolute: Integral of the absolute power of the ankle torque.
        push_off_work: Work of the push-off, in the step that a heelstrike ends; 0 in other steps.
        collision_loss: Energy lost at kneestrike and heelstrike in the step.
        heelstrike: Whether the step ended with a heelstrike.
        step_length: Distance from contact to contact of the stride that the step ended by a
            heelstrike; 0 in other steps.
        step_period: Duration of that stride; 0 in other steps.
        fell: Whether the environment terminates the episode: a fall, a stubbed toe, a stride
            longer than allowed.
        strides: Heelstrikes since the episode began.
        steps: Control steps since the episode began.
        slope: Slope of the ground in rad.
        height_change: Height of the next foothold above the present one.
        slope_change: Slope of the next foothold less that of the present one, in rad.
        push: Impulse of all pushes on the hip in the step, over m sqrt(g l).
        command: Commanded speed over sqrt(g l); 0 without a command.
        action: Action of this step, clipped to its bounds: a number for each of the scene's
            actions; zeros in the observation that `reset` returns.
        last_action: Action of the step before this one; zeros in the first step of an episode.
        reward: The environment's own reward of the step.
    """

    before: Any
    state: Any
    knee_locked: Any
    distance: Any
    duration: Any
    time: Any
    energy: Any
    hip_work: Any
    hip_work_absolute: Any
    ankle_work: Any
    ankle_work_absolute: Any
    push_off_work: Any
    collision_loss: Any
    heelstrike: Any
    step_length: Any
    step_period: Any
    fell: Any
    strides: Any
    steps: Any
    slope: Any
    height_change: Any
    slope_change: Any
    push: Any
    command: Any
    action: tuple[Any, ...]
    last_action: tuple[Any, ...]
    reward: Any
