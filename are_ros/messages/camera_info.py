"""The numbers of a sensor_msgs/CameraInfo that a view model is made of."""

from typing import Any

import numpy as np

from are_ros.messages.common import read_array
from are_ros.world.cameras import CameraInfo


def read_camera_info(message: Any, source: str = "camera_info") -> CameraInfo:
    """Return the numbers of a CameraInfo of ROS 2 (d, k, r, p) or of ROS 1 (D, K, R, P).

    Nothing is checked here: `CameraInfo.view` does that, with `source` in its sentences.
    """
    roi = message.roi
    return CameraInfo(
        width=int(message.width),
        height=int(message.height),
        distortion_model=str(message.distortion_model),
        d=_numbers(message, "d"),
        k=_numbers(message, "k"),
        r=_numbers(message, "r"),
        p=_numbers(message, "p"),
        binning_x=int(message.binning_x),
        binning_y=int(message.binning_y),
        roi=(int(roi.x_offset), int(roi.y_offset), int(roi.width), int(roi.height)),
        source=source,
    )


def _numbers(message: Any, name: str) -> tuple[float, ...]:
    values = getattr(message, name if hasattr(message, name) else name.upper())
    return tuple(read_array(values, np.float64).tolist())
