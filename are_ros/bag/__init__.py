"""Recordings: read, written, decoded; their clock, gaps, roles and message types."""
