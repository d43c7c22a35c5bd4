"""Recordings of ROS 1 and ROS 2: files, clock, gaps, roles and message types; no replay."""
