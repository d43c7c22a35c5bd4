"""Readers and writers of the files that users write: catalogues and scenarios."""
