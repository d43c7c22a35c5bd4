"""One place in a file of each format: a replay gives the same bytes, whichever it reads."""

import struct
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import trimesh

from are_ros.bag.reader import BagReader
from are_ros.bag.types import jazzy_typestore
from are_ros.builder.sensors.point_cloud import PointCloud
from are_ros.messages.common import read_header
from are_ros.messages.maps import read_voxels
from are_ros.messages.sensors import encode_cloud, read_cloud
from bags.simulation.making import RosbagsFactory
from tests.replay.conftest import MANY, Records, RunAre, WriteBag

SIZE_M = 0.1
WALL = np.argwhere(np.ones((2, 30, 20))) + np.array((60, 30, 0))
"""Voxels of a wall across the way of the robot, as integers (N, 3)."""


def octomap(voxels: npt.NDArray[np.int64], *, is_full: bool) -> bytes:
    """Return an octomap of occupied voxels, written node by node from the root down."""
    occupied, inner = struct.pack("<fB", 2.0, 0), b""

    def node(keys: npt.NDArray[np.int64], level: int) -> tuple[bytes, int]:
        number = (keys >> level & 1) @ np.array((1, 2, 4))
        word, children, nodes = 0, inner, 1
        for child in range(8):
            chosen = keys[number == child]
            if not len(chosen):
                continue
            word |= 1 << child if is_full else (3 if level else 2) << (2 * child)
            part = node(chosen, level - 1) if level else (occupied if is_full else inner, 1)
            children, nodes = children + part[0], nodes + part[1]
        head = struct.pack("<fB", 2.0, word) if is_full else struct.pack("<H", word)
        return head + children, nodes

    data, nodes = node(voxels + 2**15, 15)
    kind = "OcTree file" if is_full else "OcTree binary file"
    return f"# Octomap {kind}\nid OcTree\nsize {nodes}\nres {SIZE_M}\ndata\n".encode() + data


def pcd(points_m: npt.NDArray[np.float64]) -> bytes:
    """Return a binary PCD."""
    head = f"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS {len(points_m)}\nDATA binary\n"
    return head.encode() + points_m.astype("<f4").tobytes()


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return the files of the wall by their formats."""
    centres_m = (WALL + 0.5) * SIZE_M
    contents = {
        "bt": octomap(WALL, is_full=False),
        "ot": octomap(WALL, is_full=True),
        "pcd": pcd(centres_m),
        "ply": trimesh.PointCloud(centres_m).export(file_type="ply", encoding="binary"),
    }
    folder = tmp_path_factory.mktemp("files")
    for name, data in contents.items():
        (folder / f"wall.{name}").write_bytes(data)
    return {name: folder / f"wall.{name}" for name in contents}


def test_the_format_of_the_file_does_not_matter(
    run_are: RunAre, sample_bag: Path, files: dict[str, Path], tmp_path: Path
) -> None:
    """Octomaps and clouds of the same voxels; without the file it is another run."""
    many = ("--set", "population.arrival_rate:=0.05", "--seed", 4, "--duration", 3)
    recorded = {}
    for name in ("none", *files):
        out = tmp_path / name
        octomap_words = () if name == "none" else ("--octomap", files[name])
        done = run_are("replay", sample_bag, *many, *octomap_words, "--out", out)
        assert done.returncode == 0, done.stderr
        recorded[name] = (out / "augmented.mcap").read_bytes()
    assert len({recorded[name] for name in files}) == 1
    assert recorded["none"] != recorded["bt"]


@pytest.mark.parametrize("is_full", [False, True])
def test_an_octree_in_a_recording_gives_what_its_centres_do(
    run_are: RunAre,
    write_bag: WriteBag,
    sample_records: Records,
    factory: RosbagsFactory,
    tmp_path: Path,
    is_full: bool,
) -> None:
    """The bytes of a replay are the same, its inputs too; /octomap_binary and _full are read."""
    name = "full" if is_full else "binary"
    octrees, centres = [], []
    for topic, at_ns, message in sample_records:
        if topic != "/octomap_point_cloud_centers":
            octrees.append((topic, at_ns, message))
            centres.append((topic, at_ns, message))
            continue
        voxels = np.floor(read_cloud(message).points_m() / SIZE_M).astype(np.int64)
        data = octomap(voxels, is_full=is_full).partition(b"\ndata\n")[2]
        octree = factory.make(
            "octomap_msgs/msg/Octomap",
            header=message.header,
            binary=not is_full,
            id="OcTree",
            resolution=SIZE_M,
            data=np.frombuffer(data, np.int8),
        )
        octrees.append((f"/octomap_{name}", at_ns, octree))
        points_m = read_voxels(octree)[0]
        cloud = PointCloud.of_points("map", read_header(message, "").stamp_ns, points_m)
        store = jazzy_typestore()
        centres.append(
            (topic, at_ns, store.deserialize_cdr(encode_cloud(cloud), message.__msgtype__))
        )
        assert sorted(map(tuple, (voxels + 0.5).tolist())) == sorted(
            map(tuple, (points_m / SIZE_M).round(3).tolist())
        )
    outs = []
    for folder, records in (("octree", octrees), ("centres", centres)):
        bag, out = write_bag(tmp_path / f"{folder}.mcap", records), tmp_path / f"{folder}_out"
        done = run_are("replay", bag, *MANY, "--with-inputs", "--also", "octomap", "--out", out)
        assert done.returncode == 0, done.stderr
        outs.append(out)
    assert messages_of(outs[0]) == messages_of(outs[1])
    checked = run_are("check", outs[0])
    assert checked.returncode == 0, checked.stdout


def messages_of(out: Path) -> list[tuple[str, int, bytes]]:
    """Return what a replay wrote."""
    with BagReader([out / "augmented.mcap"]) as reader:
        return [(m.topic, m.log_time_ns, bytes(m.data)) for m in reader.messages()]


def test_damaged_octrees_in_a_recording_are_refused_in_one_sentence(
    run_are: RunAre,
    write_bag: WriteBag,
    sample_records: Records,
    factory: RosbagsFactory,
    tmp_path: Path,
) -> None:
    """A replay counts them and goes on; the walls of the map stand in."""
    name, bad = "octomap_msgs/msg/Octomap", []
    good = octomap(WALL, is_full=True).partition(b"\ndata\n")[2]
    for number, (tree, resolution, data) in enumerate(
        [("OcTree", SIZE_M, good[:-3]), ("Unknown", SIZE_M, good), ("OcTree", 0.0, good)]
    ):
        octree = factory.make(
            name, id=tree, resolution=resolution, data=np.frombuffer(data, np.int8)
        )
        octree.header.frame_id = "map"
        bad.append(("/octomap_full", sample_records[0][1] + number, octree))
    records = [r for r in sample_records if r[0] != "/octomap_point_cloud_centers"]
    bag = write_bag(tmp_path / "bag.mcap", sorted([*records, *bad], key=lambda r: r[1]))
    done = run_are("replay", bag, "--with-inputs", "--out", tmp_path / "out")
    assert done.returncode == 3, done.stderr
    said = "/octomap_full: the octomap's data are truncated, 7117 bytes are too few (the first of 3"
    assert f"refused: {said}" in done.stderr
