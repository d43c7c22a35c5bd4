"""Arrival poses: placement, arrivals out of view, requests."""
