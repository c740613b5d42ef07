"""Statements about walkers in hard conditions, to be tried few times by a test or many times."""
