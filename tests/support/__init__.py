"""Helpers that tests share: robots, plans, recordings, processes, a client over DDS."""

import os

# Read when rclpy and the message packages are imported, here and in the processes started.
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
