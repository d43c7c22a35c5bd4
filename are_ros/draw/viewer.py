"""The viewer: the scene in 3D, drawn with viser, as one page that plays without a network.

`ViewedScene` draws onto viser's scene, tick by tick; `write_view` records what it draws as a page.
The live viewer (`record.live_view`) draws the same scene for a browser that is connected.
"""

import html
import io
import json
import logging
import math
import re
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.builder.occlusion.rays import VoxelField
from are_ros.conventions import NS_PER_S
from are_ros.draw.map import known_part, map_from_part, shaded
from are_ros.draw.palette import END, ROBOT, SEEN, Rgb, class_colours, hex_of, with_class
from are_ros.draw.robot import level_sight, robot_outline
from are_ros.draw.scene import ArtefactAt, Moment, ScanPoints, SceneRecord, shown_every
from are_ros.draw.sheet import id_text
from are_ros.errors import BagError
from are_ros.population.catalogue import Catalogue, CatalogueRow
from are_ros.population.meshes.geometry import surface_of
from are_ros.whole_file import write_whole
from are_ros.wording import counted, why_refused
from are_ros.world.cameras import ViewModel
from are_ros.world.footprint import Footprint
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.surface import boxes_of
from are_ros.world.voxel_map import VoxelMap

Floats = npt.NDArray[np.float64]
Points = npt.NDArray[np.float32]
Faces = npt.NDArray[np.uint32]

MISSING_VISER: Final = (
    "the viewer needs viser: `pip install viser`, or `pip install 'are_ros[view]'`; "
    "everything else works without"
)

_MOST_RETURNS: Final = 120_000
_MOST_BOXES: Final = 20_000
_MOST_VOXELS: Final = 30_000_000
_GAP_S: Final = 1.0
_LOWEST_M, _HIGHEST_M = 0.1, 1.0
"""Walls and voxels are drawn between these heights: floor and ceiling would hide the scene."""

_UNSEEN_OPACITY: Final = 0.3
_FAN_RAYS: Final = 40
_NEAR_M: Final = 2.0
_SCAN_LASTS_NS: Final = NS_PER_S
"""A scan is shown until the next one, at most for so long: lasers may be slower than ticks."""
_WAY_OFF_M: Final = 0.01
_NOTED_STEP_M: Final = 0.005
_GROUND_LIFT_M, _FAN_LIFT_M, _WAY_LIFT_M = 0.005, 0.02, 0.03
_ROBOT_HEIGHT_M: Final = 0.3
_LABEL_GAP_M: Final = 0.12
WALL: Final[Rgb] = (206, 209, 214)
_VIRTUAL: Final[Rgb] = (224, 0, 122)
_RETURN: Final[Rgb] = END
_FIELD_OF_VIEW_RAD: Final = math.radians(45.0)
_SLANT_RAD: Final = math.radians(58.0)
LAYERS: Final = {
    "map": "/map",
    "walls": "/walls",
    "robot": "/robot",
    "camera's view": "/camera",
    "artefacts": "/artefacts",
    "labels": "/labels",
    "ways": "/ways",
    "laser scans": "/scans",
}
_SINGLE_NODES: Final = ("/map", "/walls")
_SQUARE: Final = np.array(((0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.5, -0.5)))
_OVERLAY: Final = Path(__file__).parent / "data" / "view_overlay.html"


@dataclass(frozen=True, eq=False)
class ViewedPlace:
    """What stays: the map, what stands there (an octomap, or extruded walls), robot and camera.

    `catalogue` has the meshes; an artefact of no row of it is drawn as its box. `max_range_m` is
    how far the camera sees, `ground_m` the height of the ground.
    """

    grid: OccupancyGrid
    voxels: VoxelMap
    catalogue: Catalogue
    footprint: Footprint
    camera: ViewModel | None
    max_range_m: float
    ground_m: float


@dataclass(frozen=True)
class View:
    """A page that was written: `notes` say what was left out to keep it small."""

    path: Path
    length_bytes: int
    ticks: int
    notes: tuple[str, ...] = ()

    def sentence(self) -> str:
        """Say it."""
        noted = "".join(f"; {note}" for note in self.notes)
        size = f"{self.length_bytes / 1e6:.1f} MB, {counted(self.ticks, 'tick')}"
        return f"view: {self.path} ({size}{noted})"


class ArtefactBodies:
    """The meshes and colours of artefacts: those of a catalogue, else boxes; each is made once."""

    def __init__(self, catalogue: Catalogue) -> None:
        self._rows = {row.index: row for row in catalogue.rows}
        self._colours = class_colours([row.class_name for row in catalogue.rows])
        self._meshes: dict[tuple[object, ...], tuple[Points, Faces]] = {}

    def mesh(self, row: CatalogueRow) -> tuple[Points, Faces]:
        """Return vertices (V, 3) [m] and faces (F, 3) in F_A; of equal rows the same arrays."""
        key = (row.index, row.label, row.size_m, row.box_centre_in_artefact_m)
        if key not in self._meshes:
            known = self._rows.get(row.index)
            self._meshes[key] = _mesh_of(known) if known and _fits(known, row) else _box_of(row)
        return self._meshes[key]

    def colour(self, class_name: str) -> Rgb:
        """Return the colour of a class; it stays, whichever others come."""
        if class_name not in self._colours:
            self._colours = with_class(self._colours, class_name)
        return self._colours[class_name]


def has_viser() -> bool:
    """Say whether viser is installed."""
    return find_spec("viser") is not None


def write_view(path: Path, place: ViewedPlace, record: SceneRecord, title: str) -> View:
    """Write the page: one file, which plays in a browser without a network.

    Ticks are shown in real time; gaps of a second or more are left out. Raises BagError where viser
    is not installed, there is no tick, or the system refuses to write.
    """
    if not has_viser():
        raise BagError(MISSING_VISER)
    every_tick = shown_every(len(record.series.stamps_ns))
    shown = [*record.moments(every_tick)]
    if not shown:
        raise BagError(f"{path}: there is no tick to show")
    notes = [f"one of {every_tick} ticks is shown"] if every_tick > 1 else []
    server = start_server(port=0)
    try:
        recorder = server.get_scene_serializer()
        scene = ViewedScene(server.scene, place)
        notes += scene.notes
        aim_camera(server, place, shown)
        scene.draw_ways(shown)
        returns = sum(len(scan.points_m) for tick in shown for scan in tick.scans)
        every, scanned = max(1, -(-returns // _MOST_RETURNS)), 0
        with server.atomic():  # no browser is connected: sending is put off
            for tick, length_s in zip(shown, _lengths_s(shown), strict=True):
                scene.show(tick, with_scans=scanned % every == 0)
                scanned += bool(tick.scans)
                recorder.insert_sleep(length_s)
        if every > 1:
            notes.append(f"one of {every} ticks shows the scans")
        page = recorder.as_html()
    finally:
        stop_server(server)
    overlay = _overlay(title, shown, scene.colours(shown), notes)
    at = page.rindex("</body>")
    page = page[:at] + overlay + page[at:]
    # The title is a file's name, which may be no UTF-8.
    content = page.encode("utf-8", errors="replace")
    try:
        write_whole(path, content)
    except OSError as cause:
        message = f"{path}: the page cannot be written ({why_refused(cause)})"
        raise BagError(message) from cause
    return View(path, len(content), len(shown), tuple(notes))


def start_server(port: int) -> Any:
    """Return a running server of viser on 127.0.0.1, which prints nothing; port 0: a free one."""
    import viser

    logging.getLogger("websockets").setLevel(logging.ERROR)
    with redirect_stdout(io.StringIO()):  # it prints its address
        server = viser.ViserServer(host="127.0.0.1", port=port, label="ARE", verbose=False)
    server.scene.set_up_direction("+z")
    return server


def stop_server(server: Any) -> None:
    """Stop a server without its message."""
    with redirect_stdout(io.StringIO()):
        server.stop()


def rounding_note(grid: OccupancyGrid) -> str:
    """Return how coarsely 32-bit numbers place what lies on a map, "" where to a millimetre or two.

    Meshes and pages have no others; a map in UTM coordinates is thousands of kilometres away.
    """
    far_m = np.abs(grid.origin.translation_m[:2]).max()
    step_m = float(np.spacing(np.float32(far_m)))
    if step_m < _NOTED_STEP_M:
        return ""
    far = f"{far_m / 1000.0:.0f} km from the origin of {grid.frame_id}"
    return f"{far}, places are rounded to {step_m:.2g} m"


class ViewedScene:
    """Draws a place and its ticks onto a scene of viser.

    Each tick changes only what differs from the one before. `notes` say what is drawn coarser.
    """

    def __init__(self, scene: Any, place: ViewedPlace) -> None:
        self.notes = list(filter(None, [rounding_note(place.grid)]))
        self._scene, self._place = scene, place
        self._part = known_part(place.grid)
        self._field = VoxelField.of(place.voxels)
        self._bodies = ArtefactBodies(place.catalogue)
        self._artefacts: dict[_LifeKey, _Drawn] = {}
        self._robot: _Node | None = None
        self._frustums: dict[int, _Node] = {}
        self._fans: dict[int, _Node] = {}
        self._scans: dict[str, _Node] = {}
        self._scan_ns = 0
        self._ways: dict[str, Any] = {}
        scene.configure_default_lights(enabled=True, cast_shadow=True)
        self._layers = {
            node: scene.add_frame(node, show_axes=False)
            for node in LAYERS.values()
            if node not in _SINGLE_NODES
        }
        self._draw_map()
        self._draw_walls()

    def show(self, tick: Moment, *, with_scans: bool = True) -> None:
        """Show a tick."""
        self._show_robot(tick.map_from_base)
        self._show_cameras(tick)
        there = {_life_of(one) for one in tick.artefacts}
        for gone in self._artefacts.keys() - there:
            self._artefacts.pop(gone).remove()
        for one in tick.artefacts:
            if (life := _life_of(one)) not in self._artefacts:
                self._artefacts[life] = self._new_artefact(one)
            is_perceived = one.artefact_id in tick.perceived
            self._artefacts[life].show(one, is_perceived=is_perceived)
        if tick.scans and with_scans:
            self._scan_ns = tick.stamp_ns
            self._show_scans(tick.scans)
        elif not 0 <= tick.stamp_ns - self._scan_ns < _SCAN_LASTS_NS:
            self._show_scans(())

    def colours(self, ticks: Sequence[Moment]) -> dict[str, Rgb]:
        """Return the colours in which the artefacts of ticks are drawn, by class in their order."""
        classes = sorted({one.row.class_name for tick in ticks for one in tick.artefacts})
        return {name: self._bodies.colour(name) for name in classes}

    def switch(self, layer: str, *, is_shown: bool) -> None:
        """Show or hide one of `LAYERS`."""
        node = LAYERS[layer]
        handle = self._layers.get(node) or self._scene.get_handle_by_name(node)
        if handle is not None:
            handle.visible = is_shown

    def draw_ways(self, ticks: Sequence[Moment]) -> None:
        """Draw the robot's way and that of each artefact in these ticks, instead of others."""
        robot = [t.map_from_base.translation_m[:2] for t in ticks if t.map_from_base is not None]
        ways: dict[_LifeKey, list[tuple[float, ...]]] = {}
        class_of: dict[_LifeKey, str] = {}
        for tick in ticks:
            for one in tick.artefacts:
                ways.setdefault(_life_of(one), []).append(one.pose[:2])
                class_of[_life_of(one)] = one.row.class_name
        before, self._ways = self._ways, {}
        self._draw_way("/ways/robot", np.array(robot).reshape(-1, 2), ROBOT, 0.03)
        for life, points in ways.items():
            colour = self._bodies.colour(class_of[life])
            name = "/ways/" + "_".join(map(str, life))
            self._draw_way(name, np.array(points), colour, 0.012)
        for name in before.keys() - self._ways.keys():
            before[name].remove()

    def _draw_way(self, name: str, points_m: Floats, colour: Rgb, thickness_m: float) -> None:
        way = _simplified(points_m)
        if len(way) < 2:
            return
        points = np.column_stack((way, np.full(len(way), self._place.ground_m + _WAY_LIFT_M)))
        pieces = np.stack((points[:-1], points[1:]), axis=1).astype(np.float32)
        self._ways[name] = self._scene.add_line_segments(
            name, pieces, colour, thickness=thickness_m
        )

    def _draw_map(self) -> None:
        grid, part = self._place.grid, self._part
        image, factor = shaded(part, math.inf)
        cell_m = grid.resolution_m * factor
        height, width = image.shape[:2]
        middle = map_from_part(grid, part, [(0.5 * width * factor, 0.5 * height * factor)])[0]
        turn = grid.origin.rotation_xyzw
        self._scene.add_image(
            "/map",
            np.ascontiguousarray(image),
            width * cell_m,
            height * cell_m,
            format="png",
            cast_shadow=False,
            position=(*middle.tolist(), self._place.ground_m + _GROUND_LIFT_M),
            wxyz=wxyz_of(turn),
        )

    def _draw_walls(self) -> None:
        ground_m = self._place.ground_m
        voxels = between(self._place.voxels, ground_m + _LOWEST_M, ground_m + _HIGHEST_M)
        if voxels is None:
            return
        factor = 1
        while voxels.occupied.size > _MOST_VOXELS * factor**2:
            factor *= 2
        coarse = coarsened(voxels, factor)
        low, high = boxes_of(coarse.occupied)
        while len(low) > _MOST_BOXES:
            factor *= 2
            coarse = coarsened(voxels, factor)
            low, high = boxes_of(coarse.occupied)
        if factor > 1:
            self.notes.append(f"voxels are drawn {factor} times as wide")
        vertices, faces = _prism(_SQUARE, -0.5, 0.5)
        size_m, pose = np.array(coarse.voxel_size_m), coarse.map_from_lattice
        self._scene.add_batched_meshes_simple(
            "/walls",
            vertices,
            faces,
            np.tile(np.array((1.0, 0.0, 0.0, 0.0), dtype=np.float32), (len(low), 1)),
            (0.5 * (low + high) * size_m).astype(np.float32),
            batched_scales=((high - low) * size_m).astype(np.float32),
            batched_colors=WALL,
            lod="off",
            flat_shading=True,
            side="double",
            cast_shadow=False,
            wxyz=wxyz_of(pose.rotation_xyzw),
            position=tuple(pose.translation_m.tolist()),
        )

    def _show_robot(self, map_from_base: RigidTransform | None) -> None:
        if map_from_base is not None:
            self._robot = self._robot or _Node(self._drawn_robot())
            self._robot.place(map_from_base)
        elif self._robot is not None:
            self._robot.set(visible=False)

    def _drawn_robot(self) -> Any:
        """Draw the robot: a low prism over its footprint, with an arrow on top."""
        outline = robot_outline(self._place.footprint)
        vertices, faces = _prism(outline, 0.03, _ROBOT_HEIGHT_M)
        root, body = self._scene.add_frame("/robot/base", show_axes=False), "/robot/base/body"
        self._scene.add_mesh_simple(body, vertices, faces, color=ROBOT, flat_shading=True)
        reach_m, half_m = float(outline[:, 0].max()), 0.5 * float(np.abs(outline[:, 1]).max())
        back_m = -0.3 * reach_m
        arrow = np.array(((0.85 * reach_m, 0.0), (back_m, half_m), (0.0, 0.0), (back_m, -half_m)))
        top = np.column_stack((arrow, np.full(4, _ROBOT_HEIGHT_M + 0.01)))
        self._scene.add_mesh_simple(
            "/robot/base/arrow",
            top,
            np.array(((0, 1, 2), (0, 2, 3))),
            color=(255, 255, 255),
            side="double",
            cast_shadow=False,
        )
        return root

    def _show_cameras(self, tick: Moment) -> None:
        """Show all cameras whose poses are known; the first has the number 0."""
        shown = {other.number: (other.view, other.map_from_camera) for other in tick.others}
        if self._place.camera is not None and tick.map_from_camera is not None:
            shown[0] = self._place.camera, tick.map_from_camera
        for nodes in (self._frustums, self._fans):
            for number in nodes.keys() - shown.keys():
                nodes[number].set(visible=False)
        for number, (view, map_from_camera) in sorted(shown.items()):
            if number not in self._frustums and (frustum := self._drawn_frustum(number, view)):
                self._frustums[number] = _Node(frustum)
            if number in self._frustums:
                self._frustums[number].place(map_from_camera)
            self._show_fan(number, view, map_from_camera)

    def _drawn_frustum(self, number: int, camera: ViewModel) -> Any:
        """Draw a camera's frustum; None for one that looks all around, or has one row or column."""
        if min(camera.width, camera.height) < 2:
            return None
        rays = camera.directions()
        row, column = rays[camera.height // 2], rays[:, camera.width // 2]
        edges = np.stack((row[0], row[-1], column[0], column[-1])).astype(np.float64)
        if (edges[:, 2] < 0.2).any():
            return None
        slopes = edges[:, :2] / edges[:, 2:]
        tan_x = 0.5 * float(slopes[1, 0] - slopes[0, 0])
        tan_y = 0.5 * float(slopes[3, 1] - slopes[2, 1])
        return self._scene.add_camera_frustum(
            _of_camera("/camera/frustum", number),
            2.0 * math.atan(tan_y),
            tan_x / tan_y,
            scale=0.35,
            thickness=0.012,
            color=END,
            cast_shadow=False,
        )

    def _show_fan(self, number: int, camera: ViewModel, map_from_camera: RigidTransform) -> None:
        """Show on the ground how far the image's middle row sees, up to the walls."""
        far_m = self._place.max_range_m
        rays, reach_m = level_sight(camera, map_from_camera, self._field, far_m, _FAN_RAYS)
        if len(rays) < _FAN_RAYS:
            if number in self._fans:
                self._fans[number].set(visible=False)
            return
        start_m = map_from_camera.translation_m[:2]
        ends_m = np.vstack((start_m, start_m + rays * reach_m[:, np.newaxis]))
        heights_m = np.full(len(ends_m), self._place.ground_m + _FAN_LIFT_M)
        vertices = np.round(np.column_stack((ends_m, heights_m)), 2).astype(np.float32)
        if number not in self._fans:
            ends = np.arange(1, len(rays))
            self._fans[number] = _Node(
                self._scene.add_mesh_simple(
                    _of_camera("/camera/fan", number),
                    vertices,
                    np.column_stack((np.zeros_like(ends), ends + 1, ends)),
                    color=SEEN,
                    opacity=0.28,
                    side="double",
                    cast_shadow=False,
                    receive_shadow=False,
                )
            )
        self._fans[number].handle.vertices = vertices
        self._fans[number].set(visible=True)

    def _new_artefact(self, one: ArtefactAt) -> "_Drawn":
        vertices, faces = self._bodies.mesh(one.row)
        body = self._scene.add_mesh_simple(
            f"/artefacts/{one.artefact_id}",
            vertices,
            faces,
            color=self._bodies.colour(one.row.class_name),
            flat_shading=True,
            side="double",
            opacity=_UNSEEN_OPACITY,
        )
        label = self._scene.add_label(
            f"/labels/{one.artefact_id}",
            str(one.artefact_id),
            anchor="bottom-center",
            font_screen_scale=0.8,
        )
        return _Drawn(_Node(body), _Node(label))

    def _show_scans(self, scans: Sequence[ScanPoints]) -> None:
        points = np.concatenate([np.empty((0, 3), np.float32), *(s.points_m for s in scans)])
        is_virtual = np.concatenate([np.empty(0, np.bool_), *(s.is_virtual for s in scans)])
        for name, colour, chosen in (
            ("real", _RETURN, points[~is_virtual]),
            ("virtual", _VIRTUAL, points[is_virtual]),
        ):
            self._show_returns(name, colour, chosen)

    def _show_returns(self, name: str, colour: Rgb, points_m: Points) -> None:
        """Show returns of one kind, as 16-bit offsets from the position of their node."""
        node = self._scans.get(name)
        if not len(points_m):
            if node is not None:
                node.set(visible=False)
            return
        middle = np.round(points_m.mean(axis=0) / _NEAR_M) * _NEAR_M  # so it changes rarely
        near = (points_m - middle).astype(np.float16)
        if node is None:
            node = self._scans[name] = _Node(
                self._scene.add_point_cloud(
                    f"/scans/{name}",
                    near,
                    colour,
                    point_size=0.05 if name == "real" else 0.08,
                    point_shape="circle",
                    point_shading="flat",
                )
            )
        node.handle.points = near
        node.set(position=_rounded(middle), visible=True)


_LifeKey = tuple[int, int]
"""Id and arrival [ns]: a node that was started again gives ids another time."""


def _life_of(one: ArtefactAt) -> _LifeKey:
    return one.artefact_id, one.arrival_ns


def _of_camera(name: str, number: int) -> str:
    """Return the name of a node of one of several cameras."""
    return f"{name}_{number}" if number else name


class _Node:
    """A node of viser's scene; a property is sent only when it changes.

    viser compares the values, too, but slowly: that took most of the time of a page.
    """

    def __init__(self, handle: Any) -> None:
        self.handle = handle
        self._shown: dict[str, Any] = {}

    def set(self, **values: Any) -> None:
        """Set properties, given as numbers, texts or tuples of these."""
        for name, value in values.items():
            if name not in self._shown or self._shown[name] != value:
                self._shown[name] = value
                setattr(self.handle, name, value)

    def place(self, pose: RigidTransform) -> None:
        """Move the node, and show it."""
        turn = wxyz_of(pose.rotation_xyzw)
        self.set(position=_rounded(pose.translation_m), wxyz=turn, visible=True)

    def remove(self) -> None:
        """Take the node away."""
        self.handle.remove()


class _Drawn(NamedTuple):
    """An artefact's body and label."""

    body: _Node
    label: _Node

    def show(self, one: ArtefactAt, *, is_perceived: bool) -> None:
        """Bring both up to date."""
        pose, row = one.pose, one.row
        x_m, y_m, half_rad = round(pose.x_m, 3), round(pose.y_m, 3), 0.5 * pose.yaw_rad
        label_m = pose.z_m + row.size_m[2] + _LABEL_GAP_M
        self.body.set(
            position=(x_m, y_m, round(pose.z_m + row.com_height_m, 3)),
            wxyz=(round(math.cos(half_rad), 4), 0.0, 0.0, round(math.sin(half_rad), 4)),
            opacity=None if is_perceived else _UNSEEN_OPACITY,
        )
        text = _text_of(one, is_perceived=is_perceived)
        self.label.set(position=(x_m, y_m, round(label_m, 3)), text=text)

    def remove(self) -> None:
        """Take both away."""
        self.body.remove()
        self.label.remove()


def aim_camera(
    server: Any, place: ViewedPlace, ticks: Sequence[Moment], margin_m: float = 2.0
) -> None:
    """Let the page open with a view from above, at a slant, on what happens and a margin."""
    target, distance_m = _stage_of(place, ticks, margin_m)
    camera = server.initial_camera
    away = np.array((0.0, -math.cos(_SLANT_RAD), math.sin(_SLANT_RAD)))
    camera.position = tuple((target + distance_m * away).tolist())
    camera.look_at = tuple(target.tolist())
    camera.up = (0.0, 0.0, 1.0)
    camera.fov = _FIELD_OF_VIEW_RAD


def wxyz_of(xyzw: npt.ArrayLike) -> tuple[float, float, float, float]:
    """Return a quaternion in the order of viser, rounded to what the eye sees."""
    x, y, z, w = np.round(np.asarray(xyzw, dtype=np.float64), 4).tolist()
    return w, x, y, z


def _rounded(position_m: npt.ArrayLike) -> tuple[float, ...]:
    """Return a position in whole millimetres, which take less room."""
    return tuple(np.round(np.asarray(position_m, dtype=np.float64), 3).tolist())


def _text_of(one: ArtefactAt, *, is_perceived: bool) -> str:
    """Return the label: id, name and activity; the id alone if the artefact is not perceived."""
    number, doing = id_text(one.artefact_id), one.activity or one.behaviour
    if not is_perceived:
        return number
    return f"{number} {one.row.label}" + (f": {doing}" if doing else "")


def _fits(known: CatalogueRow, row: CatalogueRow) -> bool:
    """Say whether two rows are the same type: a recording may be of another catalogue."""
    return known.label == row.label and bool(np.allclose(known.size_m, row.size_m, atol=1e-3))


def _mesh_of(row: CatalogueRow) -> tuple[Points, Faces]:
    vertices_m, faces, _ = surface_of(row)
    return vertices_m.astype(np.float32), faces.astype(np.uint32)


def _box_of(row: CatalogueRow) -> tuple[Points, Faces]:
    x_m, y_m, z_m = row.size_m
    vertices, faces = _prism(_SQUARE * (x_m, y_m), -0.5 * z_m, 0.5 * z_m)
    return vertices + np.array(row.box_centre_in_artefact_m, dtype=np.float32), faces


def _prism(outline_m: Floats, low_m: float, high_m: float) -> tuple[Points, Faces]:
    """Return the mesh of a convex outline (N, 2) between two heights."""
    count = len(outline_m)
    low = np.column_stack((outline_m, np.full(count, low_m)))
    high = np.column_stack((outline_m, np.full(count, high_m)))
    here = np.arange(count)
    after = (here + 1) % count
    lower = np.column_stack((here, after, after + count))
    upper = np.column_stack((here, after + count, here + count))
    fan = np.column_stack((np.zeros(count - 2, np.int64), here[1:-1], here[2:]))
    faces = np.vstack((lower, upper, fan + count, fan[:, ::-1]))
    return np.vstack((low, high)).astype(np.float32), faces.astype(np.uint32)


def _simplified(points_m: Floats) -> Floats:
    """Return a way (N, 2) with fewer points, each of the others within `_WAY_OFF_M` of it."""
    import cv2

    if len(points_m) < 2 or float(np.ptp(points_m, axis=0).max()) < _WAY_OFF_M:
        return points_m[:0]
    kept = cv2.approxPolyDP(points_m.astype(np.float32)[:, np.newaxis], _WAY_OFF_M, False)
    way: Floats = np.asarray(kept, dtype=np.float64)[:, 0]
    return way


def _lengths_s(ticks: Sequence[Moment]) -> list[float]:
    """Return how long each tick is shown; a gap is cut to the usual length."""
    stamps = np.array([tick.stamp_ns for tick in ticks], dtype=np.int64)
    steps = np.diff(stamps) / NS_PER_S
    usual = float(np.median(steps)) if len(steps) else 0.1
    longest = max(_GAP_S, 3.0 * usual)
    lengths = np.where((steps > 0.0) & (steps < longest), steps, usual)
    return [*lengths.tolist(), usual]


def _stage_of(place: ViewedPlace, ticks: Sequence[Moment], margin_m: float) -> tuple[Floats, float]:
    """Return the point (3,) that the camera looks at, and its distance [m]."""
    part = known_part(place.grid)
    height, width = part.cells.shape
    corners = map_from_part(place.grid, part, [(0, 0), (width, 0), (0, height), (width, height)])
    low, high = corners.min(axis=0), corners.max(axis=0)
    robot = [t.map_from_base.translation_m[:2] for t in ticks if t.map_from_base is not None]
    others = [one.pose[:2] for tick in ticks for one in tick.artefacts]
    if points := [*robot, *others]:
        around = np.array(points, dtype=np.float64)
        near, far = around.min(axis=0) - margin_m, around.max(axis=0) + margin_m
        is_on_map = (np.maximum(low, near) < np.minimum(high, far)).all()
        low = np.maximum(low, near) if is_on_map else near
        high = np.minimum(high, far) if is_on_map else far
    span = np.maximum(high - low, 2.0)
    middle = 0.5 * (low + high)
    tan = math.tan(0.5 * _FIELD_OF_VIEW_RAD)
    # Seen at a slant, what lies far behind is small: so the depth needs less room than the width.
    distance_m = max(0.36 * float(span[0]) / tan, 0.5 * float(span[1]) / tan) + 1.0
    return np.array((*middle, place.ground_m)), distance_m


def _overlay(
    title: str, ticks: Sequence[Moment], colours: Mapping[str, Rgb], notes: Sequence[str]
) -> str:
    """Return the legend of the page, with the layers to switch, and its script.

    `colours` are those of the classes, `notes` say what was left out.
    """
    starts = np.concatenate(((0.0,), np.cumsum(_lengths_s(ticks)[:-1])))
    has_scans = any(tick.scans for tick in ticks)
    entries = [
        ("real robot", ROBOT, "1"),
        ("camera's view", SEEN, "0.5"),
        *((name, colour, "1") for name, colour in colours.items()),
    ]
    if has_scans:
        entries += [("laser return", _RETURN, "1"), ("virtual return", _VIRTUAL, "1")]
    data = {
        "starts": np.round(starts, 3).tolist(),
        "alive": [len(tick.artefacts) for tick in ticks],
        "perceived": [len(tick.perceived) for tick in ticks],
    }
    rows = "".join(
        f'<li><i style="background:{hex_of(colour)};opacity:{alpha}"></i>{html.escape(name)}</li>'
        for name, colour, alpha in entries
    )
    layers = "".join(
        f'<label><input type="checkbox" checked data-node="{node}">{html.escape(name)}</label>'
        for name, node in LAYERS.items()
        if has_scans or node != "/scans"
    )
    text = _OVERLAY.read_text(encoding="utf-8")
    values = {
        "TITLE": html.escape(title),
        "ROWS": rows,
        "NOTES": "".join(f"<p>{html.escape(note)}</p>" for note in notes),
        "LAYERS": layers,
        "DATA": json.dumps(data),
    }
    # In one pass: a name may look like one of the places.
    return re.sub("@(" + "|".join(values) + ")@", lambda found: values[found[1]], text)


def coarsened(voxels: VoxelMap, factor: int) -> VoxelMap:
    """Return the map with `factor` times wider voxels, occupied where any of theirs is.

    An extruded map stays as high as it is.
    """
    factors = (factor, factor, 1 if voxels.is_extruded else factor)
    occupied = voxels.occupied
    for axis, times in enumerate(factors):
        starts = np.arange(0, occupied.shape[axis], times)
        occupied = np.maximum.reduceat(occupied, starts, axis=axis)
    x_m, y_m, z_m = (size * times for size, times in zip(voxels.voxel_size_m, factors, strict=True))
    return VoxelMap(voxels.map_from_lattice, (x_m, y_m, z_m), occupied, voxels.is_extruded)


def between(voxels: VoxelMap, low_m: float, high_m: float) -> VoxelMap | None:
    """Return what of a map lies between two heights of the map's frame, None if nothing does.

    Layers whose middle is between them are kept; tall voxels of an extruded map are cut.
    """
    pose, (x_m, y_m, z_m) = voxels.map_from_lattice, voxels.voxel_size_m
    base_m = float(pose.translation_m[2])
    if voxels.is_extruded:
        if base_m >= high_m or not voxels.occupied.any():
            return None
        return VoxelMap(pose, (x_m, y_m, min(z_m, high_m - base_m)), voxels.occupied, True)
    middles_m = base_m + (np.arange(voxels.occupied.shape[2]) + 0.5) * z_m
    layers = np.flatnonzero((middles_m > low_m) & (middles_m < high_m))
    if not len(layers):
        return None
    part = voxels.occupied[:, :, layers[0] : layers[-1] + 1]
    if not part.any():
        return None
    lift = np.array((0.0, 0.0, layers[0] * z_m))
    lifted = RigidTransform(pose.translation_m + lift, pose.rotation_xyzw)
    return VoxelMap(lifted, voxels.voxel_size_m, part)
