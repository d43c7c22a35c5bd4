"""How messages are built: each adapter gives a factory for its own kind of message object."""

from typing import Any, Protocol


class MessageFactory(Protocol):
    """Builds message objects of one middleware.

    `type_name` is the full name, as "nav_msgs/msg/OccupancyGrid". A field that is left out has its
    type's default. Arrays of numbers come as one-dimensional numpy arrays of the field's dtype,
    nested messages as what `make` returned, sequences of strings or messages as lists.
    """

    def make(self, type_name: str, /, **fields: Any) -> Any:
        """Return a new message object of the type with the fields given."""
