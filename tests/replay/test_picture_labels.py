"""Ids in the overview picture: they cover nothing, and what has no room is counted."""

import math
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from are_ros.replay._picture_artefacts import Drawn, drawn_lives
from are_ros.replay._picture_frame import _subtitle
from are_ros.replay._picture_labels import draw_labels, squares
from are_ros.replay._picture_map import Window
from are_ros.replay._picture_robot import robot_places, tag_rectangles
from tests.replay.film_records import run, walker

Rectangle = tuple[float, float, float, float]
Rectangles = npt.NDArray[np.float64]
NOTHING: Rectangles = np.empty((0, 4))
HEIGHT_M = 0.2
POINTS_PER_M = 7.0 / HEIGHT_M
HALL = Window(0.0, 10.0, 0.0, 10.0)


class Paper:
    """Takes texts as axes do, and keeps what each covers."""

    def __init__(self) -> None:
        self.texts: dict[str, Rectangle] = {}
        self.lines: list[npt.NDArray[np.float64]] = []

    def plot(self, xs: npt.ArrayLike, ys: npt.ArrayLike, **_: Any) -> None:
        """Keep a line: its two ends."""
        self.lines.append(np.column_stack((xs, ys)))

    def text(self, x_m: float, y_m: float, text: str, **_: Any) -> None:
        """Keep a text, centred at a point."""
        half = 0.5 * 0.66 * HEIGHT_M * len(text), 0.5 * HEIGHT_M
        self.texts[text] = (x_m - half[0], y_m - half[1], x_m + half[0], y_m + half[1])


def _labelled(
    drawn: list[Drawn], taken: Rectangles = NOTHING, avoided: Rectangles = NOTHING
) -> dict[str, Rectangle]:
    paper = Paper()
    count = draw_labels(paper, drawn, {}, HALL, POINTS_PER_M, taken, avoided)
    assert count == len(paper.texts)
    return paper.texts


def _standing(places: npt.ArrayLike, seen: int = 0) -> list[Drawn]:
    lives = [
        walker(number, (x, y), (x + 1e-6, y), ticks=2, seen=(0,) if number < seen else ())
        for number, (x, y) in enumerate(np.asarray(places).tolist())
    ]
    return drawn_lives(lives, 10**10)


def _meet(one: Rectangle, other: Rectangle) -> bool:
    apart_m = max(one[0] - other[2], other[0] - one[2], one[1] - other[3], other[1] - one[3])
    return apart_m < -1e-9


def _gap_m(one: Rectangle, other: Rectangle) -> float:
    across = max(one[0] - other[2], other[0] - one[2], 0.0)
    return math.hypot(across, max(one[1] - other[3], other[1] - one[3], 0.0))


def _boxes(drawn: list[Drawn]) -> list[Rectangle]:
    return [(*item.corners_m.min(axis=0), *item.corners_m.max(axis=0)) for item in drawn]


@pytest.mark.parametrize("count", [5, 40, 200])
def test_labels_of_a_crowd_cover_nothing(count: int) -> None:
    """Neither each other, nor artefacts, nor what is taken, nor the edge of the map."""
    drawn = _standing(np.random.default_rng(2).uniform(0.5, 9.5, (count, 2)))
    taken = squares(np.array(((5.0, 5.0), (2.0, 7.0))), 1.0)
    labels = [*_labelled(drawn, taken).values()]
    assert len(labels) == count if count < 100 else 0.3 * count < len(labels) < count
    for label in labels:
        assert not any(_meet(label, other) for other in (*_boxes(drawn), *taken.tolist()))
        assert 0.0 <= label[0] < label[2] <= 10.0
        assert 0.0 <= label[1] < label[3] <= 10.0
    assert not any(_meet(one, other) for one, other in combinations(labels, 2))


def test_perceived_ones_come_first() -> None:
    """Where there is room for few, it is theirs, though others have lower ids."""
    places = np.tile((5.0, 5.0), (60, 1))
    drawn = [
        *_standing(places),
        *drawn_lives([walker(99, (5, 5), (5.000001, 5), ticks=2, seen=(0,))], 10**10),
    ]
    labels = _labelled(drawn)
    assert "99" in labels
    assert len(labels) < 61


def test_what_is_to_be_avoided_is_covered_only_for_want_of_other_room() -> None:
    """A mark beside an artefact moves its id; marks all around do not keep it away."""
    drawn = _standing([(5.0, 5.0)])
    (free,) = _labelled(drawn).values()
    middle = np.array(((free[0] + free[2], free[1] + free[3]),)) / 2
    mark = squares(middle, 0.1)
    (moved,) = _labelled(drawn, avoided=mark).values()
    assert not _meet(moved, tuple(mark[0].tolist()))
    around = np.array(((0.0, 0.0, 10.0, 10.0),))
    assert _labelled(drawn, avoided=around) == _labelled(drawn)
    assert _labelled(drawn, taken=around) == {}


def test_the_subtitle_says_how_many_have_no_room() -> None:
    """And nothing of it where all have."""
    record = run([walker(1, (2, 2), (8, 6))])
    assert _subtitle(record, 0).endswith("numbers are ids, as in metrics.json")
    assert _subtitle(record, 3).endswith(
        "numbers are ids, as in metrics.json; 3 numbers left out for want of room"
    )
    assert _subtitle(record, 0, "/tags").endswith("numbers are ids, as in /tags")


def test_the_robot_and_its_tags_have_places() -> None:
    """At the ends of its way, the tags below; without a pose there are none."""
    record = run([], way=[(1.0 + 0.1 * i, 2.0, 0.0) for i in range(50)])
    assert robot_places(record, ()) == pytest.approx(np.array(((1.0, 2.0), (5.9, 2.0))))
    tags = tag_rectangles(record, POINTS_PER_M, HALL, NOTHING)
    assert tags[:, [0, 2]].mean(axis=1) == pytest.approx((1.0, 5.9))
    assert (tags[:, 3] < 2.0 - 0.2).all()
    assert (len(robot_places(run([]), ())), len(_tags([], NOTHING))) == (0, 0)


def _tags(way: list[tuple[float, float, float]], taken: Rectangles) -> Rectangles:
    return tag_rectangles(run([], way=way), POINTS_PER_M, HALL, taken)


def test_a_tag_makes_way_for_an_artefact() -> None:
    """It goes above, or beside; it stays below where all around is taken, and in the picture."""
    way = [(1.0 + 0.1 * i, 2.0, 0.0) for i in range(50)]
    start, end = _tags(way, NOTHING)
    above = _tags(way, end[np.newaxis])[1]
    assert above[1] > 2.0 + 0.2
    assert above[[0, 2]].mean() == pytest.approx(5.9)
    beside = _tags(way, np.stack((end, above)))[1]
    assert beside[0] > 5.9 + 0.2
    everywhere = np.array(((0.0, 0.0, 10.0, 10.0),))
    assert _tags(way, everywhere) == pytest.approx(np.stack((start, end)))
    low = _tags([(x, 0.4, 0.0) for x, _, _ in way], NOTHING)
    assert (low[:, 1] > 0.4).all()


def test_the_tags_of_a_robot_that_came_back_lie_apart() -> None:
    """Start and end at one place."""
    start, end = _tags([(5.0, 5.0, 0.0)] * 50, NOTHING)
    assert not _meet(tuple(start.tolist()), tuple(end.tolist()))


def test_an_id_that_is_not_right_beside_its_artefact_is_joined_to_it() -> None:
    """By a line to its middle: where it is far, or somebody else nearer; others need none."""
    paper = Paper()
    crowd = _standing(np.random.default_rng(3).uniform(0.5, 9.5, (120, 2)))
    draw_labels(paper, crowd, {}, HALL, POINTS_PER_M, NOTHING, NOTHING)
    wanted = []
    for item, own in zip(crowd, _boxes(crowd), strict=True):
        if label := paper.texts.get(str(item.life.artefact_id)):
            gaps_m = [_gap_m(label, box) for box in _boxes(crowd)]
            if _gap_m(label, own) > min(0.6 * HEIGHT_M, min(gaps_m) + 1e-9):
                wanted.append((tuple(item.centre_m.tolist()), label))
    drawn = {tuple(middle.tolist()): end for end, middle in paper.lines}
    assert drawn.keys() == {middle for middle, _ in wanted}
    assert 0 < len(drawn) < 0.5 * len(paper.texts)
    assert all(_gap_m((*drawn[m], *drawn[m]), label) < 1e-9 for m, label in wanted)
