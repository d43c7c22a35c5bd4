"""The ground truth of one artefact, as a tick gives it out."""

from are_ros.agents.events import ArtefactState
from are_ros.builder.scene import Scene
from are_ros.population.artefact import Artefact


def artefact_state(artefact: Artefact, now_ns: int) -> ArtefactState:
    """Return the state of an artefact at an instant."""
    return Scene.of([artefact], now_ns).state(0)
