"""Artefacts drawn into the images of a camera: hidden to the pixel, in the light of the place."""
