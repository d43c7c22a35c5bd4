"""`are`: the command line, a thin shell over the package."""

import os

os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")  # a damaged picture is refused in our sentence

from are_ros.cli.shell import main

__all__ = ("main",)
