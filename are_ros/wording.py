"""How sentences for a person say how many there are."""


def counted(count: int, noun: str) -> str:
    """Return a number of things: "1 message", "2 messages"."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
