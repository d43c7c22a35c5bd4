"""The edges of a frame tree as a person reads them."""

from dataclasses import dataclass

from are_ros.world._edge_table import Edge, EdgeTable, TransformSource
from are_ros.world._frame_names import FrameNames


@dataclass(frozen=True)
class FrameEdge:
    """An edge as `are inspect` shows it; a static one has stamps 0 and a count of 1.

    `parent` is that of the newest sample; stamps are those of the first and last sample kept [ns].
    """

    parent: str
    child: str
    source: TransformSource
    is_static: bool
    first_ns: int
    last_ns: int
    count: int


def listed_edges(table: EdgeTable, names: FrameNames) -> list[FrameEdge]:
    """Return all edges, sorted by parent and child."""
    edges = [_listed(edge, table, names) for edge in table.edges.values()]
    return sorted(edges, key=lambda edge: (edge.parent, edge.child))


def _listed(edge: Edge, table: EdgeTable, names: FrameNames) -> FrameEdge:
    first_ns, last_ns = table.stamp_of(edge.first), table.stamp_of(edge.end - 1)
    parent, child, count = names[edge.parent], names[edge.child], edge.end - edge.first
    return FrameEdge(parent, child, edge.source, edge.is_static, first_ns, last_ns, count)
