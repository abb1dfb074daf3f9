"""Kinematic calibration of an arm from measured poses."""
