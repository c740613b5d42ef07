"""Tests that every option makes the difference that it is there for."""
