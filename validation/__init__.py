"""Comparison of Garcia (1999), chapter 4, and other publications with computed numbers.

    python -m validation --out docs/validation.md

Each module computes the rows of some sections; `page` writes them to a file.
"""
