"""What a soak says of how far it has come, on a terminal and in a log."""

import sys
from contextlib import closing

import pytest

from are_ros.cli.soaking import SoakProgress


def test_in_a_log_there_is_a_line_a_minute(capsys: pytest.CaptureFixture[str]) -> None:
    """Of the wall clock, however often it is told; the estimate is by what is done."""
    said: list[str] = []
    now_s = [100.0]
    with closing(SoakProgress(600.0, said.append, lambda: now_s[0])) as progress:
        for second in range(0, 200, 5):
            now_s[0] = 100.0 + second
            progress.move(0.0 if second < 100 else second)
    assert said == [
        "soak: 0 of 600 artefact-minutes after 1 min: nobody lives yet",
        "soak: 120 of 600 artefact-minutes after 2 min, about 8 min to go",
        "soak: 180 of 600 artefact-minutes after 3 min, about 7 min to go",
    ]
    assert capsys.readouterr() == ("", "")


def test_the_last_minute_is_said_in_words() -> None:
    """Not as none."""
    said: list[str] = []
    now_s = [0.0]
    with closing(SoakProgress(150.0, said.append, lambda: now_s[0])) as progress:
        now_s[0] = 60.0
        progress.move(135.0)
    assert said == ["soak: 135 of 150 artefact-minutes after 1 min, less than a minute to go"]


def test_a_short_soak_says_nothing() -> None:
    """Nor does a long one when it is done: then come the results."""
    said: list[str] = []
    now_s = [0.0]
    with closing(SoakProgress(10.0, said.append, lambda: now_s[0])) as progress:
        for now_s[0], done in ((20.0, 5.0), (59.0, 9.0), (61.0, 10.5)):
            progress.move(done)
    assert said == []


def test_on_a_terminal_there_is_a_bar(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It ends full, on a line of its own."""
    monkeypatch.setattr(type(sys.stderr), "isatty", lambda _: True)
    said: list[str] = []
    with closing(SoakProgress(10.0, said.append)) as progress:
        progress.move(4.0)
        progress.move(10.4)
    shown = capsys.readouterr().err
    assert "100%" in shown.split("\r")[-1]
    assert "10/10 min" in shown
    assert shown.endswith("\n")
    assert said == []
