"""Lives that end by the law, at an instant of their own, or never, side by side."""

from are_ros.conventions import NS_PER_S
from are_ros.population.departures import Departure, IndependentLives, Lifetimes


def test_ends_come_in_the_order_of_time_whatever_they_come_from() -> None:
    """Of two at one instant, the lower id first."""
    lives = Lifetimes(IndependentLives(1, 5.0))
    drawn_ns = lives.begin(7, 0)
    assert drawn_ns is not None
    assert lives.begin(3, 0, drawn_ns - 10) == drawn_ns - 10
    assert lives.begin(9, 0, drawn_ns) == drawn_ns
    assert lives.begin(4, 0, is_for_ever=True) is None
    assert [lives.is_by_law(i) for i in (3, 4, 7, 9)] == [False, False, True, False]
    ends = []
    while (end := lives.next()) is not None:
        lives.take(end)
        lives.end(end.artefact_id, end.time_ns)
        ends.append(end)
    assert ends == [Departure(drawn_ns - 10, 3), Departure(drawn_ns, 7), Departure(drawn_ns, 9)]


def test_only_ends_that_were_given_are_postponed() -> None:
    """The law has its own way to stand still: a mean life without end."""
    lives = Lifetimes(IndependentLives(1, 5.0))
    drawn_ns = lives.begin(1, 0)
    lives.begin(2, 0, NS_PER_S)
    assert lives.postpone(500) == [Departure(NS_PER_S + 500, 2)]
    assert lives.law.departure_of(1) == drawn_ns
    lives.end(2, 0)
    assert lives.next() == Departure(drawn_ns or 0, 1)


def test_nothing_is_left_after_a_restart() -> None:
    """Neither lives by the law nor others."""
    lives = Lifetimes(IndependentLives(1, 5.0))
    lives.begin(1, 0)
    lives.begin(2, 0, NS_PER_S)
    lives.restart(100)
    assert lives.next() is None
    assert lives.is_by_law(2)
