"""A recording as rosbag2 keeps it."""

from pathlib import Path

import yaml
from rosbags.rosbag2 import Reader as Ros2Reader

from are_ros.bag.reader import BagReader, BagTopic
from are_ros.bag.writer import BagWriter, OfferedQos, describe_folder

STRING = "std_msgs/msg/String"
DATA = b"\x00\x01\x00\x00\x02\x00\x00\x00x\x00"


def write_folder(folder: Path) -> None:
    """Write a recording of two topics, one of them without a message."""
    folder.mkdir()
    offered = (OfferedQos(history="unknown", depth=0), OfferedQos(reliability="best_effort"))
    with BagWriter(folder / "run_0.mcap") as writer:
        writer.add_topic("/a", STRING, offered=offered)
        writer.add_topic("/b", STRING, is_latched=True)
        for time_ns in (100, 250):
            writer.write_raw("/a", time_ns, DATA, time_ns - 10)
    describe_folder(folder / "run_0.mcap")


def test_the_folder_is_read_as_one_recording(tmp_path: Path) -> None:
    """By rosbags, and by our reader on top of it."""
    write_folder(tmp_path / "run")
    with BagReader([tmp_path / "run"]) as reader:
        assert [(topic.name, topic.count, topic.is_latched) for topic in reader.topics] == [
            ("/a", 2, False),
            ("/b", 0, True),
        ]
        assert (reader.start_ns, reader.end_ns) == (100, 251)
        assert isinstance(reader.topics[0], BagTopic)
    with Ros2Reader(tmp_path / "run") as ros2:
        profiles = next(c for c in ros2.connections if c.topic == "/a").ext.offered_qos_profiles
    assert [profile.reliability.name for profile in profiles] == ["RELIABLE", "BEST_EFFORT"]
    assert [profile.history.name for profile in profiles] == ["UNKNOWN", "KEEP_LAST"]


def test_the_summary_is_as_jazzy_writes_it(tmp_path: Path) -> None:
    """Version, counts and extent, without YAML's anchors."""
    write_folder(tmp_path / "run")
    text = (tmp_path / "run/metadata.yaml").read_text()
    information = yaml.safe_load(text)["rosbag2_bagfile_information"]
    assert (information["version"], information["storage_identifier"]) == (9, "mcap")
    assert information["starting_time"] == {"nanoseconds_since_epoch": 100}
    assert information["duration"] == {"nanoseconds": 150}
    assert information["files"][0]["path"] == "run_0.mcap"
    assert "&" not in text
