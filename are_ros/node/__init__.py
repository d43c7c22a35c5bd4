"""Adapter over ROS 2: the lifecycle node, its parameters, topics, services and diagnostics."""
