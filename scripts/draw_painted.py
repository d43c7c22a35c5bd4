"""Draws docs/images/painted_office.png: `python scripts/draw_painted.py REPLAY [--at SECONDS]`.

REPLAY is the folder of a replay with compressed images and with inputs, as of

    are replay bags/sample_office.mcap --scenario config/scenarios/behind_walls.yaml --start 18 \
        --duration 9 --with-inputs --out out/walls

The picture is the image nearest to that time after the first message, as it came in, and beside it
as it went out.
"""

import argparse
import io
from pathlib import Path

import numpy as np
from PIL import Image

from are_ros.bag.reader import BagReader
from are_ros.bag.recording import PREFIX
from are_ros.conventions import NS_PER_S

_WIDTH = 480


def main() -> None:
    """Draw it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("replay", type=Path)
    parser.add_argument("--at", type=float, default=4.0, help="seconds")
    parser.add_argument("--out", type=Path, default=Path("docs/images/painted_office.png"))
    arguments = parser.parse_args()
    with BagReader([arguments.replay / "augmented.mcap"]) as reader:
        images = [
            topic.name
            for topic in reader.topics
            if topic.type_name.endswith("/CompressedImage") and "epth" not in topic.name
        ]
        (real,) = (name for name in images if not name.startswith(PREFIX))
        (output,) = (name for name in images if name.startswith(PREFIX))
        wanted_ns = reader.start_ns + round(arguments.at * NS_PER_S)
        near: dict[str, tuple[int, bytes]] = {}
        for message in reader.messages(images):
            known = near.get(message.topic)
            if known is None or abs(message.log_time_ns - wanted_ns) < known[0]:
                apart_ns = abs(message.log_time_ns - wanted_ns)
                near[message.topic] = apart_ns, bytes(reader.deserialize(message).data)
    pictures = [np.asarray(Image.open(io.BytesIO(near[name][1]))) for name in (real, output)]
    gap = np.full((len(pictures[0]), 8, 3), 255, np.uint8)
    both = Image.fromarray(np.hstack((pictures[0], gap, pictures[1])))
    both.thumbnail((2 * _WIDTH + 8, both.height))
    both.save(arguments.out, optimize=True)


if __name__ == "__main__":
    main()
