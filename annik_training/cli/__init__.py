"""The ``annik`` command line."""
