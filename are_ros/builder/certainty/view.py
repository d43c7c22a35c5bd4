"""What a camera looks at: how it would see a box that is not there."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from are_ros.builder.observation import Sighting
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
