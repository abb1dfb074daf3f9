"""Whole robots: every URDF of a folder, solved within its joint limits and measured.

Nothing here that checks a solution shares code with the solver: forward kinematics, limits and
restarts are NumPy on what :mod:`benchmarks.ik.peers.serial_chain` reads from the URDF.
"""
