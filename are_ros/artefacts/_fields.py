"""Typed, bounded access to one mapping of a catalogue file; every refusal is one sentence."""

import math
from collections.abc import Collection, Iterator, Mapping
from difflib import get_close_matches
from typing import Any, NoReturn

from are_ros.errors import CatalogueError

_KINDS: Mapping[type, str] = {
    bool: "true or false",
    int: "a number",
    float: "a number",
    str: "text",
    list: "a list",
    dict: "a mapping",
    type(None): "nothing",
}


class Fields:
    """The values of one mapping, the place that a refusal names, and the keys it may have."""

    def __init__(self, place: str, values: object, known: Collection[str], path: str = "") -> None:
        """Take a mapping as YAML gives it (nothing counts as an empty one).

        CatalogueError if it is no mapping, or has a key that is not known.
        """
        self._place = place
        self._path = path
        self._values: dict[Any, Any] = {}
        if values is not None:
            self._values = _mapping(place, values, path)
        for key in self._values:
            self._check_key(key, known)

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def refuse(self, key: str, reason: str) -> NoReturn:
        """Raise CatalogueError for a field."""
        raise CatalogueError(f"{self._place}: {self._path}{key} {reason}")

    def text(self, key: str) -> str:
        """Return a text that is there and not empty."""
        value = self._get(key, str)
        if not value.strip():
            self.refuse(key, "is empty")
        return str(value)

    def choice(self, key: str, known: Collection[str], default: str | None = None) -> str:
        """Return one of the known texts."""
        if default is not None and key not in self._values:
            return default
        value = self.text(key)
        if value not in known:
            self.refuse(key, f"is {value!r}, which is not known{_nearest(value, known)}")
        return value

    def flag(self, key: str, *, default: bool) -> bool:
        """Return true or false."""
        return bool(self._get(key, bool)) if key in self._values else default

    def number(self, key: str, default: float | None = None, *, positive: bool = False) -> float:
        """Return a finite number that is not negative; with `positive`, not 0 either."""
        if default is not None and key not in self._values:
            return default
        return self._checked(key, self._get(key, float), positive=positive)

    def numbers(self, key: str, counts: Collection[int], *, positive: bool = False) -> list[float]:
        """Return a list of finite, not negative numbers, as many as one of `counts`."""
        values = self._get(key, list)
        if len(values) not in counts:
            wanted = " or ".join(str(count) for count in counts)
            self.refuse(key, f"has {len(values)} numbers, but {wanted} are needed")
        return [
            self._checked(f"{key}[{i}]", value, positive=positive) for i, value in enumerate(values)
        ]

    def raw(self, key: str) -> object:
        """Return a value as it is, None if it is not there."""
        return self._values.get(key)

    def section(self, key: str, known: Collection[str]) -> "Fields":
        """Return a mapping inside this one; empty if it is not there."""
        return Fields(self._place, self._values.get(key), known, f"{self._path}{key}.")

    def _get(self, key: str, kind: type) -> Any:
        if key not in self._values:
            self.refuse(key, "is missing")
        value = self._values[key]
        self._check_kind(key, value, kind)
        return value

    def _check_kind(self, key: str, value: object, kind: type) -> None:
        kinds = (int, float) if kind is float else (kind,)
        if not isinstance(value, kinds) or (isinstance(value, bool) and kind is not bool):
            self.refuse(key, f"is {value!r}, but {_KINDS[kind]} is needed")

    def _checked(self, key: str, value: object, *, positive: bool) -> float:
        self._check_kind(key, value, float)
        number = float(value)  # type: ignore[arg-type]  # just checked
        if not math.isfinite(number):
            self.refuse(key, f"is {number}, but a finite number is needed")
        if number < 0.0 or (positive and number == 0.0):
            self.refuse(key, f"is {number:g}, but must be {'positive' if positive else '>= 0'}")
        return number

    def _check_key(self, key: object, known: Collection[str]) -> None:
        if key not in known:
            hint = _nearest(str(key), known)
            self.refuse(str(key), f"is not known{hint}")


def _mapping(place: str, values: object, path: str) -> dict[Any, Any]:
    """Return `values` if it is a mapping."""
    if isinstance(values, dict):
        return values
    subject = f" {path.rstrip('.')}" if path else ""
    found = _KINDS.get(type(values), type(values).__name__)
    raise CatalogueError(f"{place}:{subject} is {found}, but a mapping is needed")


def _nearest(word: str, known: Collection[str]) -> str:
    """Name the nearest known word, or all of them if none is near."""
    near = get_close_matches(word, known, n=1)
    if near:
        return f"; did you mean {near[0]!r}?"
    return f"; known are {', '.join(known)}"
