"""The environment's surface as a marker for rviz: the part of S_E that is real (section 3.3)."""

from typing import Final

from are_ros.builder.markers import (
    DELETE_ALL,
    Colour,
    MarkerAction,
    MarkerBatch,
    MarkerKind,
    MarkerLook,
)
from are_ros.world.surface import exposed_surface
from are_ros.world.voxel_map import VoxelMap

ENVIRONMENT: Final = "environment"
"""The namespace of the marker, whose id is 0."""

_GREY: Final[Colour] = (0.81, 0.82, 0.84, 1.0)
_ENDLESS_NS: Final = 0
_DELETE: Final = MarkerLook(ENVIRONMENT, MarkerKind.TRIANGLE_LIST, MarkerAction.DELETE)


class EnvironmentDisplay:
    """Remembers which voxels viewers have been given the surface of.

    That marker is large: it has no lifetime, so that it need not be sent again and again, and its
    triangles are computed anew only for other voxels.
    """

    def __init__(self) -> None:
        self._voxels: VoxelMap | None = None
        self._look: MarkerLook | None = None
        self._shown: MarkerLook | None = None

    def prepare(self, voxels: VoxelMap | None) -> None:
        """Compute the surface now, so that the next tick does not have to."""
        if voxels is not self._voxels:
            self._voxels, self._look = voxels, _look_of(voxels)

    def added_to(self, markers: MarkerBatch, voxels: VoxelMap | None) -> MarkerBatch:
        """Return the markers of a tick, with what brings viewers up to date with the voxels.

        The surface is added if it is new, or if the markers begin with a DELETEALL; a DELETE if
        there is no surface any more. `voxels` that did not change are the same object.
        """
        if markers.looks[:1] == DELETE_ALL.looks:
            self._shown = None
        self.prepare(voxels)
        if self._look is self._shown:
            return markers
        self._shown = self._look
        return markers.followed_by(MarkerBatch.unposed([self._look or _DELETE], [0]))


def _look_of(voxels: VoxelMap | None) -> MarkerLook | None:
    """Return the surface's looks in the map's frame, None if there is no surface."""
    if voxels is None or not voxels.occupied_count:
        return None
    vertices_m, faces = exposed_surface(voxels)
    return MarkerLook(
        ENVIRONMENT,
        MarkerKind.TRIANGLE_LIST,
        colour=_GREY,
        points=vertices_m[faces.ravel()],
        lifetime_ns=_ENDLESS_NS,
    )
