"""Pictures of runs, populations and fits: one palette, one legend, one way to draw a map."""
