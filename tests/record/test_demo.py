"""`are demo`: the node, a recorder and a player, as processes over real DDS."""

import re
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_typestore

from are_ros.bag.reader import BagReader
from are_ros.bag.recording import find_recording
from are_ros.bag.writer import BagWriter
from are_ros.conventions import NS_PER_S
from are_ros.errors import BagError
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import read_ros_parameters
from are_ros.record.demo_summary import summary_of
from are_ros.replay.command import effective_parameters
from tests.record.live_runs import (
    MANY,
    SAMPLE,
    outputs_of,
    run_are,
    run_demo,
    said_by,
    topics_of,
)
from tests.record.player_runs import write_strings

DELETE_ALL = 3
RENAMED = {
    "/map": "/world/map",
    "/octomap_point_cloud_centers": "/world/octomap",
    "/odom": "/wheels/odom",
    "/scan": "/front/scan",
    "/camera/camera_info": "/front/camera/camera_info",
}


def test_the_folder_is_complete(lockstep_run: Path) -> None:
    """The recording with all inputs and outputs, the parameters, the picture and the logs."""
    names = ("augmented.mcap", "effective.yaml", "view.html", "node.log", "recorder.log")
    assert all((lockstep_run / name).stat().st_size > 100 for name in names)
    assert not list(lockstep_run.glob("*.part"))
    assert "active: artefacts arrive" in (lockstep_run / "node.log").read_text()
    values = with_values(Parameters(), read_ros_parameters(lockstep_run / "effective.yaml"))
    assignments = [word for word in MANY if ":=" in word]
    expected = effective_parameters([SAMPLE.with_suffix(".yaml")], assignments, 10)
    images = "/camera/image_raw/compressed"
    depths = "/camera/depth_raw/compressedDepth"
    named = {"sensors.images": (images,), "sensors.depths": (depths,)}
    assert values == with_values(expected, named)


def test_the_recording_itself_tells_the_parameters(lockstep_run: Path, tmp_path: Path) -> None:
    """Where no file lies beside it."""
    copy = tmp_path / "run.mcap"
    copy.write_bytes((lockstep_run / "augmented.mcap").read_bytes())
    told = find_recording(copy).told
    assert told is not None
    assert told == find_recording(lockstep_run).told


@pytest.mark.parametrize("run", ["lockstep_run", "free_run"])
def test_all_inputs_are_in_the_recording(run: str, request: pytest.FixtureRequest) -> None:
    """As many as were played, at a rate too: the recorder misses none."""
    counts = topics_of(request.getfixturevalue(run))
    with BagReader([SAMPLE]) as reader:
        stop_ns = reader.start_ns + 15 * NS_PER_S
        played = [message.topic for message in reader.messages(stop_ns=stop_ns)]
    assert {name: counts.get(name) for name in set(played)} == {
        name: played.count(name) for name in set(played)
    }


@pytest.mark.parametrize("run", ["lockstep_run", "free_run"])
def test_the_node_says_farewell(run: str, request: pytest.FixtureRequest) -> None:
    """In the end every marker is deleted, nobody is there, and the map is the real one."""
    folder = request.getfixturevalue(run)
    outputs = outputs_of(folder)
    assert [one.action for one in outputs["markers"][-1].message.markers] == [DELETE_ALL]
    assert outputs["artefacts"][-1].message.artefacts == []
    augmented = [one.message for one in outputs["augmented_map"]]
    with BagReader([SAMPLE]) as reader:
        (real,) = [reader.deserialize(message) for message in reader.messages(["/map"])]
    assert (augmented[-1].data == real.data).all()
    assert any((one.data != real.data).any() for one in augmented)


def test_what_the_node_warned_of_is_repeated_once(tmp_path: Path) -> None:
    """Of its log, the sentences of warnings and errors."""
    from are_ros.node.diagnostics import WITHOUT_CLOCK
    from are_ros.record.demo import _warnings

    log = tmp_path / "node.log"
    words = (
        ("INFO", "active"),
        ("WARN", "tf is late"),
        ("ERROR", "no map"),
        ("WARN", "tf is late"),
        ("WARN", WITHOUT_CLOCK),
    )
    lines = [f"[{level}] [17.{k:09}] [ar_builder]: {said}" for k, (level, said) in enumerate(words)]
    log.write_text("\n".join(lines), encoding="utf-8")
    assert _warnings(log) == ["tf is late", "no map"]


def test_it_says_what_happened(lockstep_run: Path) -> None:
    """What was played, the recording's summary, where things are; of the log, warnings only."""
    said = said_by(lockstep_run).splitlines()
    assert not [line for line in said if "is overruled by tf" in line or "INFO" in line]
    assert "starting the node (kernels that are not there yet compile for a minute or two)" in said
    assert "played       1363 messages on 9 topics" in said
    summary = summary_of(lockstep_run / "augmented.mcap")
    first = said.index(summary[0])
    assert said[first : first + len(summary)] == summary
    assert re.fullmatch(r"ticks +152", summary[4])
    assert f"picture      {lockstep_run / 'overview.png'}" in said
    assert any(line.startswith(f"view: {lockstep_run / 'view.html'} (") for line in said)


def test_other_topic_names_are_found_by_their_roles(ros_available: None, tmp_path: Path) -> None:
    """The node is told the recording's names; all of its inputs reach it.

    What a node sent while the recording was made is not played beside what this one sends.
    """
    del ros_available
    bag = write_renamed(tmp_path / "renamed.mcap", 3.0)
    run_demo(tmp_path / "out", "--lockstep", bag=bag)
    outputs = outputs_of(tmp_path / "out")
    counts = topics_of(tmp_path / "out")
    assert len(outputs["scan"]) == counts["/front/scan"] == 30
    assert any(sent.message.artefacts for sent in outputs["artefacts"])
    assert not set(RENAMED) & set(counts)
    assert "waiting" not in (tmp_path / "out/node.log").read_text()


def write_renamed(path: Path, duration_s: float) -> Path:
    """Write the beginning of the sample with other topic names, and outputs of a node in it."""
    with BagReader([SAMPLE]) as reader, BagWriter(path, get_typestore(Stores.ROS2_JAZZY)) as writer:
        for topic in reader.topics:
            writer.add_topic(
                RENAMED.get(topic.name, topic.name),
                topic.type_name,
                is_latched=topic.is_latched,
                is_reliable=topic.is_reliable,
            )
        writer.add_topic("/ar_builder/scan", "sensor_msgs/msg/LaserScan")
        stop_ns = reader.start_ns + round(duration_s * NS_PER_S)
        for message in reader.messages(stop_ns=stop_ns):
            if message.topic == "/scan":
                writer.write_raw("/ar_builder/scan", message.log_time_ns, bytes(message.data))
            topic_name = RENAMED.get(message.topic, message.topic)
            writer.write_raw(topic_name, message.log_time_ns, bytes(message.data))
    return path


def test_a_node_that_ends_early_is_one_sentence(ros_available: None, tmp_path: Path) -> None:
    """It repeats the node's last line; nothing goes on running or waiting.

    Results of an earlier replay are gone: beside its metrics a recording counts as a replay's.
    """
    del ros_available
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "metrics.json").write_text("{}")
    words = ("--set", f"catalogue:={tmp_path / 'none.yaml'}", "--out", tmp_path / "out")
    done = run_are("demo", SAMPLE, *words)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    (sentence,) = [line for line in done.stderr.splitlines() if line.startswith("are: ")]
    assert sentence.startswith("are: the node ended early: ")
    assert "none.yaml" in sentence
    assert not (tmp_path / "out" / "metrics.json").exists()


def test_what_cannot_be_shown_is_one_sentence(ros_available: None, tmp_path: Path) -> None:
    """A recording without a map, and a folder that cannot be made: nothing is started."""
    del ros_available
    from are_ros.record.demo import DemoOptions
    from are_ros.record.demo import run_demo as run_here

    said: list[str] = []
    mapless = write_strings(tmp_path / "mapless.mcap", [("/a", 0.0, "x")])
    (tmp_path / "file").write_text("x")
    sentences = {
        r"mapless\.mcap: the recording has no map": DemoOptions(mapless, Parameters(), tmp_path),
        "--out .*file: it cannot be written": DemoOptions(SAMPLE, Parameters(), tmp_path / "file"),
        "nix.mcap": DemoOptions(tmp_path / "nix.mcap", Parameters(), tmp_path),
    }
    for sentence, options in sentences.items():
        with pytest.raises(BagError, match=sentence):
            run_here(options, said.append, lambda *_: lambda _: None, lambda: False)
    assert said == []


def test_a_folder_in_which_a_run_is_at_work_is_refused(ros_available: None, tmp_path: Path) -> None:
    """Its results stay as they are; nothing is started."""
    del ros_available
    from are_ros.record.commands import demo_command
    from are_ros.replay.output_folder import alone_in

    with alone_in(tmp_path), pytest.raises(BagError, match="another run writes its results there"):
        demo_command(print, SAMPLE, tmp_path, (), (), None)
    assert not list(tmp_path.iterdir())
