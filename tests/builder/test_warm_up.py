"""The kernels are compiled beforehand, for as long as somebody wants them."""

import pytest
from numba.core import event

from are_ros.artefacts.catalogue import Catalogue, CatalogueRow
from are_ros.artefacts.shapes import Shape
from are_ros.builder import warm_up as module
from are_ros.builder.warm_up import warm_up


def catalogue_of(count: int) -> Catalogue:
    """Return a catalogue of so many boxes."""
    centre, size = (0.0, 0.0, 0.0), (0.4, 0.4, 1.0)
    rows = (CatalogueRow(i, f"box_{i}", "box", size, centre, Shape.CRATE) for i in range(count))
    return Catalogue(tuple(rows))


@pytest.mark.parametrize("count", [1, 2, 5])
def test_it_works_with_catalogues_of_any_length(count: int) -> None:
    """The mixture of the parameters would not: it is made for the shipped one."""
    assert warm_up(catalogue_of(count))


def test_it_ends_between_two_steps_when_it_is_not_wanted_any_more() -> None:
    """At once, or later on."""
    assert not warm_up(catalogue_of(2), lambda: False)
    answers = iter([True] * 3)
    assert not warm_up(catalogue_of(2), lambda: next(answers, False))


def test_it_ends_before_the_next_kernel_when_it_is_not_wanted_any_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In the midst of a step; afterwards nobody listens to the compiler any more."""
    asked: list[bool] = []

    def compiling(*_: object) -> bool:
        with event.trigger_event("numba:compile"):
            asked.append(True)
        return True

    monkeypatch.setattr(module, "_run", compiling)
    assert warm_up(catalogue_of(1))
    assert not warm_up(catalogue_of(1), lambda: False)
    assert asked == [True]
    compiling()
    assert asked == [True, True]
