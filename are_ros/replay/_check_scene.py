"""The artefacts alive at one tick, as `~/artefacts` tells of them, as arrays."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from are_ros.conventions import NS_PER_S

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Scene:
    """N artefacts at `stamp_ns`: their boxes in the frame of the message, upright and turned.

    `ids`, `arrivals_ns`, `departures_ns` (0: unknown) int64 (N,); `centres_m`, `half_sizes_m`
    (N, 3), `yaws_rad` (N,) float64; `problems` say what is no upright box on its ground pose.
    `labels` are N; `offsets_m` (N, 2) are from F_A to the boxes' centres along F_A's axes, `rates`
    (N, 3) those of x, y [m/s] and yaw [rad/s] of F_A in the frame of the message; without them
    nobody moves.
    """

    stamp_ns: int
    log_ns: int
    frame_id: str
    ids: NDArray[np.int64]
    centres_m: Floats
    yaws_rad: Floats
    half_sizes_m: Floats
    arrivals_ns: NDArray[np.int64]
    departures_ns: NDArray[np.int64]
    problems: tuple[str, ...]
    labels: tuple[str, ...] = ()
    offsets_m: Floats = field(default_factory=lambda: np.empty((0, 2)))
    rates: Floats = field(default_factory=lambda: np.empty((0, 3)))

    def is_like(self, other: "Scene | None") -> bool:
        """Tell whether the same boxes stand at the same places."""
        return (
            other is not None
            and np.array_equal(self.ids, other.ids)
            and np.array_equal(self.centres_m, other.centres_m)
            and np.array_equal(self.yaws_rad, other.yaws_rad)
        )


def time_ns(stamp: Any) -> int:
    """Return a builtin_interfaces Time or Duration in nanoseconds."""
    return int(stamp.sec) * NS_PER_S + int(stamp.nanosec)


def read_scene(message: Any, log_ns: int) -> Scene:
    """Return the scene of an are_msgs/ArtefactArray."""
    artefacts = message.artefacts
    poses = np.array([_numbers(a.pose) for a in artefacts], np.float64).reshape(-1, 7)
    grounds = np.array([_numbers(a.ground_pose) for a in artefacts], np.float64).reshape(-1, 7)
    offsets = np.array([_xyz(a.box_centre) for a in artefacts], np.float64).reshape(-1, 3)
    sizes = np.array([_xyz(a.size) for a in artefacts], np.float64).reshape(-1, 3)
    twists = np.array([_planar(a.twist) for a in artefacts], np.float64).reshape(-1, 3)
    along, across = twists[:, 0], twists[:, 1]
    yaws = 2.0 * np.arctan2(poses[:, 5], poses[:, 6])
    cos, sin = np.cos(yaws), np.sin(yaws)
    turned = np.column_stack(
        (
            cos * offsets[:, 0] - sin * offsets[:, 1],
            sin * offsets[:, 0] + cos * offsets[:, 1],
            offsets[:, 2],
        )
    )
    centres = poses[:, :3] + turned
    ids = np.array([a.id for a in artefacts], np.int64)
    wrong = _wrong(poses, grounds, centres, sizes)
    return Scene(
        stamp_ns=time_ns(message.header.stamp),
        log_ns=log_ns,
        frame_id=message.header.frame_id,
        ids=ids,
        centres_m=centres,
        yaws_rad=yaws,
        half_sizes_m=0.5 * sizes,
        arrivals_ns=np.array([time_ns(a.arrival) for a in artefacts], np.int64),
        departures_ns=np.array([time_ns(a.departure) for a in artefacts], np.int64),
        problems=tuple(f"artefact {i} {text}" for text, which in wrong for i in ids[which]),
        labels=tuple(a.label for a in artefacts),
        offsets_m=offsets[:, :2],
        rates=np.column_stack(
            (cos * along - sin * across, sin * along + cos * across, twists[:, 2])
        ),
    )


def _wrong(
    poses: Floats, grounds: Floats, centres: Floats, sizes: Floats
) -> list[tuple[str, NDArray[np.bool_]]]:
    """Return what can be wrong with a pose, and with whose (N,) it is."""
    everything = np.hstack((poses, grounds, centres, sizes))
    finite = np.isfinite(everything).all(axis=1)
    norms = np.abs(np.linalg.norm(poses[:, 3:], axis=1) - 1.0)
    tilts = np.abs(poses[:, 3:5]).max(axis=1, initial=0.0)
    bottoms = centres[:, 2] - 0.5 * sizes[:, 2]
    aside = np.hypot(*(poses[:, :2] - grounds[:, :2]).T)
    turn = np.abs(np.abs(np.sum(poses[:, 3:] * grounds[:, 3:], axis=1)) - 1.0)
    return [
        ("has numbers that are not finite", ~finite),
        ("has a size that is not positive", (sizes <= 0.0).any(axis=1)),
        ("has a rotation that is no unit quaternion", norms > 1e-6),
        ("does not stand upright", tilts > 1e-9),
        ("does not stand on its ground pose", np.abs(bottoms - grounds[:, 2]) > 1e-6),
        ("is not above its ground pose", (aside > 1e-6) | (turn > 1e-9)),
    ]


def _numbers(pose: Any) -> tuple[float, ...]:
    return (*_xyz(pose.position), *_xyz(pose.orientation), pose.orientation.w)


def _planar(twist: Any) -> tuple[float, float, float]:
    return (twist.linear.x, twist.linear.y, twist.angular.z)


def _xyz(vector: Any) -> tuple[float, float, float]:
    return (vector.x, vector.y, vector.z)
