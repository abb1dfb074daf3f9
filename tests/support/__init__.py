"""Helpers that tests share: robots, plans, processes."""
