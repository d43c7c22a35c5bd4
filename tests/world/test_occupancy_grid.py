"""The grid: where its cells lie, what is refused, how cells are classed."""

import array
import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

from are_ros.errors import InputError
from are_ros.world.occupancy_grid import MAX_SIDE, OccupancyGrid, classify, distances_in_cells
from are_ros.world.rigid_transform import RigidTransform

GOOD: dict[str, Any] = {
    "data": [0, 100, -1, 50, 25, 65],
    "width": 3,
    "height": 2,
    "resolution_m": 0.5,
    "origin_xyz_m": (1.0, 2.0, 0.0),
    "origin_rotation_xyzw": (0.0, 0.0, 0.0, 1.0),
    "frame_id": "map",
}


def grid_with(**changes: Any) -> OccupancyGrid:
    """Return a checked 3 x 2 grid with some fields changed."""
    return OccupancyGrid.checked(**{**GOOD, **changes})


def test_rows_run_along_y_and_columns_along_x() -> None:
    """The message's data are row by row from the origin, x fastest."""
    grid = grid_with()
    assert grid.cells.tolist() == [[0, 100, -1], [50, 25, 65]]
    assert (grid.height, grid.width, grid.cell_area_m2) == (2, 3, 0.25)
    cells = grid.points_to_cells(np.array([[1.0, 2.0], [2.49, 2.99], [0.99, 3.0]]))
    assert cells.tolist() == [[0, 0], [1, 2], [2, -1]]
    assert grid.contains(cells).tolist() == [True, True, False]
    assert grid.cells_to_points([[1, 2]]).tolist() == [[2.25, 2.75]]


@settings(deadline=None)
@given(
    x=st.floats(-100, 100),
    y=st.floats(-100, 100),
    yaw=st.floats(-math.pi, math.pi),
    resolution=st.sampled_from((0.01, 0.05, 0.3)),
    seed=st.integers(0, 2**31),
)
def test_cells_of_a_rotated_grid_are_those_of_the_inverse_transform(
    x: float, y: float, yaw: float, resolution: float, seed: int
) -> None:
    """points_to_cells agrees with the general inverse; centres come back to their cells."""
    origin = RigidTransform.planar(x, y, yaw)
    grid = OccupancyGrid(np.zeros((7, 9), np.int8), resolution, origin, "map")
    points = np.random.default_rng(seed).uniform(-5, 5, (40, 2)) + np.array((x, y))
    local = origin.inverse().apply(np.column_stack((points, np.zeros(40))))[:, :2] / resolution
    clear = np.abs(local - np.round(local)).min(axis=1) > 1e-6
    expected = np.floor(local)[:, ::-1]
    assert np.array_equal(grid.points_to_cells(points)[clear], expected[clear])
    cells = np.argwhere(np.ones((7, 9)))
    assert np.array_equal(grid.points_to_cells(grid.cells_to_points(cells)), cells)


def test_points_that_are_not_finite_lie_outside() -> None:
    """No cell index of theirs wraps around into the grid."""
    points = np.array([[math.nan, 2.1], [math.inf, 2.1], [1.1, -math.inf], [1e300, 0.0]])
    grid = grid_with()
    assert not grid.contains(grid.points_to_cells(points)).any()


def test_cells_are_a_read_only_copy() -> None:
    """A message whose buffer is reused cannot change the grid, nor can a user of it."""
    data = np.zeros(6, dtype=np.int8)
    grid = grid_with(data=data)
    data[0] = 100
    assert grid.cells[0, 0] == 0
    with pytest.raises(ValueError, match="read-only"):
        grid.cells[0, 0] = 1


@pytest.mark.parametrize(
    "data",
    [array.array("b", [0, 100, -1, 50, 25, 65]), np.array([[0, 100, -1], [50, 25, 65]], np.int16)],
)
def test_both_middlewares_arrays_are_taken(data: npt.ArrayLike) -> None:
    """An array.array of rclpy, and any integer array in two dimensions, will do."""
    assert grid_with(data=data).cells.tolist() == [[0, 100, -1], [50, 25, 65]]


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"frame_id": ""}, "header.frame_id"),
        ({"resolution_m": 1e-6}, ": resolution is "),
        ({"resolution_m": -0.05}, ": resolution is "),
        ({"resolution_m": math.nan}, ": resolution is "),
        ({"resolution_m": math.inf}, ": resolution is "),
        ({"width": 0, "data": []}, ": width is "),
        ({"height": 0, "data": []}, ": height is "),
        ({"width": MAX_SIDE + 1}, ": width is "),
        ({"width": -3, "height": -2}, ": width is "),
        ({"width": 2**14 + 1, "height": 2**14}, "width x height is 16385 x 16384"),
        ({"width": 2**14, "height": 2**14}, "data has 6 cells"),
        ({"data": [0] * 5}, "data has 5 cells"),
        ({"data": np.zeros((3, 2), np.int8)}, "width x height is 3 x 2"),
        ({"data": [0, 0, 0, 0, 0, 101]}, "value 101"),
        ({"data": [0, 0, 0, 0, 0, -2]}, "value -2"),
        ({"data": [0.0] * 6}, "float64"),
        ({"origin_xyz_m": (0.0, math.nan, 0.0)}, "info.origin.position"),
        ({"origin_xyz_m": (0.0, 0.0)}, "info.origin.position"),
        ({"origin_xyz_m": (0.0, -1e300, 0.0)}, "info.origin.position"),
        ({"origin_rotation_xyzw": (0.0, 0.0, 0.0, 0.0)}, "no rotation at all is (0, 0, 0, 1)"),
        ({"origin_rotation_xyzw": (0.0, 0.0, 0.0, 1.001)}, "info.origin.orientation"),
        ({"origin_rotation_xyzw": (0.0, 0.0, 0.0, math.nan)}, "info.origin.orientation"),
        ({"origin_rotation_xyzw": (1.0, 0.0, 0.0, 0.0)}, "tilts the map by 3.1416"),
        ({"origin_rotation_xyzw": (0.001, 0.0, 0.0, 1.0)}, "only a rotation about z"),
    ],
)
def test_bad_fields_are_refused_by_name(changes: dict[str, Any], field: str) -> None:
    """Each refusal is one sentence with the topic, the field and the reason."""
    with pytest.raises(InputError) as caught:
        grid_with(source="/map", **changes)
    assert str(caught.value).startswith("/map: ")
    assert field in str(caught.value)


def test_float32_quaternions_are_normalised_and_small_tilts_dropped() -> None:
    """Noise within Nav2's tolerance is taken, and the stored rotation is an exact yaw."""
    yaw = 0.7
    rotation = (1e-4, -1e-4, math.sin(yaw / 2) * 1.00003, math.cos(yaw / 2) * 1.00003)
    origin = grid_with(origin_rotation_xyzw=rotation).origin
    assert origin.yaw_rad() == pytest.approx(yaw, abs=1e-7)
    assert np.linalg.norm(origin.rotation_xyzw) == pytest.approx(1.0, abs=1e-15)
    assert origin.rotation_xyzw[:2].tolist() == [0.0, 0.0]


def test_every_value_has_its_class() -> None:
    """Occupied from 65 up, free from 0 to 25, unknown is neither, over all 102 values."""
    values = np.arange(-1, 101, dtype=np.int8)
    grid = grid_with(data=values, width=102, height=1)
    classes = classify(grid, 65, 25)
    assert np.flatnonzero(classes.occupied[0]).tolist() == list(range(66, 102))
    assert np.flatnonzero(classes.free[0]).tolist() == list(range(1, 27))
    assert not (classes.free & classes.occupied).any()
    assert not classes.free.flags.writeable


def test_thresholds_that_cross_are_refused() -> None:
    """A cell would be free and occupied at once."""
    with pytest.raises(InputError, match="not below"):
        classify(grid_with(), 25, 25)


@given(
    x_m=st.floats(-5.0, 5.0, allow_nan=False),
    y_m=st.floats(-5.0, 5.0, allow_nan=False),
    yaw_rad=st.floats(-3.0, 3.0),
)
def test_one_point_has_the_cell_that_many_points_have(
    x_m: float, y_m: float, yaw_rad: float
) -> None:
    """`cell_at` agrees with `points_to_cells`, and gives None outside the grid and for NaN."""
    origin = RigidTransform.planar(-1.0, 0.5, yaw_rad)
    grid = OccupancyGrid(np.zeros((30, 20), np.int8), 0.1, origin, "map")
    row, col = grid.points_to_cells(np.array([(x_m, y_m)]))[0].tolist()
    inside = 0 <= row < 30 and 0 <= col < 20
    assert grid.cell_at(x_m, y_m) == ((row, col) if inside else None)
    assert grid.cell_at(math.nan, y_m) is None


@pytest.mark.parametrize("border", [0, 1])
def test_distances_are_exact_wherever_their_array_lies_in_memory(border: int) -> None:
    """To the last bit, each time; a library's fast way is off by an ulp at some addresses."""
    random = np.random.default_rng(3)
    is_clear = random.random((66, 79)) > 0.003
    padded = np.pad(is_clear, border)
    inner = slice(border, -border or None)
    expected = distance_transform_edt(padded)[inner, inner].astype(np.float32)
    elsewhere = []
    for size in random.integers(1, 5000, 200):
        elsewhere.append(np.empty(size, np.uint8))
        np.testing.assert_array_equal(distances_in_cells(is_clear, border), expected)
