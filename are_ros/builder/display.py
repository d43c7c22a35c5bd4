"""The artefacts drawn: the marker board, fed with what changed."""

from collections.abc import Collection, Sequence

from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.builder.markers import Marker, MarkerBoard, MarkerSubject
from are_ros.builder.mesh_bank import MeshBank
from are_ros.builder.outputs import ArtefactState


class Display:
    """Draws artefacts as meshes, or as their boxes where `meshes` is None."""

    def __init__(self, board: MarkerBoard, meshes: MeshBank | None) -> None:
        self._board = board
        self._meshes = meshes
        self._drawn: dict[int, tuple[ArtefactState, MarkerSubject]] = {}

    def update(
        self,
        now_ns: int,
        states: Sequence[ArtefactState],
        rows: Sequence[CatalogueRow],
        perceived: Collection[int],
    ) -> tuple[Marker, ...]:
        """Return the markers that bring viewers up to date; perceived artefacts are opaque."""
        drawn = {
            state.artefact_id: self._subject(state, row, state.artefact_id in perceived)
            for state, row in zip(states, rows, strict=True)
        }
        self._drawn = drawn
        return tuple(self._board.update(now_ns, [subject for _, subject in drawn.values()]))

    def _subject(
        self, state: ArtefactState, row: CatalogueRow, is_perceived: bool
    ) -> tuple[ArtefactState, MarkerSubject]:
        """Return the subject of a state; that of a state that is the same is kept."""
        known = self._drawn.get(state.artefact_id)
        if known and known[0] is state and known[1].is_perceived == is_perceived:
            return known
        return state, marker_subject(state, row, self._meshes, is_perceived=is_perceived)


def marker_subject(
    state: ArtefactState, row: CatalogueRow, meshes: MeshBank | None, *, is_perceived: bool
) -> MarkerSubject:
    """Return an artefact as the marker board takes it; without meshes, it is drawn as its box."""
    triangles, colours = (None, None) if meshes is None else meshes.drawing(row)
    return MarkerSubject(
        artefact_id=state.artefact_id,
        label=state.label,
        map_from_artefact=state.map_from_artefact,
        box_centre_m=state.box_centre_m,
        size_m=state.size_m,
        colour=row.colour,
        is_perceived=is_perceived,
        mesh_triangles_m=triangles,
        mesh_colours=colours,
    )
