"""Messages to numpy and back, bags, and the report of a bag."""
