"""The decision process: the coarse map, backward induction, tables of values, routes."""
