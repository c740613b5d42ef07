"""Functions of `disturbance_kernels` for one walker, without allocation of memory."""

from __future__ import annotations

from gym_passive_walker.envs import disturbance_kernels, task


def integrate_past_events(here, first, last, tiles, histories):
    """Implement `disturbance_kernels.integrate_past_events` for one walker."""
    record, disturbance = here.records[first, 0], here.disturbances[first]
    disturbance.until, disturbance.impulse = record.end, 0.0
    if not disturbance.idle:
        disturbance_kernels.apply_due_events(here, first)
    task.integrate_step(here, first, last, tiles, histories)
    while disturbance_kernels.goes_on(record, disturbance):
        disturbance_kernels.apply_due_events(here, first)
        task.integrate_step(here, first, last, tiles, histories)
