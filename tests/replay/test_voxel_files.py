"""One place in a file of each format: a replay gives the same bytes, whichever it reads."""

import struct
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import trimesh

from tests.replay.conftest import RunAre

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
