"""sensor_msgs/CameraInfo and the numbers of it that a view model is made of."""

from struct import Struct
from typing import Any, Final

import numpy as np

from are_ros.messages.cdr import CdrWriter
from are_ros.messages.common import read_array
from are_ros.world.cameras import CameraInfo

_SIZE: Final = Struct("<2I")
_K_R_P: Final = Struct("<30d")
_ROI: Final = Struct("<4I?")


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
        do_rectify=bool(roi.do_rectify),
    )


def encode_camera_info(info: CameraInfo, frame_id: str, stamp_ns: int) -> bytes:
    """Return a sensor_msgs/CameraInfo; struct.error unless k, r and p have their lengths."""
    x, y, width, height = info.roi
    writer = CdrWriter()
    writer.header(frame_id, stamp_ns)
    writer.pack(_SIZE, 4, info.height, info.width)
    writer.text(info.distortion_model)
    writer.numbers(np.array(info.d), "<f8")
    writer.pack(_K_R_P, 8, *info.k, *info.r, *info.p)
    writer.pack(_SIZE, 4, info.binning_x, info.binning_y)
    writer.pack(_ROI, 4, x, y, height, width, info.do_rectify)
    return writer.message()


def _numbers(message: Any, name: str) -> tuple[float, ...]:
    values = getattr(message, name if hasattr(message, name) else name.upper())
    return tuple(read_array(values, np.float64).tolist())
