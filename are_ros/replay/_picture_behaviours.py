"""Behaviours in pictures: a mark for each, and how many lives have it."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final

from are_ros.draw.scene import Life

_KNOWN: Final[Mapping[str, str]] = {
    "standing": "s",
    "walking": "o",
    "wandering": "D",
    "running": ">",
    "driving": "h",
    "following": "^",
    "stopping": "$\\Vert$",
    "gathering": "*",
    "crossing": "X",
    "avoiding": "v",
    "leaving": "<",
    "along_way": "P",
}
"""Markers of matplotlib; those of the shipped behaviours are always the same."""

_FURTHER: Final = ("p", "d", "H", "o", "s", "D")


def behaviour_of(life: Life) -> str:
    """Return what it came to do, empty if that is not known."""
    return life.doings[0].behaviour if life.doings else ""


def behaviour_counts(lives: Sequence[Life]) -> dict[str, int]:
    """Return how many lives came for what, the most frequent first."""
    counts = Counter(filter(None, map(behaviour_of, lives)))
    return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))


def behaviour_marks(names: Sequence[str]) -> dict[str, str]:
    """Return the mark of each behaviour, those of the user's own in order of their names."""
    own = sorted(set(names) - set(_KNOWN))
    return {**_KNOWN, **{name: _FURTHER[i % len(_FURTHER)] for i, name in enumerate(own)}}
