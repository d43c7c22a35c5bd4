"""What people look at: the viewer, a page to look around in."""
