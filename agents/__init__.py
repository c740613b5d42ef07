"""Everything that acts: baselines, algorithms and their presets, training and evaluation."""

from agents.closed_loop import ClosedLoopGait, closed_loop_gait

__all__ = ["ClosedLoopGait", "closed_loop_gait"]
