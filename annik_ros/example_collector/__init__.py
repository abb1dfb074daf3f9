"""example_collector: drives a robot through a plan and measures its poses."""
