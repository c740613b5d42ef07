"""Tests that each option has an effect."""
