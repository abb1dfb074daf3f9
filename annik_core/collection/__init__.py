"""Collection of measured examples on a robot."""
