"""Benchmarks of inverse kinematics."""
