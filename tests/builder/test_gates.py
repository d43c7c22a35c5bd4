"""Which artefacts pass the gate: perceived now, or remembered."""

from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.builder.costmap.augmented_map import GateMemory

IDS = st.frozensets(st.integers(0, 5))
TICKS = st.lists(st.tuples(st.integers(-3, 4), IDS, IDS), max_size=25)


def test_without_memory_only_the_perceived_pass() -> None:
    """A memory of 0 is the paper's A_f, tick by tick, ascending."""
    gate = GateMemory(0)
    assert gate.admitted(0, {3: 0, 1: 0}, [1, 2, 3]) == (1, 3)
    assert gate.admitted(1, {2: 1}, [1, 2, 3]) == (2,)
    assert gate.admitted(2, {}, [1, 2, 3]) == ()


def test_memory_keeps_an_artefact_that_went_out_of_sight() -> None:
    """It stays for the memory after it was last seen, the end included, and comes back if seen."""
    gate = GateMemory(10)
    gate.admitted(0, {7: 0}, [7])
    assert gate.admitted(5, {7: 5}, [7]) == (7,)
    assert gate.admitted(15, {}, [7]) == (7,)
    assert gate.admitted(16, {}, [7]) == ()
    assert gate.admitted(17, {7: 17}, [7]) == (7,)


def test_departed_leave_at_once() -> None:
    """No memory holds the dead, not even one perceived in the tick it left."""
    gate = GateMemory(1_000)
    gate.admitted(0, {1: 0, 2: 0}, [1, 2])
    assert gate.admitted(1, {1: 1}, [2]) == (2,)


def test_clock_that_jumps_back_forgets_what_was_seen() -> None:
    """After the jump only what is perceived from then on passes."""
    gate = GateMemory(1_000)
    gate.admitted(5_000, {1: 5_000}, [1, 2])
    assert gate.admitted(100, {2: 100}, [1, 2]) == (2,)
    assert gate.admitted(100, {}, [1, 2]) == (2,)


@settings(deadline=None)
@given(memory_ns=st.integers(0, 6), ticks=TICKS)
def test_any_history_obeys_the_definition(
    memory_ns: int, ticks: list[tuple[int, frozenset[int], frozenset[int]]]
) -> None:
    """Admitted is who lives, was seen within the memory, alive ever since, and after any jump."""
    gate = GateMemory(memory_ns)
    now_ns = 0
    history: list[tuple[int, frozenset[int], frozenset[int]]] = []
    for step_ns, perceived, alive in ticks:
        if step_ns < 0:
            history.clear()
        now_ns += step_ns
        history.append((now_ns, perceived, alive))
        expected = []
        for artefact_id in sorted(alive):
            for seen_ns, seen, living in reversed(history):
                if artefact_id not in living or now_ns - seen_ns > memory_ns:
                    break
                if artefact_id in seen:
                    expected.append(artefact_id)
                    break
        assert gate.admitted(now_ns, dict.fromkeys(perceived, now_ns), alive) == tuple(expected)


def test_a_held_sighting_counts_from_the_look() -> None:
    """Between looks the seen stay; the memory then counts from the look, not from the last tick."""
    gate = GateMemory(100)
    assert gate.admitted(50, {1: 50}, {1}) == (1,)
    assert gate.admitted(120, {1: 50}, {1}) == (1,)
    assert gate.admitted(150, {}, {1}) == (1,)
    assert gate.admitted(151, {}, {1}) == ()
