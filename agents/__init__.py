"""Learning agents: algorithms and their presets, training, evaluation and the benchmark."""
