"""Adapter over recorded bags."""
