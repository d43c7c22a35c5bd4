"""Behaviours of the user's own that fail: one sentence says whose, whom it hit, when and where."""

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from are_ros.agents.behaviours.calls import BehaviourCall, intent_of
from are_ros.agents.behaviours.open_view import OpenView
from are_ros.agents.behaviours.registry import make_behaviour, why_not
from are_ros.agents.behaviours.repertoire import Repertoire
from are_ros.agents.behaviours.situation import Intent, Situation, Standing, stand
from are_ros.agents.behaviours.walking import Walking
from are_ros.errors import BehaviourError
from tests.agents.behaviours import failing
from tests.agents.behaviours.stage import fellow_at, lattice, row_of, stream


class _Place(NamedTuple):
    """A point as a user may have it."""

    x_m: float
    y_m: float


FILE = Path(failing.__file__)
LINES = FILE.read_text(encoding="utf-8").splitlines()
CALL = BehaviourCall(7, "guest", 12_300_000_000)


def line_of(text: str, after: str = "") -> str:
    """Return the place of the first line with a text, after one with another."""
    start = next((i for i, line in enumerate(LINES) if after in line), 0)
    number = next(i for i, line in enumerate(LINES[start:], start + 1) if text in line)
    return f"({FILE}, line {number})"


def situation() -> Situation:
    """Return what artefact 7 knows at 12.3 s."""
    me, view = fellow_at((0.0, 0.0), artefact_id=7), OpenView(())
    return Situation(CALL.now_ns, me, row_of(), lattice(), stream(), view)


def said_of(behaviour: Any) -> str:
    """Return what is said of a behaviour that is asked, without its common beginning."""
    with pytest.raises(BehaviourError) as caught:
        intent_of(behaviour, situation())
    name = f"tests.agents.behaviours.failing:{type(behaviour).__name__}"
    assert caught.value.behaviour == name
    start, _, rest = str(caught.value).partition(" failed at 12.300 s: ")
    assert start == f"the behaviour {name} of artefact 7 (somebody)"
    return rest


def test_what_decide_raises_is_said_with_its_line() -> None:
    """Type and first line of the text; the traceback stays behind it."""
    late = failing.Late()
    for _ in range(3):
        assert intent_of(late, situation()).activity == "hurrying"
    assert said_of(late) == f"ValueError: late boom {line_of('late boom')}"


def test_the_line_is_the_users_where_something_of_ours_raised() -> None:
    """They called it."""
    place = line_of("situation.distance_m(nowhere)")
    assert (
        said_of(failing.Helpless()) == f"TypeError: 'NoneType' object is not subscriptable {place}"
    )


@pytest.mark.parametrize(
    "goal_m", [(3, 4), (np.int64(3), 4.0), (np.float32(3.0), np.float64(4.0)), _Place(3.0, 4.0)]
)
def test_a_goal_is_a_plain_tuple_of_floats_whatever_it_was(goal_m: Any) -> None:
    """For each other kind of numbers the kernels would be compiled anew: live, for seconds."""
    behaviour = failing.Returns()
    behaviour.what = Intent(goal_m, 1, activity="going")  # type: ignore[misc] # of this one
    intent = intent_of(behaviour, situation())
    assert intent == Intent((3.0, 4.0), 1, activity="going")
    found: Any = intent.goal_m
    assert [type(found), *map(type, found)] == [tuple, float, float]


BAD: list[tuple[Any, str]] = [
    (None, "None, which is no Intent"),
    ("walk", "'walk' (str), which is no Intent"),
    ((1.0, 2.0), "(1.0, 2.0) (tuple), which is no Intent"),
    (Intent((math.nan, 1.0), 1.0), "the goal_m (nan, 1.0): "),
    (Intent((1.0, math.inf), 1.0), "the goal_m (1.0, inf): "),
    (Intent((1.0, 1e300), 1.0), "the goal_m (1.0, 1e+300): "),
    (Intent((10**400, 1.0), 1.0), "the goal_m (1000"),
    (Intent((1.0, 2.0), 10**400), "the speed_mps 1000"),
    (Intent(None, 0.0, activity="a\ud800b"), "the activity 'a\\ud800b': "),
    (Intent([1.0, 2.0], 1.0), "the goal_m [1.0, 2.0]: "),  # type: ignore[arg-type]
    (Intent((1.0, 2.0, 0.0), 1.0), "the goal_m (1.0, 2.0, 0.0): "),  # type: ignore[arg-type]
    (Intent(None, 0.0, face_m=(math.nan, 0.0)), "the face_m (nan, 0.0): "),
    (Intent((1.0, 2.0), -0.1), "the speed_mps -0.1: "),
    (Intent((1.0, 2.0), math.nan), "the speed_mps nan: "),
    (Intent((1.0, 2.0), None), "the speed_mps None: "),  # type: ignore[arg-type]
    (Intent((1.0, 2.0), 1.0, math.nan), "the arrive_within_m nan: "),
    (Intent((1.0, 2.0), 1.0, robot_comfort_m=-1.0), "the robot_comfort_m -1.0: "),
    (Intent(None, 0.0, activity=3), "the activity 3: "),  # type: ignore[arg-type]
    (Intent((1.0, 2.0), np.zeros(2)), "the speed_mps array([0., 0.]): "),  # type: ignore[arg-type]
    (Intent((1.0, 2.0), 1.0, robot_comfort_m=""), "the robot_comfort_m '': "),  # type: ignore[arg-type]
    (
        Intent((1.0, 2.0), 1.0, robot_comfort_m=np.zeros(2)),  # type: ignore[arg-type]
        "the robot_comfort_m array([0., 0.]): ",
    ),
    (
        Intent((1.0, 2.0), 1.0, is_moving_goal=np.zeros(2)),  # type: ignore[arg-type]
        "the is_moving_goal array([0., 0.]): ",
    ),
    (
        Intent((1.0, 2.0), 1.0, is_moving_goal="no"),  # type: ignore[arg-type]
        "the is_moving_goal 'no': ",
    ),
    (Intent(np.zeros((40, 2)), 1.0), "the goal_m array([["),  # type: ignore[arg-type]
    (Intent((1.0, 2.0), 10**5000), "the speed_mps "),
]


@pytest.mark.parametrize(("what", "words"), BAD, ids=[words for _, words in BAD])
def test_what_is_no_intent_is_said(what: Any, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Which field, which value; the place is that of decide."""
    monkeypatch.setattr(failing.Returns, "what", what)
    said = said_of(failing.Returns())
    assert said.startswith(f"decide returned {words}")
    assert "\n" not in said
    assert len(said) < 400
    assert said.endswith(line_of("def decide", "class Returns"))


def test_a_good_intent_is_handed_on_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """The very object."""
    monkeypatch.setattr(failing.Returns, "what", good := stand("being good"))
    assert intent_of(failing.Returns(), situation()) is good


def test_a_failure_without_words_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """An exception that cannot say what it is ended the live node."""

    class SpeechlessError(Exception):
        def __str__(self) -> str:
            raise AttributeError("words")

    def fail(*_: object) -> Intent:
        raise SpeechlessError

    monkeypatch.setattr(failing.Returns, "decide", fail)
    assert said_of(failing.Returns()).startswith("SpeechlessError (")


def test_a_reward_that_cannot_be_looked_up_is_a_failure() -> None:
    """It is one when it is asked for, as any other."""

    class Odd(failing.Returns):
        @property
        def reward(self) -> Any:
            raise ValueError("no price")

    found = Repertoire({"standing": Standing(), "odd": Odd()}, {"standing": 0.5, "odd": 0.5})
    with pytest.raises(BehaviourError, match=r"failed at 12\.300 s: ValueError: no price \("):
        found.rewards(situation())


def test_a_constructor_that_raises_is_said() -> None:
    """Of the artefact that it was made for."""
    with pytest.raises(BehaviourError, match=r"no parts") as caught:
        make_behaviour("tests.agents.behaviours.failing:Unmade", None, CALL)
    assert str(caught.value) == (
        "the behaviour tests.agents.behaviours.failing:Unmade of artefact 7 (guest) failed at "
        f"12.300 s: RuntimeError: no parts {line_of('no parts')}"
    )


def test_a_decide_that_ends_the_program_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    """`sys.exit` in a user's code ended the run as if all were well."""

    def end(*_: object) -> Intent:
        raise SystemExit(0)

    monkeypatch.setattr(failing.Returns, "decide", end)
    with pytest.raises(BehaviourError, match="SystemExit: 0"):
        intent_of(failing.Returns(), situation())


def test_a_decide_that_takes_something_else_is_refused_by_the_catalogue(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before anybody arrives; those that take a situation are not, however they are made."""
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "odd_decides.py").write_text(
        "class Alone:\n    name = 'a'\n    def decide(self): pass\n"
        "class Greedy:\n    name = 'a'\n    def decide(self, one, two): pass\n"
        "class Static:\n    name = 'a'\n    @staticmethod\n    def decide(situation): pass\n"
        "class Any:\n    name = 'a'\n    def decide(self, *words): pass\n"
    )
    words = "has a decide that does not take a situation ("
    assert str(why_not("odd_decides:Alone")).startswith(words)
    assert str(why_not("odd_decides:Greedy")).startswith(words)
    assert why_not("odd_decides:Static") is why_not("odd_decides:Any") is None


def test_a_bug_of_ours_is_no_failure_of_the_users(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its traceback is worth seeing."""

    def stumble(*_: object) -> Intent:
        raise ZeroDivisionError

    monkeypatch.setattr(Walking, "decide", stumble)
    with pytest.raises(ZeroDivisionError):
        intent_of(Walking(), situation())
