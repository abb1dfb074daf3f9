"""Bags: reading, and writing that survives a killed recorder."""
