"""Ten artefacts painted into an image of 640 x 480, against VTK and pyrender off-screen.

    python benchmarks/rendering.py [repetitions]

Seven persons and three pallets near the camera, which fill the image, and ten persons 3 to 8 m
away, as a robot sees them; through a lens without distortion, which is what the peers can draw.

The peers (pip install vtk pyrender) get the same surfaces, triangles with normals and colours, that
stay; at each image their poses change, they draw with four samples a pixel, and colours and depths
are read back. Ours paints coarser surfaces of what is far away; the peers get the whole ones, as a
user would give them, and VTK once more those that ours takes for the first image. Then numpy and
OpenCV compare the depths with the real ones, and lay the colours over the image, blurred as ours
are. Ours is the whole job, too, and besides shadows, noise, mask and visible shares.

Peers draw with what OpenGL the machine has, on a server in software. All on one thread
(LP_NUM_THREADS=0 keeps Mesa to one, OpenCV is told). Medians and least values, of interleaved
images, of the processor's time, in which the waiting for other work on the machine does not count,
and their ratios.
"""

import argparse
import os
import time
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from typing import Any

os.environ.setdefault("LP_NUM_THREADS", "0")
os.environ.setdefault("PYOPENGL_PLATFORM", "egl")

import cv2
import numpy as np
import numpy.typing as npt

from are_ros.builder.assembly import catalogue_of
from are_ros.builder.rendering.painter import Lighting, PaintedBody, Painter
from are_ros.builder.rendering.surface import SurfaceBank
from are_ros.parameters.model import Parameters
from are_ros.world.cameras import FORWARD_FROM_OPTICAL, PinholeView
from are_ros.world.rigid_transform import RigidTransform

VIEW = PinholeView(640, 480, 525.0, 525.0, 319.5, 239.5)
CAMERA = RigidTransform.from_xyz_ypr(0.0, 0.0, 1.2, 0.0, 0.1, 0.0) @ FORWARD_FROM_OPTICAL


BANK = SurfaceBank(1)
ROWS = catalogue_of(Parameters()).rows
PERSONS = [row for row in ROWS if row.class_name == "person"]
CHOSEN = [*PERSONS[:7], *[row for row in ROWS if row.class_name != "person"][:3]]
Bodies = Callable[[float], list[PaintedBody]]


def near_bodies(turn: float) -> list[PaintedBody]:
    """Return seven persons and three things, 3 to 5 m ahead, turned by an angle."""
    found = []
    for number, row in enumerate(CHOSEN):
        half = 0.5 * np.array(row.size_m)
        x, y = 3.0 + 0.6 * (number % 4), -2.0 + 0.45 * number
        pose = RigidTransform.planar(x, y, 2.5 + 0.4 * number + turn, float(half[2]))
        found.append(PaintedBody(BANK.of(row, number), pose, half, 0.0))
    return found


def far_bodies(turn: float) -> list[PaintedBody]:
    """Return ten persons, 3 to 8 m ahead, turned by an angle."""
    found = []
    for number in range(10):
        row = PERSONS[number % len(PERSONS)]
        half = 0.5 * np.array(row.size_m)
        x = 3.0 + 5.0 * number / 9
        y = 0.45 * x * (2.0 * ((7 * number) % 10) / 9 - 1.0)
        pose = RigidTransform.planar(x, y, 2.5 + 0.4 * number + turn, float(half[2]))
        found.append(PaintedBody(BANK.of(row, number), pose, half, 0.0))
    return found


IMAGE = np.full((480, 640, 3), 120, dtype=np.uint8)
REAL_M = np.full((480, 640), 30.0, dtype=np.float32)


def by_are(bodies: Bodies) -> Callable[[int], None]:
    """Return what paints image k."""
    painter, lighting = Painter(VIEW), Lighting()

    def paint(k: int) -> None:
        random = np.random.default_rng(k)
        painter.paint(IMAGE, CAMERA, bodies(0.01 * k), REAL_M, lighting, random)

    return paint


def coarser(bodies: Bodies) -> Bodies:
    """Return bodies with the surfaces that the painter takes for the first image."""
    surfaces = []
    for body in bodies(0.0):
        camera_m = (CAMERA.inverse() @ body.map_from_box).inverse().translation_m
        away_m = np.linalg.norm(np.maximum(np.abs(camera_m) - body.half_sizes_m, 0.0))
        surfaces.append(body.surface.within(float(away_m) / VIEW.fx))

    def with_these(turn: float) -> list[PaintedBody]:
        pairs = zip(bodies(turn), surfaces, strict=True)
        return [replace(body, surface=surface) for body, surface in pairs]

    return with_these


def actor_of(body: PaintedBody, vtk: Any, support: Any) -> Any:
    """Return a body as VTK takes it."""
    corners = body.surface.corners_m.reshape(-1, 3)
    points, cells, data = vtk.vtkPoints(), vtk.vtkCellArray(), vtk.vtkPolyData()
    points.SetData(support.numpy_to_vtk(corners, deep=1))
    count = len(corners) // 3
    faces = np.column_stack((np.full(count, 3), np.arange(3 * count).reshape(-1, 3)))
    cells.SetCells(count, support.numpy_to_vtkIdTypeArray(faces.ravel().astype(np.int64), deep=1))
    data.SetPoints(points)
    data.SetPolys(cells)
    colours = (255.0 * np.sqrt(body.surface.colours.reshape(-1, 3))).astype(np.uint8)
    data.GetPointData().SetScalars(support.numpy_to_vtk(colours, deep=1))
    normals = body.surface.normals.reshape(-1, 3)
    data.GetPointData().SetNormals(support.numpy_to_vtk(normals, deep=1))
    mapper, actor = vtk.vtkPolyDataMapper(), vtk.vtkActor()
    mapper.SetInputData(data)
    actor.SetMapper(mapper)
    return actor


CLIPPING_M = (0.1, 30.0)
LENGTHS = np.linalg.norm(VIEW.rays_to_depth(), axis=2).astype(np.float32)
"""How long a ray is at a depth of 1 m."""


def lay_over(
    colours: npt.NDArray[Any], depths_m: npt.NDArray[Any], is_drawn: npt.NDArray[np.bool_]
) -> npt.NDArray[np.uint8]:
    """Return the image with what a peer drew and nothing real hides."""
    is_seen = is_drawn & (LENGTHS * depths_m <= REAL_M + 0.02)
    alpha = cv2.GaussianBlur(is_seen.astype(np.float32), (0, 0), 0.5)[:, :, np.newaxis]
    over = cv2.GaussianBlur(colours * is_seen[:, :, np.newaxis].astype(np.float32), (0, 0), 0.5)
    mixed: npt.NDArray[np.uint8] = np.clip(over + (1.0 - alpha) * IMAGE, 0, 255).astype(np.uint8)
    return mixed


def by_pyrender(bodies: Bodies) -> Callable[[int], None]:
    """Return what does the whole job for image k; ImportError without pyrender."""
    vars(np)["infty"] = np.inf  # pyrender's last release is older than numpy 2
    pyrender, trimesh = import_module("pyrender"), import_module("trimesh")
    scene = pyrender.Scene(bg_color=(0.0, 0.0, 0.0, 0.0))
    gl_camera = CAMERA.matrix() @ np.diag((1.0, -1.0, -1.0, 1.0))
    near_m, far_m = CLIPPING_M
    lens = pyrender.IntrinsicsCamera(VIEW.fx, VIEW.fy, VIEW.cx, VIEW.cy, znear=near_m, zfar=far_m)
    scene.add(lens, pose=gl_camera)
    scene.add(pyrender.DirectionalLight(intensity=3.0), pose=gl_camera)
    nodes = []
    for body in bodies(0.0):
        corners = body.surface.corners_m.reshape(-1, 3)
        mesh = trimesh.Trimesh(
            corners,
            np.arange(len(corners)).reshape(-1, 3),
            vertex_normals=body.surface.normals.reshape(-1, 3),
            vertex_colors=(255.0 * np.sqrt(body.surface.colours.reshape(-1, 3))).astype(np.uint8),
            process=False,
        )
        nodes.append(scene.add(pyrender.Mesh.from_trimesh(mesh)))
    renderer = pyrender.OffscreenRenderer(VIEW.width, VIEW.height)

    def compose(k: int) -> None:
        for node, body in zip(nodes, bodies(0.01 * k), strict=True):
            scene.set_pose(node, body.map_from_box.matrix())
        colours, depths_m = renderer.render(scene)
        if not depths_m.any():
            raise SystemExit("pyrender drew nothing")
        lay_over(colours, depths_m, depths_m > 0.0)

    return compose


def by_vtk(bodies: Bodies) -> tuple[Callable[[int], None], Callable[[int], None]]:
    """Return what draws image k and reads it back, and what does the whole job.

    ImportError without VTK.
    """
    vtk: Any = import_module("vtk")
    support: Any = import_module("vtk.util.numpy_support")
    renderer, window = vtk.vtkRenderer(), vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetSize(VIEW.width, VIEW.height)
    window.SetMultiSamples(4)
    window.AddRenderer(renderer)
    camera = renderer.GetActiveCamera()
    matrix = CAMERA.rotation_matrix()
    place = CAMERA.translation_m
    camera.SetPosition(*place)
    camera.SetFocalPoint(*(place + matrix[:, 2]))
    camera.SetViewUp(*-matrix[:, 1])
    camera.SetViewAngle(2.0 * np.degrees(np.arctan2(240.0, VIEW.fy)))
    camera.SetClippingRange(*CLIPPING_M)
    actors = []
    for body in bodies(0.0):
        actor = actor_of(body, vtk, support)
        renderer.AddActor(actor)
        actors.append(actor)

    def read(kind: str) -> npt.NDArray[np.float64]:
        found = vtk.vtkWindowToImageFilter()
        found.SetInput(window)
        found.ReadFrontBufferOff()
        found.SetShouldRerender(0)
        if kind == "depth":
            found.SetInputBufferTypeToZBuffer()
        found.Update()
        scalars = found.GetOutput().GetPointData().GetScalars()
        numbers: npt.NDArray[np.float64] = support.vtk_to_numpy(scalars)
        return numbers

    def draw(k: int) -> None:
        for actor, body in zip(actors, bodies(0.01 * k), strict=True):
            pose = vtk.vtkMatrix4x4()
            pose.DeepCopy(body.map_from_box.matrix().ravel())
            actor.SetUserMatrix(pose)
        window.Render()
        if not (read("colour").any() and read("depth").min() < 1.0):
            raise SystemExit("VTK drew nothing")

    def compose(k: int) -> None:
        draw(k)
        colours = read("colour").reshape(480, 640, -1)[::-1, :, :3]
        near_m, far_m = CLIPPING_M
        share = read("depth").reshape(480, 640)[::-1]
        depths_m = near_m * far_m / (far_m - share * (far_m - near_m))
        lay_over(colours, depths_m, share < 1.0)

    return draw, compose


def milliseconds(way: Callable[[int], None], k: int) -> float:
    """Return the processor's time of a call."""
    start_s = time.process_time()
    way(k)
    return 1e3 * (time.process_time() - start_s)


def measure(name: str, bodies: Bodies, repetitions: int) -> None:
    """Measure all ways in turns, and print medians, least times and ratios."""
    ways = {"are_ros, whole job": by_are(bodies)}
    try:
        drawing, whole = by_vtk(bodies)
        ways |= {"VTK, drawing and reading back": drawing, "VTK, whole job": whole}
        ways["VTK, coarser, whole job"] = by_vtk(coarser(bodies))[1]
        ways["pyrender, whole job"] = by_pyrender(bodies)
    except ImportError as missing:
        raise SystemExit(f"{missing.name} is not installed: pip install vtk pyrender") from None
    for way in ways.values():
        way(0)
    times = np.array([[milliseconds(way, k) for way in ways.values()] for k in range(repetitions)])
    middle, least = np.median(times, axis=0), times.min(axis=0)
    for number, way_name in enumerate(ways):
        print(
            f"{name}: {way_name:<30} {middle[number]:6.1f} ms, least {least[number]:6.1f};"
            f" ours is {middle[number] / middle[0]:4.1f} and {least[number] / least[0]:4.1f} times"
            " as quick"
        )


def main() -> None:
    """Measure both scenes."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("repetitions", nargs="?", type=int, default=60)
    given = parser.parse_args()
    cv2.setNumThreads(1)
    measure("near", near_bodies, given.repetitions)
    measure("3 to 8 m", far_bodies, given.repetitions)


if __name__ == "__main__":
    main()
