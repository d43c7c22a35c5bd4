"""Markers for rviz: how each looks, where it stands, and what changed since the last tick."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from itertools import chain
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.events import ArtefactState
from are_ros.builder.occlusion.meshes import MeshBank
from are_ros.conventions import NS_PER_S
from are_ros.parameters.choices import Labels, Shape
from are_ros.population.catalogue import CatalogueRow

Vector3 = tuple[float, float, float]
Colour = tuple[float, float, float, float]
Points = npt.NDArray[np.float64]
Colours = npt.NDArray[np.float32]

LIFETIME_NS: Final = 3 * NS_PER_S
_UNIT_SCALE: Final = (1.0, 1.0, 1.0)
_OPAQUE_WHITE: Final = (1.0, 1.0, 1.0, 1.0)
_UNTURNED: Final = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
NO_POINTS: Final[Points] = np.zeros((0, 3))
NO_COLOURS: Final[Colours] = np.zeros((0, 4), np.float32)
NO_POINTS.flags.writeable = NO_COLOURS.flags.writeable = False


class MarkerKind(IntEnum):
    """The kinds of marker used here, numbered as visualization_msgs/Marker's types."""

    ARROW = 0
    CUBE = 1
    TEXT_VIEW_FACING = 9
    TRIANGLE_LIST = 11


class MarkerAction(IntEnum):
    """What to do with a marker, numbered as visualization_msgs/Marker's actions."""

    ADD = 0
    DELETE = 2
    DELETEALL = 3


@dataclass(frozen=True, eq=False)
class MarkerLook:
    """A visualization_msgs/Marker but for its pose and its stamp.

    `points` float64 (P, 3) [m] and `colours` float32 (P, 4) or (0, 4) are a TRIANGLE_LIST's,
    relative to the pose. `marker_id` fits int32. What an action does not use has a valid default.
    """

    namespace: str
    marker_id: int
    kind: MarkerKind
    action: MarkerAction
    scale: Vector3 = _UNIT_SCALE
    colour: Colour = _OPAQUE_WHITE
    text: str = ""
    points: Points = field(default_factory=lambda: NO_POINTS)
    colours: Colours = field(default_factory=lambda: NO_COLOURS)
    lifetime_ns: int = LIFETIME_NS


@dataclass(frozen=True, eq=False)
class MarkerBatch:
    """Markers in the order in which viewers obey them.

    `poses` float64 (N, 7), read-only: x y z [m] and the quaternion x y z w in the map's frame, one
    for each of `looks`. A look is the same object as long as its marker looks the same, so that
    what was made of it can be kept.
    """

    looks: tuple[MarkerLook, ...]
    poses: npt.NDArray[np.float64]

    def __post_init__(self) -> None:
        self.poses.setflags(write=False)

    def __len__(self) -> int:
        """Count the markers."""
        return len(self.looks)

    @classmethod
    def unposed(cls, *looks: MarkerLook) -> "MarkerBatch":
        """Return markers for which the pose does not matter; they are at the origin, unturned."""
        return cls(looks, np.tile(_UNTURNED, (len(looks), 1)))

    def followed_by(self, other: "MarkerBatch") -> "MarkerBatch":
        """Return these markers, then the others."""
        if not self.looks:
            return other
        return MarkerBatch(self.looks + other.looks, np.concatenate((self.poses, other.poses)))


NO_MARKERS: Final = MarkerBatch.unposed()
DELETE_ALL: Final = MarkerBatch.unposed(MarkerLook("", 0, MarkerKind.CUBE, MarkerAction.DELETEALL))
"""Removes every marker of the topic."""


REFRESH_NS: Final = NS_PER_S
BODY, LABEL, HEADING = "body", "label", "heading"
OPAQUE, TRANSLUCENT = 1.0, 0.35
TEXT_HEIGHT_M, ARROW_THICKNESS_M, GAP_M = 0.2, 0.06, 0.05
ARROW_OF_STANDING_M, ARROW_PER_SPEED_S, LONGEST_ARROW_M = 0.1, 0.6, 2.0
"""How far an arrow reaches past the front: of one who stands, more for each m/s, and at most."""

SPEED_STEP_MPS: Final = 0.5
"""Speeds are drawn in steps: looks that stay need not be encoded again."""

WHITE = (1.0, 1.0, 1.0)
_GOLDEN_NS: Final = 618_033_989
"""The golden section of a second: multiples of it, modulo a second, spread evenly."""


@dataclass(frozen=True, eq=False)
class MarkerSubject:
    """An artefact to be drawn, but for its pose.

    The box's centre is in F_A [m], its size along F_A's axes, each above 0; `colour` is red, green,
    blue and alpha in [0, 1], of which alpha tells nothing here: perceived artefacts are opaque, the
    others translucent. `mesh_triangles_m` (T, 3, 3) are corners in F_A, None without a mesh;
    `mesh_colours` (T, 4) are their faces' colours, None for the plain colour. `speed_steps` is the
    speed over the ground, in steps of `SPEED_STEP_MPS`. Without a `label` it is labelled by its id.
    """

    artefact_id: int
    label: str
    box_centre_m: Vector3
    size_m: Vector3
    colour: Colour
    is_perceived: bool
    mesh_triangles_m: Points | None = None
    mesh_colours: npt.NDArray[np.floating] | None = None
    speed_steps: int = 0


@dataclass(frozen=True, eq=False)
class Figure:
    """A subject as drawn: body, label and heading at `offsets_m` (3, 3) in F_A, turned as it is.

    `looks` are those that are drawn, in this order; `is_drawn` tells which of the three. It is due
    for a refresh at `phase_ns` of each second; these differ from id to id.
    """

    subject: MarkerSubject
    looks: tuple[MarkerLook, ...]
    is_drawn: tuple[bool, bool, bool]
    offsets_m: Points
    phase_ns: int


def figure_of(
    subject: MarkerSubject, shape: Shape, labels: Labels, before: Figure | None = None
) -> Figure:
    """Return an artefact as drawn; of how it was drawn `before`, keep what still looks the same."""
    if before is not None and _looks_equal_but_for_speed(before.subject, subject):
        return replace(before, subject=subject, looks=(*before.looks[:-1], _heading(subject)))
    x, y, z = subject.box_centre_m
    top = z + 0.5 * subject.size_m[2] + GAP_M
    triangles_m = subject.mesh_triangles_m
    if shape is Shape.MESH and triangles_m is not None and len(triangles_m) > 0:
        body, at = _mesh(subject, triangles_m), (0.0, 0.0, 0.0)
    else:
        body, at = _box(subject), (x, y, z)
    is_labelled = labels is Labels.ALL or (labels is Labels.PERCEIVED and subject.is_perceived)
    label = (_label(subject),) if is_labelled else ()
    return Figure(
        subject,
        (body, *label, _heading(subject)),
        (True, is_labelled, True),
        np.array((at, (x, y, top + TEXT_HEIGHT_M), (x, y, top))),
        subject.artefact_id * _GOLDEN_NS % REFRESH_NS,
    )


def deletion(before: Figure, after: Figure | None = None) -> list[MarkerLook]:
    """Return the markers that remove what was drawn of an artefact and is drawn no more."""
    number = marker_id(before.subject.artefact_id)
    still = {look.namespace for look in after.looks} if after else set()
    kinds = {BODY: MarkerKind.CUBE, LABEL: MarkerKind.TEXT_VIEW_FACING, HEADING: MarkerKind.ARROW}
    return [
        MarkerLook(look.namespace, number, kinds[look.namespace], MarkerAction.DELETE)
        for look in before.looks
        if look.namespace not in still
    ]


def marker_id(artefact_id: int) -> int:
    """Return an artefact's id as a marker's: the same below 2^31, wrapped to int32 above."""
    return artefact_id % 2**31


def looks_equal(one: MarkerSubject, other: MarkerSubject) -> bool:
    """Return whether two subjects look alike; meshes are compared by identity."""
    if one is other:
        return True
    return one.speed_steps == other.speed_steps and _looks_equal_but_for_speed(one, other)


def speed_steps(vx_mps: float, vy_mps: float) -> int:
    """Return a speed over the ground as the number of steps that is nearest to it."""
    return round(math.hypot(vx_mps, vy_mps) / SPEED_STEP_MPS)


def _looks_equal_but_for_speed(one: MarkerSubject, other: MarkerSubject) -> bool:
    return (
        _plain_looks(one) == _plain_looks(other)
        and one.mesh_triangles_m is other.mesh_triangles_m
        and one.mesh_colours is other.mesh_colours
    )


def _plain_looks(subject: MarkerSubject) -> tuple[object, ...]:
    return (
        subject.label,
        subject.is_perceived,
        tuple(subject.box_centre_m),
        tuple(subject.size_m),
        tuple(subject.colour),
    )


def _alpha(subject: MarkerSubject) -> float:
    return OPAQUE if subject.is_perceived else TRANSLUCENT


def _mesh(subject: MarkerSubject, triangles_m: Points) -> MarkerLook:
    """Return the mesh in F_A; a face's colour is given to each of its corners, with the alpha.

    rviz looks for transparency in the corners' colours when there are any, else in the marker's.
    """
    alpha = _alpha(subject)
    points = np.asarray(triangles_m, np.float64).reshape(-1, 3)
    if subject.mesh_colours is None:
        colour, colours = (*subject.colour[:3], alpha), NO_COLOURS
    else:
        colour = (*subject.colour[:3], OPAQUE)
        colours = np.repeat(np.asarray(subject.mesh_colours, np.float32), 3, axis=0)
        colours[:, 3] = alpha
    return MarkerLook(
        BODY,
        marker_id(subject.artefact_id),
        MarkerKind.TRIANGLE_LIST,
        MarkerAction.ADD,
        colour=colour,
        points=points,
        colours=colours,
    )


def _box(subject: MarkerSubject) -> MarkerLook:
    return MarkerLook(
        BODY,
        marker_id(subject.artefact_id),
        MarkerKind.CUBE,
        MarkerAction.ADD,
        subject.size_m,
        (*subject.colour[:3], _alpha(subject)),
    )


def _label(subject: MarkerSubject) -> MarkerLook:
    """Return the label, or the id where there is none: rviz refuses an empty text."""
    return MarkerLook(
        LABEL,
        marker_id(subject.artefact_id),
        MarkerKind.TEXT_VIEW_FACING,
        MarkerAction.ADD,
        (TEXT_HEIGHT_M, TEXT_HEIGHT_M, TEXT_HEIGHT_M),
        (*WHITE, _alpha(subject)),
        subject.label if subject.label.strip() else str(subject.artefact_id),
    )


def _heading(subject: MarkerSubject) -> MarkerLook:
    """Return an arrow from above the box's centre along F_A's x axis, past its front.

    The faster, the farther.
    """
    speed_mps = SPEED_STEP_MPS * subject.speed_steps
    past_m = min(ARROW_OF_STANDING_M + ARROW_PER_SPEED_S * speed_mps, LONGEST_ARROW_M)
    length_m = 0.5 * subject.size_m[0] + past_m
    return MarkerLook(
        HEADING,
        marker_id(subject.artefact_id),
        MarkerKind.ARROW,
        MarkerAction.ADD,
        (length_m, ARROW_THICKNESS_M, ARROW_THICKNESS_M),
        (*subject.colour[:3], _alpha(subject)),
    )


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


NEAR_M: Final = 1.4
"""About the width of a label."""

FAR_M: Final = 1.8
"""Up to this distance a label that was an id stays one, so that texts do not alternate."""

MOST_LABELS: Final = 100
"""With more labels than this, all of them are ids."""


def crowded_ids(
    ids: Sequence[int], places_m: npt.NDArray[np.float64], before: frozenset[int]
) -> frozenset[int]:
    """Return which of `ids` (N,), distinct, at places (N, 2) in the map, stand close to another.

    `before` are the ids that did at the last tick.
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
        """Return the ids of the labelled artefacts that stand close to another labelled one."""
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
