"""Simulate a GPU, as in `tests.gpu`."""

from tests.gpu.conftest import quick_turns  # noqa: F401  (a fixture)
