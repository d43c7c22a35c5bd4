"""What a replay is asked to do."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from are_ros.builder.tick import Demand
from are_ros.parameters.model import Parameters


@dataclass(frozen=True)
class ReplayOptions:
    """The options of `are replay`; times are seconds from the beginning of the recording.

    `parameters` are the effective ones. `map_file` and `octomap_file` replace what the recording
    lacks or holds; `topics` are the user's choices by role. With `out` None nothing is written,
    but for what happened, as a scenario, into `save_scenario` if that is given. `is_wait_given`:
    the user has set `sensors.tf_wait`; else it is as long as the recording needs.
    """

    bags: tuple[Path, ...]
    parameters: Parameters
    out: Path | None = None
    map_file: Path | None = None
    octomap_file: Path | None = None
    topics: Mapping[str, str] = field(default_factory=dict)
    start_s: float = 0.0
    duration_s: float | None = None
    with_inputs: bool = False
    demand: Demand = field(default_factory=Demand)
    save_scenario: Path | None = None
    is_wait_given: bool = False
