"""What a reader of recordings raised, as one sentence a user can act on."""

from collections.abc import Iterator
from contextlib import contextmanager

from are_ros.errors import AreError, BagError

_REINDEX = "it ends too early or is damaged; `rosbag reindex` may repair it"
_RECOVER = "it ends too early (an interrupted recording?); `mcap recover` may repair it"
_DATABASE = "it is no rosbag2 database, or a damaged one"

_SENTENCES = (
    ("not indexed", "it has no index; `rosbag reindex` makes one"),
    ("index looks damaged", _REINDEX),
    ("Header could not be read", _REINDEX),
    ("of requested", _REINDEX),
    ("File end magic", _RECOVER),
    ("Truncated record", _RECOVER),
    ("Invalid MCAP", _RECOVER),
    ("File magic is invalid", "its first bytes are not those of a bag of this kind"),
    ("seems to be empty", "the file is empty"),
    ("Profile is not ros2", "it is an MCAP file of another kind than ROS 2"),
    ("Could not load YAML", "its metadata.yaml is malformed"),
    ("files are missing", "files that its metadata.yaml names are missing"),
    ("database", _DATABASE),
)

_PLAIN_SPOKEN = ("ReaderError", "SerdeError", "TypesysError", "FileNotFoundError")
"""Errors whose own text says what is wrong with the data; others speak of the code that failed."""


@contextmanager
def as_bag_errors(what: str) -> Iterator[None]:
    """Turn whatever is raised inside into a BagError that begins with `what`; ours pass."""
    try:
        yield
    except AreError:
        raise
    except Exception as cause:  # rosbags, its codecs and SQLite raise all kinds on bad bytes
        message = f"{what}: {sentence_of(cause)}"
        raise BagError(message) from cause


def sentence_of(error: Exception) -> str:
    """Return in plain words what is wrong with the recording, without a full stop."""
    text = " ".join(" ".join(str(part) for part in error.args).split()).rstrip(".")
    for part, sentence in _SENTENCES:
        if part in text:
            return sentence
    name = type(error).__name__
    if isinstance(error, PermissionError):
        return "there is no permission to read it"
    return f"it cannot be read: {text}" if name in _PLAIN_SPOKEN else f"it is damaged ({name})"
