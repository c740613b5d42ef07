"""Functions of `disturbance_kernels` for one walker, without allocation of memory."""

from __future__ import annotations

from gym_passive_walker.engine.run import integrate
from gym_passive_walker.envs import disturbance_kernels


def integrate_past_events(
    records, bodies, disturbances_, phases, options, tiles, histories, settings, hooks
):
    """Implement `disturbance_kernels.integrate_past_events` for one walker."""
    record, disturbance = records[0, 0], disturbances_[0]
    disturbance.until, disturbance.impulse = record.end, 0.0
    if not disturbance.idle:
        disturbance_kernels.apply_due_events(records, bodies, 0, disturbance, settings, hooks)
    integrate(records, bodies, phases, options, tiles, histories)
    while disturbance_kernels.goes_on(record, disturbance):
        disturbance_kernels.apply_due_events(records, bodies, 0, disturbance, settings, hooks)
        integrate(records, bodies, phases, options, tiles, histories)
