"""A small kinematic robot in a made-up building."""
