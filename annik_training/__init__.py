"""Offline training: designs of experiments, datasets, network, fit, evaluation, export."""
