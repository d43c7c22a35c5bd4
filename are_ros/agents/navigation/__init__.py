"""From where an agent wants to be to its next sub-goal: destinations, free ground, ways."""
