"""A player in lockstep with a recorder: nothing is missing, however slow the recorder is."""

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from rosbags.typesys import Stores, get_typestore

from are_ros.node.startup import has_room
from tests.record.player_runs import Record, played, write_strings
from tests.record.recorder_runs import recorded_data, recording
from tests.ros import WAIT_S, RosWorld, nap, running_s

RECORDER = "/are_recorder"
STALL_S = 0.4
STALLS = 4
BURSTS = 8


@pytest.fixture
def records() -> list[Record]:
    """Return some seconds: small messages at 100 Hz and a larger one at 10 Hz."""
    small = [("/small", at / 100, f"small {at}") for at in range(400)]
    large = [("/large", 0.003 + at / 10, f"large {at}" + "." * 30_000) for at in range(40)]
    return sorted([*small, *large], key=lambda record: record[1])


@contextmanager
def recorder_process(path: Path, *words: str) -> Iterator["subprocess.Popen[bytes]"]:
    """Record in a process of its own while the block runs."""
    command = [sys.executable, "-m", "are_ros", "record", str(path), *(words or ["--use-sim-time"])]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(WAIT_S)


def stall(process: "subprocess.Popen[bytes]", path: Path) -> None:
    """Let a process that has begun to record do nothing, again and again."""
    wait_for(lambda: any(path.parent.glob("out.mcap*")))
    for _ in range(STALLS):
        process.send_signal(signal.SIGSTOP)
        time.sleep(STALL_S)
        process.send_signal(signal.SIGCONT)
        time.sleep(STALL_S / 2.0)


def wait_for(is_so: Callable[[], bool]) -> None:
    """Wait until something is so, for as long as it may take."""
    end_s = running_s() + WAIT_S
    while not is_so() and running_s() < end_s:
        nap()
    assert is_so()


def test_a_recorder_that_stalls_misses_nothing(
    ros_available: None, tmp_path: Path, records: list[Record]
) -> None:
    """Every message of the recording is in the recording of it."""
    del ros_available
    bag = write_strings(tmp_path / "bag.mcap", records)
    path = tmp_path / "out.mcap"
    with recorder_process(path) as process:
        stalls = threading.Thread(target=stall, args=(process, path))
        stalls.start()
        try:
            run = played(bag, lockstep=(RECORDER,), wait_for=(RECORDER,))
        finally:
            stalls.join()
    assert run.outcome.is_complete
    for topic in ("/small", "/large"):
        expected = [text for name, _, text in records if name == topic]
        assert texts_of(path, topic) == expected


@pytest.mark.skipif(not has_room(), reason="shared memory is short on this machine")
def test_what_is_sent_at_once_waits_for_a_recorder_that_stalls(
    ros: RosWorld, tmp_path: Path
) -> None:
    """Three megabytes, which no publisher keeps: the half of one that is usual never holds them.

    One of some bursts has to arrive as a whole. Others may not: a process that is stopped while it
    holds the lock of its queue is sent nothing.
    """
    from rclpy.duration import Duration
    from rclpy.qos import QoSProfile
    from std_msgs.msg import String

    path = tmp_path / "out.mcap"
    publisher = ros.make_node("talker").create_publisher(String, "/large", QoSProfile(depth=1))
    bursts = [[f"{burst} {at}" + "." * 100_000 for at in range(30)] for burst in range(BURSTS)]
    with recorder_process(path, "--topics", "/large") as process:
        wait_for(lambda: publisher.get_subscription_count() > 0)
        for burst in bursts:
            publisher.publish(String(data="who acknowledges this has taken what was before"))
            assert publisher.wait_for_all_acked(Duration(seconds=WAIT_S))
            process.send_signal(signal.SIGSTOP)
            for text in burst:
                publisher.publish(String(data=text))
            process.send_signal(signal.SIGCONT)
        assert publisher.wait_for_all_acked(Duration(seconds=WAIT_S))
    arrived = set(texts_of(path, "/large"))
    assert any(arrived.issuperset(burst) for burst in bursts)


def texts_of(path: Path, topic: str) -> list[str]:
    """Return the recorded strings of a topic."""
    store = get_typestore(Stores.ROS2_JAZZY)
    return [
        store.deserialize_cdr(data, "std_msgs/msg/String").data
        for data in recorded_data(path, topic)
    ]


def test_a_recorder_tells_its_parameters(ros: RosWorld, tmp_path: Path) -> None:
    """Its services answer while it records, as those of every node."""
    from rcl_interfaces.srv import GetParameters

    node = ros.make_node("asker")
    client: Any = node.create_client(GetParameters, f"{RECORDER}/get_parameters")
    with recording(tmp_path / "out.mcap"):
        assert client.wait_for_service(WAIT_S)
        request = GetParameters.Request(names=["use_sim_time"])
        future = client.call_async(request)
        with ros.spinning():
            end_s = running_s() + WAIT_S
            while not future.done() and running_s() < end_s:
                nap()
    assert [value.bool_value for value in future.result().values] == [False]
