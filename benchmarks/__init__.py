"""Measurements of speed and of methods, each a module to run; results go to docs/results."""
