"""Independent measurements, and how they are spread over processes."""
