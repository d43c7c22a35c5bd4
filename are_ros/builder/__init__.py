"""The AR-builder (paper, section 3.3)."""
