"""Public names of `engine.own` and `models.equations`: systems that users state themselves.

The named tuples state the package's own kinds of walkers too.
"""

from gym_passive_walker.engine.own.mechanics import Link
from gym_passive_walker.engine.own.stated import StatementError
from gym_passive_walker.engine.own.statement import (
    accelerations_of,
    heelstrike_of,
    kinetic_energy_of,
    stop_of,
)
from gym_passive_walker.engine.own.system import Free, System
from gym_passive_walker.models.equations.hybrid import (
    Ground,
    Guard,
    Outcome,
    Phase,
    Refusal,
    Reset,
    Stage,
    Step,
    Strike,
    Watch,
)
from gym_passive_walker.models.equations.hybrid import System as HybridSystem

__all__ = [
    "Free",
    "Ground",
    "Guard",
    "HybridSystem",
    "Link",
    "Outcome",
    "Phase",
    "Refusal",
    "Reset",
    "Stage",
    "StatementError",
    "Step",
    "Strike",
    "System",
    "Watch",
    "accelerations_of",
    "heelstrike_of",
    "kinetic_energy_of",
    "stop_of",
]
