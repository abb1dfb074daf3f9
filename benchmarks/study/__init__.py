"""`./run study`: error against number of examples."""
