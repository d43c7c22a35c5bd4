"""Look through a recording: `are inspect` and `are align`."""
