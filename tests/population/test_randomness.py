"""Streams of random numbers that do not depend on each other."""

import numpy as np
import pytest
from scipy.stats import kstest

from are_ros.population.randomness import Purpose, generator


def test_a_stream_is_the_same_again() -> None:
    """Seed, purpose and artefact alone make the stream."""
    first = generator(7, Purpose.LIFE, 12).random(5)
    generator(7, Purpose.LIFE, 13).random(100)
    np.testing.assert_array_equal(first, generator(7, Purpose.LIFE, 12).random(5))


def test_the_stream_is_that_of_the_documented_seed_sequence() -> None:
    """Recordings can be reproduced from the spawn key (purpose, artefact)."""
    sequence = np.random.SeedSequence(7, spawn_key=(3, 12))
    expected = np.random.default_rng(sequence).random(4)
    np.testing.assert_array_equal(generator(7, Purpose.LIFE, 12).random(4), expected)


def test_streams_are_seeded_as_numpy_seeds_them() -> None:
    """Seed and number may have any size: one word, two words, or more."""
    rng = np.random.default_rng(3)
    numbers = [0, 1, 2**32 - 1, 2**32, 2**63 - 1, 2**63, 2**64 + 7]
    numbers += [int(rng.integers(2 ** int(bits))) for bits in rng.integers(1, 63, 40)]
    for seed in numbers:
        for number in numbers:
            purpose = Purpose(int(rng.integers(len(Purpose))))
            sequence = np.random.SeedSequence(seed, spawn_key=(int(purpose), number))
            ours = generator(seed, purpose, number).bit_generator.state
            assert ours == np.random.PCG64(sequence).state


@pytest.mark.parametrize(
    "other",
    [(8, Purpose.LIFE, 12), (7, Purpose.PLACE, 12), (7, Purpose.LIFE, 3), (7, Purpose.ROW, 12)],
)
def test_another_key_is_another_stream(other: tuple[int, Purpose, int]) -> None:
    """Changing any one of seed, purpose and artefact changes every number."""
    assert not np.isin(
        generator(7, Purpose.LIFE, 12).random(50), generator(*other).random(50)
    ).any()


def test_the_numbers_of_the_purposes_never_change() -> None:
    """They are part of every seed: a changed one would change old experiments."""
    names = ("ARRIVAL", "GROUP", "ROW", "LIFE", "PLACE", "DEPARTURE", "BEHAVIOUR", "MOTION")
    assert tuple(purpose.name for purpose in Purpose)[: len(names)] == names
    assert [purpose.value for purpose in Purpose] == list(range(len(Purpose)))


def test_first_numbers_of_many_artefacts_are_uniform_and_uncorrelated() -> None:
    """Over 2,000 artefacts the first numbers pass at a false-alarm level of 0.001 each."""
    rows = np.array([generator(1, Purpose.ROW, i).random() for i in range(2000)])
    lives = np.array([generator(1, Purpose.LIFE, i).random() for i in range(2000)])
    assert kstest(rows, "uniform").pvalue > 0.001
    assert abs(np.corrcoef(rows, lives)[0, 1]) < 3.29 / np.sqrt(2000)
