"""What a recording holds of interest to the checks, as values."""

from bisect import bisect_right
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final

import numpy as np

from are_ros.checks.oracle_solids import Cloud, RealMap
from are_ros.conventions import NS_PER_S
from are_ros.parameters.model import Parameters
from are_ros.replay._check_file import PREFIX
from are_ros.replay._check_frames import Frames
from are_ros.replay._check_marker_rules import MarkerChange
from are_ros.replay._check_runs import Runs
from are_ros.replay._check_scan_pairs import ScanPairs
from are_ros.replay._check_scene import Scene

_USUAL_BASES: Final = ("base_footprint", "base_link")
_REAL_MAP: Final = "/map"
_MAP_SLACK_NS: Final = NS_PER_S
"""Live, how near to the reception of a new map it is open which one a tick knew."""


@dataclass(frozen=True)
class MarkerShow:
    """One message of markers, by its time."""

    log_ns: int
    changes: tuple[MarkerChange, ...]


@dataclass(eq=False)
class Record:
    """All but the grids: ticks as scenes, messages with their times, and the inputs there are.

    `parameters` are those of effective.yaml, None where there is none. `camera_sizes` are time,
    width and height of each CameraInfo. The times are log times in a replay. Live, they are those
    of the ticks: the stamps of what a tick gives out, for inputs the tick after which they came;
    `farewells_ns` is when a node let everything vanish, and `last_words` are the lists of the
    perceived and the metrics that it gave out then. `walls` is "map" or "octomap", whose they are,
    or empty; `clouds` are the octomaps that came in.
    """

    parameters: Parameters | None
    is_live: bool = False
    walls: str = ""
    scenes: list[Scene] = field(default_factory=list)
    events: list[tuple[int, Any]] = field(default_factory=list)
    perceived: list[tuple[int, Any]] = field(default_factory=list)
    metrics: list[tuple[int, Any]] = field(default_factory=list)
    shows: list[MarkerShow] = field(default_factory=list)
    maps_by_topic: dict[str, list[RealMap]] = field(default_factory=dict)
    maps: list[RealMap] = field(default_factory=list)
    clouds: list[Cloud] = field(default_factory=list)
    camera_sizes: list[tuple[int, int, int]] = field(default_factory=list)
    frames: Frames = field(default_factory=Frames)
    scans: ScanPairs = field(default_factory=ScanPairs)
    topics: set[str] = field(default_factory=set)
    farewells_ns: list[int] = field(default_factory=list)
    last_words: list[tuple[int, Any]] = field(default_factory=list)
    lags_ns: list[int] = field(default_factory=list)
    runs: Runs = field(default_factory=Runs)

    @property
    def world_frame(self) -> str:
        """The frame of all outputs."""
        if self.parameters is None and self.scenes:
            return self.scenes[0].frame_id
        return self.settings.frames.map

    @property
    def settings(self) -> Parameters:
        """The parameters, the defaults where they are not known."""
        return Parameters() if self.parameters is None else self.parameters

    @property
    def period_ns(self) -> int:
        """The time from tick to tick; where the parameters are not known, the usual one."""
        if self.parameters is not None or len(self.scenes) < 2:
            return round(NS_PER_S / self.settings.builder.tick_rate)
        return int(np.median([b.stamp_ns - a.stamp_ns for a, b in pairwise(self.scenes)]))

    def choose_maps(self, given: RealMap | None) -> None:
        """Settle which real maps there were: the one given, else those of one topic."""
        topics = self.maps_by_topic
        name = _REAL_MAP if _REAL_MAP in topics or len(topics) != 1 else next(iter(topics))
        found = [real for real in topics.get(name, ()) if real.is_usable(self.world_frame)]
        self.maps = [given] if given else _without_repeats(found) if self.is_live else found

    def why_no_map(self) -> str:
        """Return why no real map is known, for the user."""
        if len(self.maps_by_topic) > 1:
            names = ", ".join(sorted(self.maps_by_topic))
            return f"several topics may be the real map ({names}), and no map file was given"
        return "the recording holds no real map, and no map file was given"

    def has_inputs(self) -> bool:
        """Tell whether inputs were copied beside the outputs."""
        return any(not topic.startswith(PREFIX) for topic in self.topics)

    @property
    def lacks_inputs(self) -> bool:
        """Whether it is of a replay that did not copy them: another one could."""
        return not (self.is_live or self.has_inputs())

    def base_frame(self) -> str:
        """Return the robot's base: the one configured, else the usual one that there is."""
        known = (name for name in _USUAL_BASES if self.frames.has(name))
        return self.settings.frames.base or next(known, _USUAL_BASES[0])

    def real_map_at(self, stamp_ns: int) -> RealMap | None:
        """Return the real map that a tick knew: the last received before it.

        Live it is open about the time when another one came, and the first is taken to have been
        there before: it is latched.
        """
        if self.is_live:
            later = [real.since_ns for real in self.maps[1:]]
            if any(abs(since_ns - stamp_ns) <= _MAP_SLACK_NS for since_ns in later):
                return None
            return self.maps[bisect_right(later, stamp_ns)] if self.maps else None
        known = [real for real in self.maps if real.since_ns < stamp_ns]
        if known:
            return known[-1]
        # A map from a file is there before the first tick, and logged at its very time.
        return self.maps[0] if self.maps and self.maps[0].since_ns == stamp_ns else None

    def perceived_ids(self) -> dict[int, frozenset[int]]:
        """Return the ids of `~/perceived` by time."""
        return {log: frozenset(int(a.id) for a in m.artefacts) for log, m in self.perceived}


def _without_repeats(maps: list[RealMap]) -> list[RealMap]:
    """Leave out maps that came again as they were: latched ones do."""
    kept: list[RealMap] = []
    for real in maps:
        if not kept or not (
            kept[-1].has_geometry_of(real) and np.array_equal(kept[-1].cells, real.cells)
        ):
            kept.append(real)
    return kept
