"""Clouds with labelled boxes and their calibration, as KITTI's 3D object benchmark has them."""

import csv
import math
from bisect import bisect_left
from collections import Counter, deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.bag.decoded import Sighting
from are_ros.bag.recording import PREFIX
from are_ros.builder.sensors.point_cloud import PointCloud
from are_ros.errors import BagError, FrameError, InputError
from are_ros.export.truth import Interval, TrueTick, TruthReader, chosen_topic
from are_ros.messages.sensors import read_cloud
from are_ros.replay.progress import OpenProgress
from are_ros.wording import counted, why_refused
from are_ros.world.cameras import PinholeView
from are_ros.world.rigid_transform import RigidTransform

Floats = npt.NDArray[np.float64]

_CLOUD: Final = "sensor_msgs/msg/PointCloud2"
_INTENSITIES: Final = ("intensity", "intensities", "reflectivity", "reflectance")
_TYPES: Final = {"person": "Pedestrian", "car": "Car"}
"""KITTI's names of our classes; the others keep their own, with a capital."""
_FULLY, _PARTLY = 0.8, 0.4
"""From these visible fractions on an object is fully visible (0), partly occluded (1); else 2."""
_UNKNOWN: Final = 3
_Placed = tuple[RigidTransform, RigidTransform, PinholeView, str]
"""map_from_sensor, map_from_camera, what the camera sees, its name."""
_NEAR_M: Final = 0.05
_KEPT_TICKS: Final = 200
"""So many ticks are kept for clouds that come late, as those of a slow driver."""
_WITHOUT_TRUTH: Final = "for before or after it nothing is known of the artefacts"
_EDGES: Final = tuple((a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b).bit_count() == 1)


class Label(NamedTuple):
    """A box in the level camera's frame: the middle of its bottom [m], its heading, its size."""

    kind: str
    occluded: int
    bottom_m: Floats
    rotation_y: float
    size_m: tuple[float, float, float]


class KittiWriter:
    """Writes a frame for each augmented cloud whose time, poses and camera are known."""

    def __init__(self, folder: Path) -> None:
        """Take the folder, which is made with the first frame."""
        self.frames = self.boxes = 0
        self._folder = folder

    def add(
        self,
        cloud: PointCloud,
        labels: list[tuple[Label, tuple[float, float, float, float], float]],
        projection: Floats,
        level_from_sensor: RigidTransform,
    ) -> None:
        """Write a frame: labels with their rectangles [px] and how much of them is cut off."""
        name, training = f"{self.frames:06d}", self._folder / "training"
        if not self.frames:
            for part in ("velodyne", "label_2", "calib"):
                (training / part).mkdir(parents=True, exist_ok=True)
            self._note("frame", "stamp_ns")
        (training / "velodyne" / f"{name}.bin").write_bytes(_points(cloud).tobytes())
        lines = [_line(*one) for one in labels]
        (training / "label_2" / f"{name}.txt").write_text("".join(lines), encoding="utf-8")
        text = _calibration(projection, level_from_sensor)
        (training / "calib" / f"{name}.txt").write_text(text, encoding="utf-8")
        self._note(name, cloud.stamp_ns)
        self.frames += 1
        self.boxes += len(labels)

    def _note(self, *row: object) -> None:
        with (self._folder / "frames.csv").open("a", newline="", encoding="utf-8") as table:
            csv.writer(table).writerow(row)


def export_kitti(recording: Path, folder: Path, open_progress: OpenProgress, cloud: str) -> str:
    """Write clouds, labels and calibration into a folder, and return a sentence about them.

    `cloud` names the augmented cloud's topic, empty where there is one only. What is labelled are
    the perceived artefacts, where they truly were at the stamp of the cloud. Raises BagError.
    """
    reader = TruthReader(recording)
    known = [topic for topic in reader.outputs(_CLOUD) if topic != PREFIX + "augmented_octomap"]
    without = f"{recording} has no augmented cloud (sensors.clouds)"
    topic = chosen_topic(known, cloud, "--kitti", "--cloud", without)
    clouds, writer = _Clouds(reader, topic), KittiWriter(folder)
    try:
        for tick in reader.read(open_progress, {topic: clouds.take}):
            for interval, one, placed in clouds.due(tick):
                _add(writer, interval, one, *placed)
    except OSError as cause:
        raise BagError(f"--kitti {folder}: {why_refused(cause)}") from cause
    reasons = [f"{count} left out, {why}" for why, count in clouds.all_left_out().items()]
    if not writer.frames:
        raise BagError(
            f"--kitti: no cloud can be written ({'; '.join((*reasons, *reader.left_out))}); "
            "a replay records transforms and CameraInfo with --with-inputs"
        )
    words = (counted(writer.frames, "cloud"), counted(writer.boxes, "labelled box"))
    return f"kitti: {folder} ({'; '.join((', '.join(words), *reasons, *reader.left_out))})"


class _Clouds:
    """Clouds that wait for the ticks before and after them, and for what tells where they are."""

    def __init__(self, reader: TruthReader, topic: str) -> None:
        self._reader, self._topic = reader, topic
        self._waiting: deque[tuple[PointCloud, _Placed | str]] = deque()
        self._ticks: deque[TrueTick] = deque(maxlen=_KEPT_TICKS)
        self._left_out: Counter[str] = Counter()

    def take(self, message: Any) -> None:
        """Take a cloud; one that cannot be read is left out."""
        try:
            cloud = read_cloud(message, self._topic)
        except InputError as cause:
            self._left_out[str(cause)] += 1
        else:
            self._waiting.append((cloud, _placed(self._reader, cloud)))

    def due(self, tick: TrueTick) -> Iterator[tuple[Interval, PointCloud, _Placed]]:
        """Take a tick; yield the clouds from before it that can be written, with their ticks."""
        self._ticks.append(tick)
        while self._waiting and self._waiting[0][0].stamp_ns <= tick.scene.stamp_ns:
            cloud, found = self._waiting.popleft()
            if isinstance(found, str):  # what lacked may have come meanwhile
                found = _placed(self._reader, cloud)
            after = bisect_left(self._ticks, cloud.stamp_ns, key=lambda one: one.scene.stamp_ns)
            if isinstance(found, str):
                self._left_out[found] += 1
            elif not 0 < after < len(self._ticks):
                self._left_out[_WITHOUT_TRUTH] += 1
            else:
                yield Interval(self._ticks[after - 1], self._ticks[after]), cloud, found

    def all_left_out(self) -> Counter[str]:
        """Return how many clouds were left out, by the reason; at the end, those that wait, too."""
        lack = (one if isinstance(one, str) else _WITHOUT_TRUTH for _, one in self._waiting)
        return self._left_out + Counter(lack)


def _placed(reader: TruthReader, cloud: PointCloud) -> _Placed | str:
    """Return where a cloud's sensor and the camera are, by what was read until now.

    Before the first CameraInfo, and where a pose is not known, return the reason.
    """
    camera, frames = reader.robot.camera, reader.robot.tree
    if camera is None:
        return "there was no CameraInfo yet"
    if not isinstance(camera.view, PinholeView):
        raise BagError(
            "--kitti: KITTI knows flat images only; the camera is a fisheye, or sees all around"
        )
    map_frame = reader.parameters.frames.map
    frame = camera.frame_id or reader.robot.base_frame()
    try:
        map_from_sensor = frames.lookup(map_frame, cloud.frame_id, cloud.stamp_ns)
        map_from_camera = frames.lookup(map_frame, frame, cloud.stamp_ns)
    except FrameError:
        return "the pose of its sensor or of the camera is not known"
    if not camera.frame_id:
        map_from_camera = map_from_camera @ camera.base_from_optical
    return map_from_sensor, map_from_camera, camera.view, camera.name


def _add(
    writer: KittiWriter,
    interval: Interval,
    cloud: PointCloud,
    map_from_sensor: RigidTransform,
    map_from_camera: RigidTransform,
    view: PinholeView,
    camera: str,
) -> None:
    level = level_frame(map_from_camera)
    camera_from_level = (map_from_camera.inverse() @ level).rotation_matrix()
    intrinsics = np.array(((view.fx, 0.0, view.cx), (0.0, view.fy, view.cy), (0.0, 0.0, 1.0)))
    turned = view.rectification() @ camera_from_level
    projection = np.column_stack((intrinsics @ turned, np.zeros(3)))
    labels = []
    is_after = 2 * cloud.stamp_ns >= interval.before.scene.stamp_ns + interval.after.scene.stamp_ns
    nearest = interval.after if is_after else interval.before
    for number, (k, pose) in interval.poses_at(cloud.stamp_ns).items():
        seen = nearest.sightings.get(number)
        if seen is None or camera not in (seen.cameras or (camera,)):  # another one sees it
            continue
        label = _label(interval, k, pose, _occlusion(seen, camera), level)
        corners = projection @ np.column_stack((corners_m(label), np.ones(8))).T
        shown = _rectangle(corners, view.width, view.height)
        if shown is not None:
            labels.append((label, *shown))
    writer.add(cloud, labels, projection, level.inverse() @ map_from_sensor)


def level_frame(map_from_camera: RigidTransform) -> RigidTransform:
    """Return the pose of a frame at the camera whose y is straight down, z its horizontal look.

    KITTI's boxes turn about y alone, and stand upright only in such a frame.
    """
    x, y, _ = map_from_camera.rotation_matrix()[:, 2].tolist()
    yaw = math.atan2(y, x)
    half = 0.5 * (yaw - 0.5 * math.pi)
    turned = RigidTransform(np.zeros(3), np.array((0.0, 0.0, math.sin(half), math.cos(half))))
    down = math.sqrt(0.5)
    upright = RigidTransform(np.zeros(3), np.array((-down, 0.0, 0.0, down)))
    return RigidTransform(map_from_camera.translation_m, (turned @ upright).rotation_xyzw)


def _label(
    interval: Interval, k: int, pose: Floats, occlusion: int, level: RigidTransform
) -> Label:
    scene, yaw = interval.after.scene, float(pose[3])
    ahead, aside, above = scene.box_centres_m[k].tolist()
    length, width, height = (2.0 * scene.half_sizes_m[k]).tolist()
    cos, sin = math.cos(yaw), math.sin(yaw)
    bottom = np.array((cos * ahead - sin * aside, sin * ahead + cos * aside, above - 0.5 * height))
    level_from_map = level.inverse()
    heading = level_from_map.rotation_matrix() @ (cos, sin, 0.0)
    name = scene.classes[k]
    return Label(
        _TYPES.get(name, name.capitalize().replace(" ", "_")),
        occlusion,
        level_from_map.apply((pose[:3] + bottom)[np.newaxis])[0],
        math.atan2(-heading[2], heading[0]),
        (length, width, height),
    )


def _occlusion(seen: Sighting, camera: str) -> int:
    """Return KITTI's level of occlusion; the fraction is of the camera that sees most."""
    if seen.cameras[:1] not in ((), (camera,)):
        return _UNKNOWN
    return 0 if seen.visible_fraction >= _FULLY else 1 if seen.visible_fraction >= _PARTLY else 2


def corners_m(label: Label) -> Floats:
    """Return the corners (8, 3) of a label's box, as KITTI turns it about y."""
    length, width, height = label.size_m
    signs = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)], dtype=np.float64)
    x, z = (signs[:, 0] - 0.5) * length, (signs[:, 1] - 0.5) * width
    cos, sin = math.cos(label.rotation_y), math.sin(label.rotation_y)
    around = np.column_stack((cos * x + sin * z, -height * signs[:, 2], cos * z - sin * x))
    corners: Floats = label.bottom_m + around
    return corners


def _rectangle(
    corners: Floats, width: int, height: int
) -> tuple[tuple[float, float, float, float], float] | None:
    """Return the rectangle within the image of projected corners (3, 8), and the share cut off."""
    before = [corners[:, k] for k in range(8) if corners[2, k] >= _NEAR_M]
    for a, b in _EDGES:
        one, other = corners[:, a], corners[:, b]
        if (one[2] < _NEAR_M) != (other[2] < _NEAR_M):
            before.append(one + (_NEAR_M - one[2]) / (other[2] - one[2]) * (other - one))
    if not before:
        return None
    points = np.array(before)
    pixels = points[:, :2] / points[:, 2:]
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    last = np.array((width - 1.0, height - 1.0))
    inner_low, inner_high = np.clip(low, 0.0, last), np.clip(high, 0.0, last)
    if (inner_high <= inner_low).any():
        return None
    kept = np.prod(inner_high - inner_low) / np.prod(high - low)
    (left, top), (right, bottom) = inner_low.tolist(), inner_high.tolist()
    return (left, top, right, bottom), 1.0 - float(kept)


def _line(label: Label, rectangle: tuple[float, float, float, float], cut_off: float) -> str:
    x, y, z = label.bottom_m.tolist()
    length, width, height = label.size_m
    alpha = math.remainder(label.rotation_y - math.atan2(x, z), math.tau)
    numbers = (alpha, *rectangle, height, width, length, x, y, z, label.rotation_y)
    texts = (f"{value:.4f}" for value in numbers)
    return " ".join((label.kind, f"{cut_off:.2f}", str(label.occluded), *texts)) + "\n"


def _points(cloud: PointCloud) -> npt.NDArray[np.float32]:
    """Return the returns (N, 4) of a cloud: x, y, z [m] and the intensity, else 0."""
    points_m = cloud.points_m()
    is_return = np.isfinite(points_m).all(axis=1) & points_m.any(axis=1)
    intensity = cloud.column(_INTENSITIES)
    values = np.zeros(len(points_m)) if intensity is None else intensity
    kept = np.column_stack((points_m, values))[is_return]
    finite: npt.NDArray[np.float32] = np.nan_to_num(kept.astype("<f4"), posinf=0.0, neginf=0.0)
    return finite


def _calibration(projection: Floats, level_from_sensor: RigidTransform) -> str:
    """Return the text of a calib file: all four cameras are the same one, R0 is the identity."""

    def row(name: str, matrix: Floats) -> str:
        return f"{name}: {' '.join(f'{value:.12e}' for value in matrix.ravel().tolist())}\n"

    tr = level_from_sensor.matrix()[:3]
    rows = [row(f"P{k}", projection) for k in range(4)]
    rows += [row("R0_rect", np.eye(3)), row("Tr_velo_to_cam", tr)]
    return "".join([*rows, row("Tr_imu_to_velo", np.eye(4)[:3])])
