"""Basins and first passage."""
