"""What is in a recording: `are inspect` and `are align`."""
