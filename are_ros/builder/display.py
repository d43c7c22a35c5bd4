"""The artefacts drawn: the marker board, fed with what changed."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.builder._marker_shapes import MarkerSubject, speed_steps
from are_ros.builder.marker_batch import MarkerBatch
from are_ros.builder.markers import MarkerBoard
from are_ros.builder.occlusion.meshes import MeshBank
from are_ros.builder.outputs import ArtefactState
from are_ros.parameters.choices import Labels

NEAR_M: Final = 1.4
"""As wide as most labels are."""

FAR_M: Final = 1.8
"""Who had an id beside another one keeps it up to here, lest the texts change to and fro."""

MOST_LABELS: Final = 100
"""Of more than these all are ids."""


def crowded_ids(
    ids: Sequence[int], places_m: npt.NDArray[np.float64], before: frozenset[int]
) -> frozenset[int]:
    """Return which of `ids` (N,), distinct, at places (N, 2) in the map, stand close to another.

    `before` are those who did at the last tick.
    """
    if len(ids) < 2:
        return frozenset()
    if len(ids) > MOST_LABELS:
        return frozenset(ids)
    x_m, y_m = places_m.T
    apart_m = np.hypot(x_m[:, np.newaxis] - x_m, y_m[:, np.newaxis] - y_m)
    np.fill_diagonal(apart_m, np.inf)
    was = np.array([number in before for number in ids])
    limit_m = np.where(was[:, np.newaxis] & was, FAR_M, NEAR_M)
    close = (apart_m < limit_m).any(axis=1).tolist()
    return frozenset(number for number, is_close in zip(ids, close, strict=True) if is_close)


class Display:
    """Draws artefacts as meshes, or as their boxes where `meshes` is None.

    Where labels would run into each other, they are the ids instead.
    """

    def __init__(self, board: MarkerBoard, meshes: MeshBank | None) -> None:
        self._board = board
        self._meshes = meshes
        self._states: list[ArtefactState] = []
        self._perceived: frozenset[int] = frozenset()
        self._crowded: frozenset[int] = frozenset()
        self._now_ns: int | None = None
        self._drawn: dict[int, tuple[CatalogueRow, MarkerSubject]] = {}
        self._subjects: tuple[MarkerSubject, ...] = ()
        self._poses = poses_of(())

    def update(
        self,
        now_ns: int,
        states: Sequence[ArtefactState],
        rows: Sequence[CatalogueRow],
        perceived: Collection[int],
        *,
        everything: bool = False,
    ) -> MarkerBatch:
        """Return the markers that bring viewers up to date; perceived artefacts are opaque.

        `rows` are those of `states`, whose ids are distinct. With `everything`, a DELETEALL and all
        of them: for a viewer that just came.
        """
        if self._now_ns is not None and now_ns < self._now_ns:
            self._crowded = frozenset()
        self._now_ns = now_ns
        self._take([*states], rows, frozenset(perceived))
        return self._board.update(now_ns, self._subjects, self._poses, everything=everything)

    def delete_all(self) -> MarkerBatch:
        """Return a DELETEALL, as the last thing to show; a later update gives everything."""
        self._crowded, self._now_ns = frozenset(), None
        return self._board.delete_all()

    def _take(
        self,
        states: list[ArtefactState],
        rows: Sequence[CatalogueRow],
        perceived: frozenset[int],
    ) -> None:
        """Make subjects of states that are not the same as before, and keep the others."""
        if states == self._states and perceived == self._perceived:
            return
        self._states, self._perceived, self._poses = states, perceived, poses_of(states)
        self._crowded = self._now_crowded()
        drawn = [
            self._subject(state, row, state.artefact_id in perceived)
            for state, row in zip(states, rows, strict=True)
        ]
        self._subjects = tuple([subject for _, subject in drawn])
        self._drawn = {known[1].artefact_id: known for known in drawn}

    def _now_crowded(self) -> frozenset[int]:
        """Return who of those that are labelled stands close to another of them."""
        ids = [state.artefact_id for state in self._states]
        if self._board.labels is Labels.ALL:
            return crowded_ids(ids, self._poses[:, :2], self._crowded)
        if self._board.labels is Labels.NONE or not self._perceived:
            return frozenset()
        at = [place for place, number in enumerate(ids) if number in self._perceived]
        labelled = [ids[place] for place in at]
        return crowded_ids(labelled, self._poses[at, :2], self._crowded)

    def _subject(
        self, state: ArtefactState, row: CatalogueRow, is_perceived: bool
    ) -> tuple[CatalogueRow, MarkerSubject]:
        """Return the subject of a state; that of one which only moved is kept."""
        label = "" if state.artefact_id in self._crowded else state.label
        known = self._drawn.get(state.artefact_id)
        if known is not None and known[0] is row:
            subject = known[1]
            same_words = (subject.is_perceived, subject.label) == (is_perceived, label)
            if same_words and _is_like(subject, state):
                return known
        subject = marker_subject(state, row, self._meshes, is_perceived=is_perceived)
        return row, subject if subject.label == label else replace(subject, label=label)


def marker_subject(
    state: ArtefactState, row: CatalogueRow, meshes: MeshBank | None, *, is_perceived: bool
) -> MarkerSubject:
    """Return an artefact as the marker board takes it; without meshes, it is drawn as its box."""
    triangles, colours = (None, None) if meshes is None else meshes.drawing(row)
    return MarkerSubject(
        artefact_id=state.artefact_id,
        label=state.label,
        box_centre_m=state.box_centre_m,
        size_m=state.size_m,
        colour=row.colour,
        is_perceived=is_perceived,
        mesh_triangles_m=triangles,
        mesh_colours=colours,
        speed_steps=speed_steps(*state.linear_velocity_m_s[:2]),
    )


def poses_of(states: Sequence[ArtefactState]) -> npt.NDArray[np.float64]:
    """Return the poses (N, 7) of F_A in the map's frame: x y z [m] and the quaternion x y z w."""
    poses = np.empty((len(states), 7))
    if states:
        transforms = [state.map_from_artefact for state in states]
        places_m = [transform.translation_m for transform in transforms]
        poses[:, :3] = np.concatenate(places_m).reshape(-1, 3)
        turns = [transform.rotation_xyzw for transform in transforms]
        poses[:, 3:] = np.concatenate(turns).reshape(-1, 4)
    return poses


def _is_like(subject: MarkerSubject, state: ArtefactState) -> bool:
    return (
        subject.size_m == state.size_m
        and subject.box_centre_m == state.box_centre_m
        and subject.speed_steps == speed_steps(*state.linear_velocity_m_s[:2])
    )
