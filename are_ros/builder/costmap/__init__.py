"""The augmented map and costmap (section 3.3)."""
