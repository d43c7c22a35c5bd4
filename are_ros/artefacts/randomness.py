"""Independent random streams, so that one artefact's life never changes another's."""

from enum import IntEnum
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.random.bit_generator import ISeedSequence

from are_ros.artefacts._seeding import seed_words

_TOO_LARGE = 2**63
"""For compiled code; numpy takes any."""


class Purpose(IntEnum):
    """What a stream is drawn for; the numbers are part of every seed, so they never change.

    A new purpose takes a new number at the end.
    """

    ARRIVAL = 0
    GROUP = 1
    ROW = 2
    LIFE = 3
    PLACE = 4
    DEPARTURE = 5
    BEHAVIOUR = 6
    MOTION = 7
    GOAL = 8
    PERCEPTION = 9
    REQUEST = 10


def generator(seed: int, purpose: Purpose, artefact_id: int) -> np.random.Generator:
    """Return the stream of one artefact for one purpose, the same however many others there are.

    `seed` and `artefact_id` are not negative. Streams of different seeds, purposes or artefacts
    are independent (`numpy.random.SeedSequence` with the spawn key (purpose, artefact)).
    """
    if max(seed, artefact_id) >= _TOO_LARGE:
        sequence = np.random.SeedSequence(seed, spawn_key=(int(purpose), artefact_id))
        return np.random.Generator(np.random.PCG64(sequence))
    words: Any = _Words(seed_words(seed, int(purpose), artefact_id))
    return np.random.Generator(np.random.PCG64(words))


class _Words(ISeedSequence):
    """Words that a sequence would give, for a bit generator that asks for just these."""

    def __init__(self, words: npt.NDArray[np.uint64]) -> None:
        self._words = words

    def generate_state(self, n_words: int, dtype: object = np.uint32) -> npt.NDArray[np.uint64]:
        """Return them."""
        del n_words, dtype
        return self._words
