"""The part of annik that needs neither ROS nor torch: robots, poses, models, the IK solver."""
