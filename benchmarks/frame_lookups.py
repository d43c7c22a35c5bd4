"""Lookups through four interpolated edges: the frame tree against tf2's own BufferCore.

    .venv/bin/python benchmarks/frame_lookups.py

The peer is Debian's tf2 (apt-get install python3-tf2), a CPython extension: it is loaded into this
same process from the system's folder, so this Python must be of the system's version. Each peer
turns nanoseconds into its type for stamps. Rounds alternate; medians are printed, and ratios.
"""

import argparse
import math
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from are_ros.world.transforms.tree import FrameTree

SYSTEM_PACKAGES = "/usr/lib/python3/dist-packages"
EDGES = 4
SAMPLES = 500
PERIOD_NS = 20_000_000
START_NS = 1_700_000_000_000_000_000
STAMPS = 1_000
ROUNDS = 21
NS_PER_S = 1_000_000_000

Round = Callable[[], None]
Sample = tuple[str, str, int, tuple[float, float, float], tuple[float, float, float, float]]


def samples() -> list[Sample]:
    """Return 10 s at 50 Hz of four edges, each turning in its own way."""
    made = []
    for n in range(SAMPLES):
        for edge in range(EDGES):
            stamp_ns = START_NS + n * PERIOD_NS + edge * 3_000_000
            half = 0.01 * n * (edge + 1) / 2
            turn = (0.0, 0.0, math.sin(half), math.cos(half))
            made.append((f"f{edge}", f"f{edge + 1}", stamp_ns, (0.02 * n, 0.1, 0.0), turn))
    return made


def tf2_rounds(stamps_ns: list[int]) -> dict[str, Round]:
    """Return what tf2 is measured by; empty where it cannot be loaded."""
    sys.path.append(SYSTEM_PACKAGES)
    try:
        import geometry_msgs.msg  # type: ignore[import-not-found,unused-ignore]
        import rospy  # type: ignore[import-not-found,unused-ignore]
        import tf2_py
    except ImportError as error:
        print(f"tf2 is missing, no ratios ({error}): apt-get install python3-tf2, and run this")
        print(f"with Debian's version of Python (this is {sys.version.split()[0]})")
        return {}
    finally:
        sys.path.remove(SYSTEM_PACKAGES)
    buffer = tf2_py.BufferCore(rospy.Duration(1_000_000))
    messages = []
    for parent, child, stamp_ns, (x, y, z), (i, j, k, w) in samples():
        message = geometry_msgs.msg.TransformStamped()
        message.header.frame_id, message.child_frame_id = parent, child
        message.header.stamp = rospy.Time(*divmod(stamp_ns, NS_PER_S))
        place, turn = message.transform.translation, message.transform.rotation
        (place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w) = (x, y, z), (i, j, k, w)
        messages.append(message)
    for message in messages:
        buffer.set_transform(message, "benchmark")
    times = [rospy.Time(*divmod(stamp_ns, NS_PER_S)) for stamp_ns in stamps_ns]

    def bare() -> None:
        for stamp in times:
            buffer.lookup_transform_core("f0", "f4", stamp)

    def to_arrays() -> None:
        for stamp_ns in stamps_ns:
            stamp = rospy.Time(*divmod(stamp_ns, NS_PER_S))
            found: Any = buffer.lookup_transform_core("f0", "f4", stamp).transform
            place, turn = found.translation, found.rotation
            np.array((place.x, place.y, place.z))
            np.array((turn.x, turn.y, turn.z, turn.w))

    def feed() -> None:
        fresh = tf2_py.BufferCore(rospy.Duration(1_000_000))
        for message in messages[:STAMPS]:
            fresh.set_transform(message, "benchmark")

    return {"tf2, message": bare, "tf2, to arrays": to_arrays, "tf2, set": feed}


def our_rounds(stamps_ns: list[int]) -> dict[str, Round]:
    """Return what the frame tree is measured by."""
    tree, given, out = FrameTree(), samples(), np.empty(7)
    for parent, child, stamp_ns, place, turn in given:
        tree.set_transform(parent, child, stamp_ns, place, turn)

    def lookup() -> None:
        for stamp_ns in stamps_ns:
            tree.lookup("f0", "f4", stamp_ns)

    def lookup_into() -> None:
        for stamp_ns in stamps_ns:
            tree.lookup_into("f0", "f4", stamp_ns, out)

    def feed() -> None:
        fresh = FrameTree()
        for parent, child, stamp_ns, place, turn in given[:STAMPS]:
            fresh.set_transform(parent, child, stamp_ns, place, turn)

    return {
        "lookup": lookup,
        "lookup_into": lookup_into,
        "set_transform": feed,
    }


def medians_us(rounds: dict[str, Round]) -> dict[str, float]:
    """Return the median time per stamp [us] of each, measured in turns."""
    taken: dict[str, list[float]] = {name: [] for name in rounds}
    for _ in range(ROUNDS):
        for name, run in rounds.items():
            begin = time.perf_counter()
            run()
            taken[name].append((time.perf_counter() - begin) / STAMPS * 1e6)
    return {name: statistics.median(times) for name, times in taken.items()}


def main() -> None:
    """Print times per stamp, and how many times quicker than each of tf2's forms."""
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
    dice = np.random.default_rng(1)
    span = (SAMPLES - 2) * PERIOD_NS
    stamps_ns = (START_NS + EDGES * 3_000_000 + dice.integers(0, span, STAMPS)).tolist()
    ours, theirs = our_rounds(stamps_ns), tf2_rounds(stamps_ns)
    for run in ours.values():
        run()  # compile, or load what was compiled
    median = medians_us({**ours, **theirs})
    print(f"{'per stamp':18s} {'us':>7s}" + "".join(f"{name:>18s}" for name in theirs))
    for name in ours:
        ratios = "".join(
            f"{median[peer] / median[name]:17.1f}x"
            if ("set" in peer) == ("set" in name)
            else f"{'-':>18s}"
            for peer in theirs
        )
        print(f"{name:18s} {median[name]:7.3f}{ratios}")
    for name in theirs:
        print(f"{name:18s} {median[name]:7.3f}")


if __name__ == "__main__":
    main()
