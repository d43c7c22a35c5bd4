"""Shapes of artefacts: procedural ones, and files of the user's."""
