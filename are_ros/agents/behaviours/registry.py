"""Behaviours by name: those of are_ros, and user-defined ones as `module:Class`."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any, Final

from are_ros.agents.behaviours.along_way import AlongWay
from are_ros.agents.behaviours.avoiding import Avoiding
from are_ros.agents.behaviours.calls import NO_CALL, BehaviourCall, new_behaviour, told
from are_ros.agents.behaviours.crossing import Crossing
from are_ros.agents.behaviours.following import Following
from are_ros.agents.behaviours.gathering import Gathering
from are_ros.agents.behaviours.leaving import Leaving
from are_ros.agents.behaviours.situation import Behaviour, Standing
from are_ros.agents.behaviours.walking import Driving, Running, Stopping, Walking, Wandering
from are_ros.errors import CatalogueError

_PLAIN: Final[Mapping[str, type[Behaviour]]] = {
    kind.name: kind
    for kind in (
        Standing,
        Walking,
        Wandering,
        Running,
        Driving,
        Following,
        Stopping,
        Gathering,
        Crossing,
        Avoiding,
        Leaving,
    )
}
"""Behaviours without options."""

_WITH_OPTIONS: Final = {kind.name: kind for kind in (AlongWay, Following)}
"""Behaviours to which a scenario may give options; following does without, too."""

BEHAVIOURS: Final = (*_PLAIN, AlongWay.name)
"""Names of the behaviours (the set B of section 3.2), without user-defined ones."""


def make_behaviour(
    name: str, options: Mapping[str, Any] | None = None, call: BehaviourCall = NO_CALL
) -> Behaviour:
    """Return a new behaviour for one artefact, by a name of `BEHAVIOURS` or as `module:Class`.

    `options` are those that a scenario gives to along_way and following: the arguments of the
    class. Raises CatalogueError if there is no such behaviour, BehaviourError if the constructor of
    a user-defined class raises; `call` names the artefact in the message.
    """
    if options:
        return _WITH_OPTIONS[name](**options)
    behaviour: Behaviour = new_behaviour(_class_named(name), call)
    return behaviour


def why_not(name: str, speed_mps: float = 1.0) -> str | None:
    """Return why an artefact of this speed cannot have this behaviour, None if it can.

    The text continues a sentence that begins with the name: "is not known; ...".
    """
    if name == AlongWay.name:
        return "needs a way, which only a scenario gives (way: [[x, y], ...])"
    if name not in _PLAIN:
        try:
            _class_named(name)
        except CatalogueError as refusal:
            return str(refusal).removeprefix(f"{name} ")
    if speed_mps <= 0.0 and name != Standing.name:
        return "needs an artefact that moves, but motion.speed_mps is 0: only standing is possible"
    return None


def _class_named(name: str) -> type[Behaviour]:
    """Return the class; a CatalogueError begins with the name."""
    if name in _PLAIN:
        return _PLAIN[name]
    return user_class(name, BEHAVIOURS, "decide", "a situation")


def user_class(name: str, known: Sequence[str], method: str, argument: str) -> type[Any]:
    """Return a user-defined class, `module:Class`, whose `method` takes one argument.

    `known` are the names that need no class. Raises CatalogueError, which begins with the name, if
    there is no such class, or it is none that can be constructed and called.
    """
    module_name, colon, class_name = name.partition(":")
    if not colon:
        raise CatalogueError(f"{name} is not known; known are {', '.join(known)}, and module:Class")
    if not module_name or module_name.startswith("."):
        raise CatalogueError(
            f"{name} needs the full name of a module before the colon, as in package.module:Class"
        )
    try:
        found = getattr(import_module(module_name), class_name)
    except (Exception, SystemExit) as cause:  # whatever user code raises
        raise CatalogueError(f"{name} cannot be imported ({told(cause)})") from cause
    _check_class(name, found, method, argument)
    kind: type[Any] = found
    return kind


def _check_class(name: str, found: object, method: str, argument: str) -> None:
    """Raise CatalogueError if an object is no class with a name and this method."""
    if not isinstance(found, type):
        raise CatalogueError(f"{name} is no class")
    if not isinstance(getattr(found, "name", None), str):
        raise CatalogueError(f"{name} has no class attribute name that is a text")
    if not callable(getattr(found, method, None)):
        raise CatalogueError(f"{name} has no method {method}")
    _check_takes(found, (), f"{name} cannot be constructed without arguments")
    function = inspect.getattr_static(found, method)
    if inspect.isfunction(function):
        _check_takes(function, (None, None), f"{name} has a {method} that does not take {argument}")


def _check_takes(function: Callable[..., Any], arguments: tuple[None, ...], refusal: str) -> None:
    """Raise CatalogueError if a function cannot be called with so many arguments."""
    try:
        inspect.signature(function).bind(*arguments)
    except (TypeError, ValueError) as cause:
        raise CatalogueError(f"{refusal} ({cause})") from cause
