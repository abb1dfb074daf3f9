"""The report of the tracking error in a bag."""
