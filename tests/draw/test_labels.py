"""Where labels are written: they cover nothing, keep their places, and go without words at last."""

import math
from itertools import combinations

import numpy as np
import numpy.typing as npt
import pytest

from are_ros.draw.canvas import Rectangle, text_size
from are_ros.draw.sheet import Label, Labels, Placed

Mask = npt.NDArray[np.bool_]
WIDTH, HEIGHT = 400, 300
INSIDE = (0.0, 30.0, float(WIDTH), HEIGHT - 26.0)
SIZE_PX = 11


def ground(*walls: tuple[slice, slice]) -> Mask:
    """Return a floor with walls at (rows, columns)."""
    mask = np.zeros((HEIGHT, WIDTH), dtype=np.bool_)
    for wall in walls:
        mask[wall] = True
    return mask


SHAFT = ground((slice(0, HEIGHT), slice(0, 190)), (slice(0, HEIGHT), slice(210, WIDTH)))
DARK = ground((slice(0, HEIGHT), slice(0, WIDTH)))


def labelled(
    number: int, x: float, y: float, *, half: float = 6.0, words: str = "walking"
) -> Label:
    """Return the label of a box about a pixel: with words, or the id alone."""
    texts = (f"{number} {words}", str(number)) if words else (str(number),)
    return Label(number, (x - half, y - half, x + half, y + half), texts)


def placed(labels: Labels, *wanted: Label, taken: tuple[Rectangle, ...] = ()) -> list[Placed]:
    """Return what finds a place."""
    return labels.place(wanted, [label.box for label in wanted], taken)


def crowd(count: int, seed: int) -> list[Label]:
    """Return labels of boxes all over the picture."""
    places = np.random.default_rng(seed).uniform((10, 40), (390, 260), (count, 2))
    return [labelled(i, x, y, words="") for i, (x, y) in enumerate(places.tolist())]


def meet(one: Rectangle, other: Rectangle) -> bool:
    """Tell whether two rectangles overlap."""
    apart = max(one[0] - other[2], other[0] - one[2], one[1] - other[3], other[1] - one[3])
    return apart < -1e-9


def gap_px(one: Rectangle, other: Rectangle) -> float:
    """Return how far two rectangles are apart."""
    across = max(one[0] - other[2], other[0] - one[2], 0.0)
    return math.hypot(across, max(one[1] - other[3], other[1] - one[3], 0.0))


@pytest.mark.parametrize("count", [5, 40, 200])
def test_labels_of_a_crowd_cover_nothing(count: int) -> None:
    """Neither each other, nor boxes, nor what is taken, nor the edge of the map."""
    wanted, taken = crowd(count, 2), ((190.0, 140.0, 210.0, 160.0), (70.0, 200.0, 90.0, 220.0))
    found = placed(Labels(ground(), INSIDE, SIZE_PX), *wanted, taken=taken)
    assert len(found) == count if count < 20 else 0.3 * count < len(found) <= count
    for one in found:
        others = [label.box for label in wanted if label is not one.label]
        assert not any(meet(one.place, other) for other in (*others, *taken))
        assert INSIDE[0] <= one.place[0] < one.place[2] <= INSIDE[2]
        assert INSIDE[1] <= one.place[1] < one.place[3] <= INSIDE[3]
    assert not any(meet(one.place, other.place) for one, other in combinations(found, 2))


def test_the_first_ones_come_first() -> None:
    """Where there is room for few, it is theirs, though others have lower ids."""
    wanted = [
        labelled(99, 200, 150, words=""),
        *(labelled(i, 200, 150.0, words="") for i in range(60)),
    ]
    found = placed(Labels(ground(), INSIDE, SIZE_PX), *wanted)
    assert found[0].text == "99"
    assert len(found) < 61


def test_a_label_is_above_where_there_is_floor() -> None:
    """And elsewhere where above is a wall: no pixel of the wall is touched."""
    (above,) = placed(Labels(ground(), INSIDE, SIZE_PX), labelled(1, 200, 150))
    assert above.place[3] <= 146
    walled = ground((slice(100, 142), slice(0, WIDTH)))
    (below,) = placed(Labels(walled, INSIDE, SIZE_PX), labelled(1, 200, 150))
    assert below.place[1] >= 142


def test_what_is_to_be_avoided_is_covered_only_for_want_of_other_room() -> None:
    """Walls all around do not keep a label away; what is taken all around does."""
    free = placed(Labels(ground(), INSIDE, SIZE_PX), labelled(1, 200, 150))
    dark = placed(Labels(DARK, INSIDE, SIZE_PX), labelled(1, 200, 150))
    assert [one.place for one in dark] == [one.place for one in free]
    everywhere = (0.0, 0.0, float(WIDTH), float(HEIGHT))
    assert (
        placed(Labels(ground(), INSIDE, SIZE_PX), labelled(1, 200, 150), taken=(everywhere,)) == []
    )


def test_where_words_find_no_floor_the_id_does() -> None:
    """In a corridor as wide as a number; and where there is no floor, words upon the wall."""
    (narrow,) = placed(Labels(SHAFT, INSIDE, SIZE_PX), labelled(1, 200, 150))
    assert narrow.text == "1"
    assert 189.5 <= narrow.place[0] < narrow.place[2] <= 210.5
    (wide,) = placed(Labels(DARK, INSIDE, SIZE_PX), labelled(1, 200, 150))
    assert wide.text == "1 walking"


def test_words_that_found_no_place_come_back_after_a_while() -> None:
    """Not at once, lest they flicker; and a label keeps its side while that is free."""
    half_open = SHAFT.copy()
    half_open[:, 290:] = False
    labels = Labels(half_open, INSIDE, SIZE_PX)
    assert placed(labels, labelled(1, 200, 150))[0].text == "1"
    texts = [placed(labels, labelled(1, 345, 150))[0].text for _ in range(14)]
    assert texts == ["1"] * 9 + ["1 walking"] * 5
    kept = placed(labels, labelled(1, 345, 150))[0].place
    (moved,) = placed(labels, labelled(1, 345, 150), taken=(kept,))
    assert not meet(moved.place, kept)
    assert placed(labels, labelled(1, 345, 150))[0].place == moved.place


def test_a_large_artefact_bears_its_label_where_nothing_else_is_free() -> None:
    """Beside the line to its front."""
    hole = DARK.copy()
    hole[150 - 62 : 150 + 62, 200 - 62 : 200 + 62] = False
    (found,) = placed(Labels(hole, INSIDE, SIZE_PX), labelled(1, 200, 150, half=60.0))
    left, top, right, bottom = found.place
    assert 140 <= left < right <= 260
    assert 90 <= top < bottom < 150


def test_a_label_that_is_not_right_beside_its_box_is_unclear() -> None:
    """Where it is far, or another box nearer; the others are clear."""
    wanted = crowd(120, 3)
    found = placed(Labels(ground(), INSIDE, SIZE_PX), *wanted)
    for one in found:
        own = gap_px(one.place, one.label.box)
        least = min(gap_px(one.place, label.box) for label in wanted)
        assert one.is_unclear == (own > min(7.0, least + 1e-9))
    assert 0 < sum(one.is_unclear for one in found) < 0.7 * len(found)


def test_a_label_is_as_large_as_its_text() -> None:
    """Its rectangle is that of the font."""
    (found,) = placed(Labels(ground(), INSIDE, SIZE_PX), labelled(1, 200, 150))
    left, top, right, bottom = found.place
    assert (right - left, bottom - top) == text_size("1 walking", SIZE_PX)
