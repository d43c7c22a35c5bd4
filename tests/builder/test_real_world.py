"""The real environment as it arrives: maps and clouds, good and bad, in any frame and order."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from are_ros.builder.real_world import RealWorld
from are_ros.errors import InputError
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.world.environment import Environment
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.transforms.tree import FrameTree
from are_ros.world.voxel_map import VoxelMap

Room = Callable[..., OccupancyGrid]
CUBE = np.argwhere(np.ones((4, 4, 4))) * 0.1 + 0.05
NO_TURN = (0.0, 0.0, 0.0, 1.0)


def world(**values: Any) -> tuple[RealWorld, FrameTree]:
    """Return a world with some values of `world.` set, and its frames."""
    paths = {f"world.{name}": value for name, value in values.items()}
    frames = FrameTree()
    return RealWorld(with_values(Parameters(), paths).world, "map", frames), frames


@pytest.fixture
def room(make_scene: Callable[..., Any]) -> Room:
    """Return a maker of rooms."""
    maker: Room = make_scene().room
    return maker


def now(real: RealWorld) -> Environment:
    """Return the environment, which there must be."""
    assert real.environment is not None
    return real.environment


def voxels_of(real: RealWorld) -> VoxelMap:
    """Return M3D, which there must be."""
    voxels = now(real).voxels
    assert voxels is not None
    return voxels


def low_corner(real: RealWorld) -> npt.NDArray[np.float64]:
    """Return the low corner of M3D."""
    corner: npt.NDArray[np.float64] = voxels_of(real).bounds_m()[0]
    return corner


def is_nowhere(real: RealWorld) -> bool:
    """Say whether there is no environment yet."""
    return real.environment is None


def test_without_a_cloud_the_walls_are_extruded(room: Room) -> None:
    """One tall voxel for each occupied cell, from the ground to world.wall_height."""
    real, _ = world(wall_height=1.2, ground_height=0.5)
    assert is_nowhere(real)
    real.set_grid(room())
    voxels = voxels_of(real)
    assert voxels.is_extruded
    assert voxels.occupied_count == 40 * 40 - 38 * 38
    np.testing.assert_allclose(voxels.bounds_m(), [[0.0, 0.0, 0.5], [4.0, 4.0, 1.7]])
    assert now(real).ground.heights(np.zeros((1, 2))).tolist() == [0.5]


def test_an_equal_map_changes_nothing_and_another_one_all(room: Room) -> None:
    """Environments are told apart by their version, which increases."""
    real, _ = world()
    real.set_grid(room())
    first = real.environment
    again = room()
    real.set_grid(again)
    assert real.environment is first
    assert real.grid is again
    real.set_grid(room((5, 6, 5, 6)))
    assert first is not None
    assert now(real).version > first.version


def test_a_map_without_free_space_is_said_until_there_is_some(room: Room) -> None:
    """Nobody can arrive on it: one sentence, also for the next such map; again after a good one."""
    real, _ = world()
    assert not real.has_free_cells
    closed = [replace(room(), cells=np.full_like(room().cells, value)) for value in (100, -1)]
    for grid in (*closed, room(), closed[0]):
        real.set_grid(grid)
    count = closed[0].cells.size
    why = "the map has no free cell, so nobody can arrive: of"
    rest = "are unknown, the others above world.free_threshold"
    assert [notice.rsplit(",", 1)[0] for notice in real.notices] == [
        f"{why} {count} cells 0 {rest}"
    ] * 2
    assert not real.has_free_cells


def test_thresholds_that_contradict_refuse_every_map(room: Room) -> None:
    """The second time as the first, and there is no environment."""
    real, _ = world(occupied_threshold=20, free_threshold=30)
    for _ in range(2):
        with pytest.raises(InputError, match="threshold"):
            real.set_grid(room())
    assert is_nowhere(real)
    assert real.grid is None


def test_a_cloud_may_come_before_the_map(room: Room) -> None:
    """It is used once there is one."""
    real, _ = world()
    real.set_cloud(CUBE, None, "map")
    assert is_nowhere(real)
    real.set_grid(room())
    assert voxels_of(real).occupied_count == 64
    np.testing.assert_allclose(low_corner(real), 0.0, atol=1e-9)


def test_an_equal_cloud_changes_nothing(room: Room) -> None:
    """As octomap_server sends it again and again."""
    real, _ = world()
    real.set_grid(room())
    real.set_cloud(CUBE, None, "map")
    first = real.environment
    real.set_cloud(CUBE.copy(), None, "map")
    assert real.environment is first


def test_a_cloud_that_is_made_coarser_is_said_once(room: Room) -> None:
    """Both sizes and how many there are then; no multiple moves walls, and that is said."""
    centres = (np.argwhere(np.ones((4, 4, 8))) + 0.5) * 0.05
    for size_m, said in (
        (0.1, "the cloud's voxels of 0.05 m become 16 of 0.1 m"),
        (0.15, "the cloud's voxels of 0.05 m become 12 of 0.15 m"),
        (0.08, "become 45 of 0.08 m; that is no multiple, so that walls are off by up to 0.025 m"),
    ):
        real, _ = world(voxel_size=size_m)
        real.set_grid(room())
        real.set_cloud(centres, None, "map")
        real.set_cloud(centres[:-1], None, "map")
        (sentence,) = real.notices
        assert sentence.endswith(said)


def test_a_cloud_that_lies_beside_the_map_is_said_once(room: Room) -> None:
    """Whichever comes first, and again after one that lies in it."""
    away = CUBE + np.array((300.0, 0.0, 0.0))
    for map_first in (True, False):
        real, _ = world()
        if map_first:
            real.set_grid(room())
        real.set_cloud(away, None, "map")
        real.set_grid(room())
        assert len(real.notices) == 1
        for cloud in (away + 1.0, CUBE, away):
            real.set_cloud(cloud, None, "map")
        assert len(real.notices) == 2
        assert real.notices[0].startswith(
            "no voxel of the octomap lies in the map: it is at x 300.0 to 300.4 m, y 0.0 to 0.4 m"
        )


def test_a_cloud_is_placed_by_the_newest_pose_of_its_frame(room: Room) -> None:
    """It waits for its frame without disturbing anybody, and is placed once."""
    real, frames = world()
    real.set_grid(room())
    before = real.environment
    real.set_cloud(CUBE, None, "laser")
    real.retry_cloud()
    assert real.environment is before
    assert real.missing_frame() == "laser"
    for stamp_ns, x in ((1, 1.0), (2, 2.0)):
        frames.set_transform("map", "laser", stamp_ns, (x, 0.5, 0.0), NO_TURN)
    real.retry_cloud()
    np.testing.assert_allclose(low_corner(real), (2.0, 0.5, 0.0), atol=1e-9)
    after = real.environment
    frames.set_transform("map", "laser", 3, (3.0, 0.5, 0.0), NO_TURN)
    real.retry_cloud()
    assert real.environment is after
    assert real.missing_frame() == ""


def test_a_bad_cloud_is_refused_at_once_in_any_frame(room: Room) -> None:
    """Also when its frame is not known yet, each time anew; the last good one stays."""
    real, _ = world()
    real.set_grid(room())
    real.set_cloud(CUBE, None, "map")
    good = real.environment
    for frame_id in ("map", "unknown"):
        for _ in range(2):
            with pytest.raises(InputError):
                real.set_cloud(np.zeros((1, 3)), None, frame_id)
    real.retry_cloud()
    assert real.environment is good
    assert real.missing_frame() == ""


def test_a_cloud_that_turns_out_tilted_is_dropped_with_a_sentence(room: Room) -> None:
    """A retry never raises: it runs inside a tick."""
    real, frames = world()
    real.set_grid(room())
    before = real.environment
    real.set_cloud(CUBE, None, "tilted")
    half = float(np.sqrt(0.5))
    frames.set_static("map", "tilted", (0.0, 0.0, 0.0), (half, 0.0, 0.0, half))
    real.retry_cloud()
    assert real.environment is before
    assert real.missing_frame() == ""
    (sentence,) = real.notices
    assert "'tilted'" in sentence
    assert real.dropped == sentence
    assert "tilts" in sentence


def test_a_newer_good_cloud_replaces_the_one_that_waits(room: Room) -> None:
    """The older one never comes back when its frame becomes known."""
    real, frames = world()
    real.set_grid(room())
    real.set_cloud(CUBE, None, "late")
    real.set_cloud(CUBE + 1.0, None, "map")
    frames.set_static("map", "late", (3.0, 3.0, 0.0), NO_TURN)
    real.retry_cloud()
    np.testing.assert_allclose(low_corner(real), 1.0, atol=1e-9)


@pytest.mark.parametrize(
    ("given", "parameter", "expected"), [(None, 0.0, 0.1), (0.1, 0.0, 0.1), (0.1, 0.2, 0.2)]
)
def test_the_voxel_size_is_the_parameters_else_the_files_else_inferred(
    room: Room, given: float | None, parameter: float, expected: float
) -> None:
    """In this order."""
    real, _ = world(voxel_size=parameter)
    real.set_grid(room())
    centres_m = CUBE if expected == 0.1 else CUBE * 2.0
    real.set_cloud(centres_m, given, "map")
    assert voxels_of(real).voxel_size_m == pytest.approx((expected,) * 3)


def test_the_ground_is_the_plane_or_the_floor_voxels(room: Room) -> None:
    """With voxels, artefacts stand on the top of the floor; a voxel and a centimetre is slack."""
    floor = np.argwhere(np.ones((10, 10, 1))) * 0.1 + 0.05
    for kind, height_m in (("plane", 0.0), ("voxels", 0.1)):
        real, _ = world(ground=kind)
        real.set_grid(room())
        real.set_cloud(floor, 0.1, "map")
        heights = now(real).ground.heights(np.array([[0.5, 0.5]]))
        assert heights[0] == pytest.approx(height_m)
        assert now(real).ground_clearance_m == pytest.approx(0.11)


def test_the_clearance_can_be_set(room: Room) -> None:
    """Else it is a voxel and a centimetre."""
    real, _ = world(ground_clearance=0.3)
    real.set_grid(room())
    assert now(real).ground_clearance_m == 0.3
