"""What is to be learned: the inverse kinematics of robots, and functions in closed form."""
