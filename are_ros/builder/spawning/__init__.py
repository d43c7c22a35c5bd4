"""Where artefacts arrive: placement, out of the robot's view, on request."""
