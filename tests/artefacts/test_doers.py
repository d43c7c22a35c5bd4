"""Who is of which behaviour, kept up to date."""

import numpy as np

from are_ros.artefacts.doers import Doers


def test_they_are_those_whom_looking_through_all_would_find() -> None:
    """Whoever comes, goes, or does something else; ascending."""
    rng, doers, twin = np.random.default_rng(4), Doers(), dict[int, str]()
    names = ("walking", "gathering", "leaving")
    for _ in range(500):
        one, name = int(rng.integers(40)), names[rng.integers(3)]
        if rng.random() < 0.4:
            doers.remove(one)
            twin.pop(one, None)
        else:
            doers.set(one, name)
            twin[one] = name
        for asked in names:
            assert list(doers.of(asked)) == sorted(i for i in twin if twin[i] == asked)


def test_nobody_is_of_a_behaviour_that_was_never_named() -> None:
    """And one who is not known can be forgotten."""
    doers = Doers()
    doers.remove(3)
    assert list(doers.of("dancing")) == []
