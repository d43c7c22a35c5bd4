"""The files that a user writes: catalogues and scenarios."""
