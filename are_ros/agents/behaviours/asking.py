"""Asking behaviours: those of the user's own may fail, which is said in one sentence.

Those of are_ros are trusted: what they raise is a bug of ours, whose traceback is worth seeing.
"""

import inspect
import math
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from traceback import walk_tb
from types import FrameType
from typing import Final, NamedTuple

import numpy as np

import are_ros
from are_ros.agents.behaviours.situation import Behaviour, Intent, Situation, stand
from are_ros.agents.behaviours.standing import Standing
from are_ros.conventions import NS_PER_S
from are_ros.errors import BehaviourError

FAILED: Final = "its behaviour failed"
"""What somebody does whose own behaviour is not asked any more."""

_PACKAGE: Final = are_ros.__name__
_FOLDER: Final = str(Path(are_ros.__file__).parent)
_FARTHEST_M: Final = 1e9
_NUMBERS: Final = (int, float, np.integer, np.floating)


class Asked(NamedTuple):
    """Who is asked, and when [ns]."""

    artefact_id: int
    label: str
    now_ns: int


NOBODY: Final = Asked(-1, "", 0)
"""For a behaviour that is made for no artefact."""


class Failed(Standing):
    """Stands, as its own behaviour cannot be asked any more."""

    def decide(self, situation: Situation) -> Intent:  # noqa: ARG002 - nothing can change its mind
        """Return the intent to stand."""
        return stand(FAILED)


def made(kind: type[Behaviour], asked: Asked) -> Behaviour:
    """Return a behaviour of this class. BehaviourError where one of the user's own fails."""
    if not _is_own(kind):
        return kind()
    try:
        return kind()
    except Exception as cause:  # whatever the user's code raises
        raise _raised(kind, asked, cause, "__init__") from cause


def intent_of(behaviour: Behaviour, situation: Situation) -> Intent:
    """Return what a behaviour wants. BehaviourError where one of the user's own fails."""
    kind = type(behaviour)
    if not _is_own(kind):
        return behaviour.decide(situation)
    asked = Asked(situation.me.id, situation.row.label, situation.now_ns)
    try:
        intent = behaviour.decide(situation)
    except Exception as cause:  # whatever the user's code raises
        raise _raised(kind, asked, cause, "decide") from cause
    if (reason := next(_why_no_intent(intent), None)) is not None:
        raise _failure(kind, asked, f"decide returned {reason}", _start_of(kind, "decide"))
    return intent


def who_is_asked(frame: FrameType | None) -> str:
    """Return which behaviour of the user's own a thread is in, and where, by its newest frame.

    Empty where it is in none. The thread may go on meanwhile.
    """
    lines: dict[str, str] = {}
    while frame is not None:
        code = frame.f_code
        if code in _QUESTIONS:
            kind, asked = (frame.f_locals.get(name) for name in ("kind", "asked"))
            if isinstance(kind, type) and isinstance(asked, Asked) and _is_own(kind):
                where = lines.get(_file_of(kind) or "", "")
                return _named(kind, asked) + (f" ({where})" if where else "")
        lines.setdefault(code.co_filename, f"{code.co_filename}, line {frame.f_lineno}")
        frame = frame.f_back
    return ""


@lru_cache
def _is_own(kind: type) -> bool:
    """Tell whether a class is the user's."""
    return kind.__module__.partition(".")[0] != _PACKAGE


def _why_no_intent(intent: object) -> Iterator[str]:
    """Yield what is wrong with what was returned."""
    if not isinstance(intent, Intent):
        what = "None" if intent is None else f"a {type(intent).__name__}"
        yield f"{what}, which is no Intent"
        return
    for name, point_m in (("goal_m", intent.goal_m), ("face_m", intent.face_m)):
        if not (point_m is None or _is_point(point_m)):
            yield f"the {name} {point_m!r}: a tuple of two finite numbers of metres is needed"
    for name, number in (
        ("speed_mps", intent.speed_mps),
        ("arrive_within_m", intent.arrive_within_m),
        ("robot_comfort_m", intent.robot_comfort_m or 0.0),
    ):
        if not (_is_number(number) and number >= 0.0):
            yield f"the {name} {number!r}: a finite number that is not negative is needed"
    activity: object = intent.activity
    if not isinstance(activity, str):
        yield f"the activity {activity!r}: a text is needed"


def _is_point(point_m: object) -> bool:
    if not isinstance(point_m, tuple) or len(point_m) != 2:
        return False
    return all(_is_number(one) and abs(one) <= _FARTHEST_M for one in point_m)


def _is_number(number: object) -> bool:
    return isinstance(number, _NUMBERS) and math.isfinite(number)


def _raised(kind: type, asked: Asked, cause: Exception, method: str) -> BehaviourError:
    """Return the sentence for what the user's code has raised."""
    lines = str(cause).splitlines()
    what = f"{type(cause).__name__}: {lines[0]}" if lines else type(cause).__name__
    return _failure(kind, asked, what, _place_in(kind, cause) or _start_of(kind, method))


def _failure(kind: type, asked: Asked, what: str, place: str) -> BehaviourError:
    where = f" ({place})" if place else ""
    time_s = asked.now_ns / NS_PER_S
    return BehaviourError(
        f"{_named(kind, asked)} failed at {time_s:.3f} s: {what}{where}", _name_of(kind)
    )


def _named(kind: type, asked: Asked) -> str:
    """Return a behaviour and whose it is, in words."""
    return f"the behaviour {_name_of(kind)} of artefact {asked.artefact_id} ({asked.label})"


def _name_of(kind: type) -> str:
    return f"{kind.__module__}:{kind.__qualname__}"


def _place_in(kind: type, cause: Exception) -> str:
    """Return the last line in the file of a class that a traceback passes, else in no file of ours.

    Empty where it passes only ours, as where a method does not take what it is given.
    """
    passed = [(frame.f_code.co_filename, line) for frame, line in walk_tb(cause.__traceback__)]
    foreign = [(file, line) for file, line in passed if not file.startswith(_FOLDER)]
    inside = [(file, line) for file, line in foreign if file == _file_of(kind)]
    for file, line in (inside or foreign)[-1:]:
        return f"{file}, line {line}"
    return ""


def _start_of(kind: type, name: str) -> str:
    """Return where a method or a property of a class begins, empty if that is not known."""
    found = inspect.getattr_static(kind, name, None)
    found = getattr(found, "fget", None) or getattr(found, "__func__", None) or found
    code = getattr(found, "__code__", None)
    return "" if code is None else f"{code.co_filename}, line {code.co_firstlineno}"


def _file_of(kind: type) -> str | None:
    try:
        return inspect.getsourcefile(kind)
    except TypeError:  # of a class without a file
        return None


_QUESTIONS: Final = {function.__code__ for function in (made, intent_of)}
"""The code that calls the user's; each has `kind` and `asked`."""
