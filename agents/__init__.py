"""Learning agents: algorithms and their presets, training, evaluation and the benchmark."""

from gym_passive_walker.gaits.control.maps import closed_loop_gait

__all__ = ["closed_loop_gait"]
