"""What is known of a recording's time before its replay: gaps, waits, and the clock of stamps."""

import json
from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import numpy as np
import pytest

from are_ros.bag.clock import BagClock, Ints, RecordedTimes, Times
from are_ros.bag.reader import BagReader
from are_ros.bag.stretches import (
    Window,
    needed_wait_s,
    scan_waits,
    stretches_of,
    wait_sentence,
)
from are_ros.conventions import NS_PER_S
from are_ros.errors import BagError
from are_ros.world.transforms.tree import FrameTree

Records = Sequence[tuple[str, int, Any]]
WriteBag = Callable[[Path, Records], Path]
RunAre = Callable[..., CompletedProcess[str]]

S = NS_PER_S
DAY = 86_400 * S
NO_TURN = (0.0, 0.0, 0.0, 1.0)
MANY = ("--set", "population.arrival_rate:=0.02", "--set", "population.mean_life:=60")


def every(period_ns: int, start_ns: int, stop_ns: int) -> Ints:
    """Return instants that are a period apart."""
    return np.arange(start_ns, stop_ns, period_ns, dtype=np.int64)


def times_of(moving: Ints, *sources: Times, **other: Any) -> RecordedTimes:
    """Return recorded times of what moves and of sources; the rest is empty."""
    empty: dict[str, Any] = {"edges": {}, "static_edges": frozenset(), "scans": {}}
    return RecordedTimes(0, tuple(sources), moving_log_ns=moving, **{
        **empty, "scan_frames": {}, **other
    })  # fmt: skip


def source(name: str, log_ns: Ints, ahead_ns: int, *, is_edge: bool = False) -> Times:
    """Return a source whose stamps lie so much later than its log times."""
    return Times(name, log_ns, log_ns + ahead_ns, is_edge)


def test_gaps_strays_and_ends() -> None:
    """A drive, a stray message, another drive, and a stray at the end: two spans and a gap."""
    drives = every(S // 10, DAY, DAY + 20 * S), every(S // 10, 2 * DAY, 2 * DAY + 20 * S)
    strays = np.array([DAY + 3600 * S, 3 * DAY])
    moving = np.sort(np.concatenate((*drives, strays)))
    times = times_of(moving)
    found = stretches_of(times, BagClock.of(times), 0, 4 * DAY)
    ends = tuple((int(one[0]), int(one[-1]) + 1) for one in drives)
    assert found.spans == ends
    assert [gap.length_ns for gap in found.gaps] == [ends[1][0] - ends[0][1]]
    ahead, gap, behind = found.sentences(DAY)
    assert ahead == "nothing moves in the first 24.0 h: the replay begins after them"
    assert "a gap in which nothing moves (24.0 h long, 19.90 s into it)" in gap
    assert behind.startswith("nothing moves in the last 48.0 h")


def test_a_pause_of_less_than_a_minute_is_no_gap() -> None:
    """Fifty-nine seconds are replayed, sixty-one are not; from ten seconds on, it is said."""
    for pause_s, spans, said in (
        (59, 1, "a pause"),
        (61, 2, "a gap"),
        (10, 1, "a pause"),
        (9, 1, ""),
    ):
        again_ns = 10 * S + pause_s * S
        moving = np.concatenate((every(S, 0, 11 * S), every(S, again_ns, again_ns + 10 * S)))
        times = times_of(moving)
        found = stretches_of(times, BagClock.of(times), 0, int(moving[-1]) + 1)
        assert len(found.spans) == spans
        text = f"{said} in which nothing moves ({pause_s}"
        assert [text in sentence for sentence in found.sentences(0)] == ([True] if said else [])


def test_a_window_that_ends_in_a_gap_ends_with_what_moves() -> None:
    """However little of the gap lies in it: what moves next, behind the window, tells the gap."""
    moving = every(S, 0, 11 * S)
    for next_ns, stop_ns in ((50 * S, 40 * S), (75 * S, int(moving[-1]) + 1)):
        times = replace(times_of(moving), next_moving_ns=next_ns)
        found = stretches_of(times, BagClock.of(times), 0, 40 * S)
        assert found.spans == ((0, stop_ns),)


def test_a_window_that_begins_in_a_gap_begins_with_what_moves() -> None:
    """However little of the gap lies in it: the time since which nothing moves tells the gap."""
    moving = every(S, 100 * S, 111 * S)
    for since_ns, start_ns in ((41 * S, 90 * S), (40 * S, 100 * S)):
        times = replace(times_of(moving), still_since_ns=since_ns)
        found = stretches_of(times, BagClock.of(times), 90 * S, 111 * S)
        assert found.spans == ((start_ns, 111 * S),)
        assert (found.ahead is None) == (start_ns == 90 * S)


def test_a_window_within_a_gap_has_no_span() -> None:
    """A gap on both sides of it, or up to the recording's end; a shorter pause is replayed."""
    none = np.empty(0, np.int64)
    for since_ns, next_ns, has_span in (
        (40 * S, 101 * S, False), (40 * S, 99 * S, True), (30 * S, None, False), (None, None, True)
    ):  # fmt: skip
        times = replace(times_of(none), still_since_ns=since_ns, next_moving_ns=next_ns)
        found = stretches_of(times, BagClock.of(times), 80 * S, 91 * S)
        assert found.spans == (((80 * S, 91 * S),) if has_span else ())
        assert [gap.length_ns for gap in found.gaps] == ([] if has_span else [11 * S])


def test_what_moves_for_a_second_between_gaps_is_replayed() -> None:
    """A shorter stretch is stray messages; where there is nothing else, they are replayed."""
    moving = every(S, 0, 11 * S)
    for length_ns, is_kept in ((S, True), (S - 1, False)):
        begin_ns = 200 * S
        stray = np.array([begin_ns, begin_ns + length_ns - 1], np.int64)
        times = times_of(np.concatenate((moving, stray)))
        found = stretches_of(times, BagClock.of(times), 0, 300 * S)
        spans = ((0, 10 * S + 1), (begin_ns, begin_ns + length_ns))
        assert found.spans == (spans if is_kept else spans[:1])
        alone = times_of(stray)
        found = stretches_of(alone, BagClock.of(alone), 0, 300 * S)
        assert found.spans == spans[1:]


def test_a_replay_of_a_gap_alone_is_refused(
    run_are: RunAre, sample_records: Records, write_bag: WriteBag, tmp_path: Path
) -> None:
    """In one sentence, before anything is compiled or written."""
    parted, _, _ = with_gap(list(sample_records), 100 * S)
    bag = write_bag(tmp_path / "b.mcap", parted)
    window = ("--start", "30", "--duration", "20")
    done = run_are("replay", bag, *window, "--out", tmp_path / "out")
    assert done.returncode == 1
    assert "nothing moves in the 20.0 s that --start and --duration choose" in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_start_after_the_end_says_how_long_the_drive_is(
    sample_records: Records, write_bag: WriteBag, tmp_path: Path
) -> None:
    """From what moves first on, as --start counts; a map of an hour before is no part of it."""
    records = [
        (topic, at_ns - (3600 * S if topic == "/map" else 0), message)
        for topic, at_ns, message in sample_records
    ]
    bag = write_bag(tmp_path / "b.mcap", sorted(records, key=lambda one: one[1]))
    with BagReader([bag]) as reader:
        window = Window.of(reader, {"/tf": "tf"}, 0.0, None)
        length_s = (window.stop_ns - window.begin_ns) / S
        with pytest.raises(BagError, match=f"the recording is {length_s:.1f} s long, nothing"):
            Window.of(reader, {"/tf": "tf"}, 3000.0, None)
    assert length_s < 60.0


def test_what_moved_before_a_window_is_looked_for_a_minute_back(
    sample_records: Records, write_bag: WriteBag, tmp_path: Path
) -> None:
    """The last message before it, else that minute's beginning; nothing at the recording's own."""
    parted, middle_ns, again_ns = with_gap(list(sample_records), 100 * S)
    with BagReader([write_bag(tmp_path / "b.mcap", parted)]) as reader:

        def since_ns(start_ns: int) -> int | None:
            roles = {"/odom": "odom"}
            return RecordedTimes.read(reader, roles, start_ns, reader.end_ns).still_since_ns

        odometry = [at for topic, at, _ in parted if topic == "/odom" and at < middle_ns]
        assert since_ns(reader.start_ns) is None
        assert since_ns(middle_ns + 30 * S) == odometry[-1]
        assert since_ns(again_ns - 10 * S) == again_ns - 70 * S


@pytest.mark.parametrize("ahead_s", [-12.0, -7.6, -0.6, 0.3, 7.6, 12.0])
@pytest.mark.parametrize("late_s", [0.0, 0.4])
def test_stamps_of_another_clock_are_gone_by(ahead_s: float, late_s: float) -> None:
    """Wherever stamps lie, and however late scans come: a constant shift, said with its figure."""
    log = every(S // 20, DAY, DAY + 30 * S)
    ahead = round(ahead_s * S)
    sources = (
        source("/odom", log, ahead - S // 100),
        source("map -> odom", log, ahead + S // 2, is_edge=True),
        source("/scan", log, ahead - round(late_s * S)),
    )
    clock = BagClock.of(times_of(log, *sources))
    assert abs(clock.at(DAY + S) - DAY - S - ahead) <= S // 50
    assert f"{abs(ahead_s - 0.01):.2f} s {'ahead of' if ahead > 0 else 'behind'}" in clock.sentence
    assert clock.disagreement == ""


@pytest.mark.parametrize("ahead_s", [-0.4, 0.0, 0.1])
def test_delays_are_no_other_clock(ahead_s: float) -> None:
    """A message that is under way for 0.4 s leaves the log's time alone."""
    log = every(S // 20, DAY, DAY + 30 * S)
    clock = BagClock.of(times_of(log, source("/odom", log, round(ahead_s * S))))
    assert (clock.sentence, clock.at(DAY)) == ("", DAY)


def test_a_source_with_another_clock_is_named() -> None:
    """The scans' clock is 7.6 s off: the others' is gone by, and the scans are named."""
    log = every(S // 20, DAY, DAY + 30 * S)
    sources = (
        source("/odom", log, 0),
        source("odom -> base", log, 0, is_edge=True),
        source("/scan", log, -7_600_000_000),
    )
    clock = BagClock.of(times_of(log, *sources))
    assert clock.at(DAY) == DAY
    assert clock.disagreement.startswith("/scan is stamped up to 7.60 s earlier than /odom")
    assert "there is no common clock" in clock.disagreement


def test_waits_are_those_of_the_frame_tree() -> None:
    """Random delays of two edges and of the scans: as a tree that is fed in order finds them."""
    rng = np.random.default_rng(11)

    def delayed(stamps: Ints, most_s: float) -> tuple[Ints, Ints]:
        log = stamps + rng.integers(0, round(most_s * S), len(stamps))
        order = np.argsort(log)
        return log[order], stamps[order]

    edges = {
        ("map", "odom"): Times("", *delayed(every(S // 5, 0, 20 * S), 0.2), is_edge=True),
        ("odom", "base"): Times("", *delayed(every(S // 30, 0, 20 * S), 0.1), is_edge=True),
    }
    scans = Times("/scan", *delayed(every(S // 7 + 1, S, 19 * S), 0.15))
    times = times_of(
        scans.log_ns, edges=edges, static_edges=frozenset({("base", "laser")}),
        scans={"/scan": scans}, scan_frames={"/scan": "laser"},
    )  # fmt: skip
    waits = scan_waits(times, BagClock.of(times), "map")

    tree = FrameTree()
    tree.set_static("base", "laser", (0.0, 0.0, 0.0), NO_TURN)
    came = sorted(
        (log, edge, stamp)
        for edge, one in edges.items()
        for log, stamp in zip(one.log_ns.tolist(), one.stamps_ns.tolist(), strict=True)
    )
    waiting = dict(enumerate(scans.stamps_ns.tolist()))
    expected = np.zeros(len(waiting), np.int64)
    for log, (parent, child), stamp in came:
        tree.set_transform(parent, child, stamp, (0.0, 0.0, 0.0), NO_TURN)
        for key, stamp_ns in list(waiting.items()):
            if tree.try_lookup("map", "laser", stamp_ns) is not None:
                expected[key] = max(0, log - int(scans.log_ns[key]))
                del waiting[key]
    assert not waiting
    assert waits["/scan"].tolist() == expected.tolist()
    assert (
        needed_wait_s(waits, 2.0) * S > expected.max() >= needed_wait_s(waits, 2.0) * S - S // 100
    )


def with_gap(records: Records, gap_ns: int) -> tuple[list[tuple[str, int, Any]], int, int]:
    """Return records parted in the middle by a gap, with a map in it, and the log of its ends."""
    start_ns = records[0][1]
    middle_ns = start_ns + 5 * S // 2
    parted: list[tuple[str, int, Any]] = []
    for topic, at, message in records:
        if at < middle_ns:
            parted.append((topic, at, message))
        elif topic in {"/odom", "/tf", "/scan", "/camera/camera_info"}:
            message = deepcopy(message)  # noqa: PLW2901 - other tests have the records, too
            stamped = [message.header] if hasattr(message, "header") else []
            stamped += [one.header for one in getattr(message, "transforms", [])]
            for header in stamped:
                if header.stamp.sec * S + header.stamp.nanosec < start_ns + 10 * S:
                    header.stamp.sec += gap_ns // S
            parted.append((topic, at + gap_ns, message))
    grid = next(message for topic, _, message in records if topic == "/map")
    parted.append(("/map", middle_ns + gap_ns // 2, grid))
    return sorted(parted, key=lambda one: one[1]), middle_ns, middle_ns + gap_ns


def test_a_gap_is_left_out(
    run_are: RunAre, write_bag: WriteBag, sample_bag: Path, tmp_path: Path
) -> None:
    """Three years in the middle: nothing is written in them, all go before, all checks pass."""
    with BagReader([sample_bag]) as reader:
        messages = reader.messages(stop_ns=reader.start_ns + 5 * S)
        records = [(m.topic, m.log_time_ns, reader.deserialize(m)) for m in messages]
    parted, from_ns, until_ns = with_gap(records, 3 * 365 * DAY)
    bag, out = write_bag(tmp_path / "b.mcap", parted), tmp_path / "out"
    done = run_are("replay", bag, *MANY, "--with-inputs", "--out", out)
    assert done.returncode == 0, done.stderr
    assert "the recording has a gap in which nothing moves (3.0 years long" in done.stderr
    with BagReader([out / "augmented.mcap"]) as reader:
        assert not [*reader.messages(None, from_ns + S, until_ns - S)]
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["ticks"] <= 51
    assert metrics["duration_s"] < 5.0
    lives = metrics["lives"]
    before = [life for life in lives if life["arrival_s"] < 3.0]
    assert before
    assert {life["left_by"] for life in before if life["departure_s"] is None} == set()
    assert "recording_gap" in {life["left_by"] for life in before}
    checked = run_are("check", out)
    assert checked.returncode == 0, checked.stdout
    assert "3.0 years long" in run_are("inspect", bag).stdout


def test_late_transforms_are_waited_for(
    run_are: RunAre, write_bag: WriteBag, sample_records: Records, tmp_path: Path
) -> None:
    """No scan is lost; the value in force is said, kept, and repeats the run byte for byte."""
    late = {"/odom", "/tf"}
    records = [(t, at + (3 * S // 10) * (t in late), message) for t, at, message in sample_records]
    bag = write_bag(tmp_path / "b.mcap", sorted(records, key=lambda one: one[1]))
    done = run_are("replay", bag, *MANY, "--out", tmp_path / "a")
    assert "the transforms come late: sensors.tf_wait was 0.3" in done.stderr
    scans = json.loads((tmp_path / "a/metrics.json").read_text())["scans"]["/scan"]
    assert scans["held"] + scans["passed_through"] <= 4, "those at the end have no transform"
    effective = tmp_path / "a/effective.yaml"
    run_are("replay", bag, "--params", effective, "--out", tmp_path / "b")
    one, other = ((tmp_path / name / "augmented.mcap").read_bytes() for name in "ab")
    assert one == other
    done = run_are("replay", bag, "--set", "sensors.tf_wait:=0.05", "--out", tmp_path / "c")
    assert "sensors.tf_wait is 0.05 s, but this recording needs 0.3" in done.stderr


def test_waits_that_no_scan_can_wait_for_are_told_apart() -> None:
    """A transform that comes when the poses are forgotten is late, one that never comes is not."""
    waits = np.array([0, S // 10, 2 * S])
    assert needed_wait_s({"/scan": waits}, 2.0) == 0.11
    assert needed_wait_s({"/scan": waits}, 4.0) == 2.01
    said = wait_sentence("/scan", "scan", waits, 5)
    assert "1 of 5 scans get their transform after more than 1.5 s" in said
    assert "2 of 5 scans never get their transform" in said
