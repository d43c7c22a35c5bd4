"""What is known of an input: its counts, its rate, its age."""

from are_ros.conventions import NS_PER_S
from are_ros.node.watches import InputSnapshot, InputWatch

MS = NS_PER_S // 1000


def fed(times_ms: range) -> InputWatch:
    """Return a watch that received messages at these times."""
    watch = InputWatch()
    for time_ms in times_ms:
        watch.received(time_ms * MS)
    return watch


def at(watch: InputWatch, now_ns: int) -> InputSnapshot:
    """Return what is known at a time."""
    return watch.snapshot(now_ns, "scan", "/scan")


def test_nothing_is_said_of_what_never_came() -> None:
    """Neither a rate nor an age."""
    nothing = InputSnapshot("scan", "/scan")
    assert at(InputWatch(), 5 * NS_PER_S) == nothing
    assert nothing.rate_hz is None


def test_a_publisher_is_new_from_when_it_came() -> None:
    """Another time after all have gone."""
    watch, seen = InputWatch(), []
    for time_s, publishers in ((1, 0), (2, 1), (5, 2), (6, 0), (7, 1), (9, 1)):
        snapshot = watch.snapshot(time_s * NS_PER_S, "map", "/map", publishers)
        seen.append((snapshot.publishers, snapshot.published_s))
    assert seen == [(0, 0.0), (1, 0.0), (2, 3.0), (0, 0.0), (1, 0.0), (1, 2.0)]


def test_one_message_has_an_age_and_no_rate() -> None:
    """A rate takes two."""
    figures = at(fed(range(1000, 1001)), 1500 * MS)
    assert (figures.count, figures.age_s, figures.period_s) == (1, 0.5, None)


def test_rate_is_that_of_the_messages_that_came() -> None:
    """Ten a second for a while: 0.1 s each."""
    figures = at(fed(range(0, 3000, 100)), 3000 * MS)
    assert figures.count == 30
    assert figures.period_s is not None
    assert abs(figures.period_s - 0.1) < 1e-12
    assert figures.rate_hz is not None
    assert abs(figures.rate_hz - 10.0) < 1e-9


def test_what_came_in_an_instant_has_no_rate() -> None:
    """It had queued while the node began; a little later the rate is known."""
    watch = InputWatch()
    for _ in range(9):
        watch.received(1000 * MS)
    watch.received(1001 * MS)
    assert at(watch, 1100 * MS).rate_hz is None
    watch.received(1201 * MS)
    assert at(watch, 1300 * MS).rate_hz is not None


def test_rate_forgets_what_is_older_than_its_window() -> None:
    """After 10 s at the new rate, nothing of the old one is left."""
    watch = fed(range(0, 5000, 10))
    for time_ms in range(5000, 15_001, 500):
        watch.received(time_ms * MS)
    assert at(watch, 15_001 * MS).period_s == 0.5


def test_rate_stays_when_the_input_stops() -> None:
    """It is the age that grows: so one sees at what rate it had come."""
    figures = at(fed(range(0, 1001, 100)), 60 * NS_PER_S)
    assert (figures.period_s, figures.age_s) == (0.1, 59.0)


def test_a_pause_longer_than_the_window_ends_the_rate() -> None:
    """The message after it is a first one again."""
    watch = fed(range(0, 1001, 100))
    watch.received(30 * NS_PER_S)
    assert at(watch, 30 * NS_PER_S).period_s is None
    assert watch.count == 12


def test_messages_at_one_instant_have_no_rate() -> None:
    """As after a long callback, when several wait: nothing is divided by zero."""
    figures = at(fed(range(1000, 1001)), NS_PER_S)
    watch = fed(range(1000, 1001))
    watch.received(NS_PER_S)
    assert figures.rate_hz is None
    assert at(watch, NS_PER_S).rate_hz is None


def test_many_messages_take_little_memory() -> None:
    """The rate of a fast input is that of the newest messages."""
    figures = at(fed(range(5000)), 5 * NS_PER_S)
    assert figures.count == 5000
    assert figures.rate_hz is not None
    assert abs(figures.rate_hz - 1000.0) < 1e-6


def test_refusals_are_counted_for_ever_and_of_late() -> None:
    """The last reason is kept."""
    watch = fed(range(0, 3000, 1000))
    watch.refused(0, "first")
    watch.refused(2 * NS_PER_S, "second")
    soon, later = at(watch, 5 * NS_PER_S), at(watch, 11 * NS_PER_S)
    assert (soon.refused, soon.refused_lately, soon.last_refusal) == (2, 2, "second")
    assert (later.refused, later.refused_lately, later.last_refusal) == (2, 1, "second")
    assert at(watch, 12 * NS_PER_S).refused_lately == 0
