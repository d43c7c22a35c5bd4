"""Coarser surfaces: how far they are from the whole ones, by distances, outlines and colours."""

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.builder.rendering.painter import Lighting, PaintedBody, Painter, Painting
from are_ros.builder.rendering.surface import Surface, SurfaceBank
from are_ros.population.meshes.appearance import DrawnMesh
from are_ros.world.cameras import FORWARD_FROM_OPTICAL, PinholeView
from are_ros.world.rigid_transform import RigidTransform
from tests.builder.rendering.plain_surfaces import plain_surface

trimesh = pytest.importorskip("trimesh")

Floats = npt.NDArray[np.float64]
VIEW = PinholeView(320, 320, 525.0, 525.0, 159.5, 159.5)
CAMERA = RigidTransform.from_xyz_ypr(0.0, 0.0, 0.9, 0.0, 0.0, 0.0) @ FORWARD_FROM_OPTICAL
GREY = np.full((320, 320, 3), 120, dtype=np.uint8)
NOTHING = np.full((320, 320), np.inf, dtype=np.float32)
PLAIN = Lighting(is_estimated=False, shadow=0.0, blur_px=0.0, noise=0.0)
ROWS = {row.label: row for row in read_catalogue().rows}
LABELS = [
    "person_adult",
    "person_child_tall",
    "pallet_euro",
    "car_city_red",
    "structure_cone",
    "structure_door",
    "structure_wall",
]
BANK = SurfaceBank(3)


def solid_of(surface: Surface) -> Any:
    """Return the triangles with their points in common."""
    return trimesh.Trimesh(surface.points_m, surface.indices, process=False)


def farthest_m(surface: Surface, coarse: Surface) -> float:
    """Return how far the points of a surface are from a coarser one: each from all triangles."""
    corners, kept = coarse.corners_m.astype(np.float64), {p.tobytes() for p in coarse.points_m}
    removed = [point for point in surface.points_m if point.tobytes() not in kept]
    most = 0.0
    for point in np.array(removed, dtype=np.float64).reshape(-1, 3):
        places = trimesh.triangles.closest_point(corners, np.tile(point, (len(corners), 1)))
        most = max(most, float(np.linalg.norm(places - point, axis=1).min()))
    return most


def ball(seam: bool = False) -> Surface:
    """Return a closed ball of 1,280 triangles; with a seam its upper half is of another colour."""
    body = trimesh.creation.icosphere(3, radius=0.5)
    corners = np.asarray(body.vertices)[body.faces]
    colours = np.full((len(corners), 3), 0.5)
    if seam:
        colours[corners.mean(axis=1)[:, 2] > 0.0] = (0.9, 0.1, 0.1)
    return plain_surface(corners, colours, is_closed=True)


def textured_pipe() -> Surface:
    """Return an open pipe, 1 m high, of 4,800 triangles, with a picture around it."""
    around, up = np.meshgrid(np.linspace(0.0, 1.0, 61), np.linspace(0.0, 1.0, 41))
    turns = 2.0 * np.pi * around
    points = np.stack((0.3 * np.cos(turns), 0.3 * np.sin(turns), up - 0.5), axis=2)
    places = np.stack((around, up), axis=2)

    def triangles(grid: Floats) -> Floats:
        a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
        parts = [np.stack(corners, axis=2) for corners in ((a, b, c), (a, c, d))]
        return np.concatenate([part.reshape(-1, 3, grid.shape[2]) for part in parts])

    rows, columns = np.mgrid[0:64, 0:128]
    texture = np.stack((4 * rows, 2 * columns, 255 - 4 * rows), axis=2).astype(np.uint8)
    corners = triangles(points)
    colours = np.full((len(corners), 3, 3), 0.5)
    mesh = DrawnMesh(corners, colours, None, triangles(places), texture, False)
    return Surface.of_mesh(mesh)


def paint(
    surface: Surface, away_m: float, yaw: float, half_m: Floats, tolerance: float
) -> Painting:
    """Paint a surface that stands on the floor."""
    pose = RigidTransform.planar(away_m, 0.0, yaw, float(half_m[2]))
    body = PaintedBody(surface, pose, half_m, 0.0)
    painter = Painter(VIEW, tolerance)
    return painter.paint(GREY, CAMERA, [body], NOTHING, PLAIN, np.random.default_rng(0))


@pytest.mark.parametrize("tolerance_m", [0.0025, 0.01])
def test_no_point_is_farther_from_a_coarser_surface_than_its_tolerance(tolerance_m: float) -> None:
    """Of a ball and a person; a closed surface stays closed, and has the fewer triangles."""
    for surface, most in ((ball(), 1.0), (BANK.of(ROWS["person_adult"], 2), 0.75)):
        coarse = surface.within(tolerance_m)
        assert len(coarse.indices) <= most * len(surface.indices)
        assert farthest_m(surface, coarse) <= 1.001 * tolerance_m
        assert solid_of(coarse).is_watertight
        assert solid_of(coarse).is_winding_consistent


@pytest.mark.parametrize("label", LABELS)
def test_outlines_are_the_same_within_half_a_pixel_at_most_places(label: str) -> None:
    """The mask differs in less than a tenth of the pixels along the outline, and nowhere by three.

    Over several distances and sides; the painted pixels are those of the mask.
    """
    row = ROWS[label]
    half_m, surface = 0.5 * np.array(row.size_m), BANK.of(row, 1)
    apart = outline = 0
    for away_m in (4.0, 7.0, 14.0):
        for yaw in (0.2, 1.1, 2.3):
            far_m = away_m + float(half_m[:2].max())
            whole, coarse = (paint(surface, far_m, yaw, half_m, t) for t in (0.0, 1.0))
            assert coarse.pixels is not None
            inside = (whole.mask == 0).astype(np.uint8)
            differs = (whole.mask != coarse.mask).astype(np.uint8)
            apart += int(differs.sum())
            outline += int((inside - cv2.erode(inside, np.ones((3, 3)))).sum())
            assert not cv2.erode(differs, np.ones((3, 3))).any()
            assert (coarse.pixels != GREY).any(axis=2)[coarse.mask == 0].mean() > 0.99
    assert apart < outline / 10
    assert outline > 1000


@pytest.mark.parametrize("label", LABELS)
def test_colours_are_nearly_the_same(label: str) -> None:
    """Inside both outlines, by less than three steps of 255 on an average."""
    row = ROWS[label]
    half_m, surface = 0.5 * np.array(row.size_m), BANK.of(row, 1)
    for away_m in (4.0, 7.0, 14.0):
        far_m = away_m + float(half_m[:2].max())
        whole, coarse = (paint(surface, far_m, 0.7, half_m, t) for t in (0.0, 1.0))
        assert whole.pixels is not None
        assert coarse.pixels is not None
        inside = (whole.mask == 0) & (coarse.mask == 0)
        apart = np.abs(whole.pixels.astype(int) - coarse.pixels)[inside]
        assert apart.mean() < 3.0


def test_a_texture_stays_where_it_is() -> None:
    """On a pipe of an eighth of the triangles, whose picture is one of slopes."""
    surface, half_m = textured_pipe(), np.array((0.3, 0.3, 0.5))
    coarse = surface.within(0.01)
    assert len(coarse.indices) < len(surface.indices) / 8
    x, y, z = coarse.corners_m.reshape(-1, 3).astype(np.float64).T
    around, up = coarse.uvs.reshape(-1, 2).astype(np.float64).T
    assert up == pytest.approx(z + 0.5, abs=1e-6)
    assert np.cos(2.0 * np.pi * around) == pytest.approx(x / 0.3, abs=1e-5)
    assert np.sin(2.0 * np.pi * around) == pytest.approx(y / 0.3, abs=1e-5)
    one, other = (paint(s, 4.0, 1.0, half_m, 0.0) for s in (surface, coarse))
    assert one.pixels is not None
    assert other.pixels is not None
    inside = (one.mask == 0) & (other.mask == 0)
    apart = np.abs(one.pixels.astype(int) - other.pixels)[inside]
    assert apart.mean() < 2.0
    assert np.percentile(apart, 99) < 12.0


def test_a_seam_of_colours_stays_where_it_is() -> None:
    """The red half of a ball keeps its area; no corner is of a colour that was not there."""
    surface = ball(seam=True)
    coarse = surface.within(0.02)
    assert len(coarse.indices) < 0.5 * len(surface.indices)
    shares = []
    for one in (surface, coarse):
        sides = one.corners_m[:, 1:] - one.corners_m[:, :1]
        areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
        is_red = one.colours[:, 0, 0] > 0.5
        assert (one.colours[is_red] == one.colours[is_red][0, 0]).all()
        shares.append(areas[is_red].sum() / areas.sum())
    assert shares[1] == pytest.approx(shares[0], abs=0.02)


def test_the_distance_alone_decides_which_surface_is_painted() -> None:
    """Tolerances are powers of two; near a body its own surface is painted, always the same."""
    one, other = (SurfaceBank(5).of(ROWS["person_adult"], 2) for _ in range(2))
    assert one.within(0.001) is one
    assert one.within(-1.0) is one
    assert one.within(0.0031) is one.within(0.0049)
    assert one.within(0.0051) is not one.within(0.0049)
    assert one.within(99.0) is one.within(0.16)
    _ = other.within(0.02)
    for name in ("points_m", "indices", "normals", "colours"):
        first, second = (getattr(surface.within(0.005), name) for surface in (one, other))
        assert first.tobytes() == second.tobytes()


def test_what_cannot_be_coarser_stays() -> None:
    """A tetrahedron, a lone triangle and three sheets that share one edge, at a large tolerance."""
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    book = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    pages = np.vstack((corners, (0.0, -1.0, -1.0)))
    for triangles in (
        corners[[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]],
        corners[[[1, 2, 3]]],
        pages[book],
    ):
        surface = plain_surface(triangles, np.full((len(triangles), 3), 0.5))
        coarse = surface.within(0.1)
        assert len(coarse.indices) == len(triangles)
        assert coarse.corners_m.tobytes() == surface.corners_m.tobytes()
