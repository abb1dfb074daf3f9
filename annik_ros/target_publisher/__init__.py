"""target_publisher: publishes a path of target poses."""
