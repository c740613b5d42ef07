"""Evaluation of controllers: episodes, robustness, and derivatives of an environment's steps."""
