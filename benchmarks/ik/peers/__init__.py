"""Solvers of inverse kinematics by others, behind one interface, for 'annik bench ik'."""
