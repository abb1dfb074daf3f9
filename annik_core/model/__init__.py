"""The model file: its graph, its metadata, and the session that runs it."""
