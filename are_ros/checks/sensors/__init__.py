"""Readings of sensors beside their inputs, and the octomap."""
