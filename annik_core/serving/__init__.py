"""A stream of targets, without ROS: solving, statistics, stamps."""
