"""Images <-> messages, raw and compressed, and where their CameraInfo is."""
