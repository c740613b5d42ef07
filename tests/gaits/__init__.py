"""Tests of the gait analysis."""
