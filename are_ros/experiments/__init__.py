"""Experiments: what is measured over whole runs (section 4)."""
