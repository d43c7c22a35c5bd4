"""Painted images: where pixels may change, and whether masks and boxes are where artefacts are."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from are_ros.bag.decoded import Scene
from are_ros.checks.oracle.frames import Pose
from are_ros.checks.oracle.plane import about_z, slab
from are_ros.checks.record import Record
from are_ros.checks.result import CheckResult, Tally, at_s, skipped
from are_ros.checks.sensors.colours import JPEG_BLOCK_PX, Bools, Mask, Painted
from are_ros.checks.sensors.scans import Box, BoxPositions, seen_ns, sensor_pose
from are_ros.wording import counted

Floats = NDArray[np.float64]
_List = TypeVar("_List")

_SHADOW_M: Final = 0.6
"""A shadow reaches so far beyond three quarters of the shorter half of a body; of the longer one
in proportion."""
_MASK_PX: Final = 2
"""The samples of a pixel, and what of an edge is the body's, are within this."""
_FEW_PIXELS: Final = 50
_SAME_M: Final = 1e-6
_NAME: Final = "painted images"


def check_images(record: Record) -> CheckResult:
    """Pixels change only where artefacts are, or are darker on the floor about them.

    An image in which nothing changed is its input, byte for byte. Masks are where the boxes of
    their artefacts are, and most of their pixels differ from the input. Of many changed images some
    are looked at, spread evenly.
    """
    tally, images = Tally(_NAME, "image"), record.paintings
    if not images.input_topics:
        reason = "the recording holds no image that came in"
        return skipped(_NAME, reason, needs_inputs=record.lacks_inputs)
    tally.look(images.pairs)
    if images.pairs:
        tally.note(f"{images.unchanged} as they came")
    for topic, stamp_ns in images.unmatched():
        if record.is_live:
            tally.leave_out("image", "without the one that came in, which the recording missed")
        else:
            tally.fail(f"{topic} {at_s(stamp_ns)} has no image of this stamp that came in")
    for topic, stamp_ns, fault in images.faults:
        tally.fail(f"{topic} {at_s(stamp_ns)} {fault}")
    for topic, stamp_ns in sorted(images.unpainted):
        mask = images.masks.get((topic, stamp_ns))
        is_empty = mask is None or _size(mask) < _FEW_PIXELS
        tally.require(is_empty, f"{topic} {at_s(stamp_ns)} is unchanged, but its mask is not empty")
    places = BoxPositions(record)
    for painted in images.changed.kept:
        _check_painted(tally, record, places, painted)
    return tally.result()


def _check_painted(tally: Tally, record: Record, places: BoxPositions, image: Painted) -> None:
    """Judge one changed image."""
    where = f"{image.topic} {at_s(image.stamp_ns)}"
    if image.info is None:
        tally.fail(f"{where} was changed, and no CameraInfo had come beside its input")
        return
    found, boxes = sensor_pose(record, image), places.at(seen_ns(record, image))
    if found is None or boxes is None:
        what = "the camera was" if found is None else "all artefacts were"
        tally.leave_out("changed image", f"for which it is not known where {what} at the stamp")
        return
    try:
        rays = record.scans.rays(image.info, rectified=image.is_rectified)
    except ValueError as error:
        tally.leave_out("changed image", f"with a lens that is not known ({error})")
        return
    pose, slack_m = found
    view = _View(rays, pose, boxes, slack_m)
    # Blur spreads what is painted; that of shadows is a pixel at least.
    blur_px = math.ceil(4.0 * max(1.0, record.settings.rendering.blur)) + 1
    margin_px = blur_px + image.spread_px
    bodies = _grown(view.bodies(), margin_px)
    floor = _grown(view.shadows(), margin_px)
    change = image.change
    stray = change.is_changed & ~bodies & ~floor & view.is_known
    tally.require(not stray.any(), f"{where} {_at(stray)} changed, where no artefact is")
    bright = change.is_brighter & ~bodies & floor & view.is_known
    tally.require(not bright.any(), f"{where} {_at(bright)} brighter beside an artefact")
    mask = record.paintings.masks.get((image.topic, image.stamp_ns))
    if mask is not None:
        _check_mask(tally, where, mask, view, image)


def _check_mask(tally: Tally, where: str, mask: Mask, view: "_View", image: Painted) -> None:
    ids = mask.ids
    if ids.shape != view.is_known.shape:
        tally.fail(f"{where} has a mask of another size")
        return
    for number in mask.regions:
        outside = (ids == number) & ~_grown(view.body(number), _MASK_PX) & view.is_known
        text = f"{where} the mask has id {number} in {_at(outside)}, where its box is not"
        tally.require(not outside.any(), text)
    if _size(mask) >= _FEW_PIXELS and image.spread_px < JPEG_BLOCK_PX:
        share = float(image.change.is_changed[ids > 0].mean())
        text = f"{where} only {share:.0%} of the pixels of its mask differ from the input"
        tally.require(share > 0.5, text)


class _View:
    """Where the boxes of artefacts are in an image, by the rays (H, W, 3) of its pixels."""

    def __init__(self, rays: Floats, camera: Pose, boxes: Sequence[Box], slack_m: float) -> None:
        self.is_known = ~np.asarray(np.isnan(rays).any(axis=2))
        ways = np.nan_to_num(rays) @ camera.rotation.T
        lengths = np.linalg.norm(ways, axis=2, keepdims=True)
        self._ways = ways / np.maximum(lengths, 1e-12)
        self._bodies: dict[int, Bools] = {}
        self._camera_m, self._slack_m = camera.translation_m, slack_m
        self._boxes = {box.number: box for box in boxes}

    def bodies(self) -> Bools:
        """Return the pixels (H, W) that may show an artefact."""
        return self._any(self.body(number) for number in self._boxes)

    def body(self, number: int) -> Bools:
        """Return the pixels (H, W) that may show an artefact; none for one that is not there."""
        box = self._boxes.get(number)
        if box is None:
            return np.zeros(self.is_known.shape, np.bool_)
        if number not in self._bodies:
            half_m = box.half_m + self._slack_m + box.slack_m
            self._bodies[number] = self._meets(box, half_m)
        return self._bodies[number]

    def shadows(self) -> Bools:
        """Return the pixels (H, W) that may show a floor with a shadow on it."""
        return self._any(self._shadow(box) for box in self._boxes.values())

    def _shadow(self, box: Box) -> Bools:
        reach = 0.75 + _SHADOW_M / min(box.half_m[0], box.half_m[1])
        slack_m = self._slack_m + box.slack_m
        half_m = np.append(box.half_m[:2] * reach + slack_m, slack_m)
        ground_m = box.centre_m - np.array((0.0, 0.0, box.half_m[2]))
        return self._meets(box._replace(centre_m=ground_m), half_m)

    def _meets(self, box: Box, half_m: Floats) -> Bools:
        """Return the pixels whose rays meet a box of another size, or that look out of it."""
        turn = about_z(box.yaw_rad)
        which = self._towards(box.centre_m, float(np.linalg.norm(half_m)))
        ways, here = self._ways[which] @ turn, (self._camera_m - box.centre_m) @ turn
        enters, leaves = slab(here, ways, -half_m, half_m)
        met: Bools = np.zeros(self.is_known.shape, np.bool_)
        met[which] = leaves.min(axis=1) >= np.maximum(enters.max(axis=1), 0.0)
        return np.asarray(met & self.is_known)

    def _towards(self, centre_m: Floats, radius_m: float) -> Bools:
        """Return the pixels (H, W) whose rays meet a ball."""
        way = centre_m - self._camera_m
        away_m = float(np.linalg.norm(way))
        if away_m <= radius_m:
            return np.ones(self.is_known.shape, np.bool_)
        cosine = math.sqrt(1.0 - (radius_m / away_m) ** 2) - 1e-9
        return np.asarray(self._ways @ (way / away_m) >= cosine)

    def _any(self, parts: Iterable[Bools]) -> Bools:
        found = np.zeros(self.is_known.shape, np.bool_)
        for part in parts:
            found |= part
        return found


def _grown(pixels: Bools, margin_px: int) -> Bools:
    """Return pixels (H, W) and all that are at most so far away, along rows or columns."""
    size = 2 * margin_px + 1
    down = binary_dilation(pixels, np.ones((size, 1), np.bool_))
    return np.asarray(binary_dilation(down, np.ones((1, size), np.bool_)))


def _size(mask: Mask) -> int:
    return sum(region.pixels for region in mask.regions.values())


def _at(pixels: Bools) -> str:
    if not pixels.any():
        return ""
    row, column = np.argwhere(pixels)[0].tolist()
    return f"{counted(int(pixels.sum()), 'pixel')} (row {row}, column {column} the first)"


# What is told of images and of the scene as boxes.


def check_boxes(record: Record) -> CheckResult:
    """Boxes of images are those of their masks, boxes in the map those of the lists beside them."""
    tally, images = Tally("boxes", "message"), record.paintings
    for (topic, stamp_ns), truth in images.truths.items():
        where = f"{topic} {at_s(stamp_ns)}"
        told = {int(one.id): one for one in truth.artefacts}
        tally.look()
        mask = images.masks.get((topic, stamp_ns))
        regions = {i: _roi(one) for i, one in told.items() if one.visible_pixels}
        if mask is not None:
            expected = {i: tuple(region) for i, region in mask.regions.items()}
            tally.require(regions == expected, f"{where} the truth is not that of its mask")
        for number, one in told.items():
            share = float(one.visible_fraction)
            is_odd = not 0.0 <= share <= 1.0 or (one.visible_pixels > 0 and share == 0.0)
            tally.require(not is_odd, f"{where} id {number} has the visible fraction {share:g}")
        boxes = images.boxes.get((topic, stamp_ns))
        if boxes is not None:
            tally.look()
            _check_detections(tally, where, boxes, told)
    _check_scene_boxes(tally, record)
    _check_perceived_boxes(tally, record)
    if not images.masks:
        tally.note("without masks, what is visible is not compared with any")
    return tally.result()


def _roi(one: Any) -> tuple[int, ...]:
    roi = one.roi
    return roi.x_offset, roi.y_offset, roi.width, roi.height, one.visible_pixels


def _check_detections(tally: Tally, where: str, boxes: Any, told: dict[int, Any]) -> None:
    """Compare a Detection2DArray with the truth of the same image."""
    wanted = {
        i: (one.class_name, roi[0] + 0.5 * roi[2], roi[1] + 0.5 * roi[3], *roi[2:4])
        for i, one in told.items()
        if one.visible_pixels
        for roi in [_roi(one)]
    }
    found = {}
    for one in boxes.detections:
        place, size = one.bbox.center.position, (one.bbox.size_x, one.bbox.size_y)
        found[int(one.id)] = (one.results[0].hypothesis.class_id, place.x, place.y, *size)
    tally.require(found == wanted, f"{where} the boxes are not those of the truth")


def _check_scene_boxes(tally: Tally, record: Record) -> None:
    """Compare the boxes of all artefacts with the list of the same tick."""
    scenes = {scene.stamp_ns: scene for scene in record.scenes}
    beside = _beside_lists(tally, record, record.artefact_boxes, scenes, "artefacts")
    for where, boxes, scene in beside:
        tally.require(_are_of_scene(boxes, scene), f"{where} are not those of the list")


def _beside_lists(
    tally: Tally,
    record: Record,
    told: Sequence[tuple[int, Any]],
    lists: Mapping[int, _List],
    whose: str,
) -> Iterator[tuple[str, Any, _List]]:
    """Yield for boxes a text that names them, the boxes, and the list of the same stamp.

    Boxes without such a list are left out.
    """
    for stamp_ns, boxes in told:
        if not boxes.detections and stamp_ns in record.farewells_ns:
            continue  # a farewell may have the stamp of the last tick
        if stamp_ns not in lists:
            tally.leave_out("message", f"without its list of the {whose}")
            continue
        tally.look()
        yield f"{at_s(stamp_ns)} the boxes of the {whose}", boxes, lists[stamp_ns]


def _are_of_scene(boxes: Any, scene: Scene) -> bool:
    """Tell whether boxes are those of a scene: ids, classes, places and sizes."""
    found = boxes.detections
    names = [(int(one.id), one.results[0].hypothesis.class_id) for one in found]
    if names != [*zip(scene.ids.tolist(), scene.classes, strict=True)]:
        return False
    numbers = np.array([_box_numbers(one) for one in found]).reshape(-1, 7)
    turns = numbers[:, 3] - scene.yaws_rad
    parts = (
        numbers[:, :3] - scene.centres_m,
        np.sin(0.5 * turns),
        numbers[:, 4:] - 2.0 * scene.half_sizes_m,
    )
    return all(bool((np.abs(part) < _SAME_M).all()) for part in parts)


def _box_numbers(one: Any) -> tuple[float, ...]:
    """Return centre, yaw and size of a Detection3D."""
    at, turn, size = one.bbox.center.position, one.bbox.center.orientation, one.bbox.size
    yaw_rad = 2.0 * math.atan2(turn.z, turn.w)
    return (at.x, at.y, at.z, yaw_rad, size.x, size.y, size.z)


def _check_perceived_boxes(tally: Tally, record: Record) -> None:
    """Compare the boxes of what is perceived with the list of the same stamp."""
    lists = {message.stamp_ns: message for message in record.perceived}
    beside = _beside_lists(tally, record, record.perceived_boxes, lists, "perceived")
    for where, boxes, message in beside:
        wanted = [
            (one.artefact_id, *((name, one.existence * p) for name, p in pairs))
            for one in message.sightings
            for pairs in [zip(one.classes, one.probabilities, strict=True)]
        ]
        found = [
            (int(one.id), *((r.hypothesis.class_id, r.hypothesis.score) for r in one.results))
            for one in boxes.detections
        ]
        is_same = len(found) == len(wanted) and all(map(_are_alike, found, wanted))
        tally.require(is_same, f"{where} are not those of the list")


def _are_alike(found: tuple[Any, ...], wanted: tuple[Any, ...]) -> bool:
    """Compare ids and classes, and scores, which a list has in 32 bits."""
    if found[0] != wanted[0] or len(found) != len(wanted):
        return False
    pairs = zip(found[1:], wanted[1:], strict=True)
    return all(a[0] == b[0] and abs(a[1] - b[1]) < _SAME_M for a, b in pairs)
