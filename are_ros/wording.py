"""How sentences for a person say how many there are, and which."""

from collections.abc import Sequence


def counted(count: int, noun: str) -> str:
    """Return a number of things: "1 message", "2 messages", "3 boxes"."""
    return f"{count} {noun}" if count == 1 else f"{count} {several(noun)}"


def several(noun: str) -> str:
    """Return the plural of a regular noun: "messages", "boxes"."""
    return noun + ("es" if noun.endswith(("ch", "s", "sh", "x")) else "s")


def why_refused(cause: OSError) -> str:
    """Return in words why the system refuses to make or to write something."""
    if isinstance(cause, FileExistsError):
        return "it is a file"
    if isinstance(cause, IsADirectoryError):
        return "it is a folder"
    return (cause.strerror or str(cause)).lower()


def listed(words: Sequence[str]) -> str:
    """Return words as a sentence names them: "a", "a and b", "a, b and c"."""
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))
