"""Tests of what surrounds a map: its scale, and the rows of a legend."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from are_ros.draw.canvas import text_size
from are_ros.draw.map import Window
from are_ros.draw.palette import INK
from are_ros.draw.sheet import Entry, Sheet, lines_of, patch_sign, round_length_m, rows_of
from tests.draw.made_runs import texts_written


@pytest.mark.parametrize(
    ("longest_m", "length_m"), [(0.0123, 0.01), (0.2, 0.2), (1.12, 1.0), (4.9, 2.0), (73.0, 50.0)]
)
def test_the_scale_is_a_round_length(longest_m: float, length_m: float) -> None:
    """The largest of 1, 2, 5 times a power of ten that is not longer."""
    assert round_length_m(longest_m) == pytest.approx(length_m)


def test_the_scale_is_as_long_as_it_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a window of 10 m it is a bracket of a metre; it stands above the map, and hides none."""
    sheet = Sheet.of(Window(0.0, 10.0, 0.0, 10.0), [])
    written = texts_written(monkeypatch)
    sheet.write(tmp_path / "a.png", "title", ["", "below it"])
    assert written == ["title", "below it", "1 m"]
    image = cv2.imread(str(tmp_path / "a.png"))
    assert image is not None
    left, top, right, bottom = (round(side) for side in sheet.view.rectangle)
    is_ink = (image == INK[::-1]).all(axis=2)
    bracket = np.flatnonzero(is_ink[38])
    assert np.ptp(bracket) == pytest.approx(sheet.view.px_per_m, abs=3)
    assert bracket.max() == pytest.approx(right, abs=2)
    assert not is_ink[top:bottom, left:right].any()


def test_legends_break_into_rows() -> None:
    """No row is wider than there is room, no entry gets lost, and the order stays."""
    entries = [Entry(f"entry {'x' * (i % 7)}{i}", patch_sign((0, 0, 0))) for i in range(20)]
    rows = rows_of(entries, 400.0, 14)
    assert [entry for row in rows for entry in row] == entries
    assert len(rows) > 3
    assert all(sum(entry.width_px(14) for entry in row) <= 400.0 for row in rows)


def test_a_long_subtitle_breaks_into_lines() -> None:
    """Between its parts, in their order; one that has room stays one line."""
    parts = [f"part {'x' * 9}{i}" for i in range(12)]
    lines = lines_of(parts, 500.0)
    assert "   ·   ".join(lines) == "   ·   ".join(parts)
    assert 1 < len(lines) < len(parts)
    assert all(text_size(line, 15)[0] <= 500.0 for line in lines)
    assert len(lines_of(parts, 5000.0)) == 1
