"""From a kernel's status to the error that it means."""

from are_ros.conventions import NS_PER_S
from are_ros.errors import (
    DisconnectedFramesError,
    ExtrapolationToFutureError,
    ExtrapolationToPastError,
    FrameError,
)
from are_ros.world._edge_kernels import FUTURE, LOOP, PAST, STATUSES
from are_ros.world._edge_table import EdgeTable
from are_ros.world._frame_names import FrameNames


def lookup_error(status: int, asked: str, table: EdgeTable, names: FrameNames) -> FrameError:
    """Return the error for a status other than `FOUND`; `asked` opens its sentence."""
    frame, reason = divmod(status, STATUSES)
    if reason == LOOP:
        return DisconnectedFramesError(f"{asked}: the transforms at that time close a loop")
    if reason not in {PAST, FUTURE}:
        return DisconnectedFramesError(f"{asked}: no chain of transforms joins these frames")
    edge = table.edges[frame]
    name = f"{names[edge.parent]} -> {names[edge.child]}"
    if reason == FUTURE:
        return ExtrapolationToFutureError(f"{asked}: {name} ends at {in_seconds(edge.newest_ns)}")
    begins_ns = table.stamp_of(edge.first)
    return ExtrapolationToPastError(f"{asked}: {name} begins at {in_seconds(begins_ns)}")


def in_seconds(stamp_ns: int) -> str:
    """Return a stamp as text with all its digits."""
    return f"{stamp_ns // NS_PER_S}.{stamp_ns % NS_PER_S:09d} s"
