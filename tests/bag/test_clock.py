"""Recordings whose log times lie far from their stamps."""

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from subprocess import CompletedProcess
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from are_ros.bag.clock import BagClock, RecordedTimes, Times, base_frame_of
from are_ros.bag.reader import BagReader
from are_ros.conventions import NS_PER_S
from bags.simulation.making import RosbagsFactory

Records = Sequence[tuple[str, int, Any]]
WriteBag = Callable[[Path, Records], Path]
RunAre = Callable[..., CompletedProcess[str]]

YEARS_NS = 3 * 365 * 86_400 * NS_PER_S
MANY = ("--set", "population.arrival_rate:=0.02", "--set", "population.mean_life:=2")


def clock_of(log_ns: list[int], clock_ns: list[int]) -> BagClock:
    """Return a clock that is known at some instants."""
    return BagClock(np.array(log_ns, np.int64), np.array(clock_ns, np.int64))


def test_an_agreeing_clock_is_the_log_s(sample_bag: Path) -> None:
    """Where stamps and log times agree, nothing is changed and nothing said."""
    with BagReader([sample_bag]) as reader:
        roles = {"/odom": "odom", "/tf": "tf", "/scan": "scan"}
        clock = BagClock.of(RecordedTimes.read(reader, roles, reader.start_ns, reader.end_ns))
    assert clock.sentence == ""
    assert clock.at(123) == 123


def test_between_instants_the_clock_goes_evenly() -> None:
    """Before, between and after what is known."""
    clock = clock_of([100, 200, 300], [1000, 1050, 1300])
    assert [clock.at(at) for at in (90, 100, 150, 199, 200, 240, 300, 310)] == [
        990, 1000, 1025, 1049, 1050, 1150, 1300, 1310,
    ]  # fmt: skip


@pytest.mark.parametrize("word", ["ahead of", "behind"])
def test_a_clock_that_was_set_meanwhile_is_told_with_its_largest_difference(word: str) -> None:
    """Half of the stamps lie an hour away, the others agree: none lies half an hour away."""
    even_ns = (np.arange(100, dtype=np.int64) + 10**5) * NS_PER_S
    leaping_ns = even_ns + (np.arange(100) >= 50) * 3600 * NS_PER_S
    pair = (even_ns, leaping_ns) if word == "ahead of" else (leaping_ns, even_ns)
    times: Any = SimpleNamespace(
        jump_back=None, sources=(Times("/odom", *pair),), bag_start_ns=int(even_ns[0])
    )
    assert f"the stamps lie up to 60.0 min {word} the times" in BagClock.of(times).sentence


def test_instants_of_one_log_time_are_no_division_by_zero() -> None:
    """Of several stamps at one log time the last one holds."""
    clock = clock_of([100, 100, 200], [1000, 1020, 1030])
    assert [clock.at(at) for at in (100, 150, 200)] == [1020, 1025, 1030]


@given(
    st.lists(st.tuples(st.integers(0, 10**12), st.integers(0, 10**12)), min_size=1, max_size=8),
    st.lists(st.integers(-(10**12), 2 * 10**12), min_size=2, max_size=20),
)
def test_the_clock_never_goes_back(known: list[tuple[int, int]], asked: list[int]) -> None:
    """Whatever is known of it, the clock does not decrease."""
    log_ns, clock_ns = (sorted(times) for times in zip(*known, strict=True))
    clock = clock_of(log_ns, clock_ns)
    times = [clock.at(at) for at in sorted(asked)]
    assert times == sorted(times)


# ------------------------------------------------------------------------------ whole replays


def replayed(run_are: RunAre, bag: Path, out: Path) -> tuple[list[tuple[str, int, bytes]], str]:
    """Return the messages that a replay writes, and what it says."""
    done = run_are("replay", bag, *MANY, "--out", out)
    assert done.returncode == 0, done.stderr
    with BagReader([out / "augmented.mcap"]) as reader:
        messages = [(m.topic, m.log_time_ns, bytes(m.data)) for m in reader.messages()]
    return messages, done.stderr


@pytest.fixture(scope="module")
def usual(
    run_are: RunAre,
    write_bag: WriteBag,
    sample_records: Records,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """Return the results of the recording as it was made."""
    folder = tmp_path_factory.mktemp("usual")
    messages, said = replayed(run_are, write_bag(folder / "a.mcap", sample_records), folder / "out")
    assert messages
    assert "the replay goes by" not in said
    return folder / "out"


def test_a_recorded_clock_is_followed(
    run_are: RunAre,
    write_bag: WriteBag,
    factory: RosbagsFactory,
    sample_records: Records,
    usual: Path,
    tmp_path: Path,
) -> None:
    """Log times three years off, and /clock beside them: everything comes out as it was."""
    shifted: list[tuple[str, int, Any]] = []
    for topic, at, message in sample_records:
        time = factory.make(
            "builtin_interfaces/msg/Time", sec=at // NS_PER_S, nanosec=at % NS_PER_S
        )
        shifted.append(
            ("/clock", at + YEARS_NS, factory.make("rosgraph_msgs/msg/Clock", clock=time))
        )
        shifted.append((topic, at + YEARS_NS, message))
    messages, said = replayed(run_are, write_bag(tmp_path / "b.mcap", shifted), tmp_path / "out")
    assert "the stamps lie 3.0 years behind the times of recording" in said
    assert "the replay goes by the stamps of /clock" in said
    assert messages
    for name in ("augmented.mcap", "metrics.json", "overview.png"):
        assert (tmp_path / "out" / name).read_bytes() == (usual / name).read_bytes(), name


def test_without_a_clock_the_odometry_s_is_followed(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, usual: Path, tmp_path: Path
) -> None:
    """Without /clock the stamps of the odometry serve: the same lives, the robot always known."""
    shifted = [(topic, at + YEARS_NS, message) for topic, at, message in sample_records]
    _, said = replayed(run_are, write_bag(tmp_path / "b.mcap", shifted), tmp_path / "out")
    assert "the replay goes by the stamps of /odom" in said
    ours = json.loads((tmp_path / "out" / "metrics.json").read_text())
    theirs = json.loads((usual / "metrics.json").read_text())
    assert ours["ticks_without_perception"] <= 2
    assert [life["row"] for life in ours["lives"]] == [life["row"] for life in theirs["lives"]]
    assert ours["scans"]["/scan"]["passed_through"] == 0
    assert abs(ours["first_tick_ns"] - theirs["first_tick_ns"]) < NS_PER_S


def test_a_recording_that_looped_is_refused(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """Stamps that jump back while the log goes on: one pass can be replayed, not both at once."""
    length_ns = sample_records[-1][1] - sample_records[0][1] + NS_PER_S
    twice = [
        (topic, at + YEARS_NS + lap * length_ns, message)
        for lap in range(2)
        for topic, at, message in sample_records
    ]
    bag = write_bag(tmp_path / "b.mcap", twice)
    done = run_are("replay", bag, "--out", tmp_path / "out")
    assert done.returncode == 1
    assert "the stamps jump back by" in done.stderr
    assert "looped, or a clock was set back" in done.stderr
    done = run_are("replay", bag, "--duration", 2, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", ["b.mcap", "b.db3"])
def test_a_recording_whose_log_looped_is_refused(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path, name: str
) -> None:
    """A simulation begun anew, recorded by its own clock: two drives at once. What is not, can."""
    start_ns = sample_records[0][1]
    end_ns = max(at for _, at, _ in sample_records)
    again = [record for record in sample_records if record[1] > start_ns + 2 * NS_PER_S]
    bag = write_bag(tmp_path / name, [*sample_records, *again])
    done = run_are("replay", bag, "--out", tmp_path / "out")
    assert done.returncode == 1
    until_s = (end_ns - start_ns) / NS_PER_S
    assert f"the log times jump back from {until_s:.1f} s to 2.0 s" in done.stderr
    assert "replay one part of it: --start 0.1 --duration 1.9" in done.stderr
    assert "the clock jumps back (see time)" in run_are("inspect", bag).stdout
    done = run_are("replay", bag, "--duration", 1.5, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr


def test_no_part_is_advised_where_all_is_mixed(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """Two drives from the same time on: no --start takes one of them alone."""
    bag = write_bag(tmp_path / "b.mcap", [*sample_records, *sample_records])
    done = run_are("replay", bag, "--out", tmp_path / "out")
    assert done.returncode == 1
    assert "all of it is mixed" in done.stderr
    said = run_are("inspect", bag).stdout
    assert "the clock jumps back, and no part can be told apart (see time)" in said
    assert "--start" not in said


@pytest.mark.parametrize("name", ["b.mcap", "b.db3"])
def test_the_windows_that_are_named_after_a_jump_can_be_replayed(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path, name: str
) -> None:
    """A clock that was an hour ahead at first, beside a map with the time of its making."""
    day_ns, hour_ns = 24 * 3600 * NS_PER_S, 3600 * NS_PER_S
    first_ns = sample_records[0][1]
    maps = [(topic, first_ns - day_ns, one) for topic, _, one in sample_records if topic == "/map"]
    drive = [record for record in sample_records if record[0] != "/map"]
    ahead = [(topic, at + hour_ns, one) for topic, at, one in drive if at < first_ns + 3 * NS_PER_S]
    bag = write_bag(tmp_path / name, [*maps, *ahead, *drive])
    done = run_are("replay", bag, "--out", tmp_path / "out")
    assert done.returncode == 1
    assert done.stderr.removeprefix("are: ") in run_are("inspect", bag).stdout
    windows = re.findall(r"--start (\S+) --duration (\S+)", done.stderr)
    assert [float(start_s) for start_s, _ in windows] == pytest.approx([0.0, 3600.0], abs=0.11)
    for start_s, duration_s in windows:
        window = ("--start", start_s, "--duration", duration_s)
        done = run_are("replay", bag, *window, "--out", tmp_path / "out")
        assert done.returncode == 0, done.stderr


def test_a_map_from_long_before_does_not_stretch_the_replay(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """A latched map with a log time of 0: the replay begins where the robot does."""
    maps = [(topic, 0, message) for topic, _, message in sample_records if topic == "/map"]
    rest = [record for record in sample_records if record[0] != "/map"]
    bag = write_bag(tmp_path / "b.mcap", [*maps, *rest])
    done = run_are("replay", bag, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "nothing moves in the first" in done.stderr
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert 0 < metrics["ticks"] < 1000
    assert metrics["area_m2"] > 0.0


@pytest.mark.parametrize(
    ("frames", "odometry_child", "expected"),
    [
        ({"odom", "base_link", "base_footprint"}, "", "base_footprint"),
        ({"base_link", "r1/base_footprint"}, "", "base_link"),
        ({"r1/odom", "r1/base_link"}, "", "r1/base_link"),
        ({"r1/base_footprint", "r1/base_link"}, "r1/base_link", "r1/base_footprint"),
        ({"r1/base_link", "r2/base_link"}, "", ""),
        ({"r1/base_link", "r2/base_link"}, "r2/base_link", "r2/base_link"),
        ({"camera_init", "body"}, "body", "body"),
        ({"odom", "my_base_link"}, "", ""),
        ({"odom"}, "body", ""),
    ],
)
def test_the_base_is_told_by_its_name_or_by_the_odometry(
    frames: set[str], odometry_child: str, expected: str
) -> None:
    """A usual name, also in the only namespace; else what the odometry moves, if it is known."""
    assert base_frame_of(frames, odometry_child) == expected
