"""`are`: the command line, a thin shell over the package."""

from are_ros.cli.shell import main

__all__ = ("main",)
