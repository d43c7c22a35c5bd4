"""Draws docs/images/painted_*.png and depth.png: `python scripts/draw_painted.py SCENE`.

SCENE is `office`, the sample recording as it came in and as it went out; `desk` or `room`, one
frame of a recording of others, of the folders tum-desk-rgbd and redwood-rgbd in `--data`. The desk
gives depth.png, too: its depths as they came in and as they went out.
"""

import argparse
import io
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # the scenes are those of the tests

from are_ros.bag.reader import BagReader
from are_ros.bag.recording import PREFIX
from tests.replay.test_images import BODIES, on_a_free_map

_IMAGES = Path("docs/images")
_WIDTH, _GAP = 480, 8
_NEAR_M, _FAR_M = 0.9, 4.0
_OF_OTHERS = {
    "desk": (
        "tum-desk-rgbd",
        (
            ("person_child_tall", 1.78, 0.42, 3.5),
            ("robot_disc", 1.72, -0.78, 2.0),
            ("person_adult_short", 2.75, -1.42, 2.6),
        ),
    ),
    "room": ("redwood-rgbd", BODIES),
}
"""Their recordings, and who stands in them at which x, y and yaw, on a map that is free."""


def main() -> None:
    """Draw it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", choices=("office", *_OF_OTHERS))
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if arguments.scene == "office":
            draw_office(Path(folder))
        else:
            draw_of_others(arguments.scene, arguments.data, Path(folder))


def draw_office(folder: Path) -> None:
    """Draw four seconds after the beginning, beside the image as it came in."""
    walls = ("--scenario", "config/scenarios/behind_walls.yaml")
    replay("bags/sample_office.mcap", *walls, "--start", 18, "--duration", 4.1, out=folder)
    topics = ("/camera/image_raw/compressed", f"{PREFIX}camera/image/compressed")
    files = [io.BytesIO(bytes(last(folder, topic).data)) for topic in topics]
    pictures = [np.asarray(Image.open(file)) for file in files]
    beside(pictures).save(_IMAGES / "painted_office.png", optimize=True)


def draw_of_others(scene: str, data: Path, folder: Path) -> None:
    """Draw the last frame, and the depths of the desk."""
    recording, bodies = _OF_OTHERS[scene]
    given = on_a_free_map(folder, bodies)
    replay(data / recording, *given, "--set", "sensors.gate:=all", out=folder)
    painted = last(folder, f"{PREFIX}camera/image")
    pixels = np.frombuffer(bytes(painted.data), np.uint8).reshape(painted.height, painted.step)
    colours = pixels[:, : 3 * painted.width].reshape(painted.height, painted.width, 3)
    Image.fromarray(colours).save(_IMAGES / f"painted_{scene}.png", optimize=True)
    if scene == "desk":
        depths = [last(folder, name) for name in ("/camera/depth", f"{PREFIX}depth/image")]
        both = beside([coloured(one) for one in depths])
        both.quantize(128).save(_IMAGES / "depth.png", optimize=True)


def replay(recording: object, *words: object, out: Path) -> None:
    """Replay a recording, with its inputs in the result."""
    are = [sys.executable, "-m", "are_ros"]
    command = [*are, "replay", recording, *words, "--with-inputs", "--out", out]
    subprocess.run([str(word) for word in command], check=True)


def last(folder: Path, topic: str) -> Any:
    """Return the last message of a topic of a replay."""
    with BagReader([folder / "augmented.mcap"]) as reader:
        *_, message = reader.messages([topic])
        return reader.deserialize(message)


def beside(pictures: Sequence[NDArray[np.uint8]]) -> Image.Image:
    """Return two pictures side by side."""
    gap = np.full((len(pictures[0]), _GAP, 3), 255, np.uint8)
    both = Image.fromarray(np.hstack((pictures[0], gap, pictures[1])))
    both.thumbnail((2 * _WIDTH + _GAP, both.height))
    return both


def coloured(message: Any) -> NDArray[np.uint8]:
    """Return the depths of a raw image of 16 bits in colours, black where there is none."""
    depths_m = 1e-3 * np.asarray(message.data).view("<u2").reshape(message.height, message.width)
    share = np.clip((depths_m - _NEAR_M) / (_FAR_M - _NEAR_M), 0.0, 1.0)
    colours = 255.0 * colormaps["turbo_r"](share)[..., :3] * (depths_m > 0.0)[..., None]
    return np.rint(colours).astype(np.uint8)


if __name__ == "__main__":
    main()
