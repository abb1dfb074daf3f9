"""Learn the robot that is there from poses measured on it."""
