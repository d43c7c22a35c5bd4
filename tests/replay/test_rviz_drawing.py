"""The small renderer: cameras, depth, light, solids and texts, each against what can be counted."""

import numpy as np
import pytest
from numpy.typing import NDArray

from are_ros.bag import marker_decoding as kinds
from are_ros.bag.marker_decoding import MarkerFields
from are_ros.replay.rviz_camera import RvizCamera
from are_ros.replay.rviz_canvas import Canvas, Triangles
from are_ros.replay.rviz_scene import PlacedMarker
from are_ros.replay.rviz_shapes import axes_of, ribbon, triangles_of
from are_ros.replay.rviz_text import draw_text
from are_ros.replay.rviz_voxels import draw_voxels
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap

Floats = NDArray[np.float64]

BLACK = (0.0, 0.0, 0.0)
ABOVE = RvizCamera.top_down(np.zeros(2), 10.0, (100, 80))
"""Ten pixels a metre: x from -5 to 5 m, y from -4 to 4 m."""


def square(x: float, y: float, z: float, side: float, rgba: tuple[float, ...]) -> Triangles:
    """Return a level square about a point, unlit."""
    half = 0.5 * side
    corners = np.add(((-half, -half), (half, -half), (half, half), (-half, half)), (x, y))
    points = np.column_stack((corners, np.full(4, z)))
    return Triangles(points[[[0, 1, 2], [0, 2, 3]]], np.tile(rgba, (2, 1)), lit=False)


def area_px(canvas: Canvas, channel: int) -> int:
    """Return how many pixels have some of a colour."""
    return int(np.count_nonzero(canvas.colours[..., channel] > 0.0))


def test_from_above_x_is_right_and_y_is_up() -> None:
    """Pixels count from the upper left; what is higher is nearer."""
    pixels, near = ABOVE.project(np.array(((0.0, 0.0, 0.0), (2.0, 0.0, 1.0), (0.0, 3.0, 2.0))))
    np.testing.assert_allclose(pixels, ((50, 40), (70, 40), (50, 10)), atol=1e-9)
    assert near[0] < near[1] < near[2]


def test_an_orbit_looks_at_its_focus() -> None:
    """The focus is in the middle; what is left of the view's direction is left of it."""
    focus = np.array((1.0, 2.0, 0.5))
    camera = RvizCamera.orbit(focus, 5.0, 0.3, 0.5, (200, 100))
    ahead = np.array((np.cos(0.3), np.sin(0.3), 0.0))
    left, up = np.array((-ahead[1], ahead[0], 0.0)), np.array((0.0, 0.0, 1.0))
    points = np.stack((focus, focus + left, focus + up, focus + ahead, focus - 10 * ahead))
    pixels, near = camera.project(points)
    np.testing.assert_allclose(pixels[0], (100, 50), atol=1e-9)
    assert pixels[1, 0] < 100
    assert pixels[2, 1] < 50
    assert near[3] < near[0]
    assert near[4] == -np.inf
    assert np.linalg.norm(camera.place_m - focus) == pytest.approx(5.0)
    assert camera.pixels_per_m(points[:1])[0] == pytest.approx(camera.scale / 5.0)


@pytest.mark.parametrize("is_perspective", [True, False])
def test_rays_lead_to_what_is_projected_on_their_pixels(is_perspective: bool) -> None:
    """A point along the ray of a pixel falls on the middle of that pixel."""
    camera = RvizCamera.orbit(np.zeros(3), 4.0, 0.7, 0.6, (30, 20)) if is_perspective else ABOVE
    starts, ways = camera.rays(slice(4, 6))
    pixels, _ = camera.project((starts + 3.0 * ways)[1, [0, 17]])
    np.testing.assert_allclose(pixels, ((0.5, 5.5), (17.5, 5.5)), atol=1e-6)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_what_is_nearer_hides_what_is_farther(order: tuple[int, int]) -> None:
    """In whatever order the two are drawn."""
    shapes = (square(0, 0, 0.0, 4.0, (1, 0, 0, 1)), square(0, 0, 1.0, 2.0, (0, 1, 0, 1)))
    canvas = Canvas(ABOVE, BLACK)
    for number in order:
        canvas.solid(shapes[number])
    assert area_px(canvas, 1) == 20 * 20
    assert area_px(canvas, 0) == 40 * 40 - 20 * 20


def test_a_translucent_body_is_laid_once_over_what_is_behind() -> None:
    """Its own back does not show through its front, and it hides nothing drawn later behind it."""
    both = [square(0, 0, z, 2.0, (0, 1, 0, 0.25)) for z in (1.0, 2.0)]
    corners = np.concatenate([each.corners_m for each in both])
    body = Triangles(corners, np.concatenate([each.colours for each in both]), lit=False)
    canvas = Canvas(ABOVE, (1.0, 0.0, 0.0))
    canvas.solid(body)
    np.testing.assert_allclose(canvas.colours[40, 50], (0.75, 0.25, 0.0), atol=1e-6)
    canvas.solid(square(0, 0, 0.5, 2.0, (0, 0, 1, 1)))
    np.testing.assert_allclose(canvas.colours[40, 50], (0.0, 0.0, 1.0), atol=1e-6)


def block(low: tuple[int, int, int], size: tuple[int, int, int]) -> VoxelMap:
    """Return voxels of a metre, all occupied, from a corner on."""
    corner = RigidTransform(np.array(low, dtype=np.float64), np.array((0.0, 0.0, 0.0, 1.0)))
    return VoxelMap(corner, (1.0, 1.0, 1.0), np.ones(size, np.uint8))


def test_voxels_from_above_cover_their_cells_and_hide_what_is_below() -> None:
    """Two by three metres are as many pixels; a square below is hidden, one above is not."""
    canvas = Canvas(ABOVE, BLACK)
    draw_voxels(canvas, block((-1, -2, 0), (2, 3, 1)))
    assert area_px(canvas, 0) == 20 * 30
    canvas.solid(square(0.0, -0.5, -1.0, 1.0, (1.0, 0.0, 0.0, 1.0)))
    canvas.solid(square(3.0, 0.0, -1.0, 1.0, (0.0, 0.0, 1.0, 1.0)))
    assert np.count_nonzero(canvas.colours[..., 0] == 1.0) == 0
    assert np.count_nonzero(canvas.colours[..., 2] == 1.0) == 100
    canvas.solid(square(0.0, -0.5, 2.0, 1.0, (1.0, 0.0, 0.0, 1.0)))
    assert np.count_nonzero(canvas.colours[..., 0] == 1.0) == 100


def test_voxels_in_perspective_are_where_a_solid_of_their_shape_is() -> None:
    """The same pixels as triangles of the same box; a body behind them is hidden."""
    camera = RvizCamera.orbit(np.zeros(3), 12.0, 0.3, 0.5, (160, 120))
    canvas, drawn = Canvas(camera, BLACK), Canvas(camera, BLACK)
    draw_voxels(canvas, block((-1, -1, -1), (2, 2, 2)))
    drawn.solid(solid_of(kinds.CUBE, scale=(2.0, 2.0, 2.0)))
    seen, expected = canvas.colours.sum(axis=2) > 0.0, drawn.colours.sum(axis=2) > 0.0
    assert expected.sum() > 500
    assert np.count_nonzero(seen != expected) < 0.05 * expected.sum()
    before = canvas.colours.copy()
    x, y, z = (camera.place_m + 20.0 * camera.rotation[2]).tolist()
    canvas.solid(square(x, y, z, 0.5, (1.0, 1.0, 1.0, 1.0)))
    assert np.array_equal(canvas.colours, before)


def test_a_translucent_body_behind_a_wall_is_not_seen() -> None:
    """Depth counts for it, too."""
    canvas = Canvas(ABOVE, BLACK)
    canvas.solid(square(0, 0, 3.0, 2.0, (1, 0, 0, 1)))
    canvas.solid(square(0, 0, 1.0, 4.0, (0, 1, 0, 0.5)))
    assert area_px(canvas, 1) == 40 * 40 - 20 * 20


def test_faces_are_lit_by_how_they_are_turned() -> None:
    """Neighbouring faces of a cube differ, whichever way their corners run."""
    camera = RvizCamera.orbit(np.zeros(3), 5.0, 0.5, 0.6, (120, 120))
    shape = solid_of(kinds.CUBE)
    turned = Triangles(shape.corners_m[:, ::-1], shape.colours)
    pictures = []
    for each in (shape, turned):
        canvas = Canvas(camera, BLACK)
        canvas.solid(each)
        pictures.append(canvas.colours)
    np.testing.assert_array_equal(pictures[0], pictures[1])
    shades = np.unique(pictures[0][..., 0].round(4))
    assert len(shades) == 4  # three faces and the background


def test_what_is_behind_the_camera_is_not_drawn() -> None:
    """Nor does it stop the rest."""
    camera = RvizCamera.orbit(np.zeros(3), 2.0, 0.0, 0.1, (50, 50))
    canvas = Canvas(camera, BLACK)
    canvas.solid(square(-30, 0, 0.0, 10.0, (1, 0, 0, 1)))
    assert area_px(canvas, 0) == 0
    canvas.lines(np.array((((-9.0, 0.0, 0.0), (9.0, 0.0, 0.0)),)), (0.0, 1.0, 0.0), 1.0)
    assert area_px(canvas, 1) > 0


def test_the_floor_shows_a_pixel_for_each_cell() -> None:
    """Cell (row, col) = (0, 0) touches the origin of its frame; what is clear stays as it was."""
    image = np.zeros((2, 3, 4), np.uint8)
    image[0, 0], image[1, 2] = (255, 0, 0, 255), (0, 255, 0, 51)
    canvas = Canvas(ABOVE, BLACK)
    fixed_from_grid = RigidTransform.planar(1.0, -2.0, 0.5 * np.pi)
    canvas.floor(image, 1.0, fixed_from_grid.inverse().matrix())
    assert area_px(canvas, 0) == area_px(canvas, 1) == 100
    np.testing.assert_allclose(canvas.colours[55, 55], (1.0, 0.0, 0.0))  # x 0.5, y -1.5
    np.testing.assert_allclose(canvas.colours[35, 45], (0.0, 0.2, 0.0), atol=1e-6)  # -0.5, 0.5


def test_reduction_is_the_mean_of_blocks() -> None:
    """So edges come out smooth."""
    canvas = Canvas(ABOVE, BLACK)
    canvas.colours[0, 0] = 1.0
    small = canvas.reduced(2)
    assert small.shape == (40, 50, 3)
    assert small[0, 0].tolist() == [64, 64, 64]
    assert not small[1:].any()


def fields_of(kind: int, points: Floats, colours: Floats, scale: Floats) -> MarkerFields:
    """Return a half-clear marker."""
    return MarkerFields(
        0,
        "map",
        "a",
        1,
        kind,
        0,
        np.zeros(3),
        np.array((0.0, 0.0, 0.0, 1.0)),
        scale,
        np.array((0.2, 0.4, 0.6, 0.5)),
        0,
        False,
        points,
        colours,
        0,
        "",
        "",
        False,
    )


def solid_of(
    kind: int,
    points: object = (),
    colours: object = (),
    scale: object = (1.0, 1.0, 1.0),
    pose: RigidTransform | None = None,
) -> Triangles:
    """Return the triangles of a marker."""
    fields = fields_of(
        kind,
        np.array(points, np.float64).reshape(-1, 3),
        np.array(colours, np.float64).reshape(-1, 4),
        np.array(scale, np.float64),
    )
    shape = triangles_of(PlacedMarker(fields, pose or RigidTransform.identity()))
    assert shape is not None
    return shape


def extent(shape: Triangles) -> list[list[float]]:
    """Return the least and the greatest coordinates, rounded."""
    points = shape.corners_m.reshape(-1, 3)
    return [np.round(bound, 6).tolist() for bound in (points.min(axis=0), points.max(axis=0))]


def volume(shape: Triangles) -> float:
    """Return the volume of a star-shaped solid about the origin."""
    a, b, c = shape.corners_m.transpose(1, 0, 2)
    return float(np.abs(np.sum(a * np.cross(b, c), axis=1)).sum() / 6.0)


def test_solids_are_as_large_as_their_scale() -> None:
    """Cube, sphere and cylinder about the pose, by extent and volume."""
    scale = (2.0, 1.0, 3.0)
    for kind, share in ((kinds.CUBE, 1.0), (kinds.CYLINDER, np.pi / 4), (kinds.SPHERE, np.pi / 6)):
        shape = solid_of(kind, scale=scale)
        assert extent(shape) == [[-1.0, -0.5, -1.5], [1.0, 0.5, 1.5]]
        assert volume(shape) == pytest.approx(6.0 * share, rel=0.08)
        np.testing.assert_allclose(
            shape.colours, np.tile((0.2, 0.4, 0.6, 0.5), (len(shape.colours), 1))
        )


def test_a_pose_moves_and_turns_a_solid() -> None:
    """Turned by a quarter, what was long along x is long along y."""
    pose = RigidTransform.planar(10.0, 20.0, 0.5 * np.pi, 1.0)
    shape = solid_of(kinds.CUBE, scale=(4.0, 2.0, 2.0), pose=pose)
    assert extent(shape) == [[9.0, 18.0, 0.0], [11.0, 22.0, 2.0]]


def test_arrows_are_proportioned_as_in_rviz() -> None:
    """By pose scale.x long, the head twice as thick as scale.y; by points from one to the other."""
    assert extent(solid_of(kinds.ARROW, scale=(2.0, 0.1, 0.1))) == [
        [0.0, -0.1, -0.1],
        [2.0, 0.1, 0.1],
    ]
    points = ((1.0, 1.0, 1.0), (1.0, 1.0, 4.0))
    shape = solid_of(kinds.ARROW, points, scale=(0.1, 0.4, 1.0))
    assert extent(shape) == [[0.8, 0.8, 1.0], [1.2, 1.2, 4.0]]
    heads = shape.corners_m.reshape(-1, 3)
    wide = heads[np.hypot(heads[:, 0] - 1.0, heads[:, 1] - 1.0) > 0.15]
    assert wide[:, 2].min() == pytest.approx(3.0)


def test_lists_have_a_solid_or_a_line_for_each_point() -> None:
    """In the points' colours, times the marker's alpha."""
    points = ((0.0, 0.0, 0.0), (5.0, 0.0, 0.0))
    colours = ((1.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 0.5))
    cubes = solid_of(kinds.CUBE_LIST, points, colours)
    assert len(cubes.corners_m) == 24
    assert extent(cubes) == [[-0.5, -0.5, -0.5], [5.5, 0.5, 0.5]]
    assert cubes.colours[[0, -1]].tolist() == [[1.0, 0.0, 0.0, 0.5], [0.0, 1.0, 0.0, 0.25]]
    spheres = solid_of(kinds.SPHERE_LIST, points)
    assert extent(spheres) == [[-0.5, -0.5, -0.5], [5.5, 0.5, 0.5]]
    strip = solid_of(kinds.LINE_STRIP, (*points, (5.0, 3.0, 0.0)), scale=(0.2, 1, 1))
    assert len(strip.corners_m) == 4
    pairs = solid_of(
        kinds.LINE_LIST, (*points, (5.0, 3.0, 0.0), (0.0, 3.0, 0.0)), scale=(0.2, 1, 1)
    )
    assert len(pairs.corners_m) == 4
    assert extent(pairs) == [[0.0, -0.1, 0.0], [5.0, 3.1, 0.0]]


def test_triangles_take_colours_by_corner_or_by_face() -> None:
    """And the marker's own where there are none."""
    points = ((0, 0, 0), (1, 0, 0), (0, 1, 0)) * 2
    by_corner = np.column_stack((np.repeat((0.0, 1.0), 3), np.zeros((6, 2)), np.ones(6)))
    assert solid_of(kinds.TRIANGLES, points, by_corner).colours[:, 0].tolist() == [0.0, 1.0]
    faces = solid_of(kinds.TRIANGLES, points, by_corner[[0, 3]])
    assert faces.colours.tolist() == [[0.0, 0.0, 0.0, 0.5], [1.0, 0.0, 0.0, 0.5]]
    plain = solid_of(kinds.TRIANGLES, points, scale=(2.0, 2.0, 2.0))
    assert plain.colours[0].tolist() == [0.2, 0.4, 0.6, 0.5]
    assert extent(plain) == [[0.0, 0.0, 0.0], [2.0, 2.0, 0.0]]


def test_what_has_no_triangles_is_none() -> None:
    """Texts, points, meshes of files, and arrows of no length."""
    for kind in (kinds.TEXT, kinds.POINTS, kinds.MESH, 77):
        fields = fields_of(kind, np.zeros((0, 3)), np.zeros((0, 4)), np.ones(3))
        assert triangles_of(PlacedMarker(fields, RigidTransform.identity())) is None
    nowhere = fields_of(kinds.ARROW, np.zeros((2, 3)), np.zeros((0, 4)), np.ones(3))
    assert triangles_of(PlacedMarker(nowhere, RigidTransform.identity())) is None


def test_axes_are_red_green_and_blue() -> None:
    """Along x, y and z of the frame."""
    shape = axes_of(RigidTransform.planar(0.0, 0.0, 0.5 * np.pi), 2.0, 0.1)
    third = len(shape.corners_m) // 3
    red, green, blue = (
        Triangles(shape.corners_m[i * third : (i + 1) * third], shape.colours) for i in range(3)
    )
    assert extent(red)[1][1] == 2.0
    assert extent(green)[0][0] == -2.0
    assert extent(blue)[1][2] == 2.0
    assert shape.colours[::third, :3].tolist() == np.eye(3).tolist()


def test_a_ribbon_is_as_wide_as_it_should_be() -> None:
    """A closed one comes back to its beginning."""
    corners = np.array(((0.0, 0.0, 1.0), (4.0, 0.0, 1.0), (4.0, 4.0, 1.0)))
    assert len(ribbon(corners, 0.2)) == 4
    closed = ribbon(corners, 0.2, is_closed=True)
    assert len(closed) == 6
    a, b, c = closed.transpose(1, 0, 2)
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    assert areas.sum() == pytest.approx(0.2 * (8.0 + np.hypot(4.0, 4.0)))


def ink(canvas: Canvas) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return rows and columns of what is white."""
    rows, cols = np.nonzero(canvas.colours[..., 0] > 0.5)
    return rows, cols


def test_a_text_is_centred_upright_and_as_high_as_it_says() -> None:
    """A letter without a descender takes about its height's three quarters."""
    canvas = Canvas(ABOVE, BLACK)
    draw_text(canvas, "L", np.array((1.0, 0.0, 0.0)), 4.0, (1.0, 1.0, 1.0), 1.0)
    rows, cols = ink(canvas)
    assert 25 <= rows.max() - rows.min() <= 35
    assert abs(0.5 * (cols.min() + cols.max()) - 60) < 2
    assert abs(0.5 * (rows.min() + rows.max()) - 40) < 3
    low = np.count_nonzero(rows > rows.max() - 4)
    assert low > np.count_nonzero(rows < rows.min() + 4)  # the foot of the L is below


def test_a_text_behind_something_is_hidden() -> None:
    """And so small a one that nobody could read it is left out, as are blanks."""
    canvas = Canvas(ABOVE, BLACK)
    canvas.solid(square(0, 0, 2.0, 20.0, (0, 0, 1, 1)))
    draw_text(canvas, "X", np.zeros(3), 4.0, (1.0, 1.0, 1.0), 1.0)
    draw_text(canvas, "X", np.array((0.0, 0.0, 3.0)), 0.2, (1.0, 1.0, 1.0), 1.0)
    draw_text(canvas, " ", np.array((0.0, 0.0, 3.0)), 4.0, (1.0, 1.0, 1.0), 1.0)
    draw_text(canvas, "X", np.array((90.0, 0.0, 3.0)), 4.0, (1.0, 1.0, 1.0), 1.0)
    assert area_px(canvas, 0) == 0
    draw_text(canvas, "X", np.array((0.0, 0.0, 3.0)), 4.0, (1.0, 1.0, 1.0), 0.5)
    assert canvas.colours[..., 0].max() == pytest.approx(0.5, abs=0.01)
