"""Where an artefact that turns on the spot can set out: the disc that it sweeps meets no wall."""

import numpy as np
import numpy.typing as npt

from are_ros.artefacts._roaming import Roaming


class Turning(Roaming):
    """The disc about F_A's point on the ground that holds a row's box, on the terrain it is on."""

    is_searched_for = True

    def leads_out(self, poses: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
        """Tell at which poses (N, 4) it can leave the free disc: bool (N,), all."""
        return np.ones(len(poses), np.bool_)
