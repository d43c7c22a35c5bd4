"""Prescribed motion: poses that some are given, laid out window by window as their paths."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.motion._planning import commit
from are_ros.artefacts.motion._state import COS, SIN, SPEED, Fleet, Tempo

_WINDOW_HOLDS = 5


class Scripts:
    """Who is scripted, with its poses (K, 3) from the sub-step after `begin` on."""

    def __init__(self) -> None:
        self._scripts: dict[int, tuple[int, npt.NDArray[np.float64]]] = {}
        self._laid: dict[int, int] = {}

    def begin(self, artefact_id: int, poses: npt.NDArray[np.float64], now: int) -> None:
        """Take a script; one of no poses ends the old one."""
        self.cancel(artefact_id)
        if len(poses):
            self._scripts[artefact_id] = now, poses.reshape(-1, 3)

    def cancel(self, artefact_id: int) -> None:
        """Forget a script, if there is one."""
        self._scripts.pop(artefact_id, None)
        self._laid.pop(artefact_id, None)

    def repeat(self, artefact_id: int) -> None:
        """Lay the path of this one anew in the next sub-step: it was put elsewhere."""
        self._laid.pop(artefact_id, None)

    def lay(self, slot_of: Mapping[int, int], fleet: Fleet, now: int, tempo: Tempo) -> list[int]:
        """Lay the paths of the next sub-steps; return the slots whose paths are news."""
        changed = []
        for artefact_id in sorted(self._scripts):
            begin, poses = self._scripts[artefact_id]
            slot = slot_of[artefact_id]
            if now - begin >= len(poses):
                self.cancel(artefact_id)
                fleet.place["is_scripted"][slot] = 0
            elif now - self._laid.get(artefact_id, -_WINDOW_HOLDS) >= _WINDOW_HOLDS:
                self._laid[artefact_id] = now
                _lay(fleet, slot, poses[now - begin :], now, tempo)
                changed.append(slot)
        return changed


def _lay(fleet: Fleet, slot: int, poses: npt.NDArray[np.float64], now: int, tempo: Tempo) -> None:
    """Make the next poses the path of a slot, from where it is."""
    place = fleet.place[slot]
    index = min(now - int(place["begin"]), int(place["last"]))
    coming = poses[: fleet.path.shape[1] - 1]
    path = np.empty((len(coming) + 1, fleet.path.shape[2]))
    path[0] = fleet.path[slot, index]
    path[1:, :3] = coming
    path[:, COS], path[:, SIN] = np.cos(path[:, 2]), np.sin(path[:, 2])
    steps = np.diff(path[:, :2], axis=0)
    along = steps[:, 0] * path[1:, COS] + steps[:, 1] * path[1:, SIN]
    ways = np.hypot(steps[:, 0], steps[:, 1])
    path[1:, SPEED] = np.where(along < 0.0, -ways, ways) / tempo.step_s
    path[-1, SPEED] = 0.0  # where it will stand if nothing follows
    commit(fleet, slot, path, len(coming), now, tempo)
