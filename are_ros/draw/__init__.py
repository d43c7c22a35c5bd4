"""What people look at: pictures, plots, the animation and the viewer; one palette, one legend."""
