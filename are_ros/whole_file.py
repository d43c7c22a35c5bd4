"""Files that are written as a whole, or not at all."""

from contextlib import suppress
from pathlib import Path


def write_whole(path: Path, content: bytes) -> None:
    """Write a file. Raises OSError, and leaves nothing of it, but for a device as /dev/full."""
    try:
        path.write_bytes(content)
    except OSError:
        if path.is_file():
            with suppress(OSError):
                path.unlink()
        raise
