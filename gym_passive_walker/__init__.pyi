# The public names, and the modules that they come from: `__init__.py` reads this list, and loads
# a module when one of its names is used.

from gym_passive_walker import math
from gym_passive_walker._version import __version__ as __version__
from gym_passive_walker.apps.play import play
from gym_passive_walker.apps.sweeps.run import SweepResult, sweep
from gym_passive_walker.bridge.comparison import Comparison, compare
from gym_passive_walker.bridge.export import export
from gym_passive_walker.engine.own.mechanics import Link
from gym_passive_walker.engine.own.system import StatementError, System
from gym_passive_walker.envs.evaluation.comparison import Evaluation, evaluate
from gym_passive_walker.envs.evaluation.gauntlet import Gauntlet, gauntlet
from gym_passive_walker.envs.evaluation.robustness import Robustness, robustness
from gym_passive_walker.envs.explain import explain
from gym_passive_walker.envs.policies import PolicyError, TrainedPolicy, load_policy
from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.gaits.branches.bifurcation import (
    BifurcationDiagram,
    bifurcation_diagram,
    crisis,
    lyapunov_exponents,
)
from gym_passive_walker.gaits.branches.doubling import Cascade, doubling_cascade
from gym_passive_walker.gaits.branches.family import GaitFamily, gait_family, parameter_family
from gym_passive_walker.gaits.branches.locus import BifurcationLocus, bifurcation_locus
from gym_passive_walker.gaits.control.maps import closed_loop_gait, stride_map
from gym_passive_walker.gaits.control.optimal import optimal_gait, optimal_gaits
from gym_passive_walker.gaits.control.optimum import OptimalGait
from gym_passive_walker.gaits.design.design import Design, optimize_walker, tune_to_walk
from gym_passive_walker.gaits.find.fixed_point import find_gait, find_gaits
from gym_passive_walker.gaits.find.nearest import nearest_gait
from gym_passive_walker.gaits.gait import Gait, GaitNotFound
from gym_passive_walker.gaits.look.dense_stride import Impulse, TimedExtremum
from gym_passive_walker.gaits.look.measures import (
    FootVelocity,
    collision_matrix,
    foot_velocity,
    measures,
)
from gym_passive_walker.gaits.look.reality import RealityCheck, reality_check
from gym_passive_walker.gaits.look.stability import stride_jacobian
from gym_passive_walker.gaits.look.trajectory import Trajectory, simulate
from gym_passive_walker.gaits.robust.basin import (
    Basin,
    VelocityPerturbations,
    basin_of_attraction,
    largest_push,
)
from gym_passive_walker.gaits.scenes.transition import Transition
from gym_passive_walker.gaits.stride import Stride, stride
from gym_passive_walker.gaits.terrain import Terrain, footholds, rough, stairs, waves
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.walkers import (
    WALKERS,
    Part,
    TuningErrors,
    Walker,
    WalkerError,
    as_walker,
    assemble,
    combine,
    interpolate,
    lab_walker_from_parts,
    tune,
    tuning_errors,
)

blend = interpolate
optimise_walker = optimize_walker

__all__ = [
    "WALKERS",
    "Actuation",
    "Basin",
    "BifurcationDiagram",
    "BifurcationLocus",
    "Cascade",
    "Comparison",
    "Design",
    "Evaluation",
    "FootVelocity",
    "Gait",
    "GaitFamily",
    "GaitNotFound",
    "Gauntlet",
    "Impulse",
    "Link",
    "OptimalGait",
    "Outcome",
    "Part",
    "PolicyError",
    "RealityCheck",
    "Robustness",
    "StatementError",
    "Stride",
    "SweepResult",
    "System",
    "Terrain",
    "TimedExtremum",
    "TrainedPolicy",
    "Trajectory",
    "Transition",
    "TuningErrors",
    "VelocityPerturbations",
    "Walker",
    "WalkerError",
    "as_walker",
    "assemble",
    "basin_of_attraction",
    "bifurcation_diagram",
    "bifurcation_locus",
    "closed_loop_gait",
    "collision_matrix",
    "combine",
    "compare",
    "crisis",
    "doubling_cascade",
    "evaluate",
    "explain",
    "export",
    "find_gait",
    "find_gaits",
    "foot_velocity",
    "footholds",
    "gait_family",
    "gauntlet",
    "interpolate",
    "lab_walker_from_parts",
    "largest_push",
    "load_policy",
    "lyapunov_exponents",
    "math",
    "measures",
    "nearest_gait",
    "optimal_gait",
    "optimal_gaits",
    "optimize_walker",
    "parameter_family",
    "play",
    "reality_check",
    "robustness",
    "rough",
    "simulate",
    "stairs",
    "stride",
    "stride_jacobian",
    "stride_map",
    "sweep",
    "tune",
    "tune_to_walk",
    "tuning_errors",
    "waves",
]
