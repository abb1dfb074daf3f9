"""`annik study`: error against number of examples."""
