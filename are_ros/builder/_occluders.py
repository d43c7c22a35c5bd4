"""What the artefacts hide of each other (the other artefacts in Z_S)."""

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.builder._mesh_kernels import Tree
from are_ros.builder._mesh_tiles import cast_tile
from are_ros.builder._occlusion_types import INFINITE, TIE_M, Boxes, Scratch
from are_ros.builder._ray_tiles import PIXELS


@compiled
def hide_behind_others(
    boxes: Boxes,
    tree: Tree,
    axis: npt.NDArray[np.float32],
    spread: np.float32,
    count: int,
    scratch: Scratch,
) -> None:
    """Set Z_a to inf where another artefact's shape is in front of a's box.

    A shape lies within its box: so a's own shape never hides a, one front serves all, and a shape
    matters only where its box is before some other box and before the front known so far.
    """
    depths, front, last = scratch.depths, scratch.front_m, scratch.last_m
    front[:] = INFINITE
    last[:] = -INFINITE
    for candidate in range(count):
        _raise_to(depths[candidate], last)
    for place in _nearest_first(depths, count, scratch.nearest_m):
        if not _matters(depths[place], last, front):
            continue
        box = scratch.candidates[place]
        if boxes.meshes[box] < 0:
            _lower_to(depths[place], front)
        else:
            _lower_to_mesh(boxes, tree, box, axis, spread, scratch)
    for candidate in range(count):
        _hide_behind(front, depths[candidate])


@compiled
def _nearest_first(
    depths: npt.NDArray[np.float32], count: int, nearest_m: npt.NDArray[np.float32]
) -> npt.NDArray[np.int64]:
    """Return the candidates in the order of their least depth in the tile."""
    for candidate in range(count):
        nearest_m[candidate] = depths[candidate].min()
    return np.argsort(nearest_m[:count])


@compiled
def _raise_to(depths: npt.NDArray[np.float32], last: npt.NDArray[np.float32]) -> None:
    for pixel in range(PIXELS):
        higher = (depths[pixel] > last[pixel]) & (depths[pixel] < INFINITE)
        last[pixel] = depths[pixel] if higher else last[pixel]


@compiled
def _lower_to(depths: npt.NDArray[np.float32], front: npt.NDArray[np.float32]) -> None:
    for pixel in range(PIXELS):
        front[pixel] = min(front[pixel], depths[pixel])


@compiled
def _matters(
    depths: npt.NDArray[np.float32],
    last: npt.NDArray[np.float32],
    front: npt.NDArray[np.float32],
) -> bool:
    matters = np.int32(0)
    for pixel in range(PIXELS):
        depth = depths[pixel]
        matters += np.int32((depth + TIE_M < last[pixel]) & (depth < front[pixel]))
    return bool(matters > 0)


@compiled
def _hide_behind(front: npt.NDArray[np.float32], depths: npt.NDArray[np.float32]) -> None:
    for pixel in range(PIXELS):
        hidden = depths[pixel] > front[pixel] + TIE_M
        depths[pixel] = INFINITE if hidden else depths[pixel]


@compiled
def _lower_to_mesh(
    boxes: Boxes,
    tree: Tree,
    box: int,
    axis: npt.NDArray[np.float32],
    spread: np.float32,
    scratch: Scratch,
) -> None:
    """Lower the front to the mesh that stands in a box."""
    cosine, sine = boxes.turns[box, 0], boxes.turns[box, 1]
    rays, turned = scratch.rays, scratch.mesh_rays
    for pixel in range(PIXELS):
        turned[0, pixel] = cosine * rays[0, pixel] + sine * rays[1, pixel]
        turned[1, pixel] = cosine * rays[1, pixel] - sine * rays[0, pixel]
        turned[2, pixel] = rays[2, pixel]
    mesh_axis = np.empty(3, dtype=np.float32)
    mesh_axis[0] = cosine * axis[0] + sine * axis[1]
    mesh_axis[1] = cosine * axis[1] - sine * axis[0]
    mesh_axis[2] = axis[2]
    grown = spread * boxes.far_m[box]
    cast_tile(
        tree, boxes.meshes[box], boxes.cameras_m[box], mesh_axis, grown, turned, scratch.front_m
    )
