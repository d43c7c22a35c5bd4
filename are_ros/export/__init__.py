"""What `are export` writes for other programs: the scene as a mesh, and data sets."""
