"""Robots in three dimensions, in the browser; no ROS, no torch. See docs/see_your_robot.md."""
