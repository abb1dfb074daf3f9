"""Designs of experiments: which joint positions the examples have."""
