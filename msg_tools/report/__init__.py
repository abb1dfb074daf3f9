"""Report of the tracking error in a bag."""
