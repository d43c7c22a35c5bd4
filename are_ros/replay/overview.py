"""overview.png: a run seen from above, who went where, and what the robot perceived of it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.draw.scene import SceneRecord
from are_ros.replay._picture_artefacts import (
    bounding_boxes,
    class_colours,
    draw_artefacts,
    drawn_lives,
)
from are_ros.replay._picture_behaviours import behaviour_counts, behaviour_marks
from are_ros.replay._picture_company import companies
from are_ros.replay._picture_frame import Sheet, draw_frame, draw_map
from are_ros.replay._picture_labels import draw_labels, squares
from are_ros.replay._picture_legend import legends
from are_ros.replay._picture_map import known_part, window_of
from are_ros.replay._picture_marks import draw_marks, mark_places
from are_ros.replay._picture_paths import (
    Way,
    displacements,
    draw_companies,
    draw_ways,
    way_of,
)
from are_ros.replay._picture_robot import (
    draw_fans,
    draw_path,
    robot_outline,
    robot_places,
    tag_rectangles,
)
from are_ros.replay._picture_view import Fan, Sight, fan_at, spread_indices, telling_indices
from are_ros.replay._picture_voxels import hiding_part, with_furniture
from are_ros.replay.output_folder import METRICS
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.voxel_map import VoxelMap

Floats = npt.NDArray[np.float64]

_SHOWN_FANS: Final = 3
_SWEPT_FANS: Final = 60
_MARK_PT: Final = 8.0
_PATH_PT, _PATH_POINTS = 4.0, 400


def draw_overview(
    record: SceneRecord,
    grid: OccupancyGrid,
    path: Path,
    *,
    occupied_threshold: int,
    ids_as_in: str = METRICS,
    voxels: VoxelMap | None = None,
) -> None:
    """Write the picture of a run over its map, as PNG; the same input gives the same bytes.

    It shows the known part of the map, what stands there by the octomap (`voxels`, if there is
    one), the robot's path, some of its fields of view as far as the octomap at the camera's height,
    or else the walls of the map, and taller artefacts let them reach, and each artefact where it
    ended, with the way that it went there. `ids_as_in` names where a reader finds the ids again.
    Settings of matplotlib in force change nothing.
    """
    import matplotlib as mpl

    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update({"hatch.linewidth": 0.7, "font.family": "DejaVu Sans"})
        figure = _figure(record, grid, occupied_threshold, ids_as_in, voxels)
        figure.savefig(path, format="png", metadata={"Software": None})


def _figure(
    record: SceneRecord,
    grid: OccupancyGrid,
    occupied_threshold: int,
    ids_as_in: str = METRICS,
    voxels: VoxelMap | None = None,
) -> Any:
    part, end_ns = known_part(grid), _end_ns(record)
    hiding, shown_cells = part, part
    if voxels is not None and len(record.camera):
        camera_m = float(np.median(record.camera.poses[:, 2]))
        hiding = hiding_part(grid, part, voxels, camera_m)
        shown_cells = with_furniture(grid, part, voxels)
    drawn = drawn_lives(record.lives, end_ns)
    colours = class_colours([life.row.class_name for life in record.lives])
    marks = behaviour_marks([*behaviour_counts(record.lives)])
    moved = displacements(record.events)
    ways = [way_of(item.life, moved.get(item.life.artefact_id, ())) for item in drawn]
    found = companies(record.lives, end_ns)
    outlines = [item.corners_m for item in drawn] + [way.points_m for way in ways]
    window = window_of(grid, part, np.concatenate((record.robot.poses[:, :2], *outlines)))
    handles = legends(record, colours, marks, has_companies=bool(found))
    sheet = Sheet.of(window, handles)
    swept, shown = _fans(record, Sight(grid, hiding, occupied_threshold))
    draw_map(sheet, grid, shown_cells)
    draw_fans(sheet.axes, record, swept, shown, window)
    tags = tag_rectangles(record, sheet.points_per_m, window, bounding_boxes(drawn))
    draw_path(sheet.axes, record, shown, sheet.points_per_m, tags)
    draw_ways(sheet.axes, ways, colours, marks, sheet.points_per_m)
    draw_companies(sheet.axes, found, colours)
    draw_artefacts(sheet.axes, drawn, colours, sheet.points_per_m)
    draw_marks(sheet.axes, record)
    leaders = {one.follower.artefact_id: one.leader.artefact_id for one in found}
    avoided = _avoided(record, ways, shown, sheet.points_per_m)
    labelled = draw_labels(sheet.axes, drawn, leaders, window, sheet.points_per_m, tags, avoided)
    without_id = len(drawn) - labelled
    draw_frame(sheet, record, handles, without_id=without_id, ids_as_in=ids_as_in)
    return sheet.figure


def _avoided(
    record: SceneRecord, ways: Sequence[Way], shown: Sequence[Fan], points_per_m: float
) -> Floats:
    """Return the rectangles (N, 4) [m] that ids had better not cover: marks, robot and path."""
    begins = np.array([way.points_m[0] for way in ways], dtype=np.float64).reshape(-1, 2)
    marks = np.concatenate((begins, *mark_places(record)))
    robot_m = float(np.ptp(robot_outline(record.footprint), axis=0).max())
    robots = squares(robot_places(record, shown), robot_m)
    path = record.robot.poses[:: max(1, len(record.robot) // _PATH_POINTS), :2]
    path_m, marks_m = _PATH_PT / points_per_m, _MARK_PT / points_per_m
    return np.concatenate((squares(marks, marks_m), robots, squares(path, path_m)))


def _end_ns(record: SceneRecord) -> int:
    stamps = record.series.stamps_ns
    return int(stamps[-1]) if len(stamps) else 0


def _fans(record: SceneRecord, sight: Sight) -> tuple[list[Fan], list[Fan]]:
    """Return the fans that make up the area seen, and the few that are drawn one by one."""

    def fans(indices: list[int]) -> list[Fan]:
        found = (fan_at(record, sight, index) for index in indices)
        return [fan for fan in found if fan is not None]

    swept = spread_indices(record, _SWEPT_FANS)
    return fans(swept), fans(telling_indices(record, _SHOWN_FANS))
