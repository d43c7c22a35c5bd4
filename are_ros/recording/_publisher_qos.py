"""The quality of service to record with, from what the publishers of a topic offer."""

from collections.abc import Sequence
from typing import Final

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from are_ros.replay.offered_qos import OfferedQos

_DEPTH, _BULKY_DEPTH = 1000, 100
"""Messages that may wait in the middleware; they are taken many times in a second."""

_BULKY: Final = frozenset(
    f"{package}/msg/{name}"
    for package, names in {
        "nav_msgs": ("OccupancyGrid",),
        "sensor_msgs": ("CompressedImage", "Image", "PointCloud", "PointCloud2"),
        "stereo_msgs": ("DisparityImage",),
    }.items()
    for name in names
)
"""Types of whose messages a thousand would fill the memory."""


def offered_by(profile: QoSProfile) -> OfferedQos:
    """Return in rosbag2's words what one publisher was found to offer."""
    return OfferedQos(
        reliability=profile.reliability.name.lower(),
        durability=profile.durability.name.lower(),
        history=profile.history.name.lower(),
        depth=profile.depth,
        deadline_ns=profile.deadline.nanoseconds,
        lifespan_ns=profile.lifespan.nanoseconds,
        liveliness=profile.liveliness.name.lower(),
        lease_ns=profile.liveliness_lease_duration.nanoseconds,
    )


def matching(offered: Sequence[OfferedQos], type_name: str) -> QoSProfile:
    """Return what all publishers can serve: reliable, or transient local, only if each of them is.

    A subscription that asked for more would get nothing from those that offer less.
    """
    is_reliable = all(profile.reliability == "reliable" for profile in offered)
    is_latched = all(profile.durability == "transient_local" for profile in offered)
    return QoSProfile(
        depth=_BULKY_DEPTH if type_name in _BULKY else _DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if is_reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if is_latched else DurabilityPolicy.VOLATILE,
    )
