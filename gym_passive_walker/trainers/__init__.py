"""Walkers as trainers that live on tensors take them: rsl_rl, skrl, torchrl."""
