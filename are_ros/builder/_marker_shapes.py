"""How one artefact looks: a body, a label above it and an arrow for its heading."""

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.conventions import NS_PER_S
from are_ros.parameters.choices import Shape
from are_ros.world.rigid_transform import RigidTransform

Vector3 = tuple[float, float, float]
Colour = tuple[float, float, float, float]
Points = npt.NDArray[np.float64]
Colours = npt.NDArray[np.float32]

LIFETIME_NS: Final = 3 * NS_PER_S
BODY, LABEL, HEADING = "body", "label", "heading"
OPAQUE, TRANSLUCENT = 1.0, 0.35
TEXT_HEIGHT_M, ARROW_THICKNESS_M, ARROW_OVERHANG_M, GAP_M = 0.3, 0.06, 0.3, 0.05
WHITE = (1.0, 1.0, 1.0)
UNIT_SCALE: Final = (1.0, 1.0, 1.0)
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
class MarkerSubject:
    """An artefact to be drawn, with its pose in the map's frame.

    The box's centre is in F_A [m], its size along F_A's axes, each above 0; `colour` is red, green,
    blue and alpha in [0, 1], of which alpha tells nothing here: perceived artefacts are opaque, the
    others translucent. `mesh_triangles_m` (T, 3, 3) are corners in F_A, None without a mesh;
    `mesh_colours` (T, 4) are their faces' colours, None for the plain colour.
    """

    artefact_id: int
    label: str
    map_from_artefact: RigidTransform
    box_centre_m: Vector3
    size_m: Vector3
    colour: Colour
    is_perceived: bool
    mesh_triangles_m: Points | None = None
    mesh_colours: npt.NDArray[np.floating] | None = None


@dataclass(frozen=True, eq=False)
class Marker:
    """A visualization_msgs/Marker as a value; pose and points in metres, the map's frame.

    `points` float64 (P, 3) and `colours` float32 (P, 4) or (0, 4) are a TRIANGLE_LIST's, relative
    to the pose. `marker_id` fits int32. What an action does not use has a valid default.
    """

    namespace: str
    marker_id: int
    kind: MarkerKind
    action: MarkerAction
    map_from_marker: RigidTransform = field(default_factory=RigidTransform.identity)
    scale: Vector3 = UNIT_SCALE
    colour: Colour = (*WHITE, OPAQUE)
    text: str = ""
    points: Points = field(default_factory=lambda: NO_POINTS)
    colours: Colours = field(default_factory=lambda: NO_COLOURS)
    lifetime_ns: int = LIFETIME_NS

    @classmethod
    def delete_all(cls) -> "Marker":
        """Return the marker that removes every one of the topic."""
        return cls("", 0, MarkerKind.CUBE, MarkerAction.DELETEALL)


def marker_id(artefact_id: int) -> int:
    """Return an artefact's id as a marker's: the same below 2^31, wrapped to int32 above."""
    return artefact_id % 2**31


def deletion(artefact_id: int) -> list[Marker]:
    """Return the markers that remove all of an artefact."""
    number = marker_id(artefact_id)
    return [
        Marker(namespace, number, kind, MarkerAction.DELETE)
        for namespace, kind in (
            (BODY, MarkerKind.CUBE),
            (LABEL, MarkerKind.TEXT_VIEW_FACING),
            (HEADING, MarkerKind.ARROW),
        )
    ]


def drawn(subject: MarkerSubject, shape: Shape) -> list[Marker]:
    """Return the markers of an artefact: body, label, heading."""
    x, y, z = subject.box_centre_m
    top = z + 0.5 * subject.size_m[2] + GAP_M
    offsets = np.array(((x, y, z), (x, y, top), (x, y, top + TEXT_HEIGHT_M)))
    places = subject.map_from_artefact.apply(offsets)
    poses = [RigidTransform(place, subject.map_from_artefact.rotation_xyzw) for place in places]
    triangles_m = subject.mesh_triangles_m
    if shape is Shape.MESH and triangles_m is not None and len(triangles_m) > 0:
        body = _mesh(subject, triangles_m)
    else:
        body = _box(subject, poses[0])
    return [body, _label(subject, poses[2]), _heading(subject, poses[1])]


def looks_equal(one: MarkerSubject, other: MarkerSubject) -> bool:
    """Return whether two subjects are drawn alike; meshes are compared by identity."""
    if one is other:
        return True
    return (
        _plain_looks(one) == _plain_looks(other)
        and one.mesh_triangles_m is other.mesh_triangles_m
        and one.mesh_colours is other.mesh_colours
    )


def _plain_looks(subject: MarkerSubject) -> tuple[object, ...]:
    pose = subject.map_from_artefact
    return (
        subject.label,
        subject.is_perceived,
        pose.translation_m.tobytes(),
        pose.rotation_xyzw.tobytes(),
        tuple(subject.box_centre_m),
        tuple(subject.size_m),
        tuple(subject.colour),
    )


def _alpha(subject: MarkerSubject) -> float:
    return OPAQUE if subject.is_perceived else TRANSLUCENT


def _mesh(subject: MarkerSubject, triangles_m: Points) -> Marker:
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
    return Marker(
        BODY,
        marker_id(subject.artefact_id),
        MarkerKind.TRIANGLE_LIST,
        MarkerAction.ADD,
        subject.map_from_artefact,
        colour=colour,
        points=points,
        colours=colours,
    )


def _box(subject: MarkerSubject, pose: RigidTransform) -> Marker:
    return Marker(
        BODY,
        marker_id(subject.artefact_id),
        MarkerKind.CUBE,
        MarkerAction.ADD,
        pose,
        subject.size_m,
        (*subject.colour[:3], _alpha(subject)),
    )


def _label(subject: MarkerSubject, pose: RigidTransform) -> Marker:
    """Return the label, or the id where there is none: rviz refuses an empty text."""
    return Marker(
        LABEL,
        marker_id(subject.artefact_id),
        MarkerKind.TEXT_VIEW_FACING,
        MarkerAction.ADD,
        pose,
        (TEXT_HEIGHT_M, TEXT_HEIGHT_M, TEXT_HEIGHT_M),
        (*WHITE, _alpha(subject)),
        text=subject.label if subject.label.strip() else str(subject.artefact_id),
    )


def _heading(subject: MarkerSubject, pose: RigidTransform) -> Marker:
    """Return an arrow from above the box's centre along F_A's x axis, past its front."""
    length_m = 0.5 * subject.size_m[0] + ARROW_OVERHANG_M
    return Marker(
        HEADING,
        marker_id(subject.artefact_id),
        MarkerKind.ARROW,
        MarkerAction.ADD,
        pose,
        (length_m, ARROW_THICKNESS_M, ARROW_THICKNESS_M),
        (*subject.colour[:3], _alpha(subject)),
    )
