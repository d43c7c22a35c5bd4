"""The real environment as values (paper, section 3.1)."""
