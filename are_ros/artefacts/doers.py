"""Who is of which behaviour: ids that are kept up to date, so that nobody has to look at all."""

from bisect import bisect_left, insort
from collections.abc import Sequence


class Doers:
    """Artefacts by the names of their behaviours."""

    def __init__(self) -> None:
        self._behaviours: dict[int, str] = {}
        self._ids: dict[str, list[int]] = {}

    def set(self, artefact_id: int, behaviour: str) -> None:
        """Let one be of a behaviour, be it new here or of another one before."""
        self.remove(artefact_id)
        self._behaviours[artefact_id] = behaviour
        insort(self._ids.setdefault(behaviour, []), artefact_id)

    def remove(self, artefact_id: int) -> None:
        """Forget one, known or not."""
        behaviour = self._behaviours.pop(artefact_id, None)
        if behaviour is not None:
            ids = self._ids[behaviour]
            del ids[bisect_left(ids, artefact_id)]

    def of(self, behaviour: str) -> Sequence[int]:
        """Return the ids, ascending, of those of a behaviour."""
        return self._ids.get(behaviour, ())
