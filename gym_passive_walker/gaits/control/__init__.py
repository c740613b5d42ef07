"""Actuated gaits: ticked strides, feedback, optimal gaits, and walkers under a policy."""
