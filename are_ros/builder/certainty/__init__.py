"""What a detector and a tracker make of the artefacts that the camera sees (docs/certainty.md)."""
