"""Vectorized environments for trainers that use PyTorch tensors: rsl_rl, skrl, torchrl."""
