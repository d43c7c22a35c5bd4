"""Bad input of every kind, through the command line: one clear sentence, never a traceback."""

import copy
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import numpy as np
import pytest

from are_ros.conventions import NS_PER_S

Records = Sequence[tuple[str, int, Any]]
WriteBag = Callable[[Path, Records], Path]
RunAre = Callable[..., CompletedProcess[str]]

NAN = float("nan")
MAP_YAML = (
    "image: {image}\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\n"
    "occupied_thresh: 0.65\nfree_thresh: 0.2\n"
)


@pytest.fixture(scope="module")
def shop(
    tmp_path_factory: pytest.TempPathFactory,
    write_bag: WriteBag,
    sample_bag: Path,
    sample_records: Records,
    as_ros1: Callable[[Any], Any],
) -> Path:
    """Return a folder with bad files of every kind, and a good recording."""
    folder = tmp_path_factory.mktemp("shop")
    good = sample_bag.read_bytes()
    (folder / "good.mcap").write_bytes(good)
    (folder / "own").mkdir()
    (folder / "own" / "augmented.mcap").write_bytes(good)
    middle = len(good) // 2
    spoiled = bytes(255 - byte for byte in good[middle : middle + 200])
    (folder / "spoiled.mcap").write_bytes(good[:middle] + spoiled + good[middle + 200 :])
    _write_bad_texts(folder)
    _write_bad_bags(folder, write_bag, sample_records, as_ros1)
    return folder


def _write_bad_texts(folder: Path) -> None:
    texts = {
        "text.mcap": "this is no recording\n",
        "text.bag": "this is no recording\n",
        "text.db3": "this is no recording\n",
        "text.txt": "this is no recording\n",
        "open.yaml": "image: [\n",
        "list.yaml": "- 1\n- 2\n",
        "no_image.yaml": MAP_YAML.replace("image: {image}\n", ""),
        "lost_image.yaml": MAP_YAML.format(image="lost.pgm"),
        "cut_image.yaml": MAP_YAML.format(image="cut.pgm"),
        "word.yaml": MAP_YAML.format(image="cut.pgm").replace("0.05", "fine"),
        "cut.pgm": "P5 10 10 255\nabc",
        "typo.yaml": "ar_builder:\n  ros__parameters:\n    population:\n      mean_live: 3.0\n",
        "word_for_number.yaml": "ar_builder:\n  ros__parameters:\n    seed: many\n",
        "out_of_range.yaml": "ar_builder:\n  ros__parameters:\n    costmap:\n      memory: -1.0\n",
        "loose.yaml": "population: {arrival_rate: 0.01}\n",
        "twice.yaml": "artefacts: []\nscenario: {random: true}\nartefacts: [1]\n",
        "bare.yaml": "ar_builder:\n  population: 3\n",
        "rows.yaml": "rows: 3\n",
        "cut.bt": "# Octomap OcTree binary file\nid OcTree\nsize 9\nres 0.1\ndata\na",
        "cut.ot": "# Octomap OcTree file\nid OcTree\nsize 9\nres 0.1\ndata\na",
        "cut.pcd": "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\n",
        "cut.ply": "ply\nformat ascii 1.0\nelement vertex 3\n",
        "file": "in the way",
    }
    for name, text in texts.items():
        (folder / name).write_text(text)


def _write_bad_bags(
    folder: Path, write_bag: WriteBag, records: Records, as_ros1: Callable[[Any], Any]
) -> None:
    in_ros1 = [(topic, at, as_ros1(message)) for topic, at, message in records]
    for suffix, content in ((".mcap", records), (".db3", records), (".bag", in_ros1)):
        data = write_bag(folder / f"whole_{suffix[1:]}{suffix}", content).read_bytes()
        (folder / f"cut{suffix}").write_bytes(data[: len(data) * 2 // 3])
    write_bag(folder / "empty.mcap", [])
    for name, topics in (("no_map", {"/map"}), ("no_tf", {"/tf", "/tf_static"})):
        write_bag(folder / f"{name}.mcap", [one for one in records if one[0] not in topics])
    (folder / "no_metadata").mkdir()
    (folder / "no_metadata" / "a.mcap").write_bytes(b"")
    (folder / "taken" / "metrics.json").mkdir(parents=True)


STATIC = ("replay", "good.mcap", "--static-tf")
SET = ("replay", "good.mcap", "--set")
MAP = ("replay", "good.mcap", "--map")
TOPIC = ("replay", "good.mcap", "--topic")
SCENARIO = ("replay", "good.mcap", "--scenario")
PARAMS = ("replay", "good.mcap", "--params")
CASES = (
    # recordings
    (("replay", "none.mcap"), "none.mcap: there is no such file or folder"),
    (("replay", "text.txt"), "text.txt: it is no recording; give a rosbag2 folder, an .mcap, .db3"),
    (("replay", "text.mcap"), "text.mcap: its first bytes are not those of a bag"),
    (("replay", "text.bag"), "text.bag: its first bytes are not those of a bag"),
    (("replay", "text.db3"), "text.db3: it is no rosbag2 database"),
    (("replay", "cut.mcap"), "cut.mcap: it ends too early"),
    (("inspect", "spoiled.mcap"), "spoiled.mcap: a part of it is damaged; `mcap recover` may save"),
    (("replay", "cut.bag"), "cut.bag: it ends too early or is damaged; `rosbag reindex`"),
    (("replay", "cut.db3"), "cut.db3: it ends too early or is damaged; `sqlite3 FILE .recover`"),
    (("replay", "empty/empty.mcap"), "the recording holds no message"),
    (("replay", "no_metadata"), "a folder without metadata.yaml is no rosbag2 recording; give"),
    (("replay", "good.mcap", "whole_bag.bag"), "ROS 1 and of ROS 2 cannot be read together"),
    (("replay", "no_map"), "no map (nav_msgs/OccupancyGrid): give one with --map FILE.yaml"),
    (("replay", "no_tf"), "the robot's pose in the map was never known"),
    (("replay", "good.mcap", "good.mcap"), "good.mcap: this recording is given twice"),
    (("inspect", "empty", "empty/empty.mcap"), "empty/empty.mcap: this recording is given twice"),
    (("inspect", "none.mcap"), "none.mcap: there is no such file or folder"),
    (("inspect", "cut.mcap"), "cut.mcap: it ends too early"),
    (("check", "none"), "none: there is no such file or folder"),
    # windows and frames
    (("replay", "good.mcap", "--start", "1e4"), "--start 10000: the recording is 60.0 s long"),
    (("replay", "good.mcap", "--duration", "0"), "--duration 0: it must be above 0"),
    (("replay", "good.mcap", "--map-frame", "moon"), "is 'map', but frames.map is 'moon'"),
    (("replay", "good.mcap", "--map-frame", ""), "frames.map"),
    ((*STATIC, "1 2 3 4 5 6 a"), "not of the form X Y Z YAW PITCH ROLL PARENT CHILD"),
    ((*STATIC, "1 2 3 4 5 x a b"), "its first six words are not all numbers"),
    ((*STATIC, "1 2 3 4 5 nan a b"), "a number is not finite"),
    (
        (*STATIC, "0 0 0 0 0 0 a b", "--static-tf", "1 0 0 0 0 0 b /a"),
        "'1 0 0 0 0 0 b /a': another, '0 0 0 0 0 0 a b', is about the same two frames",
    ),
    ((*STATIC, "1 2 3 4 5 6 a /a"), "parent and child must be two frames"),
    # maps and octomaps
    ((*MAP, "none.yaml"), "none.yaml: the map file cannot be read (No such file or directory in /"),
    ((*MAP, "open.yaml"), "open.yaml: the map file is no valid YAML"),
    ((*MAP, "list.yaml"), "list.yaml: the map file is no mapping"),
    ((*MAP, "no_image.yaml"), "no_image.yaml: the field image is missing"),
    ((*MAP, "word.yaml"), "word.yaml: resolution must be a finite number, it is or holds 'fine'"),
    ((*MAP, "lost_image.yaml"), "lost_image.yaml: lost.pgm: the image cannot be read (No such"),
    ((*MAP, "cut_image.yaml"), "cut.pgm: the image is truncated, 3 pixels of 100"),
    (("describe", "--map", "none.yaml"), "none.yaml: the map file cannot be read"),
    (("replay", "good.mcap", "--octomap", "none.bt"), "none.bt: the file cannot be read"),
    (("replay", "good.mcap", "--octomap", "text.txt"), "text.txt: this is no octomap"),
    (("replay", "good.mcap", "--octomap", "cut.bt"), "cut.bt: the octomap's data are truncated"),
    (("replay", "good.mcap", "--octomap", "cut.ot"), "cut.ot: the octomap's data are truncated"),
    (("replay", "good.mcap", "--octomap", "cut.pcd"), "cut.pcd: the PCD's header is truncated"),
    (("replay", "good.mcap", "--octomap", "cut.ply"), "cut.ply: the PLY's header is truncated"),
    # topics
    ((*TOPIC, "lidar:=/scan"), "--topic lidar:=/scan: there is no such role; the roles are map,"),
    ((*TOPIC, "scan:=/nix"), "the recording has no such topic; of type sensor_msgs/msg/LaserScan"),
    ((*TOPIC, "map:=/map", "--topic", "map:=/m"), "the role has /map already; only a sensor's may"),
    ((*TOPIC, "scan:=/scan", "--topic", "scan:=/nix"), "has no scan '/nix'; its scans: /scan"),
    ((*TOPIC, "scan:=/odom"), "that topic is of type nav_msgs/msg/Odometry"),
    # parameters
    ((*PARAMS, "none.yaml"), "none.yaml cannot be read (No such file or directory in /"),
    ((*PARAMS, "open.yaml"), "open.yaml is no valid YAML, line 2: "),
    ((*PARAMS, "list.yaml"), "list.yaml: its top level is not a mapping"),
    ((*PARAMS, "bare.yaml"), "bare.yaml: 'ar_builder' has no ros__parameters mapping"),
    ((*PARAMS, "typo.yaml"), "typo.yaml: parameter 'population.mean_live': there is no such param"),
    ((*PARAMS, "loose.yaml"), "loose.yaml holds nothing for ar_builder: 'population' stands in it"),
    (("describe", "--params", "loose.yaml"), "loose.yaml holds nothing for ar_builder"),
    ((*SCENARIO, "twice.yaml"), "twice.yaml is no valid YAML, line 3: the key 'artefacts' comes"),
    ((*PARAMS, "word_for_number.yaml"), "parameter 'seed': 'many' is not"),
    ((*PARAMS, "out_of_range.yaml"), "parameter 'costmap.memory': -1.0 is below 0"),
    ((*SET, "population.arival_rate:=1"), "did you mean 'population.arrival_rate'?"),
    ((*SET, "population.arrival_rate:=much"), "'population.arrival_rate': 'much' is not a number"),
    ((*SET, "population.arrival_rate:=-1"), "-1.0 is below 0.0 1/(m^2 s)"),
    ((*SET, "population.arrival_rate:=.nan"), "parameter 'population.arrival_rate': "),
    ((*SET, "seed:=[1"), "parameter 'seed': '[1' is no valid YAML: "),
    ((*SET, "seed:=-4"), "parameter 'seed': -4 is below 0"),
    ((*SET, "population.departures:=never"), "'never' is none of independent, constant_rate"),
    ((*SET, "mixture.weights:=[0.5, 0.5]", "--set", "mixture.rates:=[3]"), "2 weights and 1 rate"),
    (
        (*SET, "mixture.weights:=[0.5, 0.4]", "--set", "mixture.rates:=[3, 5]"),
        "they sum to 0.9, not to 1",
    ),
    ((*SET, "sensors.scans:=[nix]"), "the recording has no scan '/nix'; its scans: /scan"),
    ((*SET, "camera.mount:=[1, 2]"), "parameter 'camera.mount': 2 numbers, not 6"),
    ((*SET, "robot.footprint:='[[1, 2]]'"), "footprint"),
    # files that parameters name
    ((*SET, "catalogue:=none.yaml"), "none.yaml cannot be read (No such file or directory in /"),
    ((*SET, "catalogue:=rows.yaml"), "rows.yaml: classes must map"),
    ((*SET, "population.region:=zones"), "population.region is zones, but population.zones"),
    ((*SET, "population.zones:=none.yaml"), "none.yaml: the zones file cannot be read (No such"),
    # the output folder
    (("replay", "good.mcap", "--out", "file"), "--out file: the folder cannot be made (it is a"),
    (("replay", "good.mcap", "--out", "file/out"), "--out file/out: the folder cannot be made"),
    (("replay", "good.mcap", "--save-scenario", "taken"), "taken: taken cannot be written (a"),
    (("replay", "good.mcap", "--save-scenario", "file/s.yaml"), "yaml: its folder cannot be made"),
    (("view", "whole_bag.bag"), "run `are replay` on it first, and give the folder of the results"),
    (("replay", "own/augmented.mcap", "--out", "own"), "its augmented.mcap is replayed, and would"),
    (("replay", "good.mcap", "--out", "taken"), "metrics.json cannot be written, a folder has"),
)  # fmt: skip


@pytest.mark.parametrize(("words", "part"), CASES, ids=[" ".join(words) for words, _ in CASES])
def test_bad_input_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch,
    shop: Path,
    run_are: RunAre,
    words: tuple[str, ...],
    part: str,
) -> None:
    """Each kind has a sentence that says what is wrong, status 1, and leaves nothing behind."""
    monkeypatch.chdir(shop)
    before = _contents(shop)
    if words[0] == "replay" and "--duration" not in words:
        words = (*words, "--duration", "1")
    done = run_are(*words)
    said = [line for line in done.stderr.splitlines() if line.startswith("are: ")]
    assert done.returncode == 1
    assert len(said) == 1, done.stderr
    assert done.stderr.splitlines()[-1] == said[0]
    assert part in said[0]
    assert "Errno" not in said[0]
    assert done.stdout == ""
    assert _contents(shop) == before


def _contents(folder: Path) -> dict[Path, int]:
    """Return all files and folders in a folder; of files when they were written, too."""
    paths = sorted(folder.rglob("*"))
    return {path: path.stat().st_mtime_ns if path.is_file() else 0 for path in paths}


def test_a_bad_row_is_named(tmp_path: Path, run_are: RunAre, sample_bag: Path) -> None:
    """A catalogue with one bad row says which, and what is wrong with it."""
    import yaml

    from are_ros.builder.files.catalogue_file import SHIPPED_CATALOGUE

    content = yaml.safe_load(SHIPPED_CATALOGUE.read_text())
    content["rows"][7]["size"] = [0.3, -1.0, 0.3]
    (tmp_path / "bad.yaml").write_text(yaml.safe_dump(content))
    out = tmp_path / "out"
    words = ("--set", f"catalogue:={tmp_path / 'bad.yaml'}", "--out", out)
    done = run_are("replay", sample_bag, *words)
    assert (done.returncode, out.exists()) == (1, False)
    *_, line = done.stderr.splitlines()
    assert content["rows"][7]["label"] in line
    assert "size" in line


def test_a_failed_replay_leaves_the_last_results(
    tmp_path: Path, shop: Path, run_are: RunAre
) -> None:
    """A set that was complete stays complete when a later replay into its folder fails."""
    assert run_are("replay", shop / "good.mcap", "--duration", 1, "--out", tmp_path).returncode == 0
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert run_are("replay", shop / "no_tf", "--duration", 1, "--out", tmp_path).returncode == 1
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before
    assert len(before) == 6


# ------------------------------------------------------------------------------ messages


@dataclass(frozen=True)
class Fault:
    """A way to break a message of a topic, and what must be said of it."""

    topic: str
    break_: Callable[[Any], None]
    parts: tuple[str, ...]


def _set(path: str, value: Any) -> Callable[[Any], None]:
    """Return what sets an attribute deep in a message; numbers in the path are indices."""
    *parents, last = path.split(".")

    def change(message: Any) -> None:
        for name in parents:
            message = message[int(name)] if name.isdigit() else getattr(message, name)
        setattr(message, last, value)

    return change


def _first_zero(name: str) -> Callable[[Any], None]:
    def change(message: Any) -> None:
        numbers = np.array(getattr(message, name))
        numbers[0] = 0.0
        setattr(message, name, numbers)

    return change


def _shorter(message: Any) -> None:
    message.data = message.data[:-3]


def _far_away(message: Any) -> None:
    data = np.array(message.data)
    data.view("<f4")[0] = 1e30
    message.data = data


def _without_x(message: Any) -> None:
    message.fields[0].name = "u"


CLOUD, CAMERA = "/octomap_point_cloud_centers", "/camera/camera_info"
TURN = "transforms.0.transform.rotation."
FAULTS = (
    (
        Fault("/map", _shorter, ("data",)),
        Fault("/odom", _set("pose.pose.position.x", NAN), ("finite",)),
        Fault("/tf", _set(TURN + "z", NAN), ("finite",)),
        Fault("/scan", _set("angle_increment", NAN), ("angle_increment",)),
        Fault(CAMERA, _first_zero("k"), ("focal length",)),
        Fault(CLOUD, _set("row_step", 1), ("row_step 1", "width")),
    ),
    (
        Fault("/map", _set("info.resolution", 0.0), ("resolution",)),
        Fault("/odom", _set("pose.pose.orientation.w", 0.3), ("rotation",)),
        Fault("/tf", _set(TURN + "w", 0.5), ("rotation",)),
        Fault("/scan", _set("header.frame_id", ""), ("frame_id",)),
        Fault(CAMERA, _set("width", 0), ("width",)),
        Fault(CLOUD, _without_x, ("fields have no x",)),
    ),
    (
        Fault("/map", _set("info.origin.position.x", NAN), ("origin", "finite")),
        Fault("/odom", _set("header.frame_id", ""), ("frame",)),
        Fault("/tf", _set("transforms.0.child_frame_id", "odom"), ("odom",)),
        Fault("/scan", _set("range_max", NAN), ("range_max",)),
        Fault(CAMERA, _set("distortion_model", "wavy"), ("distortion_model", "wavy")),
        Fault(CLOUD, _shorter, ("data has",)),
    ),
    (
        Fault("/map", _set("info.origin.position.x", 1e300), ("origin", "exceeds")),
        Fault("/odom", _set("pose.pose.position.x", 1e300), ("exceeds",)),
        Fault("/tf", _set("transforms.0.transform.translation.z", -1e300), ("exceeds",)),
        Fault("/scan", _set("range_min", 1e3), ("range_min",)),
        Fault(CAMERA, _set("d", np.array([1e300, 0, 0, 0, 0])), ("d has a number beyond",)),
        Fault(CLOUD, _far_away, ("a point lies",)),
    ),
)


def _with_bad(records: Records, faults: Sequence[Fault]) -> Records:
    """Return the records with a broken copy of one message of each topic, amid the good ones."""
    found = list(records)
    for fault in faults:
        times = [at for topic, at, _ in records if topic == fault.topic]
        message = copy.deepcopy(next(one for topic, _, one in records if topic == fault.topic))
        fault.break_(message)
        at = times[0] + NS_PER_S if len(times) == 1 else times[len(times) // 2]
        found.append((fault.topic, at, message))
    return sorted(found, key=lambda record: record[1])


def _replay(run_are: RunAre, bag: Path, out: Path) -> tuple[CompletedProcess[str], Any]:
    many = ("--set", "population.arrival_rate:=0.02", "--set", "population.mean_life:=2")
    done = run_are("replay", bag, *many, "--out", out)
    return done, json.loads((out / "metrics.json").read_text())


@pytest.fixture(scope="module")
def clean(
    run_are: RunAre,
    write_bag: WriteBag,
    sample_records: Records,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """Return the results of the recording without a bad message."""
    folder = tmp_path_factory.mktemp("clean")
    bag = write_bag(folder / "bag.mcap", sample_records)
    done, metrics = _replay(run_are, bag, folder / "out")
    assert (done.returncode, metrics["refused"]) == (0, {})
    assert metrics["arrivals"] > 0
    return folder / "out"


@pytest.mark.parametrize("faults", FAULTS, ids=["first", "second", "third", "fourth"])
def test_bad_messages_are_refused_and_change_nothing(
    run_are: RunAre,
    write_bag: WriteBag,
    sample_records: Records,
    clean: Path,
    tmp_path: Path,
    faults: Sequence[Fault],
) -> None:
    """A sentence and a count for each, status 3, and the bytes of the recording without them."""
    bag = write_bag(tmp_path / "bad.mcap", _with_bad(sample_records, faults))
    done, metrics = _replay(run_are, bag, tmp_path / "out")
    assert done.returncode == 3
    assert metrics["refused"] == {fault.topic: 1 for fault in faults}
    lines = done.stderr.splitlines()
    for fault in faults:
        said = [line for line in lines if line.startswith(f"refused: {fault.topic}: ")]
        assert len(said) == 1, (fault.topic, lines)
        assert all(part in said[0] for part in fault.parts), said
    assert sum(line.startswith("refused: ") for line in lines) == len(faults)
    assert (tmp_path / "out" / "augmented.mcap").read_bytes() == (
        clean / "augmented.mcap"
    ).read_bytes()
    reference = json.loads((clean / "metrics.json").read_text())
    assert metrics | {"refused": {}} == reference


def test_a_bad_first_message_gives_way_to_the_next(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, clean: Path, tmp_path: Path
) -> None:
    """Where the first map, cloud and camera are bad, the good ones after them are used."""
    start_ns = sample_records[0][1]
    firsts = []
    for fault in FAULTS[0]:
        message = copy.deepcopy(
            next(one for topic, _, one in sample_records if topic == fault.topic)
        )
        fault.break_(message)
        firsts.append((fault.topic, start_ns, message))
    bag = write_bag(tmp_path / "bad.mcap", [*firsts, *sample_records])
    done, metrics = _replay(run_are, bag, tmp_path / "out")
    assert done.returncode == 3
    assert metrics["refused"] == {fault.topic: 1 for fault in FAULTS[0]}
    reference = json.loads((clean / "metrics.json").read_text())
    assert metrics["lives"] == reference["lives"]


def test_messages_of_damaged_bytes_are_refused(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """A message whose bytes are no message of its type is refused like a malformed one."""
    from are_ros.bag.reader import BagReader
    from are_ros.bag.writer import BagWriter

    source = write_bag(tmp_path / "good.mcap", sample_records)
    damaged: set[str] = set()
    with BagReader([source]) as reader, BagWriter(tmp_path / "damaged.mcap") as writer:
        for topic in reader.topics:
            writer.add_topic(topic.name, topic.type_name)
        for message in reader.messages():
            if message.log_time_ns > reader.start_ns + NS_PER_S and message.topic not in damaged:
                damaged.add(message.topic)
                writer.write_raw(message.topic, message.log_time_ns, bytes(message.data[:30]))
            writer.write_raw(message.topic, message.log_time_ns, bytes(message.data))
    done, metrics = _replay(run_are, tmp_path / "damaged.mcap", tmp_path / "out")
    assert done.returncode == 3
    assert metrics["refused"] == dict.fromkeys(damaged, 1)
    assert damaged == {"/odom", "/tf", "/scan", CAMERA}
    assert done.stderr.count(" ns is no ") == len(damaged)
