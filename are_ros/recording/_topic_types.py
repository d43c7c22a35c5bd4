"""What is needed to record a type: its definition for the file, its class for the middleware."""

from typing import Any

from are_ros.node.message_classes import message_class
from are_ros.replay.installed_types import InstalledTypes

_NO_HASH = f"RIHS01_{'0' * 64}"


class TopicTypes:
    """The types of the recorded topics; `store` describes those that were asked for."""

    def __init__(self, installed: InstalledTypes | None = None) -> None:
        self._installed = InstalledTypes() if installed is None else installed

    @property
    def store(self) -> Any:
        """The typestore of rosbags."""
        return self._installed.store

    def class_of(self, type_name: str) -> type[Any]:
        """Return rclpy's class of a type whose definition is known then as well.

        InputError or NodeError, with the reason, where one of the two is not installed.
        """
        self._installed.learn(type_name)
        found: type[Any] = message_class(type_name)
        return found

    def is_as_published(self, type_name: str, type_hash: str) -> bool:
        """Tell whether a publisher's type hash is that of the definition known here.

        Publishers that tell no hash, as those of older middlewares, are believed.
        """
        if not type_hash.startswith("RIHS01_") or type_hash == _NO_HASH:
            return True
        return bool(type_hash == self.store.hash_rihs01(type_name))
