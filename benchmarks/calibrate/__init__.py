"""Calibrations of real arms beside each other, in the same splits of public measurements."""
