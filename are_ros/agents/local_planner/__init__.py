"""The local planner: a dynamic window over motion primitives, with committed trajectories."""
