"""Tests of the ways of the artefacts in the overview picture."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from are_ros.builder.events import EventKind
from are_ros.draw.scene import SceneRecord, Track
from are_ros.replay import overview
from are_ros.replay._picture_behaviours import behaviour_counts, behaviour_marks
from are_ros.replay._picture_marks import forced
from are_ros.replay._picture_paths import displacements, shade_of, way_of
from are_ros.replay.overview import draw_overview
from tests.replay.film_records import TICK_NS, event, hall, run, walker


def _figure(record: SceneRecord) -> Any:
    return overview._figure(record, hall(), 65)


def _texts(figure: Any) -> list[str]:
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def test_a_way_is_drawn_where_it_went(tmp_path: Path) -> None:
    """Half way there is the colour of the class, and beside the way there is none."""
    life = walker(5, (2, 5), (8, 5), seen=range(100))
    draw_overview(run([life]), hall(), tmp_path / "a.png", occupied_threshold=65)
    image = cv2.imread(str(tmp_path / "a.png"))
    assert image is not None
    red = (image[:, :, 2].astype(int) - image[:, :, 1]) > 60
    rows, cols = np.nonzero(red)
    across = cols[np.abs(rows - np.median(rows)) <= 3]
    width_px = float(np.ptp(across))
    # From 2 to 8 m and half a footprint, of 10 m that the hall is wide.
    figure = _figure(run([life]))
    per_m = figure.axes[0].transData.transform([(1, 0), (0, 0)])
    assert width_px == pytest.approx(6.3 * (per_m[0, 0] - per_m[1, 0]), rel=0.05)
    assert not red[: int(np.median(rows)) - 60, : int(cols.mean())].any()


def test_a_way_fades_in_and_is_thick_where_perceived() -> None:
    """The pieces of a line get more opaque, and those that were perceived are thicker."""
    figure = _figure(run([walker(1, (2, 5), (8, 5), seen=range(50, 100))]))
    (line,) = [one for one in figure.axes[0].collections if len(one.get_linewidths()) == 99]
    alphas, widths = line.get_colors()[:, 3], np.asarray(line.get_linewidths())
    assert (np.diff(alphas) > 0).all()
    assert widths[10] < 0.5 * widths[80]


def test_a_jump_is_no_step() -> None:
    """What a displacement moves is not gone on foot, and its pieces lie on both sides."""
    life = walker(1, (2, 5), (4, 5))
    poses = life.footprints.poses.copy()
    poses[50:, 1] += 3.0
    life = replace(life, footprints=Track(life.footprints.stamps_ns.copy(), poses))
    moved = displacements([event(EventKind.DISPLACED, 50, 1)])
    way = way_of(life, moved[1])
    assert np.flatnonzero(way.is_jump).tolist() == [49]
    assert way.length_m == pytest.approx(2.0 * 98 / 99)
    assert not way_of(life, ()).is_jump.any()


def test_long_ways_keep_their_ends_and_jumps() -> None:
    """Of thousands of poses some hundred are drawn, with the ends and both sides of a jump."""
    way = way_of(walker(1, (0, 0), (9, 0), ticks=5000), [TICK_NS * 1235])
    assert len(way.points_m) < 520
    assert way.points_m[[0, -1], 0].tolist() == [0.0, 9.0]
    at = int(np.flatnonzero(way.is_jump)[0])
    assert way.points_m[at : at + 2, 0] == pytest.approx([1233 * 9 / 4999, 1234 * 9 / 4999])


def test_the_legend_counts_behaviours_and_events() -> None:
    """Behaviours with their counts, the most frequent first, and the marks that there are."""
    lives = [
        walker(1, (2, 5), (8, 5)),
        walker(2, (2, 6), (8, 6)),
        walker(3, (2, 7), (8, 7), behaviour="dancing"),
    ]
    assert behaviour_counts(lives) == {"walking": 2, "dancing": 1}
    events = [event(EventKind.ROBOT_CONTACT, 3, 1), event(EventKind.DISPLACED, 4, 1)] * 2
    texts = _texts(_figure(run(lives, events=events)))
    for wanted in (
        "walking  2",
        "dancing  1",
        "robot contact  2",
        "displaced  2",
        "person  0 of 3",
    ):
        assert wanted in texts
    assert "field of view" not in texts


def test_who_had_to_leave_is_displaced_too() -> None:
    """As the metrics count: moved by force, or gone for want of a place; marked where that was."""
    lives = [walker(1, (2, 5), (8, 5)), walker(2, (2, 6), (8, 6), ticks=50)]
    left = event(EventKind.DEPARTED, 49, 2)
    events = [event(EventKind.DISPLACED, 4, 1), replace(left, detail="displaced")]
    record = run(lives, events=[*events, replace(left, detail="life_over")])
    assert forced(record) == events
    figure = _figure(record)
    assert "displaced  2" in _texts(figure)
    (marks,) = [line for line in figure.axes[0].lines if line.get_marker() == "d"]
    assert marks.get_xydata()[1].tolist() == pytest.approx([8.0, 6.0])


def test_every_behaviour_has_a_mark() -> None:
    """Shipped ones have their own for ever; those of a user get one each."""
    marks = behaviour_marks(["walking", "zigzag", "dancing"])
    assert marks["walking"] == behaviour_marks([])["walking"]
    assert marks["dancing"] != marks["zigzag"]


def test_followers_point_to_their_leaders() -> None:
    """The label of a follower names whom it follows, and dotted rungs join the two."""
    follows = "following artefact 1"
    follower = walker(2, (2, 5), (8, 5), behaviour="following", activity=follows)
    figure = _figure(run([walker(1, (3, 5), (9, 5)), follower]))
    labels = {text.get_text() for text in figure.axes[0].texts}
    assert "2\u21921" in labels
    assert {"following", "following  1"} <= {*_texts(figure)}


def test_who_left_is_pale() -> None:
    """A footprint of who left before the end is translucent, that of who stayed is not."""
    left = walker(1, (2, 5), (3, 5), ticks=40, seen=[3], gone=True)
    stayed = walker(2, (2, 7), (3, 7), seen=[3])
    patches = _figure(run([left, stayed])).axes[0].patches
    alphas = [p.get_alpha() for p in patches if p.get_facecolor()[:3] == to_rgb("#d1495b")]
    assert alphas == [0.38, 1.0]


def test_shades_stay_near_their_class() -> None:
    """Ways of one class differ a little from id to id, and keep their hue."""
    shades = {shade_of("#d1495b", number) for number in range(5)}
    assert len(shades) == 5
    assert all(red > 2 * green * 0.9 for red, green, _ in shades)


def test_what_was_displaced_and_touched_is_marked() -> None:
    """A mark for each contact where the robot was, and for each displacement where it ended."""
    events = [event(EventKind.ROBOT_CONTACT, 10, 1), event(EventKind.DISPLACED, 20, 1)]
    way = [(1.0 + 0.01 * i, 1.0, 0.0) for i in range(100)]
    figure = _figure(run([walker(1, (2, 5), (8, 5))], way=way, events=events))
    places = {
        str(line.get_marker()): line.get_xydata()[0].tolist()
        for line in figure.axes[0].lines
        if line.get_markerfacecolor() in {"#e63946", "#ffd166"} and len(line.get_xydata()) == 1
    }
    assert places["(8, 1, 0.0)"] == pytest.approx([1.1, 1.0])
    assert places["d"] == pytest.approx([2 + 6 * 20 / 99, 5.0])
