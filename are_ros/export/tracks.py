"""The tracks of all artefacts and of the robot: one table, and a file of each in TUM's format."""

import csv
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from are_ros.builder.assembly import robot_footprint
from are_ros.conventions import NS_PER_S
from are_ros.errors import BagError
from are_ros.export.truth import TrueTick, TruthReader
from are_ros.replay.progress import OpenProgress
from are_ros.wording import counted, why_refused
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.footprint import Footprint, signed_distance_m

TABLE, TUM, ROBOT = "tracks.csv", "tum", "robot.txt"
COLUMNS: Final = (
    *("stamp_ns", "id", "label", "class"),
    *("x", "y", "z", "qx", "qy", "qz", "qw"),
    *("vx", "vy", "wz", "length", "width", "height"),
    *("behaviour", "activity", "perceived", "visible_fraction", "cameras", "robot_distance"),
)
"""Poses of F_A in the map's frame [m]; velocities [m/s, rad/s] and sizes [m] along F_A's axes.

The distance [m] is that of the robot's footprint from the artefact's, negative where they overlap.
"""


class _Life(NamedTuple):
    artefact_id: int
    label: str
    arrival_ns: int


def export_tracks(recording: Path, folder: Path, open_progress: OpenProgress) -> str:
    """Write the tracks into a new or empty folder, and return a sentence about them.

    Raises BagError where the recording has no ground truth, or the folder cannot be written.
    """
    reader = TruthReader(recording)
    try:
        (folder / TUM).mkdir(parents=True, exist_ok=True)
        with (folder / TABLE).open("w", newline="", encoding="utf-8") as file:
            ids, ticks, poses = _write(reader, csv.writer(file), folder / TUM, open_progress)
    except OSError as cause:
        raise BagError(f"--tracks {folder}: {why_refused(cause)}") from cause
    robot = f"the robot at {counted(poses, 'tick')}" if poses else "no pose of the robot"
    robot += reader.untold
    counts = f"{counted(ids, 'artefact')}, {counted(ticks, 'tick')}"
    return f"tracks: {folder} ({'; '.join((counts, robot, *reader.left_out))})"


def _write(
    reader: TruthReader, table: Any, tum: Path, open_progress: OpenProgress
) -> tuple[int, int, int]:
    """Write table and files; return the numbers of artefacts, of ticks, and of robot's poses."""
    table.writerow(COLUMNS)
    footprint = robot_footprint(reader.parameters.robot)
    lines: dict[_Life, list[str]] = {}
    files: dict[str, _Life] = {}
    robot: list[str] = []
    ticks = 0
    for tick in reader.read(open_progress, {}):
        ticks += 1
        table.writerows(_rows(tick, footprint))
        scene = tick.scene
        numbers = scene.ids.tolist(), scene.labels, scene.arrivals_ns.tolist()
        alive = [_Life(*life) for life in zip(*numbers, strict=True)]
        there = set(alive)
        for key in [key for key in lines if key not in there]:
            _save(tum, key, files, lines.pop(key))
        for key, pose in zip(alive, scene.poses.tolist(), strict=True):
            lines.setdefault(key, []).append(_tum_line(scene.stamp_ns, pose))
        if (base := tick.map_from_base) is not None:
            pose = (*base.translation_m.tolist(), *base.rotation_xyzw.tolist())
            robot.append(_tum_line(scene.stamp_ns, pose))
    for key in list(lines):
        _save(tum, key, files, lines.pop(key))
    (tum / ROBOT).write_text("".join(robot), encoding="utf-8")
    return len(files), ticks, len(robot)


def _rows(tick: TrueTick, footprint: Footprint) -> list[list[Any]]:
    scene, rows, distances = tick.scene, [], [""] * len(tick.scene.ids)
    if (base := tick.map_from_base) is not None:
        x_m, y_m, _ = base.translation_m.tolist()
        robot = footprint.at(x_m, y_m, base.yaw_rad())
        boxes = OrientedBoxes(scene.centres_m, scene.yaws_rad, scene.half_sizes_m)
        distances = [f"{value:.6g}" for value in signed_distance_m(robot, boxes).tolist()]
    for k, number in enumerate(scene.ids.tolist()):
        seen = tick.sightings.get(number)
        twist = scene.twists[k, (0, 1, 5)].tolist()
        numbers = (*scene.poses[k].tolist(), *twist, *(2.0 * scene.half_sizes_m[k]).tolist())
        rows.append(
            [
                *(scene.stamp_ns, number, scene.labels[k], scene.classes[k]),
                *(f"{value:.9g}" for value in numbers),
                *(scene.behaviours[k], scene.activities[k], int(seen is not None)),
                "" if seen is None else f"{seen.visible_fraction:.6g}",
                "" if seen is None else " ".join(seen.cameras),
                distances[k],
            ]
        )
    return rows


def _tum_line(stamp_ns: int, pose: Sequence[float]) -> str:
    seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
    return " ".join((f"{seconds}.{nanoseconds:09d}", *(f"{value:.9g}" for value in pose))) + "\n"


def _save(tum: Path, life: _Life, files: dict[str, _Life], lines: list[str]) -> None:
    """Write lines of a life to its file; one of the same id, of a later start of the node, has _2.

    `files` are the lives by the names of their files.
    """
    label = re.sub(r"[^\w.-]", "_", life.label)
    name = file_name = f"{label}_{life.artefact_id}"
    again = 1
    while files.setdefault(file_name, life) != life:
        again += 1
        file_name = f"{name}_{again}"
    with (tum / f"{file_name}.txt").open("a", encoding="utf-8") as file:
        file.writelines(lines)
