"""A stream of targets, without ROS: answers, statistics, stamps."""
