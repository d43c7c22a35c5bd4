"""Calls of behaviours: a user-defined behaviour that fails is reported in one sentence.

`new_behaviour` constructs a behaviour, `intent_of` and `reward_of` call its `decide` and `reward`.
They turn what a user-defined class raises or returns wrongly into a BehaviourError. The behaviours
of are_ros are called directly: an exception there is a bug, and its traceback is needed.
User-defined planners are called in the same way, by `new_behaviour` and `answer_of`.
"""

import inspect
import math
import reprlib
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from traceback import walk_tb
from types import FrameType
from typing import Any, Final, NamedTuple

import numpy as np

import are_ros
from are_ros.agents.behaviours.situation import Behaviour, Intent, Situation, Standing, stand
from are_ros.conventions import NS_PER_S
from are_ros.errors import BehaviourError

FAILED: Final = "its behaviour failed"
"""The activity of an artefact after its behaviour has failed."""

_PACKAGE: Final = are_ros.__name__
_FOLDER: Final = str(Path(are_ros.__file__).parent)
_FARTHEST_M: Final = 1e9
_NUMBERS: Final = (int, float, np.integer, np.floating)
_SHORT: Final = reprlib.Repr()
_SHORT.maxother = 60


class BehaviourCall(NamedTuple):
    """One call of a behaviour, or a planner: for which artefact, and at what time [ns]."""

    artefact_id: int
    label: str
    now_ns: int
    role: str = "behaviour"


NO_CALL: Final = BehaviourCall(-1, "", 0)
"""For a behaviour that is constructed for no artefact."""


class Failed(Standing):
    """Replaces a behaviour that has failed, or that of a failed planner: the artefact stands."""

    def __init__(self, activity: str = FAILED) -> None:
        self._activity = activity

    def decide(self, situation: Situation) -> Intent:  # noqa: ARG002 - it always stands
        """Return the intent to stand."""
        return stand(self._activity)


def new_behaviour(kind: type[Any], call: BehaviourCall) -> Any:
    """Return a new behaviour of this class; BehaviourError where a user-defined one fails."""
    user_class: type = kind
    if not _is_user_class(user_class):
        return kind()
    try:
        return kind()
    except (Exception, SystemExit) as cause:  # whatever the user's code raises
        raise _raised(kind, call, cause, "__init__") from cause


def intent_of(behaviour: Behaviour, situation: Situation) -> Intent:
    """Return the intent of a behaviour; BehaviourError where a user-defined one fails."""
    kind = type(behaviour)
    if not _is_user_class(kind):
        return behaviour.decide(situation)
    call = BehaviourCall(situation.me.id, situation.row.label, situation.now_ns)
    intent: Intent = answer_of(behaviour, "decide", situation, call)
    if (reason := next(_faults_of(intent), None)) is not None:
        raise wrong_answer(kind, "decide", reason, call)
    return _with_plain_goal(intent)


def reward_of(behaviour: Any, situation: Situation) -> float:
    """Return what a second of a behaviour that says so is worth now.

    BehaviourError where a user-defined one fails.
    """
    kind: type = type(behaviour)
    if not _is_user_class(kind):
        return float(behaviour.reward(situation))
    call = BehaviourCall(situation.me.id, situation.row.label, situation.now_ns)
    reward = answer_of(behaviour, "reward", situation, call)
    if not is_number(reward):
        raise wrong_answer(kind, "reward", f"{shown(reward)}: a finite number is needed", call)
    return float(reward)


def reward_bounds_of(behaviour: Any, situation: Situation) -> tuple[float, float]:
    """Return bounds of `reward_of`, by `reward_bounds` of a class of this package that has it.

    A user-defined class is asked for its reward: where it inherits, its rewards may be others.
    """
    kind: type = type(behaviour)
    if _states_bounds(kind):
        bounds: tuple[float, float] = behaviour.reward_bounds(situation)
        return bounds
    reward = reward_of(behaviour, situation)
    return reward, reward


def has_reward(behaviour: object) -> bool:
    """Return whether a behaviour has a reward; one that cannot be looked up fails when asked."""
    try:
        return hasattr(behaviour, "reward")
    except Exception:  # noqa: BLE001 - whatever the user's code raises
        return True


def answer_of(user_object: object, method: str, argument: object, call: BehaviourCall) -> Any:
    """Return what a method of a user-defined class returns; BehaviourError if it raises."""
    kind = type(user_object)
    try:
        return getattr(user_object, method)(argument)
    except (Exception, SystemExit) as cause:  # whatever the user's code raises
        raise _raised(kind, call, cause, method) from cause


def wrong_answer(kind: type, method: str, reason: str, call: BehaviourCall) -> BehaviourError:
    """Return the error for a method of a user-defined class that returned something wrong."""
    return _failure(kind, call, f"{method} returned {reason}", _start_of(kind, method))


def running_behaviour(frame: FrameType | None) -> str:
    """Return the user-defined behaviour that a thread runs, and the line, from its newest frame.

    The result is empty if it runs none. The thread may continue meanwhile.
    """
    lines: dict[str, str] = {}
    while frame is not None:
        code = frame.f_code
        if code in _CALLERS:
            kind, call = (frame.f_locals.get(name) for name in ("kind", "call"))
            if isinstance(kind, type) and isinstance(call, BehaviourCall) and _is_user_class(kind):
                where = lines.get(_file_of(kind) or "", "")
                return _title(kind, call) + (f" ({where})" if where else "")
        lines.setdefault(code.co_filename, f"{code.co_filename}, line {frame.f_lineno}")
        frame = frame.f_back
    return ""


@lru_cache
def _is_user_class(kind: type) -> bool:
    """Return whether a class is user-defined."""
    return kind.__module__.partition(".")[0] != _PACKAGE


@lru_cache
def _states_bounds(kind: type) -> bool:
    return hasattr(kind, "reward_bounds") and not _is_user_class(kind)


def _faults_of(intent: object) -> Iterator[str]:
    """Yield what is wrong with a returned intent."""
    if not isinstance(intent, Intent):
        what = "None" if intent is None else f"{shown(intent)} ({type(intent).__name__})"
        yield f"{what}, which is no Intent"
        return
    for name, point_m in (("goal_m", intent.goal_m), ("face_m", intent.face_m)):
        if not (point_m is None or _is_point(point_m)):
            yield f"the {name} {shown(point_m)}: a tuple of two finite numbers of metres is needed"
    comfort_m = 0.0 if intent.robot_comfort_m is None else intent.robot_comfort_m
    for name, number in (
        ("speed_mps", intent.speed_mps),
        ("arrive_within_m", intent.arrive_within_m),
        ("robot_comfort_m", comfort_m),
    ):
        if not (is_number(number) and number >= 0.0):
            yield f"the {name} {shown(number)}: a finite number that is not negative is needed"
    is_moving: object = intent.is_moving_goal
    if not isinstance(is_moving, bool | np.bool_):
        yield f"the is_moving_goal {shown(is_moving)}: True or False is needed"
    activity: object = intent.activity
    if not isinstance(activity, str):
        yield f"the activity {shown(activity)}: a text is needed"
    elif any("\ud800" <= letter <= "\udfff" for letter in activity):
        yield f"the activity {activity!a}: it is no Unicode text, as a message needs"


def _with_plain_goal(intent: Intent) -> Intent:
    """Return an intent whose goal is a plain tuple of floats.

    For whole numbers or named tuples the kernels would be compiled once more, for seconds.
    """
    goal_m = intent.goal_m
    if goal_m is None or (type(goal_m) is tuple and all(type(one) is float for one in goal_m)):
        return intent
    return replace(intent, goal_m=(float(goal_m[0]), float(goal_m[1])))


def _is_point(point_m: object) -> bool:
    if not isinstance(point_m, tuple) or len(point_m) != 2:
        return False
    return all(is_number(one) and abs(one) <= _FARTHEST_M for one in point_m)


def is_number(number: object) -> bool:
    """Return whether an object is a finite number."""
    try:
        return isinstance(number, _NUMBERS) and math.isfinite(number)
    except OverflowError:  # a whole number beyond all floats
        return False


def _raised(kind: type, call: BehaviourCall, cause: BaseException, method: str) -> BehaviourError:
    """Return the error for an exception of user code."""
    return _failure(kind, call, told(cause), _place_in(kind, cause) or _start_of(kind, method))


def told(cause: BaseException) -> str:
    """Return an exception of user code as the name of its class, and the first line that it has."""
    try:
        text = str(cause).strip()
    except Exception:  # noqa: BLE001 - whatever the user's code raises
        text = ""
    return f"{type(cause).__name__}: {text.splitlines()[0]}" if text else type(cause).__name__


def shown(value: object) -> str:
    """Return a value of user code, in one line that is not long."""
    try:
        return " ".join(_SHORT.repr(value).split())
    except Exception:  # noqa: BLE001 - whatever the user's code raises
        return f"a {type(value).__name__}"


def _failure(kind: type, call: BehaviourCall, what: str, place: str) -> BehaviourError:
    where = f" ({place})" if place else ""
    time_s = call.now_ns / NS_PER_S
    return BehaviourError(
        f"{_title(kind, call)} failed at {time_s:.3f} s: {what}{where}", name_of(kind)
    )


def _title(kind: type, call: BehaviourCall) -> str:
    """Return the behaviour or planner and its artefact in words."""
    return f"the {call.role} {name_of(kind)} of artefact {call.artefact_id} ({call.label})"


def name_of(kind: type) -> str:
    """Return what catalogues and the ground truth call a user-defined class: `module:Class`."""
    return f"{kind.__module__}:{kind.__qualname__}"


def _place_in(kind: type, cause: BaseException) -> str:
    """Return the last line of a traceback in the file of a class, else in a file outside are_ros.

    The result is empty if all lines are in are_ros, for example if a method has wrong parameters.
    """
    lines = [(frame.f_code.co_filename, line) for frame, line in walk_tb(cause.__traceback__)]
    foreign = [(file, line) for file, line in lines if not file.startswith(_FOLDER)]
    inside = [(file, line) for file, line in foreign if file == _file_of(kind)]
    for file, line in (inside or foreign)[-1:]:
        return f"{file}, line {line}"
    return ""


def _start_of(kind: type, name: str) -> str:
    """Return the file and line where a method or property begins, empty if not known."""
    found = inspect.getattr_static(kind, name, None)
    found = getattr(found, "fget", None) or getattr(found, "__func__", None) or found
    code = getattr(found, "__code__", None)
    return "" if code is None else f"{code.co_filename}, line {code.co_firstlineno}"


def _file_of(kind: type) -> str | None:
    try:
        return inspect.getsourcefile(kind)
    except TypeError:  # of a class without a file
        return None


_CALLERS: Final = {function.__code__ for function in (new_behaviour, answer_of)}
"""The functions that call user code; each has the locals `kind` and `call`."""
