"""The model of the artefacts (paper, section 3.2)."""
