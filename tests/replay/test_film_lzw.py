"""Tests of the compression of GIF."""

import numpy as np
import pytest

from are_ros.replay._film_lzw import compressed


def _decoded(data: bytes) -> list[int]:
    """Return the indices, by the obvious decoder: a list of words, bit by bit."""
    size0, body, at = data[0], b"", 1
    while data[at]:
        body += data[at + 1 : at + 1 + data[at]]
        at += 1 + data[at]
    assert at == len(data) - 1
    bits = "".join(f"{byte:08b}"[::-1] for byte in body)
    clear = 1 << size0
    words: list[list[int]] = []
    found: list[int] = []
    last: list[int] | None = None
    place, size = 0, size0 + 1
    while True:
        code = int(bits[place : place + size][::-1], 2)
        place += size
        if code == clear:
            words = [[i] for i in range(clear)] + [[], []]
            last, size = None, size0 + 1
            continue
        if code == clear + 1:
            assert len(bits) - place < 8
            return found
        if last is None:
            word = words[code]
        else:
            word = words[code] if code < len(words) else [*last, last[0]]
            if len(words) < 4096:
                words.append([*last, word[0]])
        found += word
        last = word
        if len(words) == 1 << size and size < 12:
            size += 1


@pytest.mark.parametrize("levels", [1, 2, 7, 256])
@pytest.mark.parametrize("side", [1, 2, 30, 300])
def test_it_decodes_to_what_it_was(levels: int, side: int) -> None:
    """Noise, runs and single pixels come back, also where the table is full many times."""
    random = np.random.default_rng(levels + side)
    indices = random.integers(0, levels, (side, side), dtype=np.uint8)
    assert _decoded(compressed(indices)) == indices.ravel().tolist()


def test_the_same_again_is_short() -> None:
    """A picture of one colour takes a thousandth of its pixels."""
    assert len(compressed(np.full((1000, 1000), 3, dtype=np.uint8))) < 2500
