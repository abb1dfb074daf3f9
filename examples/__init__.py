"""Examples, and what ``./run demo`` and ``./run learn`` start."""
