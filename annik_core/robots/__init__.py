"""Robots: definitions, joints and limits, forward kinematics, corrections."""
