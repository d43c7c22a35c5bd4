"""Whole replays of the sample recording, through the command line."""

import copy
import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import numpy as np
import pytest

from are_ros.agents.events import EventKind
from are_ros.bag.reader import BagReader
from are_ros.conventions import NS_PER_S, OCCUPIED

Records = Sequence[tuple[str, int, Any]]
WriteBag = Callable[[Path, Records], Path]
RunAre = Callable[..., CompletedProcess[str]]
ReplaySample = Callable[..., Path]

REPRODUCIBLE = ("augmented.mcap", "metrics.json", "effective.yaml", "overview.png")
OUT = "/ar_builder/"
MANY = ("--set", "population.arrival_rate:=0.02", "--set", "population.mean_life:=2")
LIFE_EVENTS = (EventKind.ARRIVED, EventKind.DEPARTED, EventKind.DISPLACED, EventKind.BLOCKED)


def outputs(folder: Path) -> list[tuple[str, int, bytes]]:
    """Return the messages of the builder's own topics: topic, log time, bytes."""
    with BagReader([folder / "augmented.mcap"]) as reader:
        topics = [topic.name for topic in reader.topics if topic.name.startswith(OUT)]
        return [(m.topic, m.log_time_ns, bytes(m.data)) for m in reader.messages(topics)]


def read(folder: Path, name: str) -> list[Any]:
    """Return the messages of one output."""
    with BagReader([folder / "augmented.mcap"]) as reader:
        return [reader.deserialize(message) for message in reader.messages([OUT + name])]


def metrics(folder: Path) -> Any:
    """Return the content of metrics.json."""
    return json.loads((folder / "metrics.json").read_text())


def stamp_ns(stamp: Any) -> int:
    """Return a stamp as nanoseconds."""
    return int(stamp.sec) * NS_PER_S + int(stamp.nanosec)


def life_events(folder: Path) -> list[tuple[int, int, int, str]]:
    """Return (time, kind, id, label) of what happened to the artefacts, perception left out."""
    kinds = [kind.value for kind in LIFE_EVENTS]
    return [
        (stamp_ns(event.header.stamp), event.kind, event.id, event.label)
        for event in read(folder, "events")
        if event.kind in kinds
    ]


def places(folder: Path) -> dict[int, dict[int, tuple[Any, ...]]]:
    """Return by tick and id the row, the arrival and the pose of every living artefact."""
    return {
        stamp_ns(array.header.stamp): {
            a.id: (a.row, stamp_ns(a.arrival), a.ground_pose.position.x, a.ground_pose.position.y,
                   a.ground_pose.orientation.z)
            for a in array.artefacts
        }
        for array in read(folder, "artefacts")
    }  # fmt: skip


# ------------------------------------------------------------------------------ one replay


def test_a_replay_leaves_its_files(sample_replay: Path) -> None:
    """The folder holds the six results and nothing else; something happened in them."""
    names = {*REPRODUCIBLE, "view.html", "timing.json"}
    assert {file.name for file in sample_replay.iterdir()} == names
    assert (sample_replay / "overview.png").read_bytes().startswith(b"\x89PNG")
    found = metrics(sample_replay)
    assert found["arrivals"] >= 3
    assert found["departures"] >= 1
    assert found["perceived_ever"] >= 1
    assert found["refused"] == {}
    timing = json.loads((sample_replay / "timing.json").read_text())
    assert set(timing["phases_s"]) == {"start_up", "replay", "picture", "view"}


def test_what_is_written_passes_all_checks(sample_replay: Path, run_are: RunAre) -> None:
    """`are check` finds nothing wrong, and with the inputs there is nothing it cannot check."""
    done = run_are("check", sample_replay)
    assert done.returncode == 0
    assert [line for line in done.stdout.splitlines() if ": passed" not in line] == []


def test_every_message_is_read_back(sample_replay: Path) -> None:
    """The recording opens in rosbags, every message deserialises, and metrics.json counts them."""
    with BagReader([sample_replay / "augmented.mcap"]) as reader:
        for message in reader.messages():
            reader.deserialize(message)
        counts = {topic.name: topic.count for topic in reader.topics}
    assert counts == metrics(sample_replay)["written"]
    assert counts[OUT + "artefacts"] == counts[OUT + "metrics"] == metrics(sample_replay)["ticks"]


def test_the_summary_is_said(sample_bag: Path, tmp_path: Path, run_are: RunAre) -> None:
    """A replay ends with a summary in lines of their own, below the bar."""
    done = run_are("replay", sample_bag, "--duration", 2, "--out", tmp_path / "new" / "out")
    assert (done.returncode, done.stdout) == (0, "")
    lines = done.stderr.splitlines()
    assert lines[-2] == f"results in {tmp_path / 'new' / 'out'}"
    assert lines[-1].startswith(f"view: {tmp_path / 'new' / 'out' / 'view.html'} (")
    assert sum(line.startswith("time ") for line in lines) == 1
    assert any(line.startswith("the transform odom -> base_footprint") for line in lines)


# ------------------------------------------------------------------------------ the same again


def test_one_seed_gives_the_same_bytes(sample_replay: Path, replay_sample: ReplaySample) -> None:
    """A second run gives identical bytes in every reproducible file; another seed does not."""
    again = replay_sample("--with-inputs")
    other = replay_sample("--with-inputs", "--seed", 4)
    for name in REPRODUCIBLE:
        assert (again / name).read_bytes() == (sample_replay / name).read_bytes(), name
        assert (other / name).read_bytes() != (sample_replay / name).read_bytes(), name


@pytest.mark.long
def test_one_seed_gives_the_same_bytes_on_each_processor(sample_bag: Path, tmp_path: Path) -> None:
    """With another kind's products of matrices (OPENBLAS_CORETYPE), and on one core."""
    certainty = sample_bag.parents[1] / "config" / "presets" / "certainty_poor.yaml"
    command = [sys.executable, "-m", "are_ros", "replay", str(sample_bag), *MANY]
    command += ["--params", str(certainty), "--start", "20", "--duration", "8", "--out"]
    one_core = ["taskset", "--cpu-list", str(min(os.sched_getaffinity(0)))]
    other_products = {**os.environ, "OPENBLAS_CORETYPE": "Prescott"}
    here, there = tmp_path / "here", tmp_path / "there"
    subprocess.run([*command, here], check=True)
    subprocess.run([*one_core, *command, there], env=other_products, check=True)
    for name in REPRODUCIBLE:
        assert (there / name).read_bytes() == (here / name).read_bytes(), name


def test_no_file_names_the_machine(sample_replay: Path, sample_bag: Path) -> None:
    """No path of the machine stands in a reproducible file."""
    for name in ("metrics.json", "effective.yaml", "augmented.mcap"):
        content = (sample_replay / name).read_bytes()
        for path in (sample_bag.parent, sample_replay):
            assert str(path).encode() not in content


def test_effective_parameters_fed_back_give_the_same(
    sample_replay: Path, sample_bag: Path, tmp_path: Path, run_are: RunAre
) -> None:
    """effective.yaml alone stands for all files, assignments and options that made it."""
    window = ("--start", 20, "--duration", 8, "--with-inputs")
    effective = sample_replay / "effective.yaml"
    done = run_are("replay", sample_bag, *window, "--params", effective, "--out", tmp_path)
    assert done.returncode == 0
    for name in REPRODUCIBLE:
        assert (tmp_path / name).read_bytes() == (sample_replay / name).read_bytes(), name


@pytest.mark.parametrize("rate_hz", [5, 20])
def test_tick_rates_give_the_same_lives(
    sample_replay: Path, replay_sample: ReplaySample, rate_hz: int
) -> None:
    """Ids, rows, arrivals, departures, displacements and places do not depend on the ticks."""
    other = replay_sample("--set", f"builder.tick_rate:={rate_hz}")
    until_ns = min(max(places(folder)) for folder in (sample_replay, other))
    assert [event for event in life_events(sample_replay) if event[0] <= until_ns] == [
        event for event in life_events(other) if event[0] <= until_ns
    ]
    ours, theirs = places(sample_replay), places(other)
    common = ours.keys() & theirs.keys()
    assert len(common) == 8 * min(rate_hz, 10)
    assert any(ours[now_ns] for now_ns in common)
    assert all(ours[now_ns] == theirs[now_ns] for now_ns in common)


def test_inputs_beside_the_outputs_change_none(
    sample_replay: Path, replay_sample: ReplaySample
) -> None:
    """Without --with-inputs the builder's topics hold the same, and the inputs are not there."""
    bare = replay_sample()
    assert outputs(bare) == outputs(sample_replay)
    assert all(topic.startswith(OUT) for topic in metrics(bare)["written"])


# ------------------------------------------------------------------------------ options


def test_what_was_recorded_before_the_start_counts(sample_replay: Path, sample_bag: Path) -> None:
    """The replay begins 20 s into the recording with the map and the frames from before."""
    found = metrics(sample_replay)
    with BagReader([sample_bag]) as reader:
        start_ns = reader.start_ns + 20 * NS_PER_S
        before = [m.topic for m in reader.messages(("/map", "/tf_static"), stop_ns=start_ns)]
    assert sorted(before) == ["/map", "/tf_static"]
    assert found["first_tick_ns"] == -(-start_ns // 10**8) * 10**8
    assert found["ticks_without_perception"] <= 1
    with BagReader([sample_replay / "augmented.mcap"]) as reader:
        times = {m.log_time_ns for m in reader.messages(("/map", "/tf_static"))}
    assert times == {start_ns}


def test_duration_ends_the_replay(
    sample_replay: Path, sample_bag: Path, tmp_path: Path, run_are: RunAre
) -> None:
    """Eight seconds have 80 ticks, none at the end; a duration beyond the end is cut there."""
    assert metrics(sample_replay)["ticks"] == 80
    words = ("--start", 58.5, "--duration", 1000, "--out", tmp_path)
    assert run_are("replay", sample_bag, *words).returncode == 0
    assert 14 <= metrics(tmp_path)["ticks"] <= 16


def test_skipped_parts_are_left_out(
    sample_replay: Path, replay_sample: ReplaySample, run_are: RunAre
) -> None:
    """Skipping leaves the ground truth as it is, and takes the topics of the part away.

    The checks do not miss them.
    """
    bare = replay_sample("--skip", "perception", "--skip", "grids", "--skip", "markers")
    with BagReader([bare / "augmented.mcap"]) as reader:
        topics = {topic.name for topic in reader.topics if topic.name.startswith(OUT)}
    assert topics >= {OUT + name for name in ("artefacts", "events", "metrics", "scan")}
    skipped = ("perceived", "markers", "augmented_map", "artefact_map_updates", "augmented_costmap")
    assert not topics & {OUT + name for name in skipped}
    done = run_are("check", bare)
    assert "FAILED" not in done.stdout
    assert "topics and types: passed" in done.stdout
    assert places(bare) == places(sample_replay)
    assert life_events(bare) == life_events(sample_replay)


# ------------------------------------------------------------------------------ other recordings


@pytest.fixture(scope="module")
def replay_five(
    run_are: RunAre, tmp_path_factory: pytest.TempPathFactory
) -> Callable[..., tuple[Path, str]]:
    """Return a replayer of recordings of the sample's first seconds: the folder, what was said."""

    def replay(*words: object) -> tuple[Path, str]:
        out = tmp_path_factory.mktemp("five")
        done = run_are("replay", *words, *MANY, "--seed", 5, "--out", out)
        assert done.returncode == 0, done.stderr
        return out, done.stderr

    return replay


@pytest.fixture(scope="module")
def five(
    sample_records: Records,
    write_bag: WriteBag,
    replay_five: Callable[..., tuple[Path, str]],
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """Return the results of the sample's first seconds, from an .mcap."""
    bag = write_bag(tmp_path_factory.mktemp("bag") / "five.mcap", sample_records)
    return replay_five(bag)[0]


def test_every_kind_of_recording_gives_the_same(
    sample_records: Records,
    write_bag: WriteBag,
    as_ros1: Callable[[Any], Any],
    replay_five: Callable[..., tuple[Path, str]],
    five: Path,
    tmp_path: Path,
) -> None:
    """ROS 1 and SQLite recordings of the same messages give the bytes that the .mcap gives."""
    assert metrics(five)["arrivals"] >= 2
    in_ros1 = [(topic, at, as_ros1(message)) for topic, at, message in sample_records]
    for path, records in ((tmp_path / "b.db3", sample_records), (tmp_path / "b.bag", in_ros1)):
        out, _ = replay_five(write_bag(path, records))
        for name in REPRODUCIBLE:
            assert (out / name).read_bytes() == (five / name).read_bytes(), (path, name)


def test_parts_are_one_recording(
    sample_records: Records,
    write_bag: WriteBag,
    replay_five: Callable[..., tuple[Path, str]],
    five: Path,
    tmp_path: Path,
) -> None:
    """A recording in two parts, given in any order, gives what the whole gives."""
    half = len(sample_records) // 2
    one = write_bag(tmp_path / "one.mcap", sample_records[:half])
    two = write_bag(tmp_path / "two.mcap", sample_records[half:])
    out, _ = replay_five(two, one.parent)
    assert outputs(out) == outputs(five)


def test_a_map_file_stands_for_the_topic(
    sample_records: Records,
    write_bag: WriteBag,
    replay_five: Callable[..., tuple[Path, str]],
    five: Path,
    tmp_path: Path,
) -> None:
    """The same map as yaml and pgm, named by --map, gives the same lives in the same places."""
    (message,) = [message for topic, _, message in sample_records if topic == "/map"]
    info = message.info
    cells = np.asarray(message.data, np.int8).reshape(info.height, info.width)
    shades = np.where(cells < 0, 205, np.where(cells == OCCUPIED, 0, 254)).astype(np.uint8)
    header = f"P5\n{info.width} {info.height}\n255\n".encode()
    (tmp_path / "map.pgm").write_bytes(header + np.flipud(shades).tobytes())
    origin = info.origin.position
    (tmp_path / "map.yaml").write_text(
        f"image: map.pgm\nresolution: {round(info.resolution, 6)}\nnegate: 0\n"
        f"origin: [{origin.x}, {origin.y}, 0]\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    rest = [record for record in sample_records if record[0] != "/map"]
    bag = write_bag(tmp_path / "rest.mcap", rest)
    out, _ = replay_five(bag, "--map", tmp_path / "map.yaml", "--with-inputs")
    assert [event[1:] for event in life_events(out)] == [e[1:] for e in life_events(five)]
    assert metrics(out)["written"]["/map"] == 1


def test_a_scripted_artefact_in_a_wall_is_said(
    sample_bag: Path, run_are: RunAre, tmp_path: Path
) -> None:
    """With the reason, though the others are well."""
    path = tmp_path / "s.yaml"
    path.write_text(
        "artefacts:\n"
        "- {label: person_adult, name: anna, at: [0.0, 0.0, 0.0]}\n"
        "- {label: person_adult, at: [9.9, 5.4, 0.0]}\n"
    )
    words = ("--scenario", path, "--set", "population.arrival_rate:=0", "--duration", "2")
    done = run_are("replay", sample_bag, *words, "--out", tmp_path / "out")
    assert done.returncode == 3
    (said,) = (line for line in done.stderr.splitlines() if line.startswith("blocked: "))
    assert "anna" in said
    assert "1 arrived, 1 blocked" in done.stderr


def test_scans_are_chosen_by_option_and_by_parameter(
    sample_records: Records,
    write_bag: WriteBag,
    replay_five: Callable[..., tuple[Path, str]],
    run_are: RunAre,
    tmp_path: Path,
) -> None:
    """Of two lasers none is taken unasked, one by --topic, both by `sensors.scans`."""
    both = [
        (name, at, message)
        for topic, at, message in sample_records
        for name in (("/front/scan", "/rear/scan") if topic == "/scan" else (topic,))
    ]
    bag = write_bag(tmp_path / "two.mcap", both)
    said = run_are("inspect", bag).stdout
    assert "choose one with --topic scan:=/NAME" in said
    assert "and several topics are sensor_msgs/msg/LaserScan: /front/scan, /rear/scan" in said
    one, _ = replay_five(bag, "--topic", "scan:=/rear/scan")
    assert metrics(one)["written"][OUT + "scan"] == metrics(one)["scans"]["/rear/scan"]["exact"]
    two, _ = replay_five(bag, "--set", "sensors.scans:=[front/scan, /rear/scan]")
    written = metrics(two)["written"]
    assert written[OUT + "front/scan"] == written[OUT + "rear/scan"] > 40


def test_a_recording_without_camera_and_scan_is_enough(
    sample_records: Records,
    write_bag: WriteBag,
    replay_five: Callable[..., tuple[Path, str]],
    tmp_path: Path,
) -> None:
    """Map and transforms do; a camera that stands in for the missing one is said."""
    few = [record for record in sample_records if record[0] in {"/map", "/tf", "/tf_static"}]
    out, said = replay_five(write_bag(tmp_path / "few.mcap", few))
    assert "no camera in the recording: a pinhole of 640x480 pixels on the base" in said
    assert metrics(out)["scans"] == {}
    assert metrics(out)["ticks_without_perception"] <= 1


def test_a_cloud_whose_frame_is_joined_to_nothing_is_said(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """The replay goes on with the walls of the map, and says why and what would help."""
    records = [(topic, at, copy.deepcopy(message)) for topic, at, message in sample_records]
    for topic, _, message in records:
        if topic == "/octomap_point_cloud_centers":
            message.header.frame_id = "nowhere"
    bag = write_bag(tmp_path / "a.mcap", records)
    done = run_are("replay", bag, "--duration", 1, "--out", tmp_path / "out")
    assert done.returncode == 3, done.stderr
    assert "the voxel cloud was not used: nothing joins its frame 'nowhere'" in done.stderr


def test_a_replay_does_not_go_on_after_the_last_stamp_of_ros_2(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """It is refused in one sentence, whose option replays what was before 2038."""
    first_ns, end_ns = sample_records[0][1], 2**31 * NS_PER_S
    later_ns = end_ns - 4 * NS_PER_S - first_ns
    records = []
    for topic, at_ns, message in sample_records:
        if at_ns > first_ns + 6 * NS_PER_S:
            break
        moved = copy.deepcopy(message)
        stamped = getattr(moved, "transforms", [moved] if hasattr(moved, "header") else [])
        for one in stamped:
            now_ns = stamp_ns(one.header.stamp) + later_ns
            one.header.stamp.sec = now_ns // NS_PER_S - (2**32 if now_ns >= end_ns else 0)
            one.header.stamp.nanosec = now_ns % NS_PER_S
        records.append((topic, at_ns + later_ns, moved))
    bag = write_bag(tmp_path / "late.mcap", records)
    done = run_are("replay", bag, "--out", tmp_path / "out")
    assert (done.returncode, done.stderr.count("Traceback")) == (1, 0)
    said = "the replay would go on after 2038 (2^31 s since 1970), where ROS 2 has no stamps: "
    assert said + "--duration 3.9 ends before" in done.stderr
    assert not (tmp_path / "out").exists()
    done = run_are("replay", bag, "--duration", "3.9", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    done = run_are("replay", bag, "--start", "4.5", "--out", tmp_path / "out")
    assert "none of the recording lies before" in done.stderr
