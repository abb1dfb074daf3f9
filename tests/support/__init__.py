"""Helpers that tests share: robots, plans, recordings, processes, a client over DDS."""

import os
import sys

# Read when numpy and torch are imported. Beside other workers and nodes, several threads only wait
# for each other.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
# Read when rclpy and the message packages are imported, here and in the processes started.
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
# Otherwise each process compiles all of annik again.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
