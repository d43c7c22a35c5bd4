"""What a camera looks at, and what the robot is told to perceive: the list of ~/perceived."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from are_ros.agents.events import PerceivedArtefact, PredictedPath, Sighting
from are_ros.conventions import NEVER_NS
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.environment import Environment


@dataclass(frozen=True, eq=False)
class View:
    """A camera at `camera_m` (2,) in the map frame, and the environment that it looks at.

    `imagine` tells how it sees each of N boxes in the map frame, alone in the environment: None
    where that is too little to be perceived. It sees nothing beyond `max_range_m`, and looks every
    `period_s`. `sightings` is what it saw at this look of the members of A_f, by id.
    """

    environment: Environment
    imagine: Callable[[OrientedBoxes], Sequence[Sighting | None]]
    camera_m: npt.NDArray[np.float64]
    max_range_m: float
    period_s: float
    sightings: Mapping[int, Sighting] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Perception:
    """The artefacts as they are perceived at `stamp_ns`, in the order of their ids.

    `boxes`, N, are where they are perceived; None: where they are. `paths` are the predicted paths
    of each, with poses `step_ns` apart; None where nothing predicts.
    """

    stamp_ns: int
    artefacts: tuple[PerceivedArtefact, ...] = ()
    boxes: OrientedBoxes | None = None
    paths: tuple[PredictedPath, ...] | None = None
    step_ns: int = 0

    @property
    def seen_ns(self) -> dict[int, int]:
        """When each was last seen, by id."""
        return {one.artefact_id: one.sighting.seen_ns for one in self.artefacts}


class Delay:
    """Gives out perceptions some time after they were made.

    What was given out is not taken back where the clock is set back a little, or the time is longer
    from now on: it is given out again.
    """

    def __init__(self) -> None:
        self._waiting: deque[Perception] = deque()
        self._due_ns = NEVER_NS

    def passed(self, perception: Perception, latency_ns: int) -> Perception:
        """Take the perception of now; return the newest that is at least so old.

        Before there is one, nothing is perceived.
        """
        due_ns = self._due_ns = max(self._due_ns, perception.stamp_ns - latency_ns)
        self._waiting.append(perception)
        while len(self._waiting) > 1 and self._waiting[1].stamp_ns <= due_ns:
            self._waiting.popleft()
        first = self._waiting[0]
        if first.stamp_ns <= due_ns:
            return first
        paths = None if perception.paths is None else ()
        stamp_ns = max(due_ns, 0)  # a simulation's clock begins at 0, and ROS knows no time before
        return Perception(stamp_ns, (), OrientedBoxes.empty(), paths, perception.step_ns)
