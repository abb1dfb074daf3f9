"""Bags: reading, and writing so that a killed recorder loses nothing."""
