"""What a recording holds of interest to the checks, as values."""

from dataclasses import dataclass, field
from typing import Any

from are_ros.parameters.model import Parameters
from are_ros.replay._check_cells import RealMap
from are_ros.replay._check_file import PREFIX
from are_ros.replay._check_frames import Frames
from are_ros.replay._check_marker_rules import MarkerChange
from are_ros.replay._check_scan_pairs import ScanPairs
from are_ros.replay._check_scene import Scene

_USUAL_BASES = ("base_footprint", "base_link")


@dataclass(frozen=True)
class MarkerShow:
    """One message of markers, by its log time."""

    log_ns: int
    changes: tuple[MarkerChange, ...]


@dataclass(eq=False)
class Record:
    """All but the grids: ticks as scenes, messages with their log times, and the inputs there are.

    `parameters` are those of effective.yaml, None where there is none. `camera_sizes` are log time,
    width and height of each CameraInfo.
    """

    parameters: Parameters | None
    scenes: list[Scene] = field(default_factory=list)
    events: list[tuple[int, Any]] = field(default_factory=list)
    perceived: list[tuple[int, Any]] = field(default_factory=list)
    metrics: list[tuple[int, Any]] = field(default_factory=list)
    shows: list[MarkerShow] = field(default_factory=list)
    maps: list[RealMap] = field(default_factory=list)
    camera_sizes: list[tuple[int, int, int]] = field(default_factory=list)
    frames: Frames = field(default_factory=Frames)
    scans: ScanPairs = field(default_factory=ScanPairs)
    topics: set[str] = field(default_factory=set)

    @property
    def world_frame(self) -> str:
        """The frame of all outputs."""
        return self.settings.frames.map

    @property
    def settings(self) -> Parameters:
        """The parameters, the defaults where they are not known."""
        return Parameters() if self.parameters is None else self.parameters

    def has_inputs(self) -> bool:
        """Tell whether inputs were copied beside the outputs."""
        return any(not topic.startswith(PREFIX) for topic in self.topics)

    def base_frame(self) -> str:
        """Return the robot's base: the one configured, else the usual one that there is."""
        known = (name for name in _USUAL_BASES if self.frames.has(name))
        return self.settings.frames.base or next(known, _USUAL_BASES[0])

    def real_map_at(self, stamp_ns: int) -> RealMap | None:
        """Return the real map that a tick knew: the last received before it."""
        known = [real for real in self.maps if real.since_ns < stamp_ns]
        if known:
            return known[-1]
        # A map from a file is there before the first tick, and logged at its very time.
        return self.maps[0] if self.maps and self.maps[0].since_ns == stamp_ns else None

    def perceived_ids(self) -> dict[int, frozenset[int]]:
        """Return the ids of `~/perceived` by stamp (the log time)."""
        return {log: frozenset(int(a.id) for a in m.artefacts) for log, m in self.perceived}
