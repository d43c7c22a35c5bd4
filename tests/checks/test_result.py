"""What a check came to, in a sentence."""

import pytest

from are_ros.checks.result import Outcome, Tally, merged, skipped, want_of_inputs


@pytest.mark.parametrize(
    ("looked_at", "failures", "left_out", "sentence"),
    [
        (1, 0, 0, "walls: passed, 1 box"),
        (2, 0, 0, "walls: passed, 2 boxes"),
        (2, 0, 1, "walls: passed, 2 boxes (not looked at: 1 tick without a map)"),
        (1, 0, 3, "walls: passed, 1 box (not looked at: 3 ticks without a map)"),
        (1, 1, 0, "walls: FAILED, 1 wrong of 1 box; the first: it is pink"),
        (9, 3, 0, "walls: FAILED, 3 wrong of 9 boxes; the first: it is pink"),
        (0, 0, 0, "walls: skipped, there are no boxes"),
        (0, 0, 2, "walls: skipped, not looked at: 2 ticks without a map"),
    ],
)
def test_counts_read_well(looked_at: int, failures: int, left_out: int, sentence: str) -> None:
    """One thing is no plural, and what was left out is told."""
    tally = Tally("walls", "box")
    tally.look(looked_at)
    if failures:
        tally.fail("it is pink", failures)
    for _ in range(left_out):
        tally.leave_out("tick", "without a map")
    assert tally.result().sentence() == sentence


def test_notes_come_before_what_was_left_out() -> None:
    """Which is one list, whatever the reasons."""
    tally = Tally("ticks", "tick")
    tally.look(3)
    tally.leave_out("tick", "without a map")
    tally.leave_out("changed scan", "of nobody")
    tally.note("the clock went back")
    wanted = "the clock went back; not looked at: 1 tick without a map; 1 changed scan of nobody"
    assert tally.result().reason == wanted


@pytest.mark.parametrize(("count", "words"), [(1, "1 skipped check needs"), (2, "checks need")])
def test_what_the_inputs_would_make_possible_is_said(count: int, words: str) -> None:
    """Once for all checks; not of those that are skipped for another reason."""
    others = [skipped("scans", "it is dark")]
    assert want_of_inputs(others) == ""
    lacking = [skipped("walls", "there is no map", needs_inputs=True)] * count
    sentence = want_of_inputs([*others, *lacking])
    assert words in sentence
    assert "are replay BAG --with-inputs" in sentence


def test_parts_add_up() -> None:
    """To one sentence, in which one thing of all is no plural."""
    empty, full = Tally("ticks", "tick"), Tally("ticks", "tick")
    full.look()
    whole = merged([empty.result(), full.result()])
    assert (whole.outcome, whole.sentence()) == (Outcome.PASSED, "ticks: passed, 1 tick")
