"""Where the labels of a film are written."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from are_ros.replay._film_actors import Actor
from are_ros.replay._film_canvas import FLOOR, FOOTER_PX, HEADER_PX
from are_ros.replay._film_labels import Labels
from tests.replay.film_records import walker

Picture = npt.NDArray[np.uint8]
WALL = (88, 95, 104)
WIDTH, HEIGHT = 400, 300


def ground(*walls: tuple[slice, slice]) -> Picture:
    """Return a floor with walls at (rows, columns)."""
    picture: Picture = np.full((HEIGHT, WIDTH, 3), FLOOR, dtype=np.uint8)
    for wall in walls:
        picture[wall] = WALL
    return picture


def actor(
    number: int, x: float, y: float, *, seen: bool = True, words: str = "walking", half: float = 6.0
) -> Actor:
    """Return somebody at a pixel, of 12 pixels to a side."""
    offsets = half * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    corners = offsets + np.array((x, y))
    nose = np.array([(x, y), (x + half, y)], dtype=np.float64)
    text = f"{number} {words}"
    return Actor(walker(number, (0, 0), (1, 1)), seen, corners, nose, (), (200, 0, 0), text)


def boxes(before: Picture, after: Picture) -> tuple[int, int, int, int]:
    """Return left, top, right and bottom of what was written."""
    rows, columns = np.nonzero((before != after).any(axis=2))
    return int(columns.min()), int(rows.min()), int(columns.max()), int(rows.max())


def drawn(labels: Labels, floor: Picture, actors: Sequence[Actor]) -> Picture:
    """Return a picture with labels alone."""
    picture: Picture = floor.copy()
    labels.draw(picture, actors, ())
    return picture


def test_a_label_is_above_where_there_is_floor() -> None:
    """And elsewhere where above is a wall: no pixel of the wall is touched."""
    floor = ground()
    above = boxes(floor, drawn(Labels(floor), floor, [actor(1, 200, 150)]))
    assert above[3] <= 146
    walled = ground((slice(100, 142), slice(0, WIDTH)))
    picture = drawn(Labels(walled), walled, [actor(1, 200, 150)])
    assert (picture[100:142] == WALL).all()
    assert boxes(walled, picture)[1] >= 142


def test_where_words_find_no_floor_the_id_does() -> None:
    """In a corridor as wide as a number; and where there is no floor, upon the wall."""
    shaft = ground((slice(0, HEIGHT), slice(0, 190)), (slice(0, HEIGHT), slice(210, WIDTH)))
    left, _, right, _ = boxes(shaft, drawn(Labels(shaft), shaft, [actor(1, 200, 150)]))
    assert 190 <= left < right < 210
    dark = ground((slice(0, HEIGHT), slice(0, WIDTH)))
    left, _, right, _ = boxes(dark, drawn(Labels(dark), dark, [actor(1, 200, 150)]))
    assert right - left > 30


def test_of_many_only_the_perceived_have_words() -> None:
    """But each has its id."""
    floor = ground()
    crowd = [actor(n, 30 + 40 * (n % 9), 60 + 60 * (n // 9), seen=n == 0) for n in range(18)]
    picture = drawn(Labels(floor), floor, crowd)
    for one in crowd:
        x, y = one.nose_px[0].astype(int).tolist()
        part = (slice(y - 22, y - 5), slice(x - 19, x + 20))
        columns = np.flatnonzero((picture[part] != floor[part]).any(axis=(0, 2)))
        assert len(columns) > 0
        assert (np.ptp(columns) > 25) == one.is_perceived


def test_labels_cover_neither_each_other_nor_header_and_footer() -> None:
    """Two beside each other, and two at the edges."""
    floor = ground()
    pair = [actor(1, 200, 150), actor(2, 214, 150)]
    alone = drawn(Labels(floor), floor, pair[:1])
    both = drawn(Labels(floor), floor, pair)
    first = (alone != floor).any(axis=2)
    assert (both[first] == alone[first]).all()
    edges = [actor(3, 100, HEADER_PX + 7), actor(4, 300, HEIGHT - FOOTER_PX - 7)]
    picture = drawn(Labels(floor), floor, edges)
    assert (picture[:HEADER_PX] == floor[:HEADER_PX]).all()
    assert (picture[HEIGHT - FOOTER_PX :] == floor[HEIGHT - FOOTER_PX :]).all()
    assert (picture != floor).any()


def test_words_that_found_no_place_come_back_after_a_while() -> None:
    """Not at once, lest they flicker; and a label keeps its side while that is free."""
    shaft = ground((slice(0, HEIGHT), slice(0, 190)), (slice(0, HEIGHT), slice(210, 290)))
    labels = Labels(shaft)
    assert np.ptp(boxes(shaft, drawn(labels, shaft, [actor(1, 200, 150)]))[::2]) < 20
    widths = [
        np.ptp(boxes(shaft, drawn(labels, shaft, [actor(1, 345, 150)]))[::2]) for _ in range(14)
    ]
    assert widths[0] < 20
    assert widths[-1] > 30
    assert sum(a != b for a, b in pairwise(widths)) == 1


def test_a_large_artefact_bears_its_label_where_nothing_else_is_free() -> None:
    """Beside the line to its front."""
    hole = ground((slice(0, HEIGHT), slice(0, WIDTH)))
    hole[150 - 62 : 150 + 62, 200 - 62 : 200 + 62] = FLOOR
    picture = drawn(Labels(hole), hole, [actor(1, 200, 150, half=60.0)])
    left, top, right, bottom = boxes(hole, picture)
    assert 140 <= left < right <= 260
    assert 90 <= top < bottom < 150
