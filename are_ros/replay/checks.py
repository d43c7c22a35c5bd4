"""The invariants of the design, checked on what was recorded, and by nothing that wrote it.

These checks read the recording, the parameters and the map; they share no code with the builder:
geometry, inflation, transforms and the decoding of markers are plain second implementations.
"""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

from are_ros.checks.oracle_solids import RealMap
from are_ros.errors import BagError
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import with_file
from are_ros.replay._check_farewells import check_farewells
from are_ros.replay._check_file import PREFIX, check_file, check_files
from are_ros.replay._check_grids import check_grids
from are_ros.replay._check_live_grids import check_live_grids
from are_ros.replay._check_live_reading import LiveReading
from are_ros.replay._check_lives import check_lives, check_metrics
from are_ros.replay._check_markers import (
    check_marker_fading,
    check_marker_rules,
    check_marker_state,
)
from are_ros.replay._check_overlaps import check_clutter, check_neighbours, check_walls
from are_ros.replay._check_paths import (
    PARAMETERS,
    RECORDING,
    RecordingFiles,
    find_recording,
    walls_of,
)
from are_ros.replay._check_perceived import check_perceived, check_sight_events
from are_ros.replay._check_reading import Reading
from are_ros.replay._check_record import Record
from are_ros.replay._check_result import CheckResult, Outcome, merged
from are_ros.replay._check_robot import check_robot
from are_ros.replay._check_scans import check_scans
from are_ros.replay._check_ticks import check_ticks

__all__ = ("CheckResult", "Outcome", "check_recording", "check_replay")

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
    progress: Callable[[float], None] | None = None,
    parameters_file: Path | None = None,
) -> tuple[CheckResult, ...]:
    """Check a replay's output folder, or a live recording: a folder, an .mcap or a .db3 file.

    A folder with augmented.mcap and metrics.json is a replay's. The real map is `map_file`, else
    the one in the recording; the parameters `parameters_file`, else effective.yaml beside it.
    `progress` is told the share done, 0 to 1. What is wrong with the recording, damaged bytes too,
    is a failed result; what cannot be looked at, a skipped one with the reason. Raises BagError
    where there is no recording of ar_builder, MapError or ParameterError for a bad map file or
    parameters.
    """
    files = find_recording(path)
    parameters = _read_parameters(parameters_file or files.parameters)
    if files.is_replay:
        return _check_replay(files.path, parameters, map_file, progress)
    return _check_live(files, parameters, map_file, progress)


def check_replay(
    folder: Path,
    map_file: Path | None = None,
    progress: Callable[[float], None] | None = None,
) -> tuple[CheckResult, ...]:
    """Check augmented.mcap in a folder as the recording of a replay; see `check_recording`."""
    path = folder / RECORDING
    if not path.is_file():
        raise BagError(f"{folder}: there is no {RECORDING} to check")
    file = folder / PARAMETERS
    parameters = _read_parameters(file if file.is_file() else None)
    return _check_replay(path, parameters, map_file, progress)


def _check_replay(
    path: Path,
    parameters: Parameters | None,
    map_file: Path | None,
    progress: Callable[[float], None] | None,
) -> tuple[CheckResult, ...]:
    meter = _Meter(progress)
    record = Record(parameters, walls=walls_of(path))
    results = check_file(path)
    meter.expect(results[0].looked_at)
    real = None if map_file is None else _read_map(map_file, record.world_frame)
    with Reading(path, record, meter.step) as reading:
        reading.read_all_but_grids()
        record.choose_maps(real)
        results += _scene_results([record])
        results += check_grids(record, reading.grids())
    results += check_scans(record)
    meter.finish()
    return (results[0], reading.tally.result(), *results[1:])


def _check_live(
    files: RecordingFiles,
    parameters: Parameters | None,
    map_file: Path | None,
    progress: Callable[[float], None] | None,
) -> tuple[CheckResult, ...]:
    meter = _Meter(progress)
    results = check_files(files.files)
    meter.expect(results[0].looked_at)
    with LiveReading(files, parameters, meter.step) as reading:
        if reading.is_open and not any(topic.startswith(PREFIX) for topic in reading.topics):
            raise BagError(f"{files.path}: it holds no topic of the node, none begins {PREFIX}")
        reading.read_all_but_grids()
        records = reading.records
        for record in records:
            real = None if map_file is None else _read_map(map_file, record.world_frame)
            record.choose_maps(real)
        results += _scene_results(records)
        results.append(merged([check_farewells(record) for record in records]))
        loops = ((record, reading.grids(number)) for number, record in enumerate(records))
        results += check_live_grids(loops)
    results += [merged(parts) for parts in zip(*map(check_scans, records), strict=True)]
    meter.finish()
    return (results[0], reading.tally.result(), *results[1:])


def _scene_results(records: Iterable[Record]) -> list[CheckResult]:
    loops = [*records]
    return [merged([check(record) for record in loops]) for check in _SCENE_CHECKS]


def _read_map(path: Path, frame_id: str) -> RealMap:
    from are_ros.world.map_file import read_map_file

    return RealMap.of_grid(read_map_file(path, frame_id))


def _read_parameters(path: Path | None) -> Parameters | None:
    """Return the effective parameters, None where they were not kept."""
    return None if path is None else with_file(Parameters(), path)


class _Meter:
    """Tells how much is done: the first pass is a fifth of it, the other two the rest."""

    def __init__(self, progress: Callable[[float], None] | None) -> None:
        self._progress = progress
        self._done = 0
        self._expected = 1

    def expect(self, messages: int) -> None:
        """Begin the other passes."""
        self._expected = max(messages, 1)
        self._tell(0.2)

    def step(self) -> None:
        """Count a message of the other passes."""
        self._done += 1
        if self._done % 64 == 0:
            self._tell(0.2 + 0.8 * min(self._done / self._expected, 1.0))

    def finish(self) -> None:
        """Say that all is done."""
        self._tell(1.0)

    def _tell(self, share: float) -> None:
        if self._progress is not None:
            self._progress(share)
