"""The family of errors: each failure that a user can cause is an `AreError` of one sentence."""

import re
from collections.abc import Collection
from importlib.metadata import PackageNotFoundError, requires
from importlib.util import find_spec
from typing import Final


class AreError(Exception):
    """Base of the family; its text is one sentence that names what, where and why."""


class InputError(AreError):
    """A message or a value from outside is malformed; it names source, field and reason."""


class ParameterError(AreError):
    """A parameter is unknown, of the wrong type or out of range; nothing was changed."""


class CatalogueError(AreError):
    """The catalogue of artefacts, or a mesh that it names, cannot be used."""


class BehaviourError(AreError):
    """A behaviour of the user failed, or returned an impossible intent; `behaviour` names it."""

    def __init__(self, sentence: str, behaviour: str) -> None:
        super().__init__(sentence)
        self.behaviour = behaviour


class ScenarioError(AreError):
    """A scenario, or a track that it names, cannot be used or written."""


class MapError(AreError):
    """A map file (occupancy grid or octomap) is missing or malformed."""


class BagError(AreError):
    """A recording is missing, truncated or lacks what is needed."""


class PlacementError(AreError):
    """An artefact cannot stand where it was asked to; the reason is named."""


class NodeError(AreError):
    """The node cannot run: a message package is missing, or ROS refuses what it needs."""


class InstallationError(AreError):
    """What is compiled at the first start cannot be kept anywhere."""


class FrameError(AreError):
    """A transform cannot be given or taken."""


class UnknownFrameError(FrameError):
    """A frame of this name was never seen."""


class DisconnectedFramesError(FrameError):
    """Both frames exist, but no chain of transforms joins them."""


class ExtrapolationToPastError(FrameError):
    """The stamp asked for lies before the oldest transform that is kept."""


class ExtrapolationToFutureError(FrameError):
    """The stamp asked for lies after the newest transform that was received."""


class InvalidTransformError(FrameError):
    """A transform with non-finite numbers, a non-unit rotation, or equal or empty frame names."""


_MODULES: Final = {"opencv-python-headless": "cv2", "pillow": "PIL", "pyyaml": "yaml"}
"""What some packages are called where they are imported."""
_REQUIREMENT: Final = re.compile(r"([\w-]+)[^;]*(?:; extra == \"(\w+)\")?")


def missing_packages(cause: ModuleNotFoundError, extras: Collection[str] = ()) -> str:
    """Say that a package of others is not installed, and how to install all that are not.

    Those are the packages that are_ros requires, and the `extras` of pyproject.toml. A module of
    our own that cannot be found is no such thing: `cause` is raised again.
    """
    module = (cause.name or "").partition(".")[0]
    if module in {"", __name__.partition(".")[0]}:
        raise cause
    missing = []
    for requirement in _requirements():
        found = _REQUIREMENT.fullmatch(requirement)
        name, extra = found.groups() if found else ("", None)
        is_wanted = extra is None or extra in extras
        if name and is_wanted and find_spec(_MODULES.get(name, name)) is None:
            missing.append(f'"{requirement.partition(";")[0].strip()}"')
    remedy = f": python -m pip install {' '.join(missing)}" if missing else ""
    return f"the Python package {module} is not installed{remedy}"


def _requirements() -> list[str]:
    try:
        return requires("are_ros") or []
    except PackageNotFoundError:  # run from its sources
        return []
