"""The invariants of the design, checked on what a replay wrote, and by nothing that wrote it.

These checks read the recording, the parameters and the map; they share no code with the builder:
geometry, inflation, transforms and the decoding of markers are plain second implementations.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from are_ros.errors import BagError
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import read_ros_parameters
from are_ros.replay._check_cells import RealMap
from are_ros.replay._check_file import check_file
from are_ros.replay._check_grids import check_grids
from are_ros.replay._check_lives import check_lives, check_metrics, check_ticks
from are_ros.replay._check_markers import check_marker_rules, check_marker_state
from are_ros.replay._check_overlaps import check_clutter, check_neighbours, check_walls
from are_ros.replay._check_perceived import check_perceived, check_sight_events
from are_ros.replay._check_reading import Reading
from are_ros.replay._check_record import Record
from are_ros.replay._check_result import CheckResult, Outcome
from are_ros.replay._check_robot import check_robot
from are_ros.replay._check_scans import check_scans

__all__ = ("CheckResult", "Outcome", "check_replay")

RECORDING: Final = "augmented.mcap"
PARAMETERS: Final = "effective.yaml"

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
)


def check_replay(
    folder: Path,
    map_file: Path | None = None,
    progress: Callable[[float], None] | None = None,
) -> tuple[CheckResult, ...]:
    """Check augmented.mcap in a folder; the real map is `map_file`, else the one in the recording.

    `progress` is told the share done, 0 to 1. What is wrong with the recording, damaged bytes too,
    is a failed result; what cannot be looked at, a skipped one with the reason. Raises BagError
    where there is no recording, MapError or ParameterError for a bad map file or effective.yaml.
    """
    path = folder / RECORDING
    if not path.is_file():
        raise BagError(f"{folder}: there is no {RECORDING} to check")
    meter = _Meter(progress)
    record = Record(_read_parameters(folder / PARAMETERS))
    results = check_file(path)
    meter.expect(results[0].looked_at)
    real = None if map_file is None else _read_map(map_file, record.world_frame)
    with Reading(path, record, meter.step) as reading:
        reading.read_all_but_grids()
        record.maps = record.maps if real is None else [real]
        results += _scene_results(record)
        results += check_grids(record, reading.grids())
    results += check_scans(record)
    meter.finish()
    return (results[0], reading.tally.result(), *results[1:])


def _scene_results(record: Record) -> Iterator[CheckResult]:
    for check in _SCENE_CHECKS:
        yield check(record)


def _read_map(path: Path, frame_id: str) -> RealMap:
    from are_ros.world.map_file import read_map_file

    return RealMap.of_grid(read_map_file(path, frame_id))


def _read_parameters(path: Path) -> Parameters | None:
    """Return the effective parameters, None where they were not kept."""
    return with_values(Parameters(), read_ros_parameters(path)) if path.is_file() else None


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
