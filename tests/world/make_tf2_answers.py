"""Ask tf2's BufferCore about random trees of frames, and keep its answers for the tests.

The oracle is Debian's tf2 (apt-get install python3-tf2), run by the system's own Python:

    /usr/bin/python3 tests/world/make_tf2_answers.py tests/world/data/tf2_answers.json.gz

Same seed, same file. What is kept are inputs and outputs, so the tests need no tf2.
"""

import gzip
import json
import math
import random
import sys
from pathlib import Path
from typing import Any

import geometry_msgs.msg  # type: ignore[import-not-found,unused-ignore]
import rospy  # type: ignore[import-not-found,unused-ignore]
import tf2_py

TREES = 16
START_NS = 1_000_000_000_000
NS_PER_S = 1_000_000_000
HISTORY_S = 10


def random_rotation(dice: random.Random, near: list[float] | None) -> list[float]:
    """Return a unit quaternion: anywhere, or a step (sometimes tiny or none) away from `near`."""
    if near is None:
        values = [dice.gauss(0, 1) for _ in range(4)]
    else:
        step = dice.choice([0.0, 1e-9, 1e-4, 0.02, 0.3])
        sign = dice.choice([1.0, -1.0])  # q and -q are the same rotation: the shorter arc
        values = [sign * value + step * dice.gauss(0, 1) for value in near]
    length = math.sqrt(sum(value * value for value in values))
    return [value / length for value in values]


def random_samples(dice: random.Random, frame: int) -> list[dict[str, Any]]:
    """Return the transforms of one frame: static, a single one, or many with changes of parent."""
    kind = dice.choice(["static", "single", "steady", "steady", "wild", "moving"])
    parent = dice.randrange(frame)
    count = {"static": 1, "single": 1}.get(kind, dice.randrange(2, 40))
    stamp = START_NS + dice.randrange(NS_PER_S)
    rotation: list[float] | None = None
    samples = []
    for _ in range(count):
        if kind == "moving" and dice.random() < 0.2:
            parent = dice.randrange(frame)
        rotation = random_rotation(dice, None if kind == "wild" else rotation)
        samples.append(
            {
                "parent": f"f{parent}",
                "child": f"f{frame}",
                "stamp": stamp,
                "static": kind == "static",
                "translation": [dice.uniform(-5, 5) for _ in range(3)],
                "rotation": rotation,
            }
        )
        stamp += dice.choice([20_000_000, 100_000_000, dice.randrange(1, NS_PER_S)])
    return samples


def random_transforms(dice: random.Random) -> list[dict[str, Any]]:
    """Return the transforms of a tree in their order of arrival: partly out of order, repeated."""
    transforms = [
        sample
        for frame in range(1, dice.randrange(3, 11))
        if dice.random() < 0.9  # a gap in the numbers may leave a second tree
        for sample in random_samples(dice, frame)
    ]
    transforms.sort(key=lambda sample: (not sample["static"], sample["stamp"]))
    for _ in range(len(transforms) // 10):
        i = dice.randrange(len(transforms))
        transforms.insert(dice.randrange(len(transforms)), transforms.pop(i))
    repeated = dict(dice.choice(transforms), translation=[9.0, 9.0, 9.0])
    return [*transforms, repeated] if not repeated["static"] else transforms


def stamp_of(stamp_ns: int) -> "rospy.Time":
    """Return nanoseconds as tf2's type."""
    return rospy.Time(*divmod(stamp_ns, NS_PER_S))


def feed(buffer: "tf2_py.BufferCore", sample: dict[str, Any]) -> None:
    """Give one transform to tf2."""
    message = geometry_msgs.msg.TransformStamped()
    message.header.frame_id, message.child_frame_id = sample["parent"], sample["child"]
    message.header.stamp = stamp_of(sample["stamp"])
    place, turn = message.transform.translation, message.transform.rotation
    place.x, place.y, place.z = sample["translation"]
    turn.x, turn.y, turn.z, turn.w = sample["rotation"]
    if sample["static"]:
        buffer.set_transform_static(message, "oracle")
    else:
        buffer.set_transform(message, "oracle")


def kind_of(error: Exception) -> str:
    """Return the kind of tf2's error; a single sample's has no direction in its text."""
    if isinstance(error, tf2_py.LookupException):
        return "unknown"
    text = str(error)
    if isinstance(error, tf2_py.ConnectivityException) or "not find a connection" in text:
        return "disconnected"
    return "past" if "into the past" in text else "future" if "into the future" in text else "time"


def ask(buffer: "tf2_py.BufferCore", target: str, source: str, stamp_ns: int) -> dict[str, Any]:
    """Return one query with tf2's answer, or the kind of its error."""
    query: dict[str, Any] = {"target": target, "source": source, "stamp": stamp_ns}
    try:
        found = buffer.lookup_transform_core(target, source, stamp_of(stamp_ns)).transform
    except tf2_py.TransformException as error:
        return {**query, "error": kind_of(error)}
    place, turn = found.translation, found.rotation
    return {**query, "pose": [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w]}


def latest(buffer: "tf2_py.BufferCore", target: str, source: str) -> dict[str, Any]:
    """Return tf2's latest common time of two frames, or the kind of its error."""
    query = {"target": target, "source": source}
    try:
        stamp = buffer.get_latest_common_time(target, source)
    except tf2_py.TransformException as error:
        return {**query, "error": kind_of(error)}
    return {**query, "stamp": stamp.to_nsec()}


def tree(seed: int) -> dict[str, Any]:
    """Return one random tree, with queries and answers."""
    dice = random.Random(seed)  # noqa: S311 - reproducible, not secret
    buffer = tf2_py.BufferCore(rospy.Duration(HISTORY_S))
    transforms = random_transforms(dice)
    for sample in transforms:
        feed(buffer, sample)
    frames = sorted({sample[end] for sample in transforms for end in ("parent", "child")})
    frames.append("nowhere")
    stamps = [sample["stamp"] for sample in transforms]
    low, high = min(stamps), max(stamps)
    queries = []
    for _ in range(150):
        stamp = dice.choice([dice.choice(stamps), dice.randrange(low - 10**8, high + 10**8)])
        target, source = dice.choice(frames), dice.choice(frames)
        if target != source or target != "nowhere":  # tf2 gives the identity there, we refuse
            queries.append(ask(buffer, target, source, stamp))
    pairs = [(a, b) for a in frames for b in frames if a != b]
    common = [latest(buffer, *dice.choice(pairs)) for _ in range(30)]
    return {"transforms": transforms, "queries": queries, "latest": common}


def main() -> None:
    """Write the file named on the command line."""
    answers = {"history_ns": HISTORY_S * NS_PER_S, "trees": [tree(seed) for seed in range(TREES)]}
    text = json.dumps(answers, separators=(",", ":"))
    Path(sys.argv[1]).write_bytes(gzip.compress(text.encode(), mtime=0))


if __name__ == "__main__":
    main()
