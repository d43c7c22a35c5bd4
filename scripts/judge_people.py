"""Which share of painted persons a people detector finds that nobody here trained.

    python scripts/judge_people.py paint RECORDING FOLDER      # with are_ros
    python scripts/judge_people.py detect FOLDER               # with OpenCV before 5

`paint` takes images of a recording (any camera without persons before it), supposes that the camera
stands level, 1.2 m high, and paints one person into each of 100 (the same ones
again, if they are fewer), 3 to 8 m away, facing anywhere. `detect`
runs OpenCV's HOG people detector (Dalal and Triggs, trained on INRIA's photographs) on the empty
and the painted images, 960 pixels wide. Its windows of 64 x 128 have a person of some 32 x 96
pixels in their middle: that is the detection. A person is found where one overlaps its box by half
(intersection over union); beside it is said how often one does so in the empty image, and in how
many empty images there is any detection. Nothing is a gate: it prints shares.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np

IMAGES = 100
FOUND = 0.5
WIDTH = 960


def paint(recording: Path, folder: Path) -> None:
    """Write empty and painted images, and where the persons are."""
    from are_ros.bag.reader import BagReader
    from are_ros.builder.assembly import catalogue_of
    from are_ros.builder.rendering.painter import Lighting, PaintedBody, Painter
    from are_ros.builder.rendering.surface import SurfaceBank
    from are_ros.messages.images.colour import read_colour
    from are_ros.parameters.model import Parameters
    from are_ros.world.cameras import FORWARD_FROM_OPTICAL, PinholeView
    from are_ros.world.rigid_transform import RigidTransform

    folder.mkdir(parents=True, exist_ok=True)
    random, bank, truth = np.random.default_rng(4), SurfaceBank(4), []
    rows = [r for r in catalogue_of(Parameters()).rows if r.class_name == "person"]
    adults = [row for row in rows if row.size_m[2] > 1.5]
    camera = RigidTransform.from_xyz_ypr(0.0, 0.0, 1.2, 0.0, 0.0, 0.0) @ FORWARD_FROM_OPTICAL
    with BagReader([recording]) as reader:
        kinds = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
        found = [topic.name for topic in reader.topics if topic.type_name in kinds]
        topics = [name for name in found if "depth" not in name][:1]
        messages = list(reader.messages(topics=topics))
        for number in range(IMAGES):
            message = messages[number * len(messages) // IMAGES]
            empty = read_colour(reader.deserialize(message)).pixels.rgb()
            height, width = empty.shape[:2]
            focal = 0.8 * width
            view = PinholeView(width, height, focal, focal, 0.5 * width, 0.5 * height)
            distance = float(random.uniform(3.0, 8.0))
            aside = float(random.uniform(-0.35, 0.35)) * distance
            row = adults[number % len(adults)]
            half = 0.5 * np.array(row.size_m)
            pose = RigidTransform.planar(
                distance, aside, float(random.uniform(-3.14, 3.14)), float(half[2])
            )
            body = PaintedBody(bank.of(row, number), pose, half, 0.0)
            nothing = np.full((height, width), np.inf, dtype=np.float32)
            done = Painter(view).paint(empty, camera, [body], nothing, Lighting(), random)
            if done.pixels is None:
                continue
            ys, xs = np.nonzero(done.mask == 0)
            box = [int(v) for v in (xs.min(), ys.min(), xs.max() + 1, ys.max() + 1)]
            truth.append({"number": number, "box": box, "distance_m": distance, "kind": row.label})
            for name, pixels in (("empty", empty), ("painted", done.pixels)):
                path = folder / f"{name}_{number:04d}.png"
                cv2.imwrite(str(path), np.ascontiguousarray(pixels[:, :, ::-1]))
    (folder / "truth.json").write_text(json.dumps(truth))
    print(f"{len(truth)} images")


def detect(folder: Path) -> None:
    """Print which share of the persons is found, and what is found in the empty images."""
    maker: Any = vars(cv2).get("HOGDescriptor")
    if maker is None:
        sys.exit(f"detect needs OpenCV before 5, and this is {cv2.__version__}")
    hog = maker()
    hog.setSVMDetector(maker.getDefaultPeopleDetector())
    truth = json.loads((folder / "truth.json").read_text())
    by_distance = {3: [0, 0], 5: [0, 0]}
    at_place = anywhere = 0
    for one in truth:
        for name in ("empty", "painted"):
            image: Any = cv2.imread(str(folder / f"{name}_{one['number']:04d}.png"))
            scale = WIDTH / image.shape[1]
            image = cv2.resize(image, None, fx=scale, fy=scale)
            windows, _ = hog.detectMultiScale(image, winStride=(8, 8), padding=(16, 16), scale=1.05)
            people = [person_in(np.asarray(window, float) / scale) for window in windows]
            is_found = any(overlap(person, one["box"]) >= FOUND for person in people)
            if name == "empty":
                at_place += is_found
                anywhere += len(people) > 0
            else:
                group = by_distance[3 if one["distance_m"] < 5.0 else 5]
                group[0] += is_found
                group[1] += 1
    count, found = len(truth), sum(hit for hit, _ in by_distance.values())
    print(f"{found} of {count} painted persons found ({found / count:.0%})")
    for start, (hit, all_) in by_distance.items():
        print(f"  from {start} m on: {hit} of {all_}")
    print(f"at the same places of the empty images: {at_place}")
    print(f"detections anywhere in {anywhere} of {count} empty images")


def person_in(window: np.ndarray) -> np.ndarray:
    """Return x, y, width, height of the person in a window of the detector."""
    x, y, w, h = window
    return np.array((x + 0.25 * w, y + 0.125 * h, 0.5 * w, 0.75 * h))


def overlap(window: np.ndarray, box: list[int]) -> float:
    """Return intersection over union of x, y, width, height and left, top, right, bottom."""
    x, y, w, h = window
    across = min(x + w, box[2]) - max(x, box[0])
    down = min(y + h, box[3]) - max(y, box[1])
    shared = max(across, 0.0) * max(down, 0.0)
    union = w * h + (box[2] - box[0]) * (box[3] - box[1]) - shared
    return float(shared / union)


def main() -> None:
    """Paint, or detect."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    painting, detecting = commands.add_parser("paint"), commands.add_parser("detect")
    painting.add_argument("recording", type=Path)
    for command in (painting, detecting):
        command.add_argument("folder", type=Path)
    given = parser.parse_args()
    if given.command == "paint":
        paint(given.recording, given.folder)
    else:
        detect(given.folder)


if __name__ == "__main__":
    main()
