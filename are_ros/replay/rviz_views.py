"""The scene drawn: in perspective from behind the robot, from above, and as a costmap."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.bag import marker_decoding as kinds
from are_ros.bag.recording import PREFIX
from are_ros.replay.rviz_camera import RvizCamera
from are_ros.replay.rviz_canvas import Canvas, Rgb, Triangles
from are_ros.replay.rviz_grids import MAP_ALPHA, Palette, costmap_palette, map_palette
from are_ros.replay.rviz_scene import PlacedMarker, RvizScene
from are_ros.replay.rviz_shapes import axes_of, ribbon, triangles_of
from are_ros.replay.rviz_text import draw_text
from are_ros.replay.rviz_voxels import draw_voxels
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform

Floats = npt.NDArray[np.float64]
Picture = npt.NDArray[np.uint8]
Size = tuple[int, int]

OVERSAMPLING: Final = 2
BACKGROUND: Final[Rgb] = (48 / 255, 48 / 255, 48 / 255)
GRID_LINE: Final[Rgb] = (160 / 255, 160 / 255, 164 / 255)
OUTLINE: Final[Rgb] = (25 / 255, 1.0, 0.0)
_OUR_SCAN: Final[Rgb] = (1.0, 0.16, 0.1)
_REAL_SCAN: Final[Rgb] = (0.95, 0.93, 0.72)

_GRID_ALPHA: Final = 0.35
_POINT_M: Final = 0.045
_LEAST_POINT_PX: Final = 2.0
_PITCH_RAD: Final = np.deg2rad(34.0)
_NEAREST_M, _FARTHEST_M = 7.0, 60.0
_ASIDE_RAD: Final = 0.4
"""So much the view is turned against the robot's heading, so that all its axes are seen."""
_REACH_M: Final = 9.0
_INNER_SHARES: Final = (0.45, 0.42)
"""How far from the middle what matters may be, as shares of width and height."""


def scan_colour(topic: str) -> Rgb:
    """Return the colour of a scan that ARE gives out, or, drawn over it, of one that came in."""
    return _OUR_SCAN if topic.startswith(PREFIX) else _REAL_SCAN


def draw_perspective(scene: RvizScene, size: Size) -> Picture:
    """Return the view from behind and above the robot, RGB (h, w, 3): all that is perceived."""
    large = (size[0] * OVERSAMPLING, size[1] * OVERSAMPLING)
    canvas = Canvas(_orbit(scene, large), BACKGROUND)
    _draw_ground(canvas, scene, scene.grid, map_palette())
    _draw_solids(canvas, scene)
    _draw_scans(canvas, scene)
    for marker in scene.markers:
        if marker.fields.kind == kinds.TEXT:
            _draw_label(canvas, marker)
    return canvas.reduced(OVERSAMPLING)


def draw_top_down(scene: RvizScene, size: Size) -> Picture:
    """Return the whole map from above, with everything but the texts, RGB (h, w, 3)."""
    canvas = _from_above(scene, size)
    _draw_ground(canvas, scene, scene.grid, map_palette())
    _draw_solids(canvas, scene)
    _draw_scans(canvas, scene)
    return canvas.reduced(OVERSAMPLING)


def draw_costmap(scene: RvizScene, size: Size) -> Picture:
    """Return the costmap over the map from above, with the robot, RGB (h, w, 3)."""
    canvas = _from_above(scene, size)
    _draw_ground(canvas, scene, scene.grid, map_palette())
    _lay(canvas, scene.costmap, costmap_palette())
    _draw_robot(canvas, scene)
    return canvas.reduced(OVERSAMPLING)


def _orbit(scene: RvizScene, size: Size) -> RvizCamera:
    """Return the camera that has the robot and what it perceives in view, as near as it can be."""
    points = _points_of_interest(scene)
    yaw = _heading(scene)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    for distance in np.linspace(_NEAREST_M, _FARTHEST_M, 107):
        camera = RvizCamera.orbit(middle, float(distance), yaw, _PITCH_RAD, size)
        pixels, near = camera.project(points)
        shares = np.abs(pixels / size - 0.5)
        if np.isfinite(near).all() and (shares < _INNER_SHARES).all():
            break
    return camera


def _points_of_interest(scene: RvizScene) -> Floats:
    """Return corners of the robot and of the opaque bodies near it; without a robot, all bodies.

    Where none is near, the nearest opaque one: a view of nothing but floor tells nothing.
    """
    bodies = [marker for marker in scene.markers if marker.fields.kind != kinds.TEXT]
    opaque = [marker for marker in bodies if _alpha(marker) > 0.9]
    shapes = [shape for shape in map(triangles_of, opaque or bodies) if shape is not None]
    boxes = [_box_of(shape) for shape in shapes]
    robot = scene.robot
    if robot is not None:
        place = robot.translation_m
        away_m = [float(np.hypot(*(box.mean(axis=0) - place)[:2])) for box in boxes]
        reach_m = max(_REACH_M, min(away_m, default=0.0)) if opaque else _REACH_M
        boxes = [box for box, so_far_m in zip(boxes, away_m, strict=True) if so_far_m <= reach_m]
        boxes.append(np.stack((place, place + _ahead(scene, 2.0))))
    if boxes:
        return np.concatenate(boxes)
    return np.column_stack((_bounds(scene), np.zeros(2)))


def _box_of(shape: Triangles) -> Floats:
    """Return the corners (8, 3) of the upright box about a shape."""
    points = shape.corners_m.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    picks = np.array(np.meshgrid(*[(0, 1)] * 3)).reshape(3, -1).T
    corners: Floats = np.where(picks == 0, low, high)
    return corners


def _alpha(marker: PlacedMarker) -> float:
    colours = marker.fields.colours
    return float(colours[:, 3].max() if len(colours) else marker.fields.colour[3])


def _heading(scene: RvizScene) -> float:
    """Return which way to look: where the robot does, else along the map's y axis."""
    ahead = _ahead(scene, 1.0)
    return float(np.arctan2(ahead[1], ahead[0])) + _ASIDE_RAD if ahead.any() else 0.5 * np.pi


def _ahead(scene: RvizScene, length_m: float) -> Floats:
    robot = scene.robot
    if robot is None:
        return np.zeros(3)
    ahead: Floats = length_m * robot.rotation_matrix()[:, 0]
    return ahead


def _from_above(scene: RvizScene, size: Size) -> Canvas:
    low, high = _bounds(scene)
    width, height = size[0] * OVERSAMPLING, size[1] * OVERSAMPLING
    spread = np.maximum(high - low, 1.0)
    scale = 0.96 * float(min(width / spread[0], height / spread[1]))
    camera = RvizCamera.top_down(0.5 * (low + high), scale, (width, height))
    return Canvas(camera, BACKGROUND)


def _bounds(scene: RvizScene) -> Floats:
    """Return the corners (2, 2) of what is known of the map; without one, about the robot."""
    if scene.grid is None:
        place = np.zeros(2) if scene.robot is None else scene.robot.translation_m[:2]
        return np.stack((place - 6.0, place + 6.0))
    grid, pose = scene.grid
    rows, cols = np.nonzero(grid.cells >= 0)
    if not len(rows):
        rows, cols = np.array((0, grid.height - 1)), np.array((0, grid.width - 1))
    box = [(x, y, 0.0) for x in (cols.min(), cols.max() + 1) for y in (rows.min(), rows.max() + 1)]
    corners = pose.apply(np.array(box) * grid.resolution_m)[:, :2]
    return np.stack((corners.min(axis=0), corners.max(axis=0)))


def _draw_ground(
    canvas: Canvas,
    scene: RvizScene,
    grid: tuple[OccupancyGrid, RigidTransform] | None,
    palette: Palette,
) -> None:
    """Draw the lines of rviz's Grid display, a metre apart, and the map over them."""
    low, high = _bounds(scene)
    (x0, y0), (x1, y1) = np.floor(low - 3.0), np.ceil(high + 3.0)
    across = [((x, y0, 0.0), (x, y1, 0.0)) for x in np.arange(x0, x1 + 1.0)]
    along = [((x0, y, 0.0), (x1, y, 0.0)) for y in np.arange(y0, y1 + 1.0)]
    canvas.lines(np.array(across + along), GRID_LINE, _GRID_ALPHA, OVERSAMPLING)
    _lay(canvas, grid, palette)


def _lay(
    canvas: Canvas, grid: tuple[OccupancyGrid, RigidTransform] | None, palette: Palette
) -> None:
    if grid is None:
        return
    cells, pose = grid
    colours = palette.copy()
    colours[:, 3] = np.rint(MAP_ALPHA * colours[:, 3])
    image = colours[cells.cells.view(np.uint8)]
    canvas.floor(image, cells.resolution_m, pose.inverse().matrix())


def _draw_solids(canvas: Canvas, scene: RvizScene) -> None:
    """Draw voxels, bodies, arrows, axes and the robot: first the opaque, the rest afar to near."""
    if scene.voxels is not None:
        draw_voxels(canvas, scene.voxels)
    shapes = [shape for shape in map(triangles_of, scene.markers) if shape is not None]
    for shape in shapes:
        if shape.is_opaque:
            canvas.solid(shape)
    _draw_robot(canvas, scene)
    clear = [shape for shape in shapes if not shape.is_opaque]
    for shape in sorted(clear, key=lambda each: _distance(canvas.camera, each), reverse=True):
        canvas.solid(shape)


def _distance(camera: RvizCamera, shape: Triangles) -> float:
    middle = shape.corners_m.reshape(-1, 3).mean(axis=0)
    return float((middle - camera.place_m) @ camera.rotation[2])


def _draw_robot(canvas: Canvas, scene: RvizScene) -> None:
    """Draw the outline as rviz's Polygon display, and the axes of the frames."""
    for name, pose in scene.axes.items():
        is_base = name == scene.base_frame
        length_m, radius_m = (0.5, 0.05) if is_base else (0.25, 0.0125)
        canvas.solid(axes_of(pose, length_m, radius_m))
    if scene.robot is None or scene.outline_m is None:
        return
    points = np.column_stack((scene.outline_m, np.full(len(scene.outline_m), 0.02)))
    corners = ribbon(scene.robot.apply(points), 0.05, is_closed=True)
    colour = np.tile((*OUTLINE, 1.0), (len(corners), 1))
    canvas.solid(Triangles(corners, colour, lit=False))


def _draw_scans(canvas: Canvas, scene: RvizScene) -> None:
    """Draw the ends of the beams as flat squares: red is left where ARE gave another end."""
    for topic, points in scene.scans:
        _draw_points(canvas, points, scan_colour(topic))


def _draw_points(canvas: Canvas, points_m: Floats, colour: Rgb) -> None:
    if not len(points_m):
        return
    pixels, near = canvas.camera.project(points_m)
    sides = _POINT_M * canvas.camera.pixels_per_m(points_m)
    halves = 0.5 * np.maximum(sides, _LEAST_POINT_PX * OVERSAMPLING)
    low = np.rint(pixels - halves[:, np.newaxis]).astype(np.int64)
    high = np.rint(pixels + halves[:, np.newaxis]).astype(np.int64)
    limits = (canvas.camera.width, canvas.camera.height)
    low, high = low.clip(0, limits), high.clip(0, limits)
    order = np.argsort(near)  # from afar to near
    for i in order[np.isfinite(near[order])]:
        _draw_square(canvas, low[i], high[i], float(near[i]), colour)


def _draw_square(
    canvas: Canvas,
    low: npt.NDArray[np.int64],
    high: npt.NDArray[np.int64],
    near: float,
    colour: Sequence[float],
) -> None:
    window = (slice(low[1], high[1]), slice(low[0], high[0]))
    seen = canvas.nearness[window] <= near * (1.0 + 1e-3 * np.sign(near))
    canvas.colours[window][seen] = colour


def _draw_label(canvas: Canvas, marker: PlacedMarker) -> None:
    red, green, blue, alpha = marker.fields.colour.tolist()
    place, height_m = marker.fixed_from_marker.translation_m, float(marker.fields.scale[2])
    draw_text(canvas, marker.fields.text, place, height_m, (red, green, blue), alpha)
