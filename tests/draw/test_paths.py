"""Tests of the paths of the artefacts in pictures."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from are_ros.agents.events import EventKind
from are_ros.draw import overview
from are_ros.draw.artefacts import (
    displacements,
    draw_paths,
    forced,
    mark_places,
    path_of,
)
from are_ros.draw.canvas import Canvas
from are_ros.draw.map import View, Window
from are_ros.draw.overview import draw_overview
from are_ros.draw.palette import behaviour_marks, class_colours, mark_outline, shade_of
from are_ros.draw.scene import Life, SceneRecord, Track
from tests.draw.made_runs import TICK_NS, event, hall, run, walker

PERSON = (209, 73, 91)
VIEW = View(Window(0.0, 10.0, 0.0, 10.0), 50.0)


def _texts(record: SceneRecord) -> list[str]:
    colours = class_colours([life.row.class_name for life in record.lives])
    marks = behaviour_marks([life.doings[0].behaviour for life in record.lives])
    legends = overview._legends(record, colours, marks, int(record.series.stamps_ns[-1]))
    return [entry.name for legend in legends for entry in legend]


def _ink(*lives: Life) -> npt.NDArray[np.int64]:
    """Return how much the paths of artefacts change each pixel of a white canvas, (h, w)."""
    canvas = Canvas((500, 500))
    paths = [path_of(life, ()) for life in lives]
    draw_paths(canvas, VIEW, paths, class_colours([]), {})
    ink: npt.NDArray[np.int64] = (255 - canvas.pixels.astype(np.int64)).sum(axis=2)
    return ink


def test_a_path_is_drawn_where_it_went(tmp_path: Path) -> None:
    """On it is the colour of the class from end to end, and beside it there is none."""
    life = walker(5, (2, 5), (8, 5), seen=range(100))
    draw_overview(run([life]), hall(), tmp_path / "a.png", occupied_threshold=65)
    image = cv2.imread(str(tmp_path / "a.png"))
    assert image is not None
    red = (image[:, :, 2].astype(int) - image[:, :, 1]) > 60
    rows, cols = np.nonzero(red[:1000])
    across = cols[np.abs(rows - np.median(rows)) <= 3]
    # From 2 to 8 m and half a footprint, of the 10.4 m that are 1020 pixels high.
    assert float(np.ptp(across)) == pytest.approx(6.3 * 1020 / 10.4, rel=0.05)
    assert not red[: int(np.median(rows)) - 60, : int(cols.mean())].any()


def test_a_path_fades_in_and_is_thick_where_perceived() -> None:
    """It gets stronger to its end, and wider where its artefact was perceived."""
    ink = _ink(walker(1, (2, 5), (8, 5), seen=range(50, 100)))
    strongest = ink[240:260].max(axis=0)
    assert strongest[120] < strongest[200] < strongest[280] < strongest[390]
    assert (ink[:, 200] > 20).sum() + 2 <= (ink[:, 390] > 20).sum()


def test_a_jump_is_no_step() -> None:
    """What a displacement moves is not gone by itself, and its pieces lie on both sides."""
    life = walker(1, (2, 5), (4, 5))
    poses = life.footprints.poses.copy()
    poses[50:, 1] += 3.0
    life = replace(life, footprints=Track(life.footprints.stamps_ns.copy(), poses))
    moved = displacements([event(EventKind.DISPLACED, 50, 1)])
    path = path_of(life, moved[1])
    assert np.flatnonzero(path.is_jump).tolist() == [49]
    assert path.length_m == pytest.approx(2.0 * 98 / 99)
    assert not path_of(life, ()).is_jump.any()


def test_long_paths_keep_their_ends_and_jumps() -> None:
    """Of thousands of poses some hundred are drawn, with the ends and both sides of a jump."""
    path = path_of(walker(1, (0, 0), (9, 0), ticks=5000), [TICK_NS * 1235])
    assert len(path.points_m) < 520
    assert path.points_m[[0, -1], 0].tolist() == [0.0, 9.0]
    at = int(np.flatnonzero(path.is_jump)[0])
    assert path.points_m[at : at + 2, 0] == pytest.approx([1233 * 9 / 4999, 1234 * 9 / 4999])


def test_the_legend_counts_behaviours_and_events() -> None:
    """Behaviours with their counts, the most frequent first, and the marks that there are."""
    lives = [
        walker(1, (2, 5), (8, 5)),
        walker(2, (2, 6), (8, 6)),
        walker(3, (2, 7), (8, 7), behaviour="dancing"),
    ]
    events = [event(EventKind.ROBOT_CONTACT, 3, 1), event(EventKind.DISPLACED, 4, 1)] * 2
    texts = _texts(run(lives, events=events))
    for wanted in (
        "walking  2",
        "dancing  1",
        "robot contact  2",
        "displaced  2",
        "person  0 of 3",
    ):
        assert wanted in texts
    assert "field of view" not in texts


def test_an_artefact_that_had_to_leave_is_displaced_too() -> None:
    """As the metrics count: moved by force, or gone for want of a place; marked where that was."""
    lives = [walker(1, (2, 5), (8, 5)), walker(2, (2, 6), (8, 6), ticks=50)]
    left = event(EventKind.DEPARTED, 49, 2)
    events = [event(EventKind.DISPLACED, 4, 1), replace(left, detail="displaced")]
    record = run(lives, events=[*events, replace(left, detail="life_over")])
    assert forced(record) == events
    assert "displaced  2" in _texts(record)
    assert mark_places(record)[0][1].tolist() == pytest.approx([8.0, 6.0])


def test_every_behaviour_has_a_mark() -> None:
    """Shipped ones have their own for ever; those of a user get one each; all can be drawn."""
    marks = behaviour_marks(["walking", "zigzag", "dancing"])
    assert marks["walking"] == behaviour_marks([])["walking"]
    assert marks["dancing"] != marks["zigzag"]
    outlines = [mark_outline(name) for name in {*marks.values(), "burst", "lozenge"}]
    assert all(np.ptp(corners, axis=0).max() == pytest.approx(1.0) for corners in outlines)
    assert all(np.abs(corners).max() < 0.7 for corners in outlines), "about the middle"


def test_an_artefact_that_left_is_pale(tmp_path: Path) -> None:
    """A footprint of one that left before the end is translucent, that of one that stayed not."""
    left = walker(1, (2, 3), (3, 3), ticks=40, seen=[3], gone=True)
    stayed = walker(2, (2, 7), (3, 7), seen=[3])
    draw_overview(run([left, stayed]), hall(), tmp_path / "a.png", occupied_threshold=65)
    image = cv2.imread(str(tmp_path / "a.png"))
    assert image is not None
    full = (image == PERSON[::-1]).all(axis=2)[98:1100]
    assert full[:510].sum() > 500
    assert full[510:].sum() == 0


def test_shades_stay_near_their_class() -> None:
    """Paths of one class differ a little from id to id, and keep their hue."""
    shades = {shade_of(PERSON, number) for number in range(5)}
    assert len(shades) == 5
    assert all(red > 2 * green * 0.9 for red, green, _ in shades)


def test_what_was_displaced_and_touched_is_marked() -> None:
    """A mark for each contact where the robot was, and for each displacement where it ended."""
    events = [event(EventKind.ROBOT_CONTACT, 10, 1), event(EventKind.DISPLACED, 20, 1)]
    way = [(1.0 + 0.01 * i, 1.0, 0.0) for i in range(100)]
    record = run([walker(1, (2, 5), (8, 5))], way=way, events=events)
    displaced, touched = mark_places(record)
    assert touched.tolist() == [pytest.approx([1.1, 1.0])]
    assert displaced.tolist() == [pytest.approx([2 + 6 * 20 / 99, 5.0])]
