"""The ground truth of one artefact, as a tick gives it out."""

from are_ros.artefacts.artefact import Artefact
from are_ros.builder.outputs import ArtefactState
from are_ros.builder.scene import Scene
from are_ros.builder.states import StateKeeper


def artefact_state(artefact: Artefact, now_ns: int) -> ArtefactState:
    """Return the state of an artefact at an instant."""
    return StateKeeper().states(Scene.of([artefact], now_ns))[0]
