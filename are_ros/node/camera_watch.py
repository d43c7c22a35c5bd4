"""How long nobody has offered to tell of the camera, and when that is worth a word."""

from typing import Final

from are_ros.conventions import NS_PER_S
from are_ros.node.input_status import GRACE_S

_STAND_IN_S: Final = 3.0


class CameraWatch:
    """Tells when the default camera is to stand in, and when it is to be said that it does.

    Times are those of a clock that never jumps. Publishers are discovered one after the other,
    and a robot may be started after the node: so nothing is said before a map has been on offer
    for the grace, all the while without a CameraInfo.
    """

    def __init__(self) -> None:
        self._blind_since_ns: int | None = None
        self._mapped_since_ns: int | None = None

    def is_to_stand_in(self, now_ns: int, *, is_missing: bool) -> bool:
        """Tell whether a camera has been missing, and no CameraInfo on offer, for some seconds."""
        self._blind_since_ns = _since(self._blind_since_ns, now_ns, holds=is_missing)
        return _has_lasted(self._blind_since_ns, now_ns, _STAND_IN_S)

    def is_to_be_said(self, now_ns: int, *, is_only_map_offered: bool) -> bool:
        """Tell whether there has been a map on offer, but no CameraInfo, for the grace."""
        self._mapped_since_ns = _since(self._mapped_since_ns, now_ns, holds=is_only_map_offered)
        return _has_lasted(self._mapped_since_ns, now_ns, GRACE_S)


def _since(before_ns: int | None, now_ns: int, *, holds: bool) -> int | None:
    """Return since when something has held without a break."""
    if not holds:
        return None
    return now_ns if before_ns is None else before_ns


def _has_lasted(since_ns: int | None, now_ns: int, least_s: float) -> bool:
    return since_ns is not None and now_ns - since_ns >= least_s * NS_PER_S
