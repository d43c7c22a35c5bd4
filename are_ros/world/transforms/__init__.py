"""The frame tree's tables, its lookups, and which source of a transform holds."""
