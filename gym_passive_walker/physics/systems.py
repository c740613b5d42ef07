"""Every kind of walker by name."""

from __future__ import annotations

from gym_passive_walker.physics import kneed, simplest, straight

SYSTEMS = {system.name: system for system in (kneed.SYSTEM, straight.SYSTEM, simplest.SYSTEM)}
