"""Settings for every test."""

from hypothesis import HealthCheck, settings

# The first example of a test may compile a kernel, which takes as long as it takes.
settings.register_profile(
    "walkers", deadline=None, max_examples=100, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("walkers")
