"""How often artefacts have moved, and how often the resolver had to step in."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from are_ros.builder.collisions import Outcome, Resolution


@dataclass
class MotionCounts:
    """Sub-steps of artefacts so far: all, those of who moved, and those that the resolver changed.

    `moved_back` and `displaced` over `artefact_steps` is the share of artefact-seconds in which a
    collision had to be resolved because planning had not avoided it.
    """

    artefact_steps: int = 0
    moving_steps: int = 0
    moved_back: int = 0
    displaced: int = 0

    def add(self, moved: npt.NDArray[np.bool_], resolution: Resolution) -> None:
        """Count a sub-step of N artefacts; `moved` (N,) tells who wanted to move."""
        self.artefact_steps += len(moved)
        self.moving_steps += int(np.count_nonzero(moved))
        if not resolution.is_all_kept:
            outcomes = resolution.outcomes
            self.moved_back += int(np.count_nonzero(outcomes == Outcome.MOVED_BACK))
            self.displaced += int(np.count_nonzero(outcomes >= Outcome.DISPLACED_TO_SAFE))
