"""Draws docs/images/depth.png: `python scripts/draw_depths.py REPLAY [--out docs/images]`.

REPLAY is the folder of a replay with raw images of depths of 16 bits (`sensor_msgs/Image`) and with
inputs. The picture is the last image as it came in, and beside it as it went out.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray
from PIL import Image

from are_ros.bag.reader import BagReader
from are_ros.bag.recording import PREFIX

_NEAR_M, _FAR_M = 0.9, 4.0
_WIDTH = 480


def main() -> None:
    """Draw it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("replay", type=Path)
    parser.add_argument("--out", type=Path, default=Path("docs/images"))
    arguments = parser.parse_args()
    with BagReader([arguments.replay / "augmented.mcap"]) as reader:
        images = [topic.name for topic in reader.topics if topic.type_name.endswith("/Image")]
        inputs = [name for name in images if not name.startswith(PREFIX)]
        outputs = [name for name in images if name.startswith(PREFIX) and "depth" in name]
        if not (inputs and outputs):
            parser.error(f"{arguments.replay}: it has no raw image of depths, or no inputs")
        last = {m.topic: reader.deserialize(m) for m in reader.messages((*inputs, *images))}
    real, output = last[inputs[0]], last[outputs[0]]
    gap = np.full((real.height, 8, 3), 255, np.uint8)
    both = Image.fromarray(np.hstack((coloured(real), gap, coloured(output))))
    both.thumbnail((2 * _WIDTH + 8, both.height))
    both.quantize(128).save(arguments.out / "depth.png", optimize=True)


def coloured(message: Any) -> NDArray[np.uint8]:
    """Return the depths of a message in colours, black where there is none."""
    depths_m = 1e-3 * np.asarray(message.data).view("<u2").reshape(message.height, message.width)
    share = np.clip((depths_m - _NEAR_M) / (_FAR_M - _NEAR_M), 0.0, 1.0)
    colours = 255.0 * colormaps["turbo_r"](share)[..., :3] * (depths_m > 0.0)[..., None]
    return np.rint(colours).astype(np.uint8)


if __name__ == "__main__":
    main()
