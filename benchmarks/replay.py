"""Replay without occlusion and grids, against rosbags reading and deserialising the same messages.

Both go over the same connections of the same recording in one process, in turn; start-up and
picture are excluded, and what is written is written. Prints medians and the ratio.

    python benchmarks/replay.py [ROUNDS] [BAG --map FILE.yaml ...]

The recording is the sample by default; any options of `are replay` may follow it.
"""

import argparse
import statistics
import tempfile
import time
from pathlib import Path

import click
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from are_ros.cli.offline import replay as replay_options
from are_ros.replay.command import options_of
from are_ros.replay.session import run_replay
from are_ros.replay.timeline import ReplayOptions

SAMPLE = Path(__file__).resolve().parents[1] / "bags" / "sample_office.mcap"


def main() -> None:
    """Run the rounds and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rounds", nargs="?", type=int, default=5)
    parser.add_argument("recording", nargs=argparse.REMAINDER, help="BAG and options of are replay")
    given = parser.parse_args()
    rounds, arguments = given.rounds, given.recording or [str(SAMPLE)]
    with tempfile.TemporaryDirectory() as folder:
        options = parsed([*arguments, "--out", folder, "--skip", "perception", "--skip", "grids"])
        topics = replayed(options)[1]  # also compiles the kernels
        pairs = [(replayed(options)[0], read(options, topics)) for _ in range(rounds)]
    ours_s = statistics.median(ours for ours, _ in pairs)
    theirs_s = statistics.median(theirs for _, theirs in pairs)
    ratio = statistics.median(ours / theirs for ours, theirs in pairs)
    print(f"replay, no occlusion, no grids   {ours_s:.3f} s")
    print(f"rosbags, read and deserialised   {theirs_s:.3f} s")
    print(f"ratio (median of {rounds})            {ratio:.2f}")


def parsed(arguments: list[str]) -> ReplayOptions:
    """Return the options of a command line of `are replay`."""
    context = click.Context(replay_options)
    replay_options.parse_args(context, arguments)
    return options_of(**context.params)


def replayed(options: ReplayOptions) -> tuple[float, list[str]]:
    """Return how long the replay proper took [s], and the topics that it read."""
    outcome = run_replay(options, lambda _: None, lambda _start, _end: lambda _now: None)
    return outcome.stopwatch.phases_s["replay"], list(outcome.role_of_topic)


def read(options: ReplayOptions, topics: list[str]) -> float:
    """Return how long rosbags takes to read and deserialise the same topics [s]."""
    types = get_typestore(Stores.ROS2_JAZZY)
    with AnyReader(list(options.bags), default_typestore=types) as reader:
        wanted = [each for each in reader.connections if each.topic in topics]
        began_s = time.perf_counter()
        for connection, _, data in reader.messages(connections=wanted):
            reader.deserialize(data, connection.msgtype)
        return time.perf_counter() - began_s


if __name__ == "__main__":
    main()
