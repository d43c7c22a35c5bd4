"""ARE: an Augmented Reality Environment for mobile robots."""

from are_ros._version import __version__

__all__ = ["__version__"]
