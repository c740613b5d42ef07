"""What learns to walk: algorithms and their presets, training, evaluation and the benchmark."""

from gym_passive_walker.control.closed_loop import ClosedLoopGait, closed_loop_gait

__all__ = ["ClosedLoopGait", "closed_loop_gait"]
