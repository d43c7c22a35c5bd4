"""Augmented sensor readings, each at its own stamp."""
