"""The family of errors: each failure that a user can cause is an `AreError` of one sentence."""


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
