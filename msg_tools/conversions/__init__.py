"""Conversions between ROS messages and numpy arrays."""
