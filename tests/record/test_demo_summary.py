"""The few lines about a recording of the live node."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from are_ros.agents.events import EventKind
from are_ros.errors import BagError
from are_ros.record.demo_summary import summary_of
from bags.simulation.making import RosbagsFactory
from tests.record.player_runs import write_messages

FACTORY = RosbagsFactory()


def artefacts(*identifiers: int) -> Any:
    """Return a tick's artefacts."""
    ones = [
        FACTORY.make("are_msgs/msg/Artefact", id=number, class_name="person")
        for number in identifiers
    ]
    return FACTORY.make("are_msgs/msg/ArtefactArray", artefacts=ones)


def perceived(*identifiers: int) -> Any:
    """Return a tick's perceived artefacts."""
    ones = [FACTORY.make("are_msgs/msg/PerceivedArtefact", id=number) for number in identifiers]
    return FACTORY.make("are_msgs/msg/PerceivedArtefactArray", artefacts=ones)


def event(kind: EventKind) -> Any:
    """Return an event."""
    return FACTORY.make("are_msgs/msg/ArtefactEvent", kind=int(kind))


def test_it_counts(tmp_path: Path) -> None:
    """Who came and went, who was perceived, contacts, ticks and messages; no false alarms."""
    records = [
        ("/ar_builder/artefacts", 0.0, artefacts()),
        ("/ar_builder/artefacts", 0.1, artefacts(1, 2, 3)),
        ("/ar_builder/artefacts", 0.2, artefacts(2, 3)),
        ("/ar_builder/perceived", 0.1, perceived(3)),
        ("/ar_builder/perceived", 0.2, perceived(3, 10**12)),
        *[("/ar_builder/events", 0.1, event(EventKind.ARRIVED))] * 3,
        ("/ar_builder/events", 0.2, event(EventKind.DEPARTED)),
        ("/ar_builder/events", 0.2, event(EventKind.ROBOT_CONTACT)),
        ("/ar_builder/markers", 0.2, FACTORY.make("visualization_msgs/msg/MarkerArray")),
        ("/markers", 0.2, FACTORY.make("visualization_msgs/msg/MarkerArray")),
    ]
    assert summary_of(write_messages(tmp_path / "live.mcap", records)) == [
        "artefacts    3 arrived, 1 departed; alive 1.7 on average, 3 at most",
        "perceived    1 of 3 at some time",
        "robot        1 contact with artefacts",
        "in the maps  0.0 on average, 0.0 of them out of sight (costmap.memory, costmap.gate)",
        "ticks        3",
        "published    0 augmented maps, 0 augmented scans, 1 marker message",
    ]


def test_it_tells_what_the_memory_keeps(tmp_path: Path) -> None:
    """Who stands in the artefact map, and who of them is not perceived."""
    tick = artefacts(1, 2, 3)
    for one, x_m in zip(tick.artefacts, (0.5, 1.5, 2.5), strict=True):
        one.ground_pose.position.x = x_m
        one.ground_pose.position.y = 0.5
    cells = np.array([100, 100, 0], np.int8)
    turn = FACTORY.make("geometry_msgs/msg/Quaternion", w=1.0)
    origin = FACTORY.make("geometry_msgs/msg/Pose", orientation=turn)
    info = FACTORY.make(
        "nav_msgs/msg/MapMetaData", resolution=1.0, width=3, height=1, origin=origin
    )
    header = FACTORY.make("std_msgs/msg/Header", frame_id="map")
    grid = FACTORY.make("nav_msgs/msg/OccupancyGrid", header=header, info=info, data=cells)
    records = [
        ("/ar_builder/artefact_map", 0.0, grid),
        ("/ar_builder/artefacts", 0.1, tick),
        ("/ar_builder/perceived", 0.1, perceived(1)),
    ]
    lines = summary_of(write_messages(tmp_path / "live.mcap", records))
    assert lines[3].startswith("in the maps  2.0 on average, 1.0 of them out of sight")


@pytest.mark.parametrize(
    ("tenths", "said"),
    [(range(5), "5"), ((0, 3, 4), "3"), ((0, 1, 5, 6), "4 of 7"), ((0, 9, 20), "3 of 21")],
)
def test_it_tells_how_many_ticks_were_left_out(
    tmp_path: Path, tenths: Sequence[int], said: str
) -> None:
    """By the stamps, at the rate of the parameters; here the default one."""
    records = []
    for tenth in tenths:
        tick = artefacts(1)
        tick.header.stamp.sec, tick.header.stamp.nanosec = tenth // 10, tenth % 10 * 10**8
        records.append(("/ar_builder/artefacts", tenth / 10, tick))
    line = summary_of(write_messages(tmp_path / "live.mcap", records))[4]
    assert line.split(": the node did not keep up")[0] == f"ticks        {said}"


def test_without_outputs_there_is_nothing_to_count(tmp_path: Path) -> None:
    """A recording without the node's topics gives zeros."""
    grid = FACTORY.make("nav_msgs/msg/OccupancyGrid")
    lines = summary_of(write_messages(tmp_path / "inputs.mcap", [("/map", 0.0, grid)]))
    assert lines[0] == "artefacts    0 arrived, 0 departed; alive 0.0 on average, 0 at most"
    assert [lines[2], lines[4]] == ["robot        0 contacts with artefacts", "ticks        0"]


def test_what_is_no_recording_is_an_error(tmp_path: Path) -> None:
    """In a sentence."""
    (tmp_path / "x.mcap").write_text("no recording")
    with pytest.raises(BagError, match=r"x\.mcap"):
        summary_of(tmp_path / "x.mcap")
