"""When lives end: by the law of departures, at an instant given, or never."""

from bisect import insort

from are_ros.artefacts.departures import Departure, DepartureLaw


class Lifetimes:
    """The ends of the lives of all who live, in the order of time; instants are nanoseconds.

    Who has an end of its own, or none at all, takes no part in the `law`.
    """

    def __init__(self, law: DepartureLaw) -> None:
        self.law = law
        self._given: list[Departure] = []
        self._outside_the_law: set[int] = set()

    def begin(
        self, artefact_id: int, now_ns: int, end_ns: int | None = None, *, is_for_ever: bool = False
    ) -> int | None:
        """Let a life begin, and return its end where it is known; one not given is drawn."""
        if end_ns is not None:
            insort(self._given, Departure(end_ns, artefact_id))
        if end_ns is not None or is_for_ever:
            self._outside_the_law.add(artefact_id)
            return end_ns
        self.law.arrived(artefact_id, now_ns)
        return self.law.departure_of(artefact_id)

    def end(self, artefact_id: int, now_ns: int) -> None:
        """Forget a life, which is over, or is cut short."""
        if artefact_id in self._outside_the_law:
            self._outside_the_law.remove(artefact_id)
            self._given = [end for end in self._given if end.artefact_id != artefact_id]
        else:
            self.law.removed(artefact_id, now_ns)

    def next(self) -> Departure | None:
        """Return the next end of a life as things stand, None if there is none."""
        drawn = self.law.next()
        if self._given and (drawn is None or self._given[0] < drawn):
            return self._given[0]
        return drawn

    def take(self, departure: Departure) -> None:
        """Take the next end of a life, as `next` has just returned it; then `end` it."""
        if self.is_by_law(departure.artefact_id):
            self.law.pop()

    def is_by_law(self, artefact_id: int) -> bool:
        """Say whether it is the law that ends this life."""
        return artefact_id not in self._outside_the_law

    def postpone(self, by_ns: int) -> list[Departure]:
        """Let the ends that were given come so much later; return them."""
        self._given = [Departure(end.time_ns + by_ns, end.artefact_id) for end in self._given]
        return self._given

    def restart(self, now_ns: int) -> None:
        """Forget all lives and go on at `now_ns`, earlier or later."""
        self._given.clear()
        self._outside_the_law.clear()
        self.law.restart(now_ns)
