"""Painted images with masks and boxes, as COCO has them."""

import json
from bisect import bisect_right
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.bag.decoded import Scene
from are_ros.conventions import NS_PER_S
from are_ros.errors import BagError, InputError
from are_ros.export.truth import TruthReader, chosen_topic
from are_ros.messages.images.colour import read_colour
from are_ros.messages.images.image import read_image
from are_ros.replay.progress import OpenProgress
from are_ros.wording import counted, why_refused

_MASK = "/mask"
_WAITING: Final = 20
"""So many images wait for their masks, and masks for their images."""


class CocoWriter:
    """Writes an image and the masks of its artefacts once both have come."""

    def __init__(self, folder: Path) -> None:
        self.images: list[dict[str, Any]] = []
        self.annotations: list[dict[str, Any]] = []
        self._kinds: dict[int, dict[int, tuple[str, str]]] = {}
        """Class and label, by id and arrival [ns]."""
        self._stamps_ns: list[int] = []
        self._folder = folder
        (folder / "images").mkdir(parents=True, exist_ok=True)

    def add(self, stamp_ns: int, rgb: npt.NDArray[np.uint8], ids: npt.NDArray[np.int32]) -> None:
        """Add an image (H, W, 3) and the ids (H, W) of the artefacts at its pixels, 0: none."""
        import cv2

        self._stamps_ns.append(stamp_ns)
        number = len(self.images) + 1
        name = f"{number - 1:06d}.png"
        _, data = cv2.imencode(".png", np.ascontiguousarray(rgb[:, :, ::-1]))
        (self._folder / "images" / name).write_bytes(data.tobytes())
        height, width = ids.shape
        self.images.append(
            {
                "id": number,
                "file_name": name,
                "width": width,
                "height": height,
                "stamp": f"{stamp_ns // NS_PER_S}.{stamp_ns % NS_PER_S:09d}",
            }
        )
        for artefact_id in np.unique(ids[ids > 0]).tolist():
            self.annotations.append(self._annotation(number, artefact_id, ids == artefact_id))

    def learn(self, scene: Scene) -> None:
        """Learn the classes and labels of the artefacts of a tick."""
        columns = scene.ids.tolist(), scene.arrivals_ns.tolist(), scene.classes, scene.labels
        for number, arrival_ns, *kind in zip(*columns, strict=True):
            self._kinds.setdefault(number, {})[arrival_ns] = kind[0], kind[1]

    def finish(self) -> int:
        """Write annotations.json; return how many artefacts it tells of.

        Artefacts without a recorded class, which left between two ticks, are left out.
        """
        names = sorted({name for of_id in self._kinds.values() for name, _ in of_id.values()})
        categories = {name: k + 1 for k, name in enumerate(names)}
        kept: list[dict[str, Any]] = []
        for one in self.annotations:
            kind = self._kind_of(one["artefact_id"], self._stamps_ns[one["image_id"] - 1])
            if kind is not None:
                own = {"id": len(kept) + 1, "category_id": categories[kind[0]], "label": kind[1]}
                kept.append({**one, **own})
        content = {
            "info": {"description": "artefacts painted by ARE"},
            "images": self.images,
            "annotations": kept,
            "categories": [{"id": k, "name": name} for name, k in categories.items()],
        }
        path = self._folder / "annotations.json"
        path.write_text(json.dumps(content, indent=1), encoding="utf-8")
        return len(kept)

    def _kind_of(self, artefact_id: int, stamp_ns: int) -> tuple[str, str] | None:
        """Return class and label of an id at a time, None where they were not recorded.

        A node that was started again gives ids another time.
        """
        known = self._kinds.get(artefact_id, {})
        arrivals_ns = sorted(known)
        begun = bisect_right(arrivals_ns, stamp_ns)
        return known[arrivals_ns[max(begun - 1, 0)]] if known else None

    def _annotation(
        self, image: int, artefact_id: int, mask: npt.NDArray[np.bool_]
    ) -> dict[str, Any]:
        rows, columns = np.nonzero(mask)
        left, top = int(columns.min()), int(rows.min())
        return {
            "image_id": image,
            "artefact_id": artefact_id,
            "segmentation": {"size": list(mask.shape), "counts": run_lengths(mask)},
            "area": len(rows),
            "bbox": [left, top, int(columns.max()) - left + 1, int(rows.max()) - top + 1],
            "iscrowd": 0,
        }


def run_lengths(mask: npt.NDArray[np.bool_]) -> list[int]:
    """Return the lengths of the runs of a mask (H, W), column by column, zeros first."""
    flat = mask.ravel(order="F")
    changes = np.flatnonzero(np.diff(flat.astype(np.int8), prepend=0, append=1 - int(flat[-1])))
    return [int(n) for n in np.diff(changes, prepend=0)]


def export_coco(recording: Path, folder: Path, open_progress: OpenProgress, image: str) -> str:
    """Write images and annotations into a folder, and return a sentence about them.

    `image` names the painted image's topic, empty where there is one only. Raises BagError.
    """
    reader = TruthReader(recording)
    known = [topic.removesuffix(_MASK) for topic in reader.outputs() if topic.endswith(_MASK)]
    without = f"{recording} has no mask of an image (sensors.masks: true)"
    topic = chosen_topic(known, image, "--coco", "--image", without)
    try:
        pairs = _Pairs(topic, CocoWriter(folder))
        takers = {topic: pairs.take_image, topic + _MASK: pairs.take_mask}
        for tick in reader.read(open_progress, takers):
            pairs.writer.learn(tick.scene)
        count = pairs.writer.finish()
    except OSError as cause:
        raise BagError(f"--coco {folder}: {why_refused(cause)}") from cause
    left_out = [*pairs.left_out(), *reader.left_out]
    if not pairs.writer.images:
        raise BagError(f"--coco: no image can be written ({'; '.join(left_out) or without})")
    return "; ".join((f"coco: {folder} ({_summary(len(pairs.writer.images), count)}", *left_out))


class _Pairs:
    """Puts each painted image and its mask together, whichever comes first."""

    def __init__(self, topic: str, writer: CocoWriter) -> None:
        self.writer = writer
        self._damaged: list[str] = []
        """Why images cannot be read."""
        self._alone = [0, 0]
        """How many images, and how many masks, waited for too long."""
        self._topic = topic
        self._images: dict[int, npt.NDArray[np.uint8]] = {}
        self._masks: dict[int, npt.NDArray[np.int32]] = {}

    def take_image(self, message: Any) -> None:
        """Take an image; one that cannot be read counts as damaged."""
        try:
            image = read_colour(message, self._topic)
            self._images[image.stamp_ns] = image.pixels.rgb()
        except InputError as cause:
            self._damaged.append(str(cause))
            return
        self._pair(image.stamp_ns)

    def take_mask(self, message: Any) -> None:
        """Take a mask."""
        mask = read_image(message, self._topic + _MASK)
        self._masks[mask.stamp_ns] = mask.pixels().astype(np.int32)
        self._pair(mask.stamp_ns)

    def _pair(self, stamp_ns: int) -> None:
        if stamp_ns in self._images and stamp_ns in self._masks:
            self.writer.add(stamp_ns, self._images.pop(stamp_ns), self._masks.pop(stamp_ns))
        both: tuple[dict[int, Any], ...] = self._images, self._masks
        for k, waiting in enumerate(both):
            if len(waiting) > _WAITING:
                waiting.pop(min(waiting))
                self._alone[k] += 1

    def left_out(self) -> list[str]:
        """Return sentences on what was left out; at the end, what still waits counts, too."""
        said, damaged = [], self._damaged
        without_mask = self._alone[0] + len(self._images)
        without_image = self._alone[1] + len(self._masks) - len(damaged)
        if damaged:
            images = counted(len(damaged), "image")
            said.append(f"{images} of {self._topic} left out, the first: {damaged[0]}")
        if without_mask:
            images = counted(without_mask, "image")
            said.append(f"{images} of {self._topic} without a mask left out")
        if without_image > 0:
            masks = counted(without_image, "mask")
            said.append(f"{masks} without an image of {self._topic} left out")
        return said


def _summary(images: int, annotations: int) -> str:
    """Return how much was written; closes the bracket."""
    found = f"{counted(images, 'image')}, {counted(annotations, 'annotation')})"
    return found if annotations or not images else f"{found}; no artefact is in view in any image"
