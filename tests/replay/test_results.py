"""Tests of the numbers that a replay leaves."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from are_ros.agents.events import ArtefactEvent, EventKind, SceneMetrics
from are_ros.builder.sensors.sensor_path import SensorPathCounts
from are_ros.draw.scene import Life, SceneRecord, TickSeries, Track
from are_ros.population.catalogue import CatalogueRow
from are_ros.population.meshes.shapes import Shape
from are_ros.replay.progress import Stopwatch
from are_ros.replay.results import (
    metrics_content,
    summary_lines,
    timing_content,
    write_json,
)
from are_ros.world.boxes import OrientedBoxes
from are_ros.world.footprint import Footprint, signed_distance_m

PERSON = CatalogueRow(3, "tall", "person", (0.4, 0.6, 1.8), (0.0, 0.0, 0.0), Shape.WALL)
CAR = CatalogueRow(8, "small", "car", (4.0, 1.7, 1.5), (0.0, 0.0, 0.0), Shape.WALL)
HALF_CAR = 0.5 * np.array([CAR.size_m])
S = 1_000_000_000
START_NS = 1_000 * S


def _empty_track(width: int) -> Track:
    return Track(np.zeros(0, dtype=np.int64), np.zeros((0, width)))


def _record(ticks: int = 3) -> SceneRecord:
    """Return two lives, one of them perceived; one artefact was blocked."""
    seen_ns, never = np.array([START_NS, START_NS]), np.zeros(0, dtype=np.int64)
    lives = (
        Life(1, PERSON, START_NS, START_NS + S, "life_over", _empty_track(3), seen_ns),
        Life(2, CAR, START_NS + S // 2, None, "", _empty_track(3), never),
    )
    events = (
        ArtefactEvent(START_NS + S, EventKind.DEPARTED, 1, "tall", "life_over"),
        ArtefactEvent(START_NS + S, EventKind.BLOCKED, 3, "small", "no_place"),
    )
    stamps = START_NS + S * np.arange(ticks, dtype=np.int64)
    counts = np.arange(ticks, dtype=np.int64)
    clutter = np.where(counts == 0, math.nan, 0.1 * counts)
    return SceneRecord(
        seed=5,
        max_range_m=9.0,
        footprint=Footprint.disc(0.2),
        robot=_empty_track(3),
        camera=_empty_track(7),
        views=(),
        view_of_pose=counts[:0],
        lives=lives if ticks else (),
        events=events if ticks else (),
        series=TickSeries(stamps, counts, counts.copy(), clutter, 1 if ticks else 0),
        metrics=SceneMetrics(1, 0, 2, 1, 1, 0, 0, math.nan, 0.2) if ticks else None,
    )


SCANS = {"/scan": SensorPathCounts(7, 2, 1)}
COUNTS = ({"scan": SCANS, "range": {}}, {"/tf": 4}, {"/b": 3, "/a": 1})
NONE: Any = ({}, {}, {})


def test_metrics() -> None:
    """The metrics say how many, of which class, why, and when."""
    content = metrics_content(_record(), *COUNTS)
    assert (content["arrivals"], content["blocked_by_cause"]) == (2, {"no_place": 1})
    assert content["departures_by_cause"] == {"life_over": 1}
    assert content["classes"] == {
        "car": {"arrived": 1, "perceived": 0, "closest_m": None},
        "person": {"arrived": 1, "perceived": 1, "closest_m": None},
    }
    assert content["alive"] == {"mean": 1.0, "max": 2}
    assert content["clutter_ratio"] == pytest.approx({"mean": 0.15, "max": 0.2})
    assert (content["duration_s"], content["ticks"], content["perceived_ever"]) == (2.0, 3, 1)
    assert content["scans"] == {"/scan": {"exact": 7, "held": 2, "passed_through": 1}}
    assert list(content["written"]) == ["/a", "/b"]


def test_without_perception_nothing_is_said_to_be_perceived() -> None:
    """What nobody looked for is not known: null in the metrics, and no count in the summary."""
    record = _record()
    record = replace(record, series=replace(record.series, blind_ticks=None))
    content = metrics_content(record, *NONE)
    assert content["perceived"] == {"mean": None, "max": None}
    assert content["perceived_ever"] is content["ticks_without_perception"] is None
    assert content["classes"]["car"] == {"arrived": 1, "perceived": None, "closest_m": None}
    summary = "\n".join(summary_lines(content))
    assert "perceived  left out\n" in summary
    assert " of 1" not in summary


def test_lives_in_seconds_since_the_first_tick() -> None:
    """Each life has its row and its instants; what did not happen is null."""
    first, second = metrics_content(_record(), *COUNTS)["lives"]
    assert first == {
        "id": 1,
        "row": 3,
        "label": "tall",
        "class": "person",
        "arrival_s": 0.0,
        "departure_s": 1.0,
        "left_by": "life_over",
        "first_perceived_s": 0.0,
        "last_perceived_s": 0.0,
        "ticks_perceived": 2,
        "robot_contacts": 0,
        "closest_m": None,
        "closest_s": None,
    }
    assert (second["arrival_s"], second["departure_s"], second["left_by"]) == (0.5, None, None)


def test_how_close_the_robot_came() -> None:
    """Tick by tick as the footprint at the robot's pose says, while the artefact was there."""
    random = np.random.default_rng(7)
    stamps_ns = START_NS + S * np.arange(40, dtype=np.int64)
    robot = Track(stamps_ns[1:], random.uniform(-3.0, 3.0, (39, 3)))
    walked = Track(stamps_ns[5:30:3], random.uniform(-3.0, 3.0, (9, 3)))
    outline = Footprint(np.array([(0.5, 0.3), (0.5, -0.3), (-0.2, -0.3), (-0.2, 0.3)]), 0.1)
    never = np.zeros(0, dtype=np.int64)
    life = Life(1, CAR, stamps_ns[5], stamps_ns[31], "life_over", walked, never)
    later = replace(life, artefact_id=2, row=PERSON, arrival_ns=stamps_ns[-1] + 1)
    record = replace(_record(40), footprint=outline, robot=robot, lives=(life, later))
    expected = {}
    for stamp_ns, pose in zip(stamps_ns[5:31].tolist(), robot.poses[4:].tolist(), strict=False):
        x_m, y_m, yaw_rad = life.footprint_at(stamp_ns)
        box = OrientedBoxes(np.array([[x_m, y_m, 0.0]]), np.array([yaw_rad]), HALF_CAR)
        expected[stamp_ns] = signed_distance_m(outline.at(*pose), box)[0]
    found_ns, distances_m = record.robot_distances(life)
    assert found_ns.tolist() == list(expected)
    assert distances_m == pytest.approx(list(expected.values()), abs=1e-12)
    closest_ns = min(expected, key=expected.__getitem__)
    content = metrics_content(record, *NONE)
    first, second = content["lives"]
    assert first["closest_m"] == round(expected[closest_ns], 6)
    assert first["closest_s"] == (closest_ns - START_NS) / S
    assert second["closest_m"] is content["classes"]["person"]["closest_m"] is None
    assert content["classes"]["car"]["closest_m"] == first["closest_m"] < 0.0
    text = f"; {-first['closest_m']:.2f} m into small 1 after {first['closest_s']:.1f} s"
    assert text in "\n".join(summary_lines(content))
    content["lives"][0]["closest_m"] = 0.25
    assert "; closest 0.25 m from small 1 after" in "\n".join(summary_lines(content))


def test_a_touch_is_no_distance() -> None:
    """Who was touched has moved aside at the tick: it counts as 0 m, at the first touch."""
    robot = Track(START_NS + S * np.arange(2, dtype=np.int64), np.zeros((2, 3)))
    stood = Track(robot.stamps_ns[:1], np.array([(5.0, 0.0, 0.0)]))
    never = np.zeros(0, dtype=np.int64)
    lives = tuple(Life(k, PERSON, START_NS, None, "", stood, never) for k in (1, 2))
    touches = tuple(
        ArtefactEvent(START_NS + k * S // 4, EventKind.ROBOT_CONTACT, 2, "tall") for k in (1, 2)
    )
    content = metrics_content(replace(_record(2), robot=robot, lives=lives, events=touches), *NONE)
    first, second = content["lives"]
    assert first["closest_m"] > 4.0
    assert second["closest_m"] == 0.0 == content["classes"]["person"]["closest_m"]
    assert (first["robot_contacts"], second["robot_contacts"], second["closest_s"]) == (0, 2, 0.25)
    summary = "\n".join(summary_lines(content | {"robot_contacts": 2}))
    assert "2 contacts with 1 artefact; closest 0.00 m from tall 2 after 0.2 s" in summary


@pytest.mark.parametrize("ticks", [0, 1, 3])
def test_files_are_strict_json(tmp_path: Path, ticks: int) -> None:
    """What is not known is null, never NaN, and the file reads back as it was written."""
    content = metrics_content(_record(ticks), *NONE)
    write_json(tmp_path / "metrics.json", content)
    text = (tmp_path / "metrics.json").read_text(encoding="utf-8")
    assert text.endswith("}\n")
    assert "NaN" not in text
    assert json.loads(text) == content
    assert content["area_m2"] is None


def test_timing() -> None:
    """Timing has phases, percentiles of a tick, and the real-time factor proper and overall."""
    clock = Stopwatch({"start_up": 0.25, "replay": 0.75}, [0.001] * 99 + [0.101])
    content = timing_content(_record(), clock)
    assert content["real_time_factor"] == pytest.approx(2.0 / 0.75)
    assert content["real_time_factor_overall"] == pytest.approx(2.0)
    assert content["tick_ms"] == pytest.approx({"p50": 1.0, "p90": 1.0, "p99": 2.0, "max": 101.0})
    assert content["phases_s"] == {"start_up": 0.25, "replay": 0.75}


def test_timing_of_nothing() -> None:
    """Without a tick and without a phase there are no figures, and no error."""
    content = timing_content(_record(0), Stopwatch({}))
    assert content["real_time_factor"] is None
    assert content["tick_ms"]["p50"] is None


def test_summary() -> None:
    """The summary names what a person asks for first, in aligned lines."""
    metrics = metrics_content(_record(), *COUNTS)
    lines = summary_lines(metrics, timing_content(_record(), Stopwatch({"replay": 0.5})))
    text = "\n".join(lines)
    assert "2.0 s in 3 ticks, 4 times real time; 0.5 s in all" in text
    for taken_s, factor in ((2.0, "1"), (5.0, "0.4"), (125.0, "0.016"), (0.1, "20")):
        slow = timing_content(_record(), Stopwatch({"replay": taken_s}))
        assert f"ticks, {factor} times real time" in summary_lines(metrics, slow)[0]
    assert "2 arrived, 1 departed, 1 blocked; alive 1.0 on average, 2 at most" in text
    assert "1 of 2 at some time; 1 of 3 ticks without camera or its pose" in text
    assert (
        "7 augmented at their stamp, 2 augmented with the latest map->odom (that of their stamp"
        in text
    )
    assert " came too late), 1 passed through unaugmented" in text
    assert "0 contacts with artefacts" in text
    assert "4 messages on 2 topics" in text
    assert len({line.index("  ", 2) for line in lines if line.startswith("  ")}) >= 1


def test_summary_says_what_its_seconds_hold() -> None:
    """All phases that there were."""
    metrics = metrics_content(_record(), *COUNTS)
    phases = {"start_up": 1.0, "replay": 0.5, "picture": 2.0}
    for animation, text in (
        ({}, "3.5 s with start-up and picture"),
        ({"animation": 4.0}, "7.5 s with start-up, picture and animation"),
    ):
        timing = timing_content(_record(), Stopwatch(phases | animation))
        assert summary_lines(metrics, timing)[0].endswith(text)


def test_ranges_are_no_scans() -> None:
    """They have a key and a line of their own, where there are any."""
    assert "ranges" not in metrics_content(_record(), *COUNTS)
    readings = {"scan": SCANS, "range": {"/sonar": SensorPathCounts(3, 0, 0)}}
    metrics = metrics_content(_record(), readings, {}, {})
    assert list(metrics["scans"]) == ["/scan"]
    assert metrics["ranges"] == {"/sonar": {"exact": 3, "held": 0, "passed_through": 0}}
    assert "range /sonar  3 augmented at their stamp" in summary_lines(metrics)


def test_summary_of_nothing() -> None:
    """A replay without ticks is summed up, too."""
    lines = summary_lines(metrics_content(_record(0), *NONE))
    assert lines[0].endswith("0.0 s in 0 ticks")
