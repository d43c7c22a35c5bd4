"""The zones file: what it says, what is refused, and which cells a polygon covers."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.errors import ParameterError
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.regions import Zone, polygon_mask, read_zones_file, region_of_zones
from are_ros.world.rigid_transform import RigidTransform


def _grid(
    height: int, width: int, resolution_m: float = 1.0, origin: RigidTransform | None = None
) -> OccupancyGrid:
    cells = np.zeros((height, width), np.int8)
    return OccupancyGrid(cells, resolution_m, origin or RigidTransform.identity(), "map")


def _slow_mask(polygon_m: npt.NDArray[np.float64], grid: OccupancyGrid) -> npt.NDArray[np.bool_]:
    """Count, for each cell centre on its own, the edges that cross the ray to its right."""
    mask = np.zeros((grid.height, grid.width), np.bool_)
    for row in range(grid.height):
        for col in range(grid.width):
            px, py = grid.cells_to_points([(row, col)])[0]
            for (ax, ay), (bx, by) in zip(polygon_m, np.roll(polygon_m, -1, axis=0), strict=True):
                if (ay > py) != (by > py) and px < ax + (py - ay) * (bx - ax) / (by - ay):
                    mask[row, col] ^= True
    return mask


def _file(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "zones.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_is_read_as_it_stands(tmp_path: Path) -> None:
    """Names, polygons, weights and no-spawn polygons come back as written."""
    path = _file(
        tmp_path,
        "zones:\n"
        "- {name: hall, polygon: [[0, 0], [2, 0], [2, 1.5]], weight: 3}\n"
        "- {polygon: [[5, 5], [6, 5], [6, 6], [5, 6]]}\n"
        "no_spawn: [[[0, 0], [1, 0], [0, 1]]]\n",
    )
    content = read_zones_file(path)
    assert [(zone.name, zone.weight) for zone in content.zones] == [("hall", 3.0), ("zone 1", 1.0)]
    np.testing.assert_array_equal(content.zones[0].polygon_m, [[0, 0], [2, 0], [2, 1.5]])
    np.testing.assert_array_equal(content.no_spawn[0], [[0, 0], [1, 0], [0, 1]])
    assert not content.zones[0].polygon_m.flags.writeable


def test_lists_may_be_left_out(tmp_path: Path) -> None:
    """A file of no-spawn polygons alone has no zones."""
    content = read_zones_file(_file(tmp_path, "no_spawn: [[[0, 0], [1, 0], [0, 1]]]\nzones:\n"))
    assert content.zones == ()
    assert len(content.no_spawn) == 1


def test_entrances_and_exits_stand_in_for_each_other(tmp_path: Path) -> None:
    """Ways in are entrances, else zones; ways out are exits, else entrances, else none."""
    polygon = "polygon: [[0, 0], [1, 0], [0, 1]]"
    zones, entrances, exits = (
        f"{name}: [{{{polygon}}}]\n" for name in ("zones", "entrances", "exits")
    )

    def ways(text: str) -> list[list[str]]:
        content = read_zones_file(_file(tmp_path, text))
        return [[way.name for way in ways] for ways in (content.ways_in, content.ways_out)]

    assert ways(zones) == [["zone 0"], []]
    assert ways(exits) == [[], ["exit 0"]]
    assert ways(zones + entrances) == [["entrance 0"], ["entrance 0"]]
    assert ways(zones + entrances + exits) == [["entrance 0"], ["exit 0"]]


def test_weights_add_where_zones_overlap() -> None:
    """Two squares of weights 2 and 0.5 share two cells."""
    square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
    zones = [Zone("a", square, 2.0), Zone("b", square + np.array((1.0, 0.0)), 0.5)]
    expected = np.zeros((3, 4))
    expected[:2, :3] = (2.0, 2.5, 0.5)
    region = region_of_zones(zones, np.ones((3, 4), np.bool_), _grid(3, 4))
    np.testing.assert_array_equal(region.weight, expected)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("zones: [", "is no valid YAML"),
        ("[1, 2]", "must map some of entrances, exits, no_spawn, zones to lists"),
        ("", "must map some of"),
        ("zones: 3", "zones is no list"),
        ("zone: []", "zone is not known; did you mean 'zones'"),
        ("zones: [1]", r" zones\[0\] is a number, but a mapping is needed"),
        ("zones: [{name: 3, polygon: [[0, 0], [1, 0], [0, 1]]}]", r"zones\[0\]\.name is 3"),
        ("zones: [{name: a, polygon: [[0, 0], [1, 0]]}]", r"zones\[0\]\.polygon is no list of at"),
        ("zones: [{name: a}]", r"zones\[0\]\.polygon is no list"),
        ("zones: [{polygon: [[0, 0], [1, 0], [0, x]]}]", r"zones\[0\]\.polygon\[2\] is \[0, 'x'\]"),
        ("zones: [{polygon: [[0, 0], [1, 0], [0, .inf]]}]", r"\[2\] is \[0, inf\]"),
        ("zones: [{polygon: [[0, 0], [1, 0], [0, 1, 2]]}]", r"\[2\] is \[0, 1, 2\]"),
        ("zones: [{polygon: [[0, 0], [1, 0], [0, 1]], weight: 0}]", "weight is 0, but must be"),
        ("zones: [{polygon: [[0, 0], [1, 0], [0, 1]], weight: 1.0e+39}]", "weight is 1e\\+39, but"),
        ("zones: [{polygon: [[0, 0], [1, 0], [0, 1]], weight: 1.0e-46}]", "weight is 1e-46, but"),
        ("zones: [{polygon: [[0, 0], [1, 0], [0, 1.0e+308]]}]", "has a corner at 1e\\+308 m"),
        ("zones: [{polygon: [[0, 0], [1, 0], [0, 1]], weight: true}]", r"weight is True"),
        ("zones: [{polygon: [[0, 0], [1, 0], [0, 1]], colour: 1}]", r"\[0\]\.colour is not known"),
        ("zones: [{polygon: [[1, 1], [2, 2], [3, 3]]}]", r"polygon encloses nothing: its corners"),
        ("no_spawn: [[[1, 1], [1, 1], [1, 1]]]", r"no_spawn\[0\] encloses nothing: its corners"),
        ("no_spawn: [[[0, 0], [1, 0], 5]]", r"no_spawn\[0\]\[2\] is 5"),
        ("no_spawn: {}", "no_spawn is no list"),
        ("entrances: 1", "entrances is no list"),
        ("exits: [{polygon: [[0, 0], [1, 0]]}]", r"exits\[0\]\.polygon is no list of at least"),
    ],
)
def test_a_bad_file_is_refused_in_one_sentence(tmp_path: Path, text: str, reason: str) -> None:
    """The error names the file, the field and the reason on one line."""
    path = _file(tmp_path, text)
    with pytest.raises(ParameterError, match=reason) as refusal:
        read_zones_file(path)
    assert str(refusal.value).startswith(str(path))
    assert "\n" not in str(refusal.value)


def test_a_file_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    """Neither a missing file nor bytes that are no text raise anything but the family's error."""
    with pytest.raises(ParameterError, match="cannot be read"):
        read_zones_file(tmp_path / "missing.yaml")
    (tmp_path / "bytes.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ParameterError, match="cannot be read"):
        read_zones_file(tmp_path / "bytes.yaml")


def test_a_square_covers_the_cells_with_their_centres_in_it() -> None:
    """From (0.5, 1) to (2.5, 3): low edges belong to it, high edges do not."""
    square = np.array([[0.5, 1.0], [2.5, 1.0], [2.5, 3.0], [0.5, 3.0]])
    expected = np.zeros((4, 4), np.bool_)
    expected[1:3, 0:2] = True
    np.testing.assert_array_equal(polygon_mask(square, _grid(4, 4)), expected)


@given(
    corners=st.lists(
        st.tuples(st.floats(-4.0, 12.0), st.floats(-4.0, 12.0)), min_size=3, max_size=7
    )
)
def test_any_polygon_covers_what_a_slow_count_says(corners: list[tuple[float, float]]) -> None:
    """Even self-crossing polygons, partly outside, agree with a cell by cell crossing count."""
    polygon_m = np.array(corners) + np.array([np.pi, np.e]) / 1e3  # no edge meets a centre
    grid = _grid(9, 7)
    np.testing.assert_array_equal(polygon_mask(polygon_m, grid), _slow_mask(polygon_m, grid))


def test_a_turned_and_shifted_grid_is_honoured() -> None:
    """On a grid with yaw 0.7 and a fine resolution the slow count agrees too."""
    grid = _grid(20, 30, 0.25, RigidTransform.planar(-1.0, 2.0, 0.7))
    polygon_m = np.array([[-1.0, 2.5], [2.5, 4.0], [0.5, 7.0], [0.0, 4.0]])
    mask = polygon_mask(polygon_m, grid)
    assert mask.sum() > 40
    np.testing.assert_array_equal(mask, _slow_mask(polygon_m, grid))
