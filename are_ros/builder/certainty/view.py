"""What a camera looks at: how it would see a box that is not there."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from are_ros.builder.observation import Sighting
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.environment import Environment


@dataclass(frozen=True, eq=False)
class View:
    """A camera at `camera_m` (2,) in the map frame, and the environment that it looks at.

    `imagine` tells how it sees each of N boxes in the map frame, alone in the environment: None
    where that is too little to be perceived. It sees nothing beyond `max_range_m`.
    """

    environment: Environment
    imagine: Callable[[OrientedBoxes], Sequence[Sighting | None]]
    camera_m: npt.NDArray[np.float64]
    max_range_m: float
