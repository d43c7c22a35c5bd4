"""The invariants of the design, checked on what was recorded, and by nothing that wrote it.

These checks read the recording, the parameters and the map; they share no code with the builder:
geometry, inflation, transforms and the decoding of markers are plain second implementations.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from are_ros.bag.recording import PREFIX, find_recording
from are_ros.checks.certainty import check_certainty, check_predicted
from are_ros.checks.file import check_files
from are_ros.checks.grids import check_grids
from are_ros.checks.markers import check_marker_fading, check_marker_rules, check_marker_state
from are_ros.checks.oracle.solids import RealMap
from are_ros.checks.overlaps import check_clutter, check_neighbours, check_robot, check_walls
from are_ros.checks.record import Reading
from are_ros.checks.result import CheckResult, Outcome
from are_ros.checks.sensors.depth_images import DepthFrame
from are_ros.checks.sensors.missing import check_missing
from are_ros.checks.sensors.octomap import check_octomap
from are_ros.checks.sensors.painted import check_boxes, check_images
from are_ros.checks.sensors.scans import check_depths, check_scans
from are_ros.checks.sightings import check_perceived, check_sight_events
from are_ros.checks.ticks import check_farewells, check_lives, check_metrics, check_ticks
from are_ros.errors import BagError
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import with_file
from are_ros.world.map_io import read_map_file

__all__ = ("CheckResult", "Outcome", "check_recording")

_SCENE_CHECKS: Final = (
    check_ticks,
    check_lives,
    check_metrics,
    check_perceived,
    check_sight_events,
    check_walls,
    check_neighbours,
    check_robot,
    check_clutter,
    check_marker_rules,
    check_marker_state,
    check_marker_fading,
)


def check_recording(
    path: Path,
    map_file: Path | None = None,
    parameters_file: Path | None = None,
) -> Iterator[CheckResult]:
    """Check a replay's output folder, or a live recording: a folder, an .mcap or a .db3 file.

    A folder with augmented.mcap and metrics.json is a replay's. The real map is `map_file`, else
    the one in the recording; the parameters `parameters_file`, else those that the run tells.
    What is wrong with the recording, damaged bytes too, is a failed result; what cannot be looked
    at, a skipped one with the reason. Of a file that cannot be opened nothing else follows. Each
    comes when it is known; those of readings take longest.
    Raises BagError where there is no recording of ar_builder, MapError or ParameterError for a bad
    map file or parameters.
    """
    files = find_recording(path)
    chosen = None if parameters_file is None else with_file(Parameters(), parameters_file)
    parameters = chosen or files.told
    is_live = not files.is_replay
    of_file, *of_others = check_files(files.files, is_live=is_live)
    with Reading(files, parameters) as reading:
        if is_live and reading.is_open and not any(t.startswith(PREFIX) for t in reading.topics):
            raise BagError(f"{files.path}: it holds no topic of the node, none begins {PREFIX}")
        yield of_file
        if not reading.is_open:  # there is nothing to look at
            yield reading.tally.result()
            return
        reading.read_all_but_grids()
        record = reading.record
        given = None
        if map_file is not None:
            given = RealMap.of_grid(read_map_file(map_file, record.world_frame))
        record.choose_maps(given)
        checks = (*_SCENE_CHECKS, check_farewells) if is_live else _SCENE_CHECKS
        if parameters is not None and parameters.certainty.enabled:
            checks = (*checks, check_certainty, check_predicted)
        of_scene = [check(record) for check in checks]
        of_grids = check_grids(record, reading.grids())
    yield from (reading.tally.result(), *of_others, *of_scene, *of_grids)
    yield from check_scans(record)
    yield check_missing(record)
    for is_there, check in (
        (record.scans.counts[DepthFrame], check_depths),
        (record.has_images, check_images),
        (record.has_boxes, check_boxes),
        (record.octomaps.kept, check_octomap),
    ):
        if is_there:
            yield check(record)
