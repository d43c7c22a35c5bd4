"""The names of the simulated robot's frames, as REP 105 and TurtleBot have them."""

from typing import Final

MAP_FRAME: Final = "map"
ODOM_FRAME: Final = "odom"
BASE_FRAME: Final = "base_footprint"
SCAN_FRAME: Final = "base_scan"
CAMERA_FRAME: Final = "camera_optical_frame"
