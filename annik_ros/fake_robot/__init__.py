"""fake_robot: a simulated robot that follows commands and reports the tracking error."""
