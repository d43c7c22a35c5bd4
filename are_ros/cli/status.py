"""The exit status of `are`; 0 is all well, 2 wrong usage."""

from typing import Final

FAILED: Final = 1
IMPERFECT: Final = 3
INTERRUPTED: Final = 130
