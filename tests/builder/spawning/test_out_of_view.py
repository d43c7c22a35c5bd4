"""What no camera sees: bracketed by the z-buffer on the boxes as they are and a little larger."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pytest

from are_ros.builder.occlusion.rays import VoxelField
from are_ros.builder.occlusion.zbuffer import ZBuffer
from are_ros.builder.spawning.spawner import OutOfView
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.cameras import (
    FORWARD_FROM_OPTICAL,
    CameraAt,
    FisheyeView,
    OmnidirectionalView,
    PinholeView,
    ViewModel,
)
from are_ros.world.environment import Environment, PlaneGround
from are_ros.world.occupancy_grid import OccupancyGrid, classify
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap

VIEW = PinholeView.from_field_of_view(160, 120, math.pi / 2)
VIEWS: dict[str, ViewModel] = {
    "pinhole": VIEW,
    "distorted": PinholeView(90, 70, 60.0, 61.0, 44.0, 35.0, (-0.3, 0.02) + (0.0,) * 12),
    "fisheye": FisheyeView(90, 70, 22.0, 22.0, 45.0, 33.0, (0.01, 0.0, 0.0, 0.0)),
    "omnidirectional": OmnidirectionalView(150, 50, -0.8, 0.6),
    "tiny": PinholeView.from_field_of_view(7, 5, 1.0),
}


@dataclass(frozen=True)
class Blind(ViewModel):
    """A view of which no pixel has a ray."""

    width: int = 20
    height: int = 10

    def _rays(self) -> npt.NDArray[np.float64]:
        return np.full((self.height, self.width, 3), np.nan)


def _camera(x: float, y: float, z: float, yaw: float = 0.0, pitch: float = 0.0) -> RigidTransform:
    return RigidTransform.from_xyz_ypr(x, y, z, yaw, pitch, 0.0) @ FORWARD_FROM_OPTICAL


def _environment(voxels: VoxelMap | None) -> Environment:
    cells = np.zeros((10, 10), np.int8)
    grid = OccupancyGrid(cells, 1.0, RigidTransform.identity(), "map")
    return Environment(grid, classify(grid, 65, 25), voxels, PlaneGround(0.0), 0.01)


def _clutter(rng: np.random.Generator) -> VoxelMap:
    """Return blocks about an empty middle, where the camera is."""
    occupied = np.kron(rng.random((7, 6, 3)) < 0.15, np.ones((4, 4, 2))).astype(np.uint8)
    occupied[9:20, 7:18] = 0
    return VoxelMap(RigidTransform.planar(-5.0, -4.0, 0.2, z=-0.2), (0.35, 0.35, 0.3), occupied)


def _crowd(rng: np.random.Generator, count: int) -> OrientedBoxes:
    centres = rng.uniform((-7.0, -7.0, 0.1), (7.0, 7.0, 1.3), (count, 3))
    return OrientedBoxes(centres, rng.uniform(-3.1, 3.1, count), rng.uniform(0.0, 0.6, (count, 3)))


def _seen(
    view: ViewModel, camera: RigidTransform, boxes: OrientedBoxes, voxels: VoxelMap, grown: float
) -> npt.NDArray[np.bool_]:
    larger = OrientedBoxes(boxes.centres_m, boxes.yaws_rad, boxes.half_sizes_m + grown)
    buffer = ZBuffer(view, 6.0)
    shown = buffer.visibility(camera, larger, VoxelField.of(voxels), None, False)
    return shown.visible_pixels > 0


@pytest.mark.parametrize("name", list(VIEWS))
@pytest.mark.parametrize("seed", range(6))
def test_it_lies_between_the_zbuffer_on_the_boxes_and_on_larger_ones(name: str, seed: int) -> None:
    """Whatever shows in a pixel is in view; whatever is in view shows when grown by 2 mm.

    Looking at few pixels first changes no answer: they are those of all pixels, grown by 1 mm.
    """
    rng = np.random.default_rng(seed)
    voxels, boxes, view = _clutter(rng), _crowd(rng, 400), VIEWS[name]
    x, y, z, yaw, pitch = rng.uniform((-0.3, -0.3, 0.5, -3.1, -0.4), (0.3, 0.3, 1.5, 3.1, 0.4))
    camera = _camera(x, y, z, yaw, pitch)
    unseen = OutOfView(6.0)
    unseen.look(_environment(voxels), [CameraAt(0, view, camera)])
    hidden = unseen.hides(boxes)
    assert not (hidden & _seen(view, camera, boxes, voxels, 0.0)).any()
    assert _seen(view, camera, boxes, voxels, 2e-3)[~hidden].all()
    np.testing.assert_array_equal(hidden, ~_seen(view, camera, boxes, voxels, 1e-3))
    assert 20 < np.count_nonzero(hidden) < 395


def test_the_order_of_the_questions_changes_no_answer() -> None:
    """One by one, backwards, or all at once: what was looked up before does not matter."""
    rng = np.random.default_rng(3)
    environment, boxes = _environment(_clutter(rng)), _crowd(rng, 200)
    viewpoint = CameraAt(0, VIEW, _camera(0.1, 0.2, 1.0, 0.5))
    together, backwards = OutOfView(6.0), OutOfView(6.0)
    together.look(environment, [viewpoint])
    backwards.look(environment, [viewpoint])
    hidden = together.hides(boxes)
    one_by_one = [bool(backwards.hides(boxes.at(i))[0]) for i in reversed(range(len(boxes)))]
    assert one_by_one[::-1] == hidden.tolist()
    np.testing.assert_array_equal(together.hides(boxes), hidden)
    assert together.hides(OrientedBoxes.empty()).shape == (0,)


WALL = VoxelMap(RigidTransform.planar(2.0, -1.0, 0.0), (0.1, 0.1, 2.0), np.ones((1, 20, 1), "u1"))
AHEAD, FAR, BEHIND_WALL, BEHIND, ABOUT = range(5)
PLACES = OrientedBoxes(
    np.array([(1.5, 0, 1), (6.2, 4.2, 1), (3, 0, 1), (-2, 0, 1), (0.1, 0.0, 1.0)]),
    np.zeros(5),
    np.full((5, 3), 0.2),
)
"""In front of a wall, beyond the range, behind the wall, behind the camera, about the camera."""


def _indices(mask: npt.NDArray[np.bool_]) -> list[int]:
    return [int(i) for i in np.flatnonzero(mask)]


def _hidden(*viewpoints: CameraAt, max_range_m: float = 5.0) -> list[int]:
    unseen = OutOfView(max_range_m)
    unseen.look(_environment(WALL), viewpoints)
    return _indices(unseen.hides(PLACES))


def test_walls_range_and_field_of_view_hide() -> None:
    """Boxes of the same question do not hide each other, the one about the camera neither."""
    forward = CameraAt(0, VIEW, _camera(0.0, 0.0, 1.0))
    assert _hidden(forward) == [FAR, BEHIND_WALL, BEHIND]
    assert _hidden(forward, max_range_m=30.0) == [BEHIND_WALL, BEHIND]


def test_all_cameras_count() -> None:
    """Hidden is what none sees; with no camera, or none with a ray, everything is."""
    forward = CameraAt(0, VIEW, _camera(0.0, 0.0, 1.0))
    backward = CameraAt(0, VIEW, _camera(0.0, 0.0, 1.0, math.pi))
    assert _hidden(forward, backward) == [FAR, BEHIND_WALL]
    assert _hidden() == [AHEAD, FAR, BEHIND_WALL, BEHIND, ABOUT]
    assert OutOfView(5.0).hides(PLACES).all()
    unseen = OutOfView(5.0)
    blind: ViewModel = Blind()
    unseen.look(_environment(WALL), [CameraAt(0, blind, RigidTransform.identity())])
    assert unseen.hides(PLACES).all()


def test_every_change_of_what_is_looked_at_counts() -> None:
    """Another pose, view model, number of cameras or environment; the same again is no change."""
    unseen, environment = OutOfView(5.0), _environment(WALL)
    camera = _camera(0.0, 0.0, 1.0)
    narrow = PinholeView.from_field_of_view(80, 60, 0.1)

    def hidden(where: Environment, *viewpoints: CameraAt) -> list[int]:
        unseen.look(where, viewpoints)
        return _indices(unseen.hides(PLACES))

    assert hidden(environment, CameraAt(0, VIEW, camera)) == [FAR, BEHIND_WALL, BEHIND]
    assert hidden(environment, CameraAt(0, VIEW, _camera(0.0, 0.0, 1.0, math.pi))) == [
        AHEAD,
        FAR,
        BEHIND_WALL,
    ]
    up = _camera(0.0, 0.0, 1.0, 0.0, -1.2)
    assert hidden(environment, CameraAt(0, VIEW, up)) == [AHEAD, FAR, BEHIND_WALL, BEHIND]
    assert hidden(environment, CameraAt(0, VIEW, camera)) == [FAR, BEHIND_WALL, BEHIND]
    assert hidden(environment, CameraAt(0, VIEW, _camera(0.0, 0.0, 1.0))) == [
        FAR,
        BEHIND_WALL,
        BEHIND,
    ]
    assert hidden(_environment(None), CameraAt(0, VIEW, camera)) == [FAR, BEHIND]
    aside = CameraAt(0, narrow, _camera(0.0, 0.0, 1.0, 0.5))
    assert hidden(environment, aside) == [AHEAD, FAR, BEHIND_WALL, BEHIND]
    assert hidden(environment) == [AHEAD, FAR, BEHIND_WALL, BEHIND, ABOUT]
