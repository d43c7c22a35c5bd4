"""Markers for rviz: how each artefact looks, where it stands, and what changed since the last tick.

Each artefact has a body (its box or its mesh), a heading (an arrow), and perhaps a label. Perceived
artefacts are opaque, the others translucent. `EnvironmentDisplay` adds the surface of the place.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from itertools import chain
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.builder.occlusion.meshes import MeshBank
from are_ros.builder.scene import Scene
from are_ros.conventions import NS_PER_S
from are_ros.parameters.choices import Labels
from are_ros.population.catalogue import CatalogueRow
from are_ros.world.rigid_transform import product
from are_ros.world.surface import exposed_surface
from are_ros.world.voxel_map import VoxelMap

Vector3 = tuple[float, float, float]
Colour = tuple[float, float, float, float]
Floats = npt.NDArray[np.float64]
Colours = npt.NDArray[np.float32]

LIFETIME_NS: Final = 3 * NS_PER_S
"""Viewers drop a marker this long after they last got it, so that a dead ARE leaves none."""

REFRESH_NS: Final = NS_PER_S
"""Each artefact's markers are given out at least this often."""

BODY, LABEL, HEADING = "body", "label", "heading"
OPAQUE, TRANSLUCENT = 1.0, 0.35
TEXT_HEIGHT_M, ARROW_THICKNESS_M, GAP_M = 0.2, 0.06, 0.05
ARROW_OF_STANDING_M, ARROW_PER_SPEED_S, LONGEST_ARROW_M = 0.1, 0.6, 2.0
"""How far an arrow reaches past the front: of a standing artefact, more for each m/s, at most."""

SPEED_STEP_MPS: Final = 0.5
"""Speeds are drawn in steps, so that looks stay and need not be encoded again."""

NEAR_M: Final = 1.4
"""About the width of a label. Labels that are closer together become ids."""

FAR_M: Final = 1.8
"""Up to this distance a label that was an id stays one, so that texts do not alternate."""

MOST_LABELS: Final = 100
"""With more labels than this, all of them are ids."""

NO_POINTS: Final[Floats] = np.zeros((0, 3))
NO_COLOURS: Final[Colours] = np.zeros((0, 4), np.float32)
NO_POINTS.flags.writeable = NO_COLOURS.flags.writeable = False
_UNTURNED: Final = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_GOLDEN_NS: Final = 618_033_989
"""The golden section of a second: multiples of it, modulo a second, spread evenly."""


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
    """A visualization_msgs/Marker but for its id, its pose and its stamp.

    `points` float64 (P, 3) [m] and `colours` float32 (P, 4) or (0, 4) are a TRIANGLE_LIST's,
    relative to the pose. A lifetime of 0 is endless. What an action does not use has a valid
    default. Artefacts that look the same share their looks.
    """

    namespace: str
    kind: MarkerKind
    action: MarkerAction = MarkerAction.ADD
    scale: Vector3 = (1.0, 1.0, 1.0)
    colour: Colour = (1.0, 1.0, 1.0, 1.0)
    text: str = ""
    points: Floats = field(default_factory=lambda: NO_POINTS)
    colours: Colours = field(default_factory=lambda: NO_COLOURS)
    lifetime_ns: int = LIFETIME_NS


Looks = tuple[MarkerLook, ...]
_Key = tuple[str, int | str, bool, int]
"""What looks go by: namespace, index of the row (of a label its text), is perceived, speed."""


@dataclass(frozen=True, eq=False)
class MarkerBatch:
    """N markers in the order in which viewers obey them.

    `ids` int64 (N,), in the range of int32, are the markers' ids. `poses` float64 (N, 7), x y z [m]
    and the quaternion x y z w, are in the map's frame. A look is the same object as long as its
    marker looks the same, so that what was made of it can be kept.
    """

    looks: Looks
    ids: npt.NDArray[np.int64]
    poses: Floats

    def __post_init__(self) -> None:
        self.poses.setflags(write=False)

    def __len__(self) -> int:
        """Count the markers."""
        return len(self.looks)

    @classmethod
    def unposed(cls, looks: Iterable[MarkerLook] = (), ids: Sequence[int] = ()) -> "MarkerBatch":
        """Return markers for which the pose does not matter; they are at the origin, unturned."""
        poses = np.tile(_UNTURNED, (len(ids), 1))
        return cls(tuple(looks), np.array(ids, dtype=np.int64), poses)

    def followed_by(self, other: "MarkerBatch") -> "MarkerBatch":
        """Return these markers, then the others."""
        return MarkerBatch(
            self.looks + other.looks,
            np.concatenate((self.ids, other.ids)),
            np.concatenate((self.poses, other.poses)),
        )


NO_MARKERS: Final = MarkerBatch.unposed()
DELETE_ALL: Final = MarkerBatch.unposed(
    [MarkerLook("", MarkerKind.CUBE, MarkerAction.DELETEALL)], [0]
)
"""Removes every marker of the topic."""

_DELETE: Final = {
    BODY: MarkerLook(BODY, MarkerKind.CUBE, MarkerAction.DELETE),
    LABEL: MarkerLook(LABEL, MarkerKind.TEXT_VIEW_FACING, MarkerAction.DELETE),
    HEADING: MarkerLook(HEADING, MarkerKind.ARROW, MarkerAction.DELETE),
}


class MarkerDisplay:
    """Remembers what viewers have been given, and gives out the difference.

    Each artefact is refreshed once a second, at an instant of its own, so that a tick has its share
    of all. Labels that would run into each other are ids instead. `meshes` None draws boxes.
    """

    def __init__(self, labels: Labels = Labels.PERCEIVED, meshes: MeshBank | None = None) -> None:
        self._labels, self._meshes = labels, meshes
        self._looks: dict[_Key, MarkerLook] = {}
        self._forget()

    def _forget(self) -> None:
        self._now_ns: int | None = None
        self._crowded: frozenset[int] = frozenset()
        self._shown: tuple[Scene | None, frozenset[int]] = (None, frozenset())
        self._figures: dict[int, Looks] = {}
        self._poses, self._offsets_m = np.empty((0, 7)), np.empty((0, 3, 3))
        self._is_drawn = np.empty((0, 3), dtype=np.bool_)
        self._phases_ns = self._due_ns = np.empty(0, dtype=np.int64)

    def update(
        self, now_ns: int, scene: Scene, perceived: Collection[int], *, everything: bool = False
    ) -> MarkerBatch:
        """Return the markers that bring viewers up to date with a scene, whose ids are distinct.

        DELETE for artefacts that departed and for labels that are no longer to be seen, ADD for
        those that came, moved, changed their looks or were due for a refresh. A DELETEALL and
        everything if asked for (there is a new viewer), at the first update and after the clock
        jumped back.
        """
        if self._now_ns is None or now_ns < self._now_ns:
            self._forget()
            everything = True
        self._now_ns = now_ns
        removed = NO_MARKERS
        if self._shown != (scene, perceived := frozenset(perceived)):
            removed = self._arrange(self._figures_of(scene, perceived), scene)
            self._shown = scene, perceived
        due = (scene.poses != self._poses).any(axis=1) | (self._due_ns <= now_ns) | everything
        self._poses = scene.poses
        return (DELETE_ALL if everything else removed).followed_by(self._drawn(now_ns, due))

    def delete_all(self) -> MarkerBatch:
        """Return a DELETEALL, and start anew: the next update gives everything."""
        self._forget()
        return DELETE_ALL

    def _figures_of(self, scene: Scene, perceived: frozenset[int]) -> dict[int, Looks]:
        """Return the looks of each artefact by id: body, label if it has one, heading."""
        ids, known = [one.id for one in scene.artefacts], self._looks
        seen = [number in perceived for number in ids]
        steps = [speed_steps(vx, vy) for vx, vy, _ in scene.twists.tolist()]
        texts = self._texts_of(scene, ids, seen)
        keys: dict[int, tuple[_Key, ...]] = {}
        wanted: dict[_Key, CatalogueRow] = {}
        for i, row, is_seen, text, step in zip(ids, scene.rows, seen, texts, steps, strict=True):
            body, heading = (BODY, row.index, is_seen, 0), (HEADING, row.index, is_seen, step)
            keys[i] = (body, (LABEL, text, is_seen, 0), heading) if text else (body, heading)
            for key in keys[i]:
                wanted[key] = row
        self._looks = {key: known.get(key) or self._look(row, *key) for key, row in wanted.items()}
        return {i: tuple([self._looks[key] for key in own]) for i, own in keys.items()}

    def _texts_of(self, scene: Scene, ids: list[int], seen: list[bool]) -> list[str]:
        """Return the labels' texts, empty for an artefact without a label."""
        wants = {Labels.ALL: [True] * len(ids), Labels.PERCEIVED: seen}.get(self._labels)
        if wants is None or not any(wants):
            self._crowded = frozenset()
            return [""] * len(ids)
        labelled = [k for k, is_wanted in enumerate(wants) if is_wanted]
        places_m = scene.motions[labelled, :2]
        self._crowded = crowded_ids([ids[k] for k in labelled], places_m, self._crowded)
        texts = [""] * len(ids)
        for k in labelled:
            label = "" if ids[k] in self._crowded else scene.rows[k].label
            texts[k] = label if label.strip() else str(ids[k])  # rviz refuses an empty text
        return texts

    def _arrange(self, figures: dict[int, Looks], scene: Scene) -> MarkerBatch:
        """Take the figures of now; return what removes those that are drawn no more.

        An artefact that is new or looks otherwise has no pose yet, so that it is drawn anew.
        """
        before, self._figures = self._figures, figures
        if list(before.items()) == list(figures.items()):
            return NO_MARKERS
        places = {number: k for k, number in enumerate(before)}
        kept = [places[i] if before.get(i) == looks else -1 for i, looks in figures.items()]
        self._poses = np.concatenate((self._poses, np.full((1, 7), np.nan)))[kept]
        self._due_ns = np.append(self._due_ns, 0)[kept]
        self._phases_ns = np.array([i * _GOLDEN_NS % REFRESH_NS for i in figures], dtype=np.int64)
        rows = {row.index: row for row in scene.rows}
        offsets_m = {index: self._offsets_m_of(row) for index, row in rows.items()}
        self._offsets_m = np.array([offsets_m[row.index] for row in scene.rows]).reshape(-1, 3, 3)
        has_label = [len(looks) > 2 for looks in figures.values()]
        self._is_drawn = np.ones((len(figures), 3), np.bool_)
        self._is_drawn[:, 1] = has_label
        return deletions(before, figures)

    def _drawn(self, now_ns: int, due: npt.NDArray[np.bool_]) -> MarkerBatch:
        """Return the markers of the artefacts that are due, and note when they are due again."""
        if not due.any():
            return NO_MARKERS
        late_ns = (now_ns - self._phases_ns[due]) % REFRESH_NS
        self._due_ns[due] = now_ns + REFRESH_NS - late_ns
        drawn = [
            (number, looks)
            for (number, looks), is_due in zip(self._figures.items(), due.tolist(), strict=True)
            if is_due
        ]
        poses = marker_poses(self._poses[due], self._offsets_m[due])
        return MarkerBatch(
            tuple(chain.from_iterable([looks for _, looks in drawn])),
            np.array([marker_id(i) for i, looks in drawn for _ in looks], dtype=np.int64),
            poses[self._is_drawn[due].ravel()],
        )

    def _look(
        self, row: CatalogueRow, namespace: str, subject: int | str, is_perceived: bool, steps: int
    ) -> MarkerLook:
        """Return the looks of a key: `subject` is a row's index, of a label the text."""
        colour = (*row.colour[:3], OPAQUE if is_perceived else TRANSLUCENT)
        if namespace == BODY:
            return self._body(row, colour)
        if namespace == HEADING:
            return _heading(row, colour, SPEED_STEP_MPS * steps)
        return MarkerLook(
            LABEL,
            MarkerKind.TEXT_VIEW_FACING,
            scale=(TEXT_HEIGHT_M, TEXT_HEIGHT_M, TEXT_HEIGHT_M),
            colour=(1.0, 1.0, 1.0, colour[3]),
            text=str(subject),
        )

    def _body(self, row: CatalogueRow, colour: Colour) -> MarkerLook:
        """Return a row's mesh, each face's colour given to its corners, or else its box.

        rviz looks for transparency in the corners' colours when there are any, else in the
        marker's.
        """
        if self._meshes is None:
            return MarkerLook(BODY, MarkerKind.CUBE, scale=row.size_m, colour=colour)
        triangles_m, face_colours = self._meshes.drawing(row)
        colours = np.repeat(face_colours, 3, axis=0)
        colours[:, 3] = colour[3]
        return MarkerLook(
            BODY,
            MarkerKind.TRIANGLE_LIST,
            colour=(*colour[:3], OPAQUE),
            points=triangles_m.reshape(-1, 3),
            colours=colours,
        )

    def _offsets_m_of(self, row: CatalogueRow) -> tuple[Vector3, Vector3, Vector3]:
        """Return where body, label and heading are in F_A [m]."""
        x, y, z = row.box_centre_in_artefact_m
        top = z + 0.5 * row.size_m[2] + GAP_M
        body = (x, y, z) if self._meshes is None else (0.0, 0.0, 0.0)
        return body, (x, y, top + TEXT_HEIGHT_M), (x, y, top)


def _heading(row: CatalogueRow, colour: Colour, speed_mps: float) -> MarkerLook:
    """Return an arrow along F_A's x axis, past the box's front: the faster, the farther."""
    past_m = min(ARROW_OF_STANDING_M + ARROW_PER_SPEED_S * speed_mps, LONGEST_ARROW_M)
    size_m = (0.5 * row.size_m[0] + past_m, ARROW_THICKNESS_M, ARROW_THICKNESS_M)
    return MarkerLook(HEADING, MarkerKind.ARROW, scale=size_m, colour=colour)


def deletions(before: Mapping[int, Looks], now: Mapping[int, Looks]) -> MarkerBatch:
    """Return the markers that remove labels that were lost and artefacts that departed."""
    lost = [(i, LABEL) for i, looks in now.items() if len(before.get(i, ())) > len(looks)]
    gone = sorted(before.keys() - now.keys())
    lost += [(i, look.namespace) for i in gone for look in before[i]]
    return MarkerBatch.unposed(
        [_DELETE[namespace] for _, namespace in lost], [marker_id(i) for i, _ in lost]
    )


def marker_id(artefact_id: int) -> int:
    """Return an artefact's id as a marker's: the same below 2^31, wrapped to int32 above."""
    return artefact_id % 2**31


def speed_steps(vx_mps: float, vy_mps: float) -> int:
    """Return a speed over the ground as the number of steps that is nearest to it."""
    return round(math.hypot(vx_mps, vy_mps) / SPEED_STEP_MPS)


def marker_poses(poses: Floats, offsets_m: Floats) -> Floats:
    """Return the poses (K * M, 7) of the M markers of each of K artefacts.

    `poses` (K, 7) are the artefacts', x y z [m] and the quaternion q as x y z w, turned about z
    only; `offsets_m` (K, M, 3) are the places o of the markers from there. A marker is at
    p + R(q) o, turned as its artefact is.
    """
    count, markers = offsets_m.shape[:2]
    z, w = poses[:, 5], poses[:, 6]
    rotations = np.zeros((count, 3, 3))
    rotations[:, 0, 0] = rotations[:, 1, 1] = 1 - 2 * (z * z)
    rotations[:, 1, 0] = 2 * (z * w)
    rotations[:, 0, 1] = -rotations[:, 1, 0]
    rotations[:, 2, 2] = 1.0
    placed = np.empty((count, markers, 7))
    # A product of small matrices for each artefact: the very numbers of RigidTransform.apply.
    placed[:, :, :3] = product(offsets_m, rotations.transpose(0, 2, 1)) + poses[:, None, :3]
    placed[:, :, 3:] = poses[:, None, 3:]
    return placed.reshape(count * markers, 7)


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


ENVIRONMENT: Final = "environment"
"""The namespace of the marker, whose id is 0."""

_GREY: Final[Colour] = (0.81, 0.82, 0.84, 1.0)
_ENDLESS_NS: Final = 0
_NO_SURFACE: Final = MarkerLook(ENVIRONMENT, MarkerKind.TRIANGLE_LIST, MarkerAction.DELETE)


class EnvironmentDisplay:
    """Remembers which voxels viewers have been given the surface of.

    That marker is large: it has no lifetime, so that it need not be sent again and again, and its
    triangles are computed anew only for other voxels.
    """

    def __init__(self) -> None:
        self._voxels: VoxelMap | None = None
        self._look: MarkerLook | None = None
        self._shown: MarkerLook | None = None

    def prepare(self, voxels: VoxelMap | None) -> None:
        """Compute the surface now, so that the next tick does not have to."""
        if voxels is not self._voxels:
            self._voxels, self._look = voxels, _look_of(voxels)

    def added_to(self, markers: MarkerBatch, voxels: VoxelMap | None) -> MarkerBatch:
        """Return the markers of a tick, with what brings viewers up to date with the voxels.

        The surface is added if it is new, or if the markers begin with a DELETEALL; a DELETE if
        there is no surface any more. `voxels` that did not change are the same object.
        """
        if markers.looks[:1] == DELETE_ALL.looks:
            self._shown = None
        self.prepare(voxels)
        if self._look is self._shown:
            return markers
        self._shown = self._look
        return markers.followed_by(MarkerBatch.unposed([self._look or _NO_SURFACE], [0]))


def _look_of(voxels: VoxelMap | None) -> MarkerLook | None:
    """Return the surface's looks in the map's frame, None if there is no surface."""
    if voxels is None or not voxels.occupied_count:
        return None
    vertices_m, faces = exposed_surface(voxels)
    return MarkerLook(
        ENVIRONMENT,
        MarkerKind.TRIANGLE_LIST,
        colour=_GREY,
        points=vertices_m[faces.ravel()],
        lifetime_ns=_ENDLESS_NS,
    )
