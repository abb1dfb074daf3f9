"""Simulated robots, perfect or not."""
