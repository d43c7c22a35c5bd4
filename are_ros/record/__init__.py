"""Recordings played to live nodes, live topics recorded, and the demo that joins both."""
