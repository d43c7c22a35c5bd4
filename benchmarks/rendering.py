"""Ten artefacts painted into an image of 640 x 480, against VTK drawing them off-screen.

    python benchmarks/rendering.py [repetitions]

VTK (pip install vtk) gets the same triangles, normals and colours as actors that stay; at each
image their poses change, it draws with four samples a pixel, and colours and depths are read back,
which hiding behind real things takes. Ours is the whole job: it draws, compares with real ranges,
shades, lays shadows and artefacts over the image with blur and noise, and makes mask and visible
shares. VTK draws with what OpenGL the machine has, on a server in software. Both on one thread
(LP_NUM_THREADS=0 keeps Mesa to one). Medians, and their ratio.
"""

import os
import sys
import time
from collections.abc import Callable
from importlib import import_module
from typing import Any

os.environ.setdefault("LP_NUM_THREADS", "0")

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


def bodies(turn: float) -> list[PaintedBody]:
    """Return seven persons and three things, 3 to 5 m ahead, turned by an angle."""
    found = []
    for number, row in enumerate(CHOSEN):
        half = 0.5 * np.array(row.size_m)
        x, y = 3.0 + 0.6 * (number % 4), -2.0 + 0.45 * number
        pose = RigidTransform.planar(x, y, 2.5 + 0.4 * number + turn, float(half[2]))
        found.append(PaintedBody(BANK.of(row, number), pose, half, 0.0))
    return found


BANK = SurfaceBank(1)
ROWS = catalogue_of(Parameters()).rows
CHOSEN = [
    *[row for row in ROWS if row.class_name == "person"][:7],
    *[row for row in ROWS if row.class_name != "person"][:3],
]


def by_are() -> Callable[[int], None]:
    """Return what paints image k."""
    painter, lighting = Painter(VIEW), Lighting()
    image = np.full((480, 640, 3), 120, dtype=np.uint8)
    nothing = np.full((480, 640), 30.0, dtype=np.float32)

    def paint(k: int) -> None:
        random = np.random.default_rng(k)
        painter.paint(image, CAMERA, bodies(0.01 * k), nothing, lighting, random)

    return paint


def by_vtk() -> Callable[[int], None]:
    """Return what draws image k; ImportError without VTK."""
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
    camera.SetClippingRange(0.1, 30.0)
    actors = []
    for body in bodies(0.0):
        corners = body.surface.corners_m.reshape(-1, 3)
        points, cells, data = vtk.vtkPoints(), vtk.vtkCellArray(), vtk.vtkPolyData()
        points.SetData(support.numpy_to_vtk(corners, deep=1))
        count = len(corners) // 3
        faces = np.column_stack((np.full(count, 3), np.arange(3 * count).reshape(-1, 3)))
        cells.SetCells(
            count, support.numpy_to_vtkIdTypeArray(faces.ravel().astype(np.int64), deep=1)
        )
        data.SetPoints(points)
        data.SetPolys(cells)
        colours = (255.0 * np.sqrt(body.surface.colours.reshape(-1, 3))).astype(np.uint8)
        data.GetPointData().SetScalars(support.numpy_to_vtk(colours, deep=1))
        data.GetPointData().SetNormals(
            support.numpy_to_vtk(body.surface.normals.reshape(-1, 3), deep=1)
        )
        mapper, actor = vtk.vtkPolyDataMapper(), vtk.vtkActor()
        mapper.SetInputData(data)
        actor.SetMapper(mapper)
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

    return draw


def median_ms(way: Callable[[int], None], repetitions: int) -> float:
    """Return the median time of a call."""
    times = []
    for k in range(repetitions + 3):
        start_s = time.perf_counter()
        way(k)
        times.append(time.perf_counter() - start_s)
    return 1e3 * float(np.median(times[3:]))


def main() -> None:
    """Measure both in turns, and print the medians."""
    repetitions = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    ours = by_are()
    try:
        theirs = by_vtk()
    except ImportError:
        print(f"are_ros {median_ms(ours, repetitions):.1f} ms; VTK is not installed")
        return
    rounds = [(median_ms(ours, repetitions), median_ms(theirs, repetitions)) for _ in range(3)]
    mine, other = np.median(rounds, axis=0).tolist()
    print(f"are_ros {mine:.1f} ms, VTK {other:.1f} ms an image: {other / mine:.1f} times as quick")


if __name__ == "__main__":
    main()
