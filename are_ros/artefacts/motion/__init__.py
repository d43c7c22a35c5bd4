"""Motion planning: short committed trajectories, free of collisions, that end in a stand."""
