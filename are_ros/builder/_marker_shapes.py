"""How one artefact looks: a body, a label above it and an arrow for its heading and speed."""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.builder.marker_batch import (
    NO_COLOURS,
    Colour,
    MarkerAction,
    MarkerKind,
    MarkerLook,
    Points,
    Vector3,
)
from are_ros.conventions import NS_PER_S
from are_ros.parameters.choices import Labels, Shape

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
