"""Independent random streams: what one artefact draws never changes what another draws."""

from enum import IntEnum

import numpy as np
import numpy.typing as npt


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
    DECISION = 11
    CLASSIFICATION = 12
    ESTIMATION = 13
    FALSE_ALARM = 14
    APPEARANCE = 15
    INTENT = 16
    IMAGE_NOISE = 17
    INITIAL = 18


def generator(seed: int, purpose: Purpose, artefact_id: int) -> np.random.Generator:
    """Return the stream of one artefact for one purpose, the same however many others there are.

    `seed` and `artefact_id` are not negative. Streams of different seeds, purposes or artefacts
    are independent (`numpy.random.SeedSequence` with the spawn key (purpose, artefact)).
    """
    sequence = np.random.SeedSequence(seed, spawn_key=(int(purpose), artefact_id))
    return np.random.Generator(np.random.PCG64(sequence))


def inverted(cumulative: npt.NDArray[np.float64], random: np.random.Generator) -> int:
    """Draw an index by cumulative weights (N,), the last one > 0, with one uniform number."""
    uniform = random.random() * cumulative[-1]
    return int(np.searchsorted(cumulative, uniform, side="right"))
