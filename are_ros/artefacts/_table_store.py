"""Tables kept by key up to so much memory."""

from collections import OrderedDict
from typing import Generic, Protocol, TypeVar


class Sized(Protocol):
    """What knows how much memory it takes."""

    @property
    def nbytes(self) -> int:
        """Memory [bytes]."""


Key = TypeVar("Key")
Table = TypeVar("Table", bound=Sized)


class TableStore(Generic[Key, Table]):
    """The least recently used go first; the newest stays whatever it needs."""

    def __init__(self, budget_bytes: int) -> None:
        self._budget_bytes = budget_bytes
        self._tables: OrderedDict[Key, Table] = OrderedDict()
        self.nbytes = 0

    def __len__(self) -> int:
        return len(self._tables)

    def clear(self) -> None:
        """Forget all."""
        self._tables.clear()
        self.nbytes = 0

    def get(self, key: Key) -> Table | None:
        """Return the table of a key, used now; None if it is not known, or not any more."""
        table = self._tables.get(key)
        if table is not None:
            self._tables.move_to_end(key)
        return table

    def put(self, key: Key, table: Table) -> None:
        """Keep a table of a key that has none."""
        self._tables[key] = table
        self.nbytes += table.nbytes
        while self.nbytes > self._budget_bytes and len(self._tables) > 1:
            _, oldest = self._tables.popitem(last=False)
            self.nbytes -= oldest.nbytes
