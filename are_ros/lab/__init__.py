"""Measurements over whole runs: the soak and its judge."""
