"""Who wants the same as before is not asked: nothing that happens is another for it."""

from typing import Any, ClassVar

import pytest

from are_ros.artefacts import steady_minds
from are_ros.artefacts.behaviours import asking
from are_ros.artefacts.behaviours.intent import Intent, Steady
from are_ros.artefacts.behaviours.situation import Situation
from are_ros.artefacts.behaviours.walking import Running, Stopping, Walking
from are_ros.artefacts.catalogue import Catalogue
from are_ros.artefacts.minds import Minds
from tests.builder.town import DRIVE, Record, Town, hall, row

KINDS = Catalogue(
    (
        row(0, "walking"),
        row(1, "stopping"),
        row(2, "crossing"),
        row(3, "avoiding"),
        row(4, "wandering"),
        row(5, "driving", DRIVE, (1.2, 0.6, 1.0)),
        row(6, "gathering"),
        row(7, "following"),
    )
)
BUSY: dict[str, Any] = {
    "population.arrival_rate": 0.02,
    "population.mean_life": 25.0,
    "population.region": "free",
    "mixture.rates": (3.0,),
    "seed": 5,
}
WALLS = ((7.0, 7.2, 0.0, 4.4), (7.0, 7.2, 5.6, 10.0), (3.0, 3.4, 3.0, 3.4))
CLOSED = (*WALLS, (7.0, 7.2, 4.4, 5.6))


def lived(*, has_robot: bool, closes_at_s: float | None = None) -> tuple[Record, list[Any]]:
    """Return what has happened in 40 s, and what all have said at its end."""
    robot = (1.0, 1.0) if has_robot else None
    town = Town.of(BUSY, hall(14.0, 10.0, *WALLS), KINDS, robot)
    record = town.run(0.0, closes_at_s or 40.0, 10.0)
    if closes_at_s is not None:
        town.map(closes_at_s, hall(14.0, 10.0, *CLOSED))
        later = town.run(closes_at_s, 40.0, 10.0)
        record.moments.update(later.moments)
    living = town.lives.population.living.values()
    return record, [(one.id, one.behaviour, one.activity) for one in living]


@pytest.mark.parametrize(
    ("has_robot", "closes_at_s"), [(False, None), (True, None), (False, 15.03)]
)
def test_lives_are_the_same_as_if_all_were_asked(
    monkeypatch: pytest.MonkeyPatch, has_robot: bool, closes_at_s: float | None
) -> None:
    """Where each is at each sub-step, to the bit, and what it says: with a robot, in a new map."""
    record, said = lived(has_robot=has_robot, closes_at_s=closes_at_s)
    monkeypatch.setattr(steady_minds, "steady_of", lambda *_: None)
    asked, would_say = lived(has_robot=has_robot, closes_at_s=closes_at_s)
    assert said == would_say
    assert record.moments == asked.moments
    assert len(record.moments) > 300


def test_most_are_not_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Walkers on their way."""
    counts = {"due": 0, "asked": 0}
    due_in, situations = Minds._due_in, Minds._situations

    def counted(self: Minds, *args: Any) -> Any:
        due = due_in(self, *args)
        counts["due"] += len(due)
        return due

    def asked(self: Minds, minds: Any, *args: Any) -> Any:
        counts["asked"] += len(minds)
        return situations(self, minds, *args)

    monkeypatch.setattr(Minds, "_due_in", counted)
    monkeypatch.setattr(Minds, "_situations", asked)
    values, walkers = {**BUSY, "mixture.rates": (0.5,)}, Catalogue((row(0, "walking"),))
    Town.of(values, hall(14.0, 10.0), walkers, None).run(0.0, 30.0, 10.0)
    assert counts["due"] > 50
    assert counts["asked"] < 0.5 * counts["due"]


class Dreaming(Walking):
    """Walks, but stands when it likes: its `steady` is not made for that."""

    name: ClassVar[str] = "dreaming"

    def decide(self, situation: Situation) -> Intent:
        """Decide."""
        return super().decide(situation)


class Marching(Dreaming):
    """Knows what it does."""

    @property
    def steady(self) -> Steady | None:
        """Say that it goes on."""
        return super().steady


@pytest.mark.parametrize(
    ("kind", "tells"),
    [(Walking, True), (Running, True), (Stopping, True), (Dreaming, False), (Marching, True)],
)
def test_who_decides_otherwise_than_it_says_is_asked(kind: type, tells: bool) -> None:
    """An inherited `steady` is for the `decide` that comes with it."""
    assert asking.tells(kind) is tells
    assert not asking.tells(object)
