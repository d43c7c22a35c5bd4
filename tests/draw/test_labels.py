"""Where labels are written: they cover nothing, keep their sides, and go without words at last."""

from itertools import combinations

import numpy as np
import pytest

from are_ros.draw.canvas import Rectangle, text_size
from are_ros.draw.sheet import Label, Labels, Placed

WIDTH, HEIGHT = 400, 300
INSIDE = (0.0, 30.0, float(WIDTH), HEIGHT - 26.0)
SIZE_PX = 11


def labelled(
    number: int, x: float, y: float, *, half: float = 6.0, words: str = "walking"
) -> Label:
    """Return the label of a box about a pixel: with words, or the id alone."""
    texts = (f"{number} {words}", str(number)) if words else (str(number),)
    return Label(number, (x - half, y - half, x + half, y + half), texts)


def placed(labels: Labels, *wanted: Label, taken: tuple[Rectangle, ...] = ()) -> list[Placed]:
    """Return what finds a place."""
    return labels.place(wanted, [*(label.box for label in wanted), *taken])


def crowd(count: int, seed: int) -> list[Label]:
    """Return labels of boxes all over the picture."""
    places = np.random.default_rng(seed).uniform((10, 40), (390, 260), (count, 2))
    return [labelled(i, x, y, words="") for i, (x, y) in enumerate(places.tolist())]


def meet(one: Rectangle, other: Rectangle) -> bool:
    """Tell whether two rectangles overlap."""
    apart = max(one[0] - other[2], other[0] - one[2], one[1] - other[3], other[1] - one[3])
    return apart < -1e-9


@pytest.mark.parametrize("count", [5, 40, 200])
def test_labels_of_a_crowd_cover_nothing(count: int) -> None:
    """Neither each other, nor boxes, nor what is taken, nor the edge of the map."""
    wanted, taken = crowd(count, 2), ((190.0, 140.0, 210.0, 160.0), (70.0, 200.0, 90.0, 220.0))
    found = placed(Labels(INSIDE, SIZE_PX), *wanted, taken=taken)
    assert len(found) == count if count < 20 else 0.2 * count < len(found) <= count
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
    found = placed(Labels(INSIDE, SIZE_PX), *wanted)
    assert found[0].text == "99"
    assert len(found) < 61


def test_a_label_is_above_where_that_is_free() -> None:
    """And elsewhere where above is taken; nowhere, where all is."""
    above = placed(Labels(INSIDE, SIZE_PX), labelled(1, 200, 150))[0].place
    assert above[3] <= 146
    below = placed(Labels(INSIDE, SIZE_PX), labelled(1, 200, 150), taken=(above,))[0].place
    assert below[1] >= 156
    everywhere = (0.0, 0.0, float(WIDTH), float(HEIGHT))
    assert placed(Labels(INSIDE, SIZE_PX), labelled(1, 200, 150), taken=(everywhere,)) == []


def test_where_words_find_no_place_the_id_does() -> None:
    """In a corridor as wide as a number."""
    corridor = ((0.0, 0.0, 190.0, float(HEIGHT)), (210.0, 0.0, float(WIDTH), float(HEIGHT)))
    (narrow,) = placed(Labels(INSIDE, SIZE_PX), labelled(1, 200, 150), taken=corridor)
    assert narrow.text == "1"
    assert 190.0 <= narrow.place[0] < narrow.place[2] <= 210.0


def test_a_label_keeps_its_side() -> None:
    """While that is free, though the one above is free again."""
    labels = Labels(INSIDE, SIZE_PX)
    above = placed(labels, labelled(1, 200, 150))[0].place
    (moved,) = placed(labels, labelled(1, 200, 150), taken=(above,))
    assert not meet(moved.place, above)
    assert placed(labels, labelled(1, 200, 150))[0].place == moved.place


def test_a_label_is_as_large_as_its_text() -> None:
    """Its rectangle is that of the font."""
    (found,) = placed(Labels(INSIDE, SIZE_PX), labelled(1, 200, 150))
    left, top, right, bottom = found.place
    assert (right - left, bottom - top) == text_size("1 walking", SIZE_PX)
