"""Frames by name and by number."""

from are_ros.errors import UnknownFrameError


class FrameNames:
    """Numbers the frames in the order in which they come; leading slashes do not count.

    `numbers` holds each spelling that was met, so that the usual case is one look at a dict.
    """

    def __init__(self) -> None:
        self.numbers: dict[str, int] = {}
        self._names: list[str] = []

    def __getitem__(self, number: int) -> str:
        return self._names[number]

    def __len__(self) -> int:
        return len(self._names)

    def __contains__(self, name: str) -> bool:
        return name.lstrip("/") in self.numbers

    def sorted(self) -> list[str]:
        """Return all names, in alphabetical order."""
        return sorted(self._names)

    def number_or_add(self, name: str) -> int:
        """Return a frame's number, a new one for a new name."""
        number = self.numbers.get(name)
        if number is not None:
            return number
        plain = name.lstrip("/")
        number = self.numbers.get(plain)
        if number is None:
            number = len(self._names)
            self._names.append(plain)
        self.numbers[name] = self.numbers[plain] = number
        return number

    def number(self, name: str) -> int:
        """Return a known frame's number, or raise UnknownFrameError."""
        number = self.numbers.get(name.lstrip("/"))
        if number is None:
            known = ", ".join(self.sorted()) or "none"
            raise UnknownFrameError(f"frame {name!r} was never seen; known frames: {known}")
        return number
