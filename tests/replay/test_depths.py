"""A replay of a recording with images of depths, raw and compressed, judged by `are check`."""

import copy
import re
import shutil
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from are_ros.bag.reader import BagReader
from bags.simulation.making import RosbagsFactory
from tests.checks.test_live import Tape
from tests.replay.conftest import MANY, Records, RunAre, WriteBag

WIDTH, HEIGHT, PADDING = 80, 60, 6
RAW, PACKED = "/kinect/depth/image_raw", "/tof/depth/image_rect/compressedDepth"
A, B = 10100.0, -1009.0


def camera_info(header: Any, factory: RosbagsFactory) -> Any:
    """Return the CameraInfo of a wide lens that distorts."""
    return factory.make(
        "sensor_msgs/msg/CameraInfo",
        header=header,
        width=WIDTH,
        height=HEIGHT,
        distortion_model="plumb_bob",
        d=np.array([-0.2, 0.05, 1e-3, -1e-3, 0.0]),
        k=np.array([50.0, 0, 39.0, 0, 51.0, 30.5, 0, 0, 1.0]),
        r=np.eye(3).reshape(-1),
        p=np.array([48.0, 0, 39.5, 0, 0, 48.0, 29.5, 0, 0, 0, 1.0, 0]),
    )


def raw_depth(header: Any, factory: RosbagsFactory, depths_mm: npt.NDArray[np.uint16]) -> Any:
    """Return big-endian millimetres in rows with padding."""
    rows = depths_mm.astype(">u2").view(np.uint8).reshape(HEIGHT, -1)
    rows = np.pad(rows, ((0, 0), (0, PADDING)), constant_values=9)
    return factory.make(
        "sensor_msgs/msg/Image",
        header=header,
        height=HEIGHT,
        width=WIDTH,
        encoding="16UC1",
        is_bigendian=1,
        step=rows.shape[1],
        data=rows.reshape(-1),
    )


def packed_depth(header: Any, factory: RosbagsFactory, depths_mm: npt.NDArray[np.uint16]) -> Any:
    """Return metres as image_transport compresses them."""
    with np.errstate(divide="ignore"):
        numbers = np.where(depths_mm > 0, A / (1e-3 * depths_mm) + B, 0.0).astype(np.uint16)
    png = cv2.imencode(".png", numbers)[1].reshape(-1)
    return factory.make(
        "sensor_msgs/msg/CompressedImage",
        header=header,
        format="32FC1; compressedDepth png",
        data=np.concatenate((np.frombuffer(struct.pack("<iff", 0, A, B), np.uint8), png)),
    )


@pytest.fixture(scope="module")
def replay(
    sample_records: Records,
    factory: RosbagsFactory,
    write_bag: WriteBag,
    run_are: RunAre,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """Return the results of five seconds of the sample with two depth cameras."""
    folder, records = tmp_path_factory.mktemp("depths"), list[tuple[str, int, Any]]()
    rng = np.random.default_rng(5)
    for topic, log_ns, message in sample_records:
        records.append((topic, log_ns, message))
        is_third = len([one for one in records if one[0] == "/camera/camera_info"]) % 3 == 0
        if topic == "/camera/camera_info" and is_third:
            header = message.header
            depths_mm = rng.integers(500, 9000, (HEIGHT, WIDTH)).astype(np.uint16)
            depths_mm[rng.random(depths_mm.shape) < 0.3] = 0
            info = camera_info(header, factory)
            records += [
                (RAW, log_ns, raw_depth(header, factory, depths_mm)),
                ("/kinect/depth/camera_info", log_ns, info),
                ("/tof/depth/camera_info", log_ns, info),
                (PACKED, log_ns, packed_depth(header, factory, depths_mm)),
            ]
    bag = write_bag(folder / "bag.mcap", records)
    both = ("--topic", f"depth:={RAW}", "--topic", f"depth:={PACKED}")
    done = run_are(
        *("replay", bag, *MANY, *both, "--topic", "camera/camera_info:=/camera/camera_info"),
        *("--seed", 3, "--with-inputs", "--out", folder / "out"),
    )
    assert done.returncode == 0, done.stderr
    return folder / "out"


def test_depths_pass_the_checks(replay: Path, run_are: RunAre) -> None:
    """Every pixel is what one gets who computes it anew; the CameraInfo is the input's."""
    done = run_are("check", replay)
    assert done.returncode == 0, done.stdout + done.stderr
    (anew,) = [line for line in done.stdout.splitlines() if line.startswith("depth images")]
    assert "passed" in anew
    assert int(anew.split(",")[1].split()[0]) > 100_000


def test_wrong_pixels_are_counted_as_pixels(replay: Path, run_are: RunAre, tmp_path: Path) -> None:
    """As those that were looked at are; it said how many images had some."""
    tape = Tape.of(replay)
    entries = list(tape.entries)
    output = f"/ar_builder{RAW}"
    spoilt = max(n for n, (_, topic, _) in enumerate(entries) if topic == output)
    log_ns, topic, data = entries[spoilt]
    last_row = len(data) - PADDING - 2 * WIDTH
    entries[spoilt] = (log_ns, topic, data[:last_row] + b"\xff" * 2 * WIDTH + data[-PADDING:])
    shutil.copytree(replay, tmp_path / "run")
    replace(tape, entries=tuple(entries)).write_file(tmp_path / "run" / "augmented.mcap")
    done = run_are("check", tmp_path / "run")
    found = re.search(r"FAILED, (\d+) wrong of \d+ pixels .* has (\d+) pixels other", done.stdout)
    assert found, done.stdout
    assert int(found[1]) == int(found[2]) > 1


def test_images_of_depths_are_known_by_what_they_hold(
    replay: Path, run_are: RunAre, tmp_path: Path
) -> None:
    """Whatever their topics are called: as many are judged as under a usual name."""

    def renamed(topic: str) -> str:
        return topic.replace("/depth", "").replace("kinect", "left").replace("tof", "right")

    tape = Tape.of(replay)
    entries = tuple((log_ns, renamed(topic), data) for log_ns, topic, data in tape.entries)
    types = {renamed(topic): kind for topic, kind in tape.types.items()}
    run = replace(tape, entries=entries, types=types).write(tmp_path / "run")
    found = []
    for folder in (replay, run):
        done = run_are("check", folder)
        assert done.returncode == 0, done.stdout + done.stderr
        found += re.findall(r"(\d+) depth images of \d+ pixels", done.stdout)
        assert "painted images" not in done.stdout
    assert len(found) == 2
    assert found[0] == found[1]


def test_a_damaged_recording_of_depths_is_a_result(
    replay: Path, run_are: RunAre, tmp_path: Path
) -> None:
    """The fault is that of the one file, however many topics of images are looked into."""
    shutil.copytree(replay, tmp_path / "run")
    path = tmp_path / "run" / "augmented.mcap"
    data = bytearray(path.read_bytes())
    data[2000:6000] = bytes(4000)
    path.write_bytes(data)
    done = run_are("check", tmp_path / "run")
    assert done.returncode != 0
    assert "Traceback" not in done.stdout + done.stderr
    (reader,) = [line for line in done.stdout.splitlines() if line.startswith("rosbags reader")]
    assert "FAILED, 2 wrong" in reader  # one for all but the grids, one for the grids
    assert reader.endswith("it is damaged")


def test_each_image_goes_out_with_its_camera_info(replay: Path) -> None:
    """In pairs of one stamp, some with artefacts; those without are what came in, to the byte."""
    with BagReader([replay / "augmented.mcap"]) as reader:
        sent: dict[str, dict[bytes, bytes]] = {}
        for message in reader.messages():
            stamp = bytes(message.data[4:12])
            sent.setdefault(message.topic, {})[stamp] = bytes(message.data)
    for topic in (RAW, PACKED):
        before, after = sent[topic], sent[f"/ar_builder{topic}"]
        infos = sent[f"/ar_builder/{topic.split('/')[1]}/depth/camera_info"]
        assert len(after) > 10
        assert after.keys() == infos.keys()
        assert after.keys() <= before.keys()
        changed = sum(before[stamp] != data for stamp, data in after.items())
        assert 3 < changed < len(after)


ODD = "/odd/lens"


def lone_depths(
    sample_records: Records, factory: RosbagsFactory, infos: dict[str, tuple[str, int]]
) -> Records:
    """Return two seconds of the sample with an image of depths on PACKED instead of its own.

    `infos` are the frame and the width of a CameraInfo by its topic; an empty frame is the image's.
    """
    records, begin_ns = list[tuple[str, int, Any]](), sample_records[0][1]
    for topic, log_ns, message in sample_records:
        if log_ns > begin_ns + 2_000_000_000 or topic.startswith(
            ("/camera/depth", "/camera/image")
        ):
            continue
        records.append((topic, log_ns, message))
        if topic == "/camera/camera_info":
            depths_mm = np.full((HEIGHT, WIDTH), 3000, np.uint16)
            records.append((PACKED, log_ns, packed_depth(message.header, factory, depths_mm)))
            for name, (frame, width) in infos.items():
                info = copy.deepcopy(camera_info(message.header, factory))
                info.header.frame_id, info.width = frame or message.header.frame_id, width
                records.append((name, log_ns, info))
    return records


def test_a_camera_info_of_the_same_frame_and_size_is_found(
    sample_records: Records,
    factory: RosbagsFactory,
    write_bag: WriteBag,
    run_are: RunAre,
    tmp_path: Path,
) -> None:
    """As where it is beside the images; others have another frame or size, or are outputs."""
    decoys = {"/a/lens": ("base_link", WIDTH), "/z/lens": ("", WIDTH - 1)}
    decoys["/ar_builder/depth/camera_info"] = ("", WIDTH)
    sent = {}
    for name, topic in (("beside", "/tof/depth/camera_info"), ("odd", ODD)):
        records = lone_depths(sample_records, factory, {**decoys, topic: ("", WIDTH)})
        bag = write_bag(tmp_path / f"{name}.mcap", records)
        camera = ("--topic", "camera/camera_info:=/camera/camera_info", "--with-inputs")
        words = (*MANY, *camera, "--set", "population.arrival_rate:=0.2", "--out", tmp_path / name)
        done = run_are("replay", bag, *words)
        assert done.returncode == 0, done.stderr
        said = f"{PACKED} has no CameraInfo beside it, on /tof/depth/camera_info: {ODD} is taken"
        assert (said in done.stdout + done.stderr) == (name == "odd")
        assert (said in run_are("inspect", bag).stdout) == (name == "odd")
        with BagReader([tmp_path / name / "augmented.mcap"]) as reader:
            outputs = [
                f"/ar_builder/depth/{part}" for part in ("image/compressedDepth", "camera_info")
            ]
            sent[name] = [(m.topic, m.log_time_ns, m.data) for m in reader.messages(outputs)]
            inputs = {m.data[40:] for m in reader.messages((PACKED,))}
        images = [data for topic, _, data in sent[name] if topic.endswith("compressedDepth")]
        assert len({data[40:] for data in images} - inputs) > 3  # artefacts are in the picture
        checked = run_are("check", tmp_path / name)
        assert checked.returncode == 0, checked.stdout
        assert "depth images computed anew: passed" in checked.stdout
    assert sent["odd"] == sent["beside"]


def test_of_several_camera_infos_the_user_chooses(
    sample_records: Records,
    factory: RosbagsFactory,
    write_bag: WriteBag,
    run_are: RunAre,
    tmp_path: Path,
) -> None:
    """Two lenses fit the image: it stays as it is, unless one is chosen; what is wrong is named."""
    records = [*lone_depths(sample_records, factory, {"/a/lens": ("", WIDTH), ODD: ("", WIDTH)})]
    for number, (topic, log_ns, message) in enumerate(records):
        if topic == ODD:
            other = copy.deepcopy(message)
            other.k[0] = 51.0
            records[number] = (topic, log_ns, other)
    bag = write_bag(tmp_path / "bag.mcap", records)
    words = (*MANY, "--topic", "camera/camera_info:=/camera/camera_info", "--out", tmp_path / "out")
    option = f'--set "sensors.camera_infos:=[{PACKED}:=/a/lens]" takes the first'
    assert f"it may be /a/lens or {ODD}; {option}" in run_are("inspect", bag).stdout
    bare = run_are("replay", bag, *words)
    assert bare.returncode == 3
    assert option in bare.stderr
    assert "no CameraInfo that can be used has come on /tof/depth/camera_info" in bare.stderr
    chosen = f"sensors.camera_infos:=[{PACKED}:={ODD}]"
    done = run_are("replay", bag, *words, "--set", chosen)
    assert done.returncode == 0
    assert re.search(rf"depth {PACKED} +\d+ augmented at their stamp", done.stderr)
    for wrong, sentence in (
        (
            f"[{PACKED}:=/none]",
            "the recording has no CameraInfo '/none'; it has: /a/lens, /camera/",
        ),
        (f"[/tof:={ODD}]", f"/tof is no topic of images that are augmented: {PACKED}"),
        (f"[{ODD}]", f"'{ODD}' is not two topics, as in /image"),
    ):
        done = run_are("replay", bag, *words, "--set", f"sensors.camera_infos:={wrong}")
        assert done.returncode == 1, done.stderr
        assert sentence in done.stderr
