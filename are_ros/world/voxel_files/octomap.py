"""OctoMap's files, binary (.bt) and full (.ot): the occupied leaves, as voxel centres.

A binary tree says of each leaf whether it is occupied. A full one has the log odds of each node; a
leaf is occupied from `OCCUPIED_LOG_ODDS` on, as OctoMap itself decides. The file has no threshold.
`read_voxel_file` reads these and all other files that M3D may come from.
"""

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled
from are_ros.errors import MapError
from are_ros.world.voxel_files.clouds import (
    MAX_CENTRES,
    Points,
    read_bytes,
    read_pcd_file,
    read_ply_file,
)

OCCUPIED_LOG_ODDS: Final = 0.0
"""OctoMap's occupancy threshold, a probability of 0.5."""

_TREE_DEPTH: Final = 16
FINEST_M, WIDEST_M = 1e-6, 1000.0
"""The voxels of an octree are wider than the first, and at most as wide as the second."""
_FIRST_LINE: Final = b"# Octomap OcTree binary file"
_FIRST_LINE_OF_OT: Final = b"# Octomap OcTree file"
_NODES: Final = {
    name: np.dtype([("log_odds", "<f4"), ("other", "u1", other), ("children", "u1")])
    for name, other in (("OcTree", 0), ("ColorOcTree", 3))
}
"""The nodes of a full tree by its type: the octree of colours has three bytes of colour."""
_WORD_BYTES: Final = 2
_WHOLE, _TRUNCATED, _TOO_DEEP = 0, 1, 2


class OctreeHeader(NamedTuple):
    """What an octree's bytes do not tell: the type of its nodes, its kind, the finest voxel's size.

    `node_count` is None where nobody counted them; `data_start` is the length of a file's header.
    """

    tree_type: str
    is_full: bool
    resolution_m: float
    node_count: int | None = None
    data_start: int = 0


def read_voxel_file(path: Path, voxel_size_m: float | None) -> tuple[Points, float | None]:
    """Return points (N, 3) [m], float32, in the map's frame, and the size of their voxels [m].

    The name's end tells the format: .pcd, .ply, and an octomap otherwise. The points are the
    centres of occupied voxels if the size is known; it is None for a point cloud, which may have
    any number of points in a voxel. `voxel_size_m` is what a mesh becomes voxels of, None if that
    is not chosen. Raises MapError.
    """
    suffix = path.suffix.lower()
    if suffix == ".ply":
        return read_ply_file(path, voxel_size_m)
    if suffix == ".pcd":
        return read_pcd_file(path), None
    return read_octomap_file(path)


def read_octomap_file(path: Path) -> tuple[npt.NDArray[np.float32], float]:
    """Return centres (N, 3) [m], float32, of the occupied voxels of an octomap, and their size.

    Leaves of every size are expanded to voxels of the finest size; the frame is the octree's
    own, with voxel corners at multiples of the size; the order is that of the file. N may be 0.
    Raises MapError for a file that is missing, of another kind, truncated, inconsistent with its
    header, or of more than `MAX_CENTRES` voxels.
    """
    data = read_bytes(path)
    header = _parsed_header(path, data)
    centres_m = read_octree(str(path), data[header.data_start :], header)
    return centres_m, header.resolution_m


def read_octree(source: str, data: bytes, header: OctreeHeader) -> npt.NDArray[np.float32]:
    """Return the centres (N, 3) [m], float32, of `read_octomap_file` from an octree's bytes alone.

    Raises MapError as there, but for a missing file; its sentence begins with `source`.
    """
    if header.tree_type not in _NODES:
        known = tuple(_NODES)
        raise MapError(f"{source}: the octomap's id is {header.tree_type}, not one of {known}")
    leaves = _occupied_leaves(source, data, header)
    count = sum(8 ** int(level) * int(n) for level, n in enumerate(np.bincount(leaves[:, 3])))
    if count > MAX_CENTRES:
        message = (
            f"{source}: {count} voxels of {header.resolution_m:g} m are more than {MAX_CENTRES};"
            f" crop or coarsen the octomap"
        )
        raise MapError(message)
    return _expanded(leaves, count, header.resolution_m)


def _parsed_header(path: Path, data: bytes) -> OctreeHeader:
    is_full = _is_full(path, data)
    fields: dict[str, str] = {}
    position = 0
    while True:
        end = data.find(b"\n", position)
        if end < 0:
            raise MapError(f"{path}: the octomap's header is truncated, it has no line 'data'")
        words = data[position:end].decode("latin-1").split()
        position = end + 1
        if words[:1] == ["data"]:
            break
        if len(words) > 1 and not words[0].startswith("#"):
            fields[words[0]] = words[1]
    numbers = _resolution_m(path, fields), _node_count(path, fields)
    return OctreeHeader(fields.get("id", "None"), is_full, *numbers, position)


def _is_full(path: Path, data: bytes) -> bool:
    """Return whether the first line is that of a full tree; MapError if it is no octomap's."""
    is_full = data.startswith(_FIRST_LINE_OF_OT)
    if not is_full and not data.startswith(_FIRST_LINE):
        known = f"'{_FIRST_LINE.decode()}' or '{_FIRST_LINE_OF_OT.decode()}'"
        message = (
            f"{path}: this is no octomap, its first line is not {known}; the names of point clouds"
            " end in .pcd or .ply"
        )
        raise MapError(message)
    return is_full


def _node_count(path: Path, fields: dict[str, str]) -> int:
    text = fields.get("size", "")
    if not (text.isascii() and text.isdigit() and len(text) < 19):
        raise MapError(f"{path}: the octomap's size is {text!r}, not a number of nodes")
    return int(text)


def _resolution_m(path: Path, fields: dict[str, str]) -> float:
    text = fields.get("res", "")
    try:
        resolution_m = float(text)
    except ValueError:
        resolution_m = math.nan
    if not FINEST_M < resolution_m <= WIDEST_M:  # nan is neither
        raise MapError(
            f"{path}: the octomap's res is {text[:20]!r}, not a positive length of a voxel"
        )
    return resolution_m


def _occupied_leaves(source: str, data: bytes, header: OctreeHeader) -> npt.NDArray[np.int64]:
    """Return (L, 4): low voxel index x, y, z and level of each occupied leaf, 2**level wide."""
    none = np.empty((0, 4), dtype=np.int64)
    if header.node_count == 0 or (header.node_count is None and not data):
        return none
    walk: _Walk = partial(_walk, np.frombuffer(data, np.uint8))
    if header.is_full:
        walk = _full_walk(source, data, header)
    status, nodes, count, read = walk(none)
    if status == _TRUNCATED:
        raise MapError(f"{source}: the octomap's data are truncated, {len(data)} bytes are too few")
    if status == _TOO_DEEP:
        message = f"{source}: the octomap's data are corrupt, deeper than {_TREE_DEPTH} levels"
        raise MapError(message)
    _check_rest(source, len(data), read, header)
    if header.node_count not in (None, nodes):
        counted = header.node_count
        message = f"{source}: the octomap holds {nodes} nodes, but its size says {counted}"
        raise MapError(message)
    leaves = np.empty((count, 4), dtype=np.int64)
    walk(leaves)
    return leaves


def _check_rest(source: str, size: int, read: int, header: OctreeHeader) -> None:
    """Refuse a tree that ends before its data, where nobody counted its nodes."""
    rest = size - read * (_NODES[header.tree_type].itemsize if header.is_full else _WORD_BYTES)
    if header.node_count is None and rest:
        kinds = ("binary", "full") if not header.is_full else ("full", "binary")
        message = (
            f"{source}: the octomap's data are corrupt: its tree, read as a {kinds[0]} one, ends"
            f" {rest} bytes before them; is it a {kinds[1]} one, or of another type?"
        )
        raise MapError(message)


_Walk = Callable[[npt.NDArray[np.int64]], tuple[int, int, int, int]]
"""Walks a tree depth first; returns status, nodes and occupied leaves, storing what fits.

And how many records it read: of a full tree its nodes, of a binary one the inner nodes' words.
"""


def _full_walk(source: str, data: bytes, header: OctreeHeader) -> _Walk:
    node = _NODES[header.tree_type]
    count = len(data) // node.itemsize
    count = count if header.node_count is None else min(header.node_count, count)
    nodes = np.frombuffer(data, node, count=count)
    log_odds = nodes["log_odds"]
    if not np.isfinite(log_odds).all():
        raise MapError(f"{source}: the octomap's data are corrupt, log odds are not finite")
    is_occupied = (log_odds >= OCCUPIED_LOG_ODDS).astype(np.uint8)
    return partial(_walk_full, is_occupied, np.ascontiguousarray(nodes["children"]))


@compiled
def _walk_full(
    is_occupied: npt.NDArray[np.uint8],
    children: npt.NDArray[np.uint8],
    leaves: npt.NDArray[np.int64],
) -> tuple[int, int, int, int]:
    """Walk a full tree, whose nodes (N,) are in depth-first order, the root first.

    Bit i of a node's children says that there is child i; a node without any is a leaf. Bits 0, 1,
    2 of a child's number are its x, y, z.
    """
    corner = np.zeros((_TREE_DEPTH + 1, 3), dtype=np.int64)
    corner[0, :] = -(1 << (_TREE_DEPTH - 1))
    unread = np.zeros(_TREE_DEPTH + 1, dtype=np.int64)
    nodes, count, depth = 0, 0, 0
    while True:
        if nodes == children.shape[0]:
            return _TRUNCATED, nodes, count, nodes
        level = _TREE_DEPTH - depth
        unread[depth] = children[nodes]
        if unread[depth] == 0 and is_occupied[nodes]:
            if count < leaves.shape[0]:
                leaves[count, 0], leaves[count, 1] = corner[depth, 0], corner[depth, 1]
                leaves[count, 2], leaves[count, 3] = corner[depth, 2], level
            count += 1
        nodes += 1
        while unread[depth] == 0:
            if depth == 0:
                return _WHOLE, nodes, count, nodes
            depth -= 1
        if depth == _TREE_DEPTH:
            return _TOO_DEEP, nodes, count, nodes
        number = 0
        while unread[depth] >> number & 1 == 0:
            number += 1
        unread[depth] &= ~(1 << number)
        half = _TREE_DEPTH - 1 - depth
        for axis in range(3):
            corner[depth + 1, axis] = corner[depth, axis] + ((number >> axis & 1) << half)
        depth += 1


@compiled
def _walk(codes: npt.NDArray[np.uint8], leaves: npt.NDArray[np.int64]) -> tuple[int, int, int, int]:
    """Walk a binary tree.

    A node is two bytes, two bits a child: 0 unknown, 1 free leaf, 2 occupied leaf, 3 inner node;
    the inner children follow in order. Bits 0, 1, 2 of a child's number are its x, y, z.
    """
    corner = np.zeros((_TREE_DEPTH + 1, 3), dtype=np.int64)
    corner[0, :] = -(1 << (_TREE_DEPTH - 1))
    word = np.zeros(_TREE_DEPTH + 1, dtype=np.int64)
    child = np.zeros(_TREE_DEPTH + 1, dtype=np.int64)
    if codes.shape[0] < 2:
        return _TRUNCATED, 0, 0, 0
    word[0] = np.int64(codes[0]) | np.int64(codes[1]) << 8
    position, nodes, count, depth = 2, 1, 0, 0
    while depth >= 0:
        if child[depth] == 8:
            depth -= 1
            continue
        number = child[depth]
        code = (word[depth] >> (2 * number)) & 3
        child[depth] += 1
        if code == 0:
            continue
        nodes += 1
        level = _TREE_DEPTH - 1 - depth
        x = corner[depth, 0] + ((number & 1) << level)
        y = corner[depth, 1] + ((number >> 1 & 1) << level)
        z = corner[depth, 2] + ((number >> 2 & 1) << level)
        if code == 2:
            if count < leaves.shape[0]:
                leaves[count, 0], leaves[count, 1] = x, y
                leaves[count, 2], leaves[count, 3] = z, level
            count += 1
        elif code == 3:
            if level == 0:
                return _TOO_DEEP, nodes, count, position // 2
            if position + 2 > codes.shape[0]:
                return _TRUNCATED, nodes, count, position // 2
            depth += 1
            corner[depth, 0], corner[depth, 1], corner[depth, 2] = x, y, z
            word[depth] = np.int64(codes[position]) | np.int64(codes[position + 1]) << 8
            child[depth] = 0
            position += 2
    return _WHOLE, nodes, count, position // 2


def _expanded(
    leaves: npt.NDArray[np.int64], count: int, resolution_m: float
) -> npt.NDArray[np.float32]:
    """Return the centres (count, 3) [m] of the finest voxels that leaves (L, 4) consist of."""
    widths = np.left_shift(1, leaves[:, 3])
    sizes = widths**3
    width = np.repeat(widths, sizes)
    number = np.arange(count) - np.repeat(np.cumsum(sizes) - sizes, sizes)  # within its leaf
    inner = np.column_stack((number // width**2, number // width % width, number % width))
    indices = np.repeat(leaves[:, :3], sizes, axis=0) + inner
    centres_m: npt.NDArray[np.float32] = ((indices + 0.5) * resolution_m).astype(np.float32)
    return centres_m
