"""How many messages of a topic never arrived, told from the gaps in the publisher's numbers."""


class LossCount:
    """Counts the gaps of one topic while it has one publisher; several cannot be told apart.

    A gap counts only when the publishers are seen to be the same afterwards: a new publisher
    speaks before it is found, and its numbers are its own.
    """

    def __init__(self) -> None:
        self.lost = 0
        self._last: int | None = None
        self._unproven = 0
        self._is_alone = False

    def see(self, sequence: int) -> None:
        """Take the number of a message as its publisher counted it, in order of arrival."""
        if self._is_alone:
            if self._last is not None and sequence > self._last + 1:
                self._unproven += sequence - self._last - 1
            self._last = sequence

    def settle(self, publishers: int, *, are_the_same: bool) -> None:
        """Take how many publishers there are now, and whether they are those of the last time."""
        if are_the_same:
            self.lost += self._unproven
        else:
            self._last = None
        self._unproven = 0
        self._is_alone = publishers == 1
