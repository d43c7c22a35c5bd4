"""Tables are kept up to so many bytes, the least recently used go first."""

import numpy as np

from are_ros.agents.mdp.value_tables import TableStore


def test_the_least_recently_used_go_first() -> None:
    """What was asked for since is kept longer, and the memory is counted."""
    store: TableStore[str, np.ndarray] = TableStore(30)
    for name in "abc":
        store.put(name, np.zeros(10, np.uint8))
    assert store.get("a") is not None
    store.put("d", np.zeros(5, np.uint8))
    assert [store.get(name) is not None for name in "abcd"] == [True, False, True, True]
    assert (len(store), store.nbytes) == (3, 25)
    store.clear()
    assert len(store) == store.nbytes == 0
    assert store.get("a") is None


def test_the_newest_stays_whatever_it_needs() -> None:
    """One that is larger than the bound is kept alone."""
    store: TableStore[int, np.ndarray] = TableStore(4)
    for number in range(3):
        store.put(number, np.zeros(9, np.uint8))
        assert len(store) == 1
        assert store.get(number) is not None
