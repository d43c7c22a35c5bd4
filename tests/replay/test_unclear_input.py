"""Recordings that lack something, through the command line: what is said, and what still works."""

import copy
import json
from collections.abc import Sequence
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any, Protocol

import yaml

Records = Sequence[tuple[str, int, Any]]


class WriteBag(Protocol):
    """Writes (topic, log time, message) into a recording."""

    def __call__(self, path: Path, records: Records) -> Path:
        """Return the path of what was written."""


class RunAre(Protocol):
    """Runs `are` in this process."""

    def __call__(self, *words: object) -> CompletedProcess[str]:
        """Return what it printed and its status."""


def test_two_lasers_are_both_augmented(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """A repeated --topic takes both, as sensors.scans does, and effective.yaml repeats it."""
    renamed = [("/front" if topic == "/scan" else topic, at, m) for topic, at, m in sample_records]
    rear = [("/rear", at, copy.deepcopy(m)) for topic, at, m in sample_records if topic == "/scan"]
    records = sorted([*renamed, *rear], key=lambda record: record[1])
    bag = write_bag(tmp_path / "bag.mcap", records)
    both = ("--topic", "scan:=/front", "--topic", "scan:=/rear")
    done = run_are("replay", bag, *both, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    scans = json.loads((tmp_path / "out" / "metrics.json").read_text())["scans"]
    assert set(scans) == {"/front", "/rear"}
    assert scans["/front"] == scans["/rear"]
    again = run_are(
        "replay", bag, "--params", tmp_path / "out/effective.yaml", "--out", tmp_path / "again"
    )
    assert (tmp_path / "again/augmented.mcap").read_bytes() == (
        tmp_path / "out/augmented.mcap"
    ).read_bytes()
    assert "choose one with --topic" not in again.stderr


def test_an_option_replaces_a_transform_of_the_file(
    run_are: RunAre, sample_bag: Path, tmp_path: Path
) -> None:
    """--static-tf about two frames of which frames.static tells holds; the others stay."""
    section = {"frames.static": ["0 0 0 0 0 0 a b", "0 0 0 0 0 0 b c"]}
    parameters = tmp_path / "p.yaml"
    parameters.write_text(yaml.safe_dump({"ar_builder": {"ros__parameters": section}}))
    words = ("--duration", 1, "--static-tf", "1 0 0 0 0 0 b a")
    done = run_are("replay", sample_bag, "--params", parameters, *words, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    effective = yaml.safe_load((tmp_path / "out/effective.yaml").read_text())
    static = effective["ar_builder"]["ros__parameters"]["frames"]["static"]
    assert static == ["0 0 0 0 0 0 b c", "1 0 0 0 0 0 b a"]
