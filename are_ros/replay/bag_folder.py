"""A recording as rosbag2 keeps it: a folder with the MCAP file and metadata.yaml, its summary."""

from pathlib import Path
from typing import Any

import yaml
from mcap.reader import make_reader
from mcap.records import Channel, Schema, Statistics

from are_ros.errors import BagError

_VERSION = 9
"""Of metadata.yaml, as ROS 2 Jazzy writes it."""


def describe_folder(file: Path) -> None:
    """Write metadata.yaml beside a finished MCAP file; BagError if it cannot be written."""
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    if summary is None or summary.statistics is None:
        raise BagError(f"{file}: the recording has no summary")
    description = _description(
        file.name, summary.statistics, list(summary.channels.values()), summary.schemas
    )
    text = yaml.safe_dump({"rosbag2_bagfile_information": description}, sort_keys=False)
    target = file.with_name("metadata.yaml")
    try:
        target.write_text(text, "utf-8")
    except OSError as cause:
        message = f"{target} cannot be written: {cause.strerror}"
        raise BagError(message) from cause


def _description(
    name: str, statistics: Statistics, channels: list[Channel], schemas: dict[int, Schema]
) -> dict[str, Any]:
    counts = statistics.channel_message_counts
    return {
        "version": _VERSION,
        "storage_identifier": "mcap",
        **_extent(statistics),
        "topics_with_message_count": [
            {
                "topic_metadata": _topic(channel, schemas[channel.schema_id].name),
                "message_count": counts.get(channel.id, 0),
            }
            for channel in channels
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [name],
        "files": [{"path": name, **_extent(statistics)}],
        "custom_data": None,
        "ros_distro": "jazzy",
    }


def _extent(statistics: Statistics) -> dict[str, Any]:
    start_ns, end_ns = statistics.message_start_time, statistics.message_end_time
    return {
        "starting_time": {"nanoseconds_since_epoch": start_ns},
        "duration": {"nanoseconds": end_ns - start_ns},
        "message_count": statistics.message_count,
    }


def _topic(channel: Channel, type_name: str) -> dict[str, Any]:
    return {
        "name": channel.topic,
        "type": type_name,
        "serialization_format": channel.message_encoding,
        "offered_qos_profiles": yaml.safe_load(channel.metadata["offered_qos_profiles"]),
        "type_description_hash": channel.metadata["topic_type_hash"],
    }
