"""Everything that acts: baselines, algorithms and their presets, training and evaluation."""
