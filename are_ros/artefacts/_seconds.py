"""Seconds as people write them, and integer nanoseconds: exact to the nanosecond both ways."""

from decimal import Decimal
from typing import Final

from are_ros.conventions import NS_PER_S

_DIGITS: Final = 9
_MOST_S: Final = 10**_DIGITS


def ns_of_seconds(value: object) -> int:
    """Return a number, or its decimal text, of seconds in [0, 1e9] as the nearest nanosecond.

    A float counts as the shortest text that stands for it, so that 0.1 is 100,000,000 ns. Raises
    ValueError, whose text goes on from the name of a field, for anything else.
    """
    if isinstance(value, bool):
        raise ValueError(f"is {value!r}, but seconds are needed")  # noqa: TRY004 - one kind for all
    text = value.strip() if isinstance(value, str) else repr(value)
    whole, _, part = text.partition(".")
    if _are_digits(whole) and (_are_digits(part) or not part):
        return int(whole) * NS_PER_S + int(part.ljust(_DIGITS, "0"))
    return _ns_of_decimal(text, value)


def seconds_text(t_ns: int) -> str:
    """Return nanoseconds >= 0 as seconds, in as many decimals as it takes and no more."""
    whole, part = divmod(t_ns, NS_PER_S)
    return f"{whole}.{part:09d}".rstrip("0").rstrip(".")


def _are_digits(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) <= _DIGITS


def _ns_of_decimal(text: str, value: object) -> int:
    """Return the nanoseconds of a text in any form that a Decimal may have."""
    try:
        seconds = Decimal(text)
        is_in_range = 0 <= seconds <= _MOST_S
    except ArithmeticError as cause:
        raise ValueError(f"is {value!r}, but seconds are needed") from cause
    if not is_in_range:
        raise ValueError(f"is {text}, but seconds from 0 to 1e9 are taken")
    return int((seconds * NS_PER_S).to_integral_value())
