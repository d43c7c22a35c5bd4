"""The displays of rviz as state machines: markers, maps, frames; and its colours."""

from typing import Any

import numpy as np
import pytest

from are_ros.bag.types import RosbagsFactory, jazzy_typestore
from are_ros.conventions import NS_PER_S
from are_ros.messages.transforms import StampedTransform
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.replay.rviz_frames import RvizFrames
from are_ros.replay.rviz_grids import MapDisplay, costmap_palette, map_palette
from are_ros.replay.rviz_markers import MarkerDisplay

ARRAY = "visualization_msgs/msg/MarkerArray"
MAKE = RosbagsFactory().make
Row = tuple[str, int, int, int]


def array_of(*rows: Row) -> bytes:
    """Return a MarkerArray of (namespace, id, action, lifetime in ns)."""
    markers = [
        MAKE(
            "visualization_msgs/msg/Marker",
            ns=namespace,
            id=number,
            action=action,
            lifetime=MAKE(
                "builtin_interfaces/msg/Duration",
                sec=life_ns // NS_PER_S,
                nanosec=life_ns % NS_PER_S,
            ),
        )
        for namespace, number, action, life_ns in rows
    ]
    return bytes(jazzy_typestore().serialize_cdr(MAKE(ARRAY, markers=markers), ARRAY))


def keys(display: MarkerDisplay, now_ns: int = 0) -> list[tuple[str, int]]:
    """Return what is shown."""
    return [(marker.namespace, marker.number) for marker in display.shown(now_ns)]


def test_an_add_replaces_and_a_delete_removes() -> None:
    """Markers are told apart by namespace and id."""
    display = MarkerDisplay()
    display.take(0, array_of(("a", 1, 0, 0), ("b", 1, 0, 0), ("a", 2, 0, 0)))
    display.take(1, array_of(("a", 1, 0, 5), ("b", 1, 2, 0), ("z", 9, 2, 0)))
    assert keys(display) == [("a", 1), ("a", 2)]
    assert display.shown(0)[0].lifetime_ns == 5
    assert display.complaints == []


def test_delete_all_takes_a_namespace_or_everything() -> None:
    """And what follows it in the message is shown."""
    display = MarkerDisplay()
    display.take(0, array_of(("a", 1, 0, 0), ("b", 1, 0, 0)))
    display.take(0, array_of(("a", 0, 3, 0)))
    assert keys(display) == [("b", 1)]
    display.take(0, array_of(("", 0, 3, 0), ("c", 4, 0, 0)))
    assert keys(display) == [("c", 4)]


def test_a_lifetime_counts_from_the_last_reception() -> None:
    """It ends exactly then; a tenth of a millisecond is endless, as it is in rviz."""
    display = MarkerDisplay()
    display.take(10, array_of(("a", 1, 0, NS_PER_S), ("a", 2, 0, 100_000)))
    assert keys(display, NS_PER_S + 9) == [("a", 1), ("a", 2)]
    assert keys(display, NS_PER_S + 10) == [("a", 2)]
    display.take(NS_PER_S, array_of(("a", 1, 0, NS_PER_S)))
    assert keys(display, 2 * NS_PER_S - 1) == [("a", 1), ("a", 2)]


def test_what_rviz_complains_of_is_kept() -> None:
    """Twins in a message, an unknown action, bytes that are none; the rest is shown."""
    display = MarkerDisplay()
    display.take(0, array_of(("a", 1, 0, 0), ("a", 1, 0, 0), ("b", 2, 1, 0)))
    display.take(0, b"\0\1\0\0\1\0\0\0")
    assert keys(display) == [("a", 1)]
    assert len(display.complaints) == 3
    assert "same namespace and id" in display.complaints[0]


def grid_of(cells: list[list[int]]) -> Any:
    """Return an OccupancyGrid."""
    data = np.array(cells, np.int8)
    info = MAKE(
        "nav_msgs/msg/MapMetaData", resolution=0.5, width=data.shape[1], height=data.shape[0]
    )
    header = MAKE("std_msgs/msg/Header", frame_id="map")
    return MAKE("nav_msgs/msg/OccupancyGrid", header=header, info=info, data=data.reshape(-1))


def update_of(x: int, y: int, cells: list[list[int]]) -> Any:
    """Return an OccupancyGridUpdate."""
    data = np.array(cells, np.int8)
    return MAKE(
        "map_msgs/msg/OccupancyGridUpdate",
        x=x,
        y=y,
        width=data.shape[1],
        height=data.shape[0],
        data=data.reshape(-1),
    )


def test_updates_patch_the_map() -> None:
    """Before the first map they are left out; x counts columns, y rows."""
    early = MapDisplay()
    early.take_update(update_of(0, 0, [[100]]))
    assert early.grid is None
    display = MapDisplay()
    display.take_grid(grid_of([[0, 0, 0], [0, 0, 0]]))
    display.take_update(update_of(1, 0, [[7, 8], [9, 10]]))
    grid = display.grid
    assert grid is not None
    assert grid.cells.tolist() == [[0, 7, 8], [0, 9, 10]]
    assert display.complaint == ""


@pytest.mark.parametrize(("x", "y"), [(2, 0), (0, 1), (-1, 0), (0, -1)])
def test_an_update_beyond_the_map_changes_nothing(x: int, y: int) -> None:
    """And it is a complaint."""
    display = MapDisplay()
    display.take_grid(grid_of([[0, 0, 0], [0, 0, 0]]))
    display.take_update(update_of(x, y, [[7, 8], [9, 10]]))
    assert display.grid is not None
    assert not display.grid.cells.any()
    assert "beyond the map" in display.complaint


def test_a_malformed_map_leaves_the_old_one() -> None:
    """A next one that is right makes good."""
    display = MapDisplay()
    display.take_grid(grid_of([[5]]))
    broken = grid_of([[1, 2]])
    broken.info.width = 3
    display.take_grid(broken)
    assert display.grid is not None
    assert display.grid.cells.tolist() == [[5]]
    assert display.complaint
    display.take_grid(grid_of([[6]]))
    assert display.complaint == ""


def test_palettes_are_those_of_rviz() -> None:
    """Values that its source gives, as unsigned bytes: -1 is 255."""
    plain, costs = map_palette(), costmap_palette()
    assert plain[[0, 50, 100]].tolist() == [
        [255, 255, 255, 255],
        [128, 128, 128, 255],
        [0, 0, 0, 255],
    ]
    assert costs[[0, 1, 98, 99, 100]].tolist() == [
        [0, 0, 0, 0],
        [2, 0, 253, 255],
        [249, 0, 6, 255],
        [0, 255, 255, 255],
        [255, 0, 255, 255],
    ]
    for palette in (plain, costs):
        assert palette[255].tolist() == [0x70, 0x89, 0x86, 255]
        assert palette[[101, 127]].tolist() == [[0, 255, 0, 255]] * 2
        assert palette[[128, 254]].tolist() == [[255, 0, 0, 255], [255, 255, 0, 255]]


def transform(parent: str, child: str, second: int, x: float) -> StampedTransform:
    """Return an edge without a turn."""
    return StampedTransform(parent, child, second * NS_PER_S, (x, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def test_frames_are_known_at_their_newest_and_at_a_stamp() -> None:
    """Static ones always; leading slashes are none."""
    frames = RvizFrames()
    frames.take(
        [transform("map", "odom", 1, 1.0), transform("map", "odom", 3, 3.0)], is_static=False
    )
    frames.take([transform("odom", "base_link", 0, 10.0)], is_static=True)
    newest, then = frames.newest("map", "/base_link"), frames.at("map", "base_link", 2 * NS_PER_S)
    assert newest is not None
    assert then is not None
    assert newest.translation_m[0] == pytest.approx(13.0)
    assert then.translation_m[0] == pytest.approx(12.0)
    assert frames.at("map", "base_link", 4 * NS_PER_S) is None
    assert set(frames.axes("map")) == {"map", "odom", "base_link"}
    assert frames.base() == "base_link"
    torso = with_values(Parameters(), {"frames.base": "torso"})
    assert RvizFrames(torso).base() == "torso"
    assert frames.complaints == []


def test_a_frame_that_is_not_there_is_a_complaint() -> None:
    """As is a transform that cannot be taken."""
    frames = RvizFrames()
    assert frames.newest("map", "nowhere") is None
    frames.take([transform("map", "map", 0, 1.0)], is_static=True)
    assert len(frames.complaints) == 2
    assert frames.newest("map", "map") is not None
    assert frames.base() == "base_footprint"
