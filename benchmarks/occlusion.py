"""Occlusion against Embree and numpy, side by side: one 640 x 480 pinhole, boxes as occluders.

The peer traces the exposed faces of the voxels with embreex, one ray per pixel, tests each box by
slabs in numpy over all pixels, and compares as equation 2 says. Both give the pixels that see each
artefact; the largest difference is printed.

    python benchmarks/occlusion.py [repetitions] [octomap.bt]

With the octomap of a file the camera stands 1 m up in its middle, or near it.
"""

import argparse
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median

import numpy as np
import numpy.typing as npt
import trimesh

from are_ros.builder.occlusion.meshes import MeshPool, MeshSelection
from are_ros.builder.occlusion.rays import VoxelField
from are_ros.builder.occlusion.zbuffer import ZBuffer
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.cameras import FORWARD_FROM_OPTICAL, PinholeView
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_files.octomap import read_voxel_file
from are_ros.world.voxel_map import VoxelMap

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.world.surface import exposed_faces

try:
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene
except ImportError:
    raise SystemExit("embreex is not installed: pip install embreex") from None

Floats = npt.NDArray[np.float32]
Occupied = npt.NDArray[np.uint8]

VIEW = PinholeView.from_field_of_view(640, 480, math.pi / 2)
MAX_RANGE_M = 20.0
CAMERA_M = (10.01, 7.52, 1.03)
CAMERA = RigidTransform.from_xyz_ypr(*CAMERA_M, 0.7, 0.0, 0.0) @ FORWARD_FROM_OPTICAL


def walls(generator: np.random.Generator, shape: tuple[int, int]) -> npt.NDArray[np.bool_]:
    """Return the plan of a hall with short walls in it, clear around its middle."""
    plan = np.zeros(shape, dtype=np.bool_)
    plan[[0, -1]], plan[:, [0, -1]] = True, True
    for x, y in generator.integers(0, (shape[0] - 40, shape[1] - 40), (14, 2)).tolist():
        along_x = generator.random() < 0.5
        plan[x : x + (40 if along_x else 2), y : y + (2 if along_x else 40)] = True
    plan[160:240, 110:190] = False
    return plan


def hall() -> VoxelMap:
    """Return 20 x 15 m of floor and walls of 0.05 m voxels."""
    occupied = np.zeros((400, 300, 50), dtype=np.uint8)
    plan = walls(np.random.default_rng(1), (400, 300))
    occupied[plan, :20] = 1
    occupied[:, :, 0] = 1
    return VoxelMap(RigidTransform.identity(), (0.05, 0.05, 0.05), occupied)


def extruded_hall() -> VoxelMap:
    """Return the same walls as one layer of voxels of 2 m."""
    plan = walls(np.random.default_rng(1), (400, 300)).astype(np.uint8)
    return VoxelMap(RigidTransform.identity(), (0.05, 0.05, 2.0), plan[:, :, np.newaxis], True)


def crowd(count: int) -> OrientedBoxes:
    """Return people in view, 1.5 to 10 m away, on the floor."""
    generator = np.random.default_rng(count)
    ranges, bearings = generator.uniform(1.5, 10.0, count), generator.uniform(-0.1, 1.5, count)
    x, y = CAMERA_M[0] + ranges * np.cos(bearings), CAMERA_M[1] + ranges * np.sin(bearings)
    centres = np.column_stack((x, y, np.full(count, 0.95)))
    half_sizes = np.tile((0.25, 0.25, 0.9), (count, 1))
    return OrientedBoxes(centres, generator.uniform(-3.1, 3.1, count), half_sizes)


def capsule() -> trimesh.Trimesh:
    """Return a mesh of 960 triangles, its middle at 0."""
    solid = trimesh.creation.capsule(height=1.3, radius=0.25, count=[16, 32])
    solid.apply_translation((0.0, 0.0, -0.65))
    return solid


SOLID = capsule()
MOST_MESHES = 20
"""With more meshes the peer takes seconds."""


def capsules(count: int) -> MeshSelection:
    """Return that mesh for every box."""
    pool = MeshPool.of([(np.array(SOLID.vertices), SOLID.faces)])
    return MeshSelection(pool, np.zeros(count, dtype=np.int64))


def place_of_file(path: Path) -> VoxelMap:
    """Return the octomap of a file, moved so that the camera of the others stands in its middle."""
    centres_m, size_m = read_voxel_file(path, None)
    voxels = VoxelMap.from_centres(centres_m, size_m, RigidTransform.identity())
    floor = int(voxels.occupied.sum(axis=(0, 1)).argmax())  # the layer with most voxels
    size = voxels.voxel_size_m[2]
    level = min(floor + round(1.0 / size), voxels.occupied.shape[2] - 1)
    free = np.argwhere(voxels.occupied[:, :, level] == 0)
    free = free[voxels.occupied[free[:, 0], free[:, 1], floor] == 1]  # with a floor below
    middle = np.array(voxels.occupied.shape[:2]) / 2
    i, j = free[np.abs(free - middle).sum(axis=1).argmin()].tolist()
    here = voxels.map_from_lattice.apply(
        (np.array([(i, j, level)]) + 0.5) * np.array(voxels.voxel_size_m)
    )[0]
    shift = RigidTransform(np.array(CAMERA_M) - here, np.array([0.0, 0.0, 0.0, 1.0]))
    return VoxelMap.from_centres(centres_m, size_m, shift)


class Peer:
    """Embree over the exposed faces, and slabs in numpy."""

    def __init__(self, voxels: VoxelMap) -> None:
        surface = exposed_faces(voxels)
        corners = np.asarray(surface.vertices, dtype=np.float32)[surface.faces]
        self._bodies: list[TriangleMesh] = []  # scenes do not keep theirs alive
        self._scene = EmbreeScene()
        self._mesh = TriangleMesh(self._scene, corners)
        rays = VIEW.directions().reshape(-1, 3) @ CAMERA.rotation_matrix().T
        self.rays: Floats = np.ascontiguousarray(rays, dtype=np.float32)
        self._origin = CAMERA.translation_m
        self._planes: Floats = np.ascontiguousarray(self.rays.T)
        self._origins: Floats = np.tile(self._origin, (len(rays), 1)).astype(np.float32)

    def environment(self) -> Floats:
        """Return the environment's distance per pixel; Embree writes 1e37 for a miss."""
        distances: Floats = self._scene.run(self._origins, self.rays, query="DISTANCE")
        return distances

    def box_depth(self, boxes: OrientedBoxes, index: int) -> Floats:
        """Return where the rays enter a box, inf if they miss it or it is out of range."""
        x, y, z, cosine, sine, *half = boxes.packed[index].astype(np.float32)
        apart = (self._origin - (x, y, z)).astype(np.float32)
        turn = np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]], dtype=np.float32)
        near, far = np.float32(0.0), np.float32(np.inf)
        for start, ray, side in zip(turn @ apart, turn @ self._planes, half, strict=True):
            inverse = 1.0 / ray
            a, b = (-side - start) * inverse, (side - start) * inverse
            near = np.maximum(near, np.minimum(a, b))
            far = np.minimum(far, np.maximum(a, b))
        met = (near <= far) & (near <= MAX_RANGE_M)
        depth: Floats = np.where(met, near, np.float32(np.inf))
        return depth

    def meshes(self, boxes: OrientedBoxes, solid: trimesh.Trimesh) -> list[EmbreeScene]:
        """Return a scene for the mesh that stands in each box; this is not part of the job."""
        scenes = []
        for x, y, z, cosine, sine, *_ in boxes.packed.tolist():
            turn = np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])
            vertices = np.array(solid.vertices) @ turn + (x, y, z)
            scenes.append(EmbreeScene())
            self._bodies.append(TriangleMesh(scenes[-1], vertices[solid.faces].astype(np.float32)))
        return scenes

    def visible(self, boxes: OrientedBoxes, bodies: Sequence[EmbreeScene] = ()) -> list[int]:
        """Return how many pixels see each box; what hides others are the bodies, or the boxes.

        A box is never hidden by its own shape, which lies in it.
        """
        depths = [self.box_depth(boxes, index) for index in range(len(boxes))]
        front = self.environment()
        for body in bodies:
            np.minimum(front, body.run(self._origins, self.rays, query="DISTANCE"), out=front)
        for depth in () if bodies else depths:
            np.minimum(front, depth, out=front)
        front += np.float32(1e-3)
        return [int(np.count_nonzero((d <= front) & np.isfinite(d))) for d in depths]


def milliseconds(action: Callable[[], object]) -> float:
    """Return how long one call takes [ms]."""
    start = time.perf_counter()
    action()
    return 1e3 * (time.perf_counter() - start)


def compare(name: str, ours: Callable[[], object], peer: Callable[[], object], runs: int) -> None:
    """Print the medians of interleaved runs, and their ratio."""
    ours()
    times = [(milliseconds(ours), milliseconds(peer)) for _ in range(runs)]
    mine, theirs = median(t for t, _ in times), median(t for _, t in times)
    print(f"{name:<52}{mine:9.2f} ms {theirs:10.1f} ms {theirs / mine:8.1f}x")


def measure(title: str, voxels: VoxelMap, runs: int) -> None:
    """Print all comparisons for one environment."""
    print(f"\n{title}: {voxels.occupied_count} occupied voxels{'ours':>22}{'peer':>14}{'ratio':>9}")
    field, peer, buffer = VoxelField.of(voxels), Peer(voxels), ZBuffer(VIEW, MAX_RANGE_M)
    compare(
        "map structure",
        lambda: VoxelField.of(replace(voxels)),  # it is kept with the map: a new one is given
        lambda: Peer(voxels),
        max(1, runs // 4),
    )
    compare(
        "environment depth, every pixel",
        lambda: field.first_hits(CAMERA.translation_m, peer.rays, MAX_RANGE_M),
        peer.environment,
        runs,
    )
    for count in (5, 20, 200):
        measure_crowd(crowd(count), capsules(count), buffer, field, peer, runs)


def measure_crowd(
    boxes: OrientedBoxes,
    shapes: MeshSelection,
    buffer: ZBuffer,
    field: VoxelField,
    peer: Peer,
    runs: int,
) -> None:
    """Print the whole job for some artefacts, and how far the answers are apart."""
    compare(
        f"occlusion, {len(boxes)} artefacts, boxes",
        lambda: buffer.visibility(CAMERA, boxes, field),
        lambda: peer.visible(boxes),
        max(2, runs // (1 + len(boxes) // 20)),
    )
    if len(boxes) <= MOST_MESHES:
        bodies = peer.meshes(boxes, SOLID)
        compare(
            f"occlusion, {len(boxes)} artefacts, meshes of {len(SOLID.faces)} triangles",
            lambda: buffer.visibility(CAMERA, boxes, field, shapes),
            lambda: peer.visible(boxes, bodies),
            max(2, runs // (1 + len(boxes) // 20)),
        )
    seen = buffer.visibility(CAMERA, boxes, field).visible_pixels
    apart = int(np.abs(seen - peer.visible(boxes)).max())
    print(f"  {np.count_nonzero(seen)} seen; visible pixels differ by at most {apart}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("repetitions", nargs="?", type=int, default=9)
    parser.add_argument("octomap", nargs="?", type=Path)
    given = parser.parse_args()
    measure("Voxels of 0.05 m", hall(), given.repetitions)
    measure("One layer of tall voxels", extruded_hall(), given.repetitions)
    if given.octomap:
        measure("The octomap of the file", place_of_file(given.octomap), given.repetitions)
