"""Solvers of inverse kinematics by others, behind one interface, for './run bench ik'."""
