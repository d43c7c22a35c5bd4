"""Tests of the paths of the artefacts in pictures."""

from dataclasses import replace
from pathlib import Path as File

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from are_ros.agents.events import EventKind
from are_ros.draw import overview
from are_ros.draw.artefacts import (
    Path,
    contact_places,
    draw_paths,
    forced,
    places_of,
)
from are_ros.draw.canvas import Canvas
from are_ros.draw.map import View, Window
from are_ros.draw.overview import draw_overview
from are_ros.draw.palette import behaviour_colours, class_colours, mark_outline
from are_ros.draw.scene import Life, SceneRecord
from tests.draw.made_runs import event, hall, run, walker

PERSON = (209, 73, 91)
VIEW = View(Window(0.0, 10.0, 0.0, 10.0), 50.0)


def _texts(record: SceneRecord) -> list[str]:
    colours = class_colours([life.row.class_name for life in record.lives])
    behaviours = behaviour_colours([life.doings[0].behaviour for life in record.lives])
    legends = overview._legends(record, colours, behaviours, int(record.series.stamps_ns[-1]))
    return [entry.name for legend in legends for entry in legend]


def _ink(*lives: Life) -> npt.NDArray[np.int64]:
    """Return how much the paths of artefacts change each pixel of a white canvas, (h, w)."""
    canvas = Canvas((500, 500))
    paths = [Path.of(life) for life in lives]
    draw_paths(canvas, VIEW, paths, class_colours([]), {})
    ink: npt.NDArray[np.int64] = (255 - canvas.pixels.astype(np.int64)).sum(axis=2)
    return ink


def test_a_path_is_drawn_where_it_went(tmp_path: File) -> None:
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


def test_a_long_path_is_drawn_whole() -> None:
    """Every pose of it is a point."""
    path = Path.of(walker(1, (0, 0), (9, 0), ticks=5000))
    assert len(path.points_m) == 5000
    assert path.length_m == pytest.approx(9.0)


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
    assert places_of(record, forced(record))[1].tolist() == pytest.approx([8.0, 6.0])


def test_every_behaviour_has_a_colour() -> None:
    """Shipped ones have their own for ever; those of a user get one each."""
    colours = behaviour_colours(["walking", "zigzag", "dancing"])
    assert colours["walking"] == behaviour_colours([])["walking"]
    assert colours["dancing"] != colours["zigzag"]


def test_every_mark_can_be_drawn() -> None:
    """It is as wide as is asked for, about the middle."""
    outlines = [mark_outline(name) for name in ("disc", "burst", "lozenge")]
    assert all(np.ptp(corners, axis=0).max() == pytest.approx(1.0) for corners in outlines)
    assert all(np.abs(corners).max() < 0.7 for corners in outlines)


def test_an_artefact_that_left_is_pale(tmp_path: File) -> None:
    """A footprint of one that left before the end is translucent, that of one that stayed not."""
    left = walker(1, (2, 3), (3, 3), ticks=40, seen=[3], gone=True)
    stayed = walker(2, (2, 7), (3, 7), seen=[3])
    draw_overview(run([left, stayed]), hall(), tmp_path / "a.png", occupied_threshold=65)
    image = cv2.imread(str(tmp_path / "a.png"))
    assert image is not None
    full = (image == PERSON[::-1]).all(axis=2)[98:1100]
    assert full[:510].sum() > 500
    assert full[510:, 290:].sum() == 0, "right of the mark at the beginning of its path"


def test_what_was_displaced_and_touched_is_marked() -> None:
    """A mark for each contact where the robot was, and for each displacement where it ended."""
    events = [event(EventKind.ROBOT_CONTACT, 10, 1), event(EventKind.DISPLACED, 20, 1)]
    way = [(1.0 + 0.01 * i, 1.0, 0.0) for i in range(100)]
    record = run([walker(1, (2, 5), (8, 5))], way=way, events=events)
    assert contact_places(record).tolist() == [pytest.approx([1.1, 1.0])]
    displaced = places_of(record, forced(record))
    assert displaced.tolist() == [pytest.approx([2 + 6 * 20 / 99, 5.0])]
