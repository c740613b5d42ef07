"""Tests of the models and the engine against independent mechanics."""
