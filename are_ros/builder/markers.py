"""The board that draws the artefacts as markers for rviz, and gives out only what changed."""

from collections.abc import Sequence
from itertools import chain
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.builder._marker_shapes import (
    REFRESH_NS,
    Figure,
    MarkerSubject,
    deletion,
    figure_of,
    looks_equal,
)
from are_ros.builder.marker_batch import (
    DELETE_ALL,
    MarkerAction,
    MarkerBatch,
    MarkerKind,
    MarkerLook,
)
from are_ros.parameters.choices import Labels, Shape

__all__ = (
    "MarkerAction",
    "MarkerBatch",
    "MarkerBoard",
    "MarkerKind",
    "MarkerLook",
    "MarkerSubject",
    "marker_poses",
)

Poses = npt.NDArray[np.float64]


def marker_poses(poses: Poses, offsets_m: npt.NDArray[np.float64]) -> Poses:
    """Return the poses (K * M, 7) of the M markers of each of K figures.

    `poses` (K, 7) are the figures', x y z [m] and the quaternion q as x y z w; `offsets_m` (K, M,
    3) the markers' places o from there. A marker is at p + R(q) o, turned as its figure is.
    """
    count, markers = offsets_m.shape[:2]
    placed = np.empty((count, markers, 7))
    # A product of small matrices for each figure: the very numbers of RigidTransform.apply.
    turned_m = offsets_m @ _rotation_matrices(poses[:, 3:]).transpose(0, 2, 1)
    placed[:, :, :3] = turned_m + poses[:, None, :3]
    placed[:, :, 3:] = poses[:, None, 3:]
    return placed.reshape(count * markers, 7)


def _rotation_matrices(rotations_xyzw: Poses) -> npt.NDArray[np.float64]:
    """Return unit quaternions (K, 4) as matrices (K, 3, 3)."""
    x, y, z, w = rotations_xyzw.T
    matrices = np.empty((len(rotations_xyzw), 3, 3))
    matrices[:, 0, 0] = 1 - 2 * (y * y + z * z)
    matrices[:, 0, 1] = 2 * (x * y - z * w)
    matrices[:, 0, 2] = 2 * (x * z + y * w)
    matrices[:, 1, 0] = 2 * (x * y + z * w)
    matrices[:, 1, 1] = 1 - 2 * (x * x + z * z)
    matrices[:, 1, 2] = 2 * (y * z - x * w)
    matrices[:, 2, 0] = 2 * (x * z - y * w)
    matrices[:, 2, 1] = 2 * (y * z + x * w)
    matrices[:, 2, 2] = 1 - 2 * (x * x + y * y)
    return matrices


_NOWHERE: Final = np.full((1, 7), np.nan)
"""Where somebody was who had not been given out: it differs from every pose."""


class MarkerBoard:
    """Remembers what viewers have been given, and gives out the difference.

    A marker fades 3 s after it was last given out, so that a dead ARE leaves none; each is
    refreshed once a second, at an instant of its own, so that a tick has its share of all. All
    poses are in the map's frame.
    """

    def __init__(self, shape: Shape = Shape.BOX, labels: Labels = Labels.PERCEIVED) -> None:
        self._shape, self._labels = shape, labels
        self._now_ns: int | None
        self._subjects: tuple[MarkerSubject, ...]
        self._places: dict[int, int]
        self._poses: Poses
        self._due_ns: npt.NDArray[np.int64]
        self._forget()

    @property
    def labels(self) -> Labels:
        """Whose labels are drawn."""
        return self._labels

    def update(
        self,
        now_ns: int,
        shown: Sequence[MarkerSubject],
        poses: Poses,
        *,
        everything: bool = False,
    ) -> MarkerBatch:
        """Return the markers that bring viewers up to date with the artefacts of now.

        `poses` (N, 7) are those of the N `shown`, whose ids are distinct: x y z [m] and x y z w.
        DELETE for those who departed and for labels that are to be seen no more, ADD for those who
        came, moved, changed their looks or were due for a refresh. A DELETEALL and everything if
        asked for (there is a new viewer), at the first update and after the clock jumped back. It
        is quickest with the very same subjects.
        """
        if self._now_ns is None or now_ns < self._now_ns:
            self._forget()
            everything = True
        self._now_ns = now_ns
        left = self._arrange(tuple(shown))
        due = (poses != self._poses).any(axis=1) | (self._due_ns <= now_ns) | everything
        self._poses = poses.copy()
        first = DELETE_ALL if everything else MarkerBatch.unposed(*left)
        return first.followed_by(self._draw(now_ns, due))

    def delete_all(self) -> MarkerBatch:
        """Return a DELETEALL, and start anew: the next update gives everything."""
        self._forget()
        return DELETE_ALL

    def _forget(self) -> None:
        self._now_ns, self._subjects, self._places = None, (), {}
        self._poses, self._due_ns = np.empty((0, 7)), np.empty(0, dtype=np.int64)
        self._set_figures([])

    def _set_figures(self, figures: list[Figure]) -> None:
        self._figures = figures
        self._looks = _looks_of(figures)
        offsets_m = np.concatenate((np.empty((0, 3)), *(figure.offsets_m for figure in figures)))
        self._offsets_m = offsets_m.reshape(-1, 3, 3)
        is_drawn = np.array([figure.is_drawn for figure in figures], dtype=np.bool_)
        self._is_drawn = is_drawn.reshape(-1, 3)
        self._phases_ns = np.array([figure.phase_ns for figure in figures], dtype=np.int64)

    def _arrange(self, subjects: tuple[MarkerSubject, ...]) -> list[MarkerLook]:
        """Take over who is shown; return what removes who departed, and labels no more drawn.

        Who is new, or looks otherwise, has been nowhere yet.
        """
        if subjects == self._subjects:
            return []
        figures, places = [], []
        left: list[MarkerLook] = []
        known = {number: self._figures[place] for number, place in self._places.items()}
        for subject in subjects:
            before = known.pop(subject.artefact_id, None)
            if before is not None and looks_equal(before.subject, subject):
                figures.append(before)
                places.append(self._places[subject.artefact_id])
                continue
            figures.append(figure_of(subject, self._shape, self._labels, before))
            places.append(-1)
            left += deletion(before, figures[-1]) if before is not None else ()
        left += [look for number in sorted(known) for look in deletion(known[number])]
        self._poses = np.concatenate((self._poses, _NOWHERE))[places]
        self._due_ns = np.append(self._due_ns, 0)[places]
        self._subjects = subjects
        self._places = {subject.artefact_id: place for place, subject in enumerate(subjects)}
        self._set_figures(figures)
        return left

    def _draw(self, now_ns: int, due: npt.NDArray[np.bool_]) -> MarkerBatch:
        """Return the markers of those who are due, and note when they are due again."""
        late_ns = (now_ns - self._phases_ns[due]) % REFRESH_NS
        self._due_ns[due] = now_ns + REFRESH_NS - late_ns
        if due.all():
            poses = marker_poses(self._poses, self._offsets_m)
            return MarkerBatch(self._looks, poses[self._is_drawn.ravel()])
        looks = _looks_of([self._figures[place] for place in np.flatnonzero(due).tolist()])
        poses = marker_poses(self._poses[due], self._offsets_m[due])
        return MarkerBatch(looks, poses[self._is_drawn[due].ravel()])


def _looks_of(figures: list[Figure]) -> tuple[MarkerLook, ...]:
    return tuple(chain.from_iterable(figure.looks for figure in figures))
