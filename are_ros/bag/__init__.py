"""Recordings: what the node, a replay or `are record` wrote, as plain values."""
